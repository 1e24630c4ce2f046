"""The state that results from the ledger's entries, applied one after the other."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.vpn import identity
from atlantis_netcfg.vpn.ledger.file import CorruptLedgerError, LedgerEntry

if TYPE_CHECKING:
    from collections.abc import Iterable

    from atlantis_netcfg.vpn.ledger import records

NEVER_HANDED_OUT = "never handed out"
"""Reason for a certificate whose file has no recorded delivery: it counts as revoked from the start."""


def membership(entries: Iterable[LedgerEntry]) -> identity.MembershipList:
    """Return the members after these entries."""
    return LedgerState(entries).membership()


@dataclass
class _AddressHolder:
    """A member while the entries are read."""

    member: identity.Member
    certificates: dict[str, identity.Certificate] = field(default_factory=dict)
    """Certificates by common name, oldest first."""


class LedgerState:
    """The state after a number of entries; more can be applied. Each kind of record has its method."""

    def __init__(self, entries: Iterable[LedgerEntry] = ()) -> None:
        self.founded: records.FoundingRecord | None = None
        self.server: records.ServerIssueRecord | None = None
        self.published: records.PublicationRecord | None = None
        self.delivered: dict[str, records.DeliveryRecord] = {}
        """The last delivery of each common name."""
        self.issued: dict[str, records.IssueRecord] = {}
        self.open: dict[str, records.BeginRecord] = {}
        """Unfinished commands, by operation."""
        self.pending: dict[str, str] = {}
        """Common names that were recorded and not delivered, with the operation of each."""
        self.done: dict[str, set[str]] = {}
        """Common names delivered or revoked by unfinished commands, by operation."""
        self.taken: dict[int, datetime] = {}
        """Serials of a lost copy of the authority, which stay on the list, with the time of their adoption."""
        self.last: datetime | None = None
        """Time of the last entry; None: no entries."""
        self._holders: dict[str, _AddressHolder] = {}
        self._queued: dict[str, None] = {}
        for entry in entries:
            self.apply(entry)

    def apply(self, entry: LedgerEntry) -> None:
        """Apply one entry. Raises CorruptLedgerError if it refers to something that no earlier entry created."""
        self.last = entry.at
        step = getattr(self, f"_{entry.record.kind.replace('-', '_')}")
        try:
            step(entry, entry.record)
        except KeyError as unknown:
            raise CorruptLedgerError(
                f"line {arg(entry.number)} of the ledger refers to {arg(unknown)}, which was never issued",
                hint="sign nothing; restore the ledger from your backup of the authority",
            ) from None

    def membership(self) -> identity.MembershipList:
        """Return the current members as an immutable value."""
        crl_record = self.published
        return identity.MembershipList(
            members=MappingProxyType({name: self.member(name) for name in self._holders}),
            crl_number=crl_record.number if crl_record else 0,
            crl_sha256=crl_record.sha256 if crl_record else "",
            crl_next_update=crl_record.next_update if crl_record else datetime.min.replace(tzinfo=UTC),
            queued_names=tuple(self._queued),
        )

    def member(self, name: str) -> identity.Member:
        """One member with its certificates."""
        holder = self._holders[name]
        return replace(holder.member, certificates=tuple(holder.certificates.values()))

    def _founded(self, _: LedgerEntry, record: records.FoundingRecord) -> None:
        self.founded = record

    def _server_issued(self, _: LedgerEntry, record: records.ServerIssueRecord) -> None:
        self.server = record

    def _begun(self, entry: LedgerEntry, record: records.BeginRecord) -> None:
        self.open[entry.operation] = record
        self.done[entry.operation] = set()

    def _committed(self, entry: LedgerEntry, _: records.CommitRecord) -> None:
        self._close(entry.operation)

    def _rolled_back(self, entry: LedgerEntry, record: records.RolledBack) -> None:
        self._close(entry.operation)
        for common_name in record.common_names:
            self.pending.pop(common_name, None)

    def _issued(self, entry: LedgerEntry, record: records.IssueRecord) -> None:
        self.issued[record.common_name] = record
        self.pending[record.common_name] = entry.operation
        holder = self._holders.get(record.name)
        if holder is None:
            holder = self._holders[record.name] = _AddressHolder(_member(record))
        elif not any(item in self.delivered for item in holder.certificates):
            holder.member = _member(record)
        certificate = identity.Certificate(
            common_name=record.common_name,
            serial=record.serial,
            sha256=record.sha256,
            not_before=record.not_before,
            not_after=record.not_after,
            wrap=record.wrap,
            key=record.key,
            standing=identity.CertificateStatus.REVOKED,
            revoked=entry.at,
            reason=NEVER_HANDED_OUT,
        )
        holder.certificates[record.common_name] = certificate

    def _delivered(self, entry: LedgerEntry, record: records.DeliveryRecord) -> None:
        self.delivered[record.common_name] = record
        self._mark_done(entry, record.common_name)
        if self.pending.pop(record.common_name, None) is not None:
            self._holder(record.common_name).member = _member(self.issued[record.common_name])
            self._update_certificate(
                record.common_name, standing=identity.CertificateStatus.ISSUED, revoked=None, reason=""
            )

    def _revoked(self, entry: LedgerEntry, record: records.RevocationRecord) -> None:
        self._update_certificate(
            record.common_name, standing=identity.CertificateStatus.REVOKED, revoked=entry.at, reason=record.reason
        )
        self._mark_done(entry, record.common_name)
        self.pending.pop(record.common_name, None)
        if record.common_name in self.delivered:
            self._queued[record.common_name] = None

    def _seen(self, _: LedgerEntry, record: records.SightingRecord) -> None:
        if self._good(record.common_name):
            self._update_certificate(record.common_name, standing=identity.CertificateStatus.SEEN, seen=record.last)

    def _superseded(self, entry: LedgerEntry, record: records.SupersedeRecord) -> None:
        if self._good(record.common_name):
            reason = msg(f"{arg(record.by)} is in use")
            self._update_certificate(
                record.common_name, standing=identity.CertificateStatus.SUPERSEDED, revoked=entry.at, reason=reason
            )

    def _settled(self, _: LedgerEntry, record: records.SettlementRecord) -> None:
        self._queued.pop(record.common_name, None)

    def _published(self, _: LedgerEntry, record: records.PublicationRecord) -> None:
        self.published = record

    def _taken(self, entry: LedgerEntry, record: records.TakeoverRecord) -> None:
        self.taken.update(dict.fromkeys(record.serials, entry.at))

    def _clock_trusted(self, _: LedgerEntry, record: records.ClockTrustRecord) -> None:
        """Do nothing: only relevant for an audit."""

    def _good(self, common_name: str) -> bool:
        """Return True if the certificate is good; a revoked one never becomes good again."""
        return self._holder(common_name).certificates[common_name].good

    def _close(self, operation: str) -> None:
        self.open.pop(operation, None)
        self.done.pop(operation, None)

    def _mark_done(self, entry: LedgerEntry, common_name: str) -> None:
        if entry.operation in self.done:
            self.done[entry.operation].add(self.issued[common_name].name)

    def _holder(self, common_name: str) -> _AddressHolder:
        return self._holders[self.issued[common_name].name]

    def _update_certificate(self, common_name: str, **changes: Any) -> None:  # noqa: ANN401 - fields of Certificate
        certificates = self._holder(common_name).certificates
        certificates[common_name] = replace(certificates[common_name], **changes)


def _member(record: records.IssueRecord) -> identity.Member:
    return identity.Member(
        name=record.name,
        kind=record.device_kind,
        partner=record.partner,
        device=record.device,
        address=record.address,
        link=record.link,
        vehicle=record.vehicle,
        certificates=(),
        system=record.system,
        distribution=record.distribution,
    )
