"""What is done with the CA key while its lock is held: issue, renew, revoke, publish.

Certificates are made, recorded, handed out, and recorded again: in that order, and in batches.
"""

from __future__ import annotations

import base64
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from cryptography.hazmat.primitives.serialization import Encoding

from atlantis_netcfg.core.errors import NetcfgError, UsageError
from atlantis_netcfg.vpn import pki
from atlantis_netcfg.vpn.authority import files
from atlantis_netcfg.vpn.authority.files import CRL
from atlantis_netcfg.vpn.authority.ledger_session import new_operation
from atlantis_netcfg.vpn.authority.model import (
    EnrolmentRequest,
    HandoutFile,
    IssueResult,
    RenewalRequest,
    RevocationResult,
    ServerNames,
    os_errors_as,
)
from atlantis_netcfg.vpn.authority.plan import Planned, known_member, plan_issue, plan_renewal, printable_text
from atlantis_netcfg.vpn.authority.signing_session import needs_another
from atlantis_netcfg.vpn.identity import Certificate, CertificateStatus, Identity, Member
from atlantis_netcfg.vpn.ledger import NEVER_HANDED_OUT, records

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
    from ipaddress import IPv4Address

    from atlantis_netcfg.core.secret import Secret
    from atlantis_netcfg.vpn.authority.signing_session import SigningSession
    from atlantis_netcfg.vpn.identity import MembershipList


BATCH = 100
"""Two waits for the disk for so many; and no more than these are made anew when a command is killed."""
REPLACED = "replaced before it was seen in use"


@dataclass(frozen=True, slots=True)
class _Made:
    """A certificate that nobody but this process has."""

    planned: Planned
    record: records.Issued
    key: Secret


def hand_out(
    session: SigningSession,
    command: records.Command,
    planned: Sequence[Planned],
    deliver: Callable[[Identity], HandoutFile],
) -> None:
    """Make these certificates and hand them out; each is on disk in the ledger before `deliver` sees it.

    If anything fails, what was handed out stands, the rest is withdrawn, and the error goes on.
    """
    operation = new_operation()
    try:
        session.ledger.write([records.Begun(command=command, names=_names(planned))], operation)
        for start in range(0, len(planned), BATCH):
            _batch(session, operation, planned[start : start + BATCH], deliver)
        # Also without a revocation: by the number of its list a server knows a record that is older than this one.
        session.publish(operation)
        session.ledger.write([records.Committed()], operation)
    except Exception:
        # Best effort, while the disk is as it is: the next command looks again.
        if session.ledger.usable:
            with suppress(NetcfgError, OSError):
                session.recover(left=False)
        raise


def _names(planned: Sequence[Planned]) -> tuple[str, ...]:
    return tuple(item.member.name for item in planned)


def _batch(
    session: SigningSession, operation: str, planned: Sequence[Planned], deliver: Callable[[Identity], HandoutFile]
) -> None:
    made = [_made(session, item) for item in planned]
    session.ledger.write([entry.record for entry in made], operation)
    done: list[records.Record] = []
    try:
        with os_errors_as("the certificates cannot be written"):
            files.restore_copies(session.folder, [item.record for item in made])
        for item in made:
            with os_errors_as(f"what `{item.planned.member.name}` gets cannot be written"):
                delivered = deliver(_identity(session, item))
            done.extend(_handed_out(item.planned, delivered))
    finally:
        if done:
            session.ledger.write(done, operation)


def _handed_out(planned: Planned, delivered: HandoutFile) -> Iterator[records.Record]:
    yield records.Delivered(common_name=planned.common_name, path=delivered.path, sha256=delivered.sha256)
    for old in planned.replaces:
        yield records.Revoked(common_name=old, reason=REPLACED)


def _made(session: SigningSession, planned: Planned) -> _Made:
    key = pki.new_key(planned.key)
    certificate = pki.new_client(
        session.ca, key.public_key(), planned.common_name, pki.new_serial(), planned.days, session.ledger.now()
    )
    member = planned.member
    record = records.Issued(
        name=member.name,
        device_kind=member.kind,
        partner=member.partner,
        device=member.device,
        address=member.address,
        link=member.link,
        vehicle=member.vehicle,
        common_name=planned.common_name,
        serial=certificate.serial_number,
        sha256=pki.sha256(certificate),
        not_before=certificate.not_valid_before_utc,
        not_after=certificate.not_valid_after_utc,
        wrap=planned.wrap,
        key=planned.key,
        request_id=planned.request_id,
        der=base64.b64encode(certificate.public_bytes(Encoding.DER)).decode("ascii"),
    )
    return _Made(planned, record, pki.key_pem(key))


def _identity(session: SigningSession, made: _Made) -> Identity:
    record = made.record
    certificate = Certificate(
        common_name=record.common_name,
        serial=record.serial,
        sha256=record.sha256,
        not_before=record.not_before,
        not_after=record.not_after,
        wrap=record.wrap,
        key=record.key,
        standing=CertificateStatus.ISSUED,
    )
    before = made.planned.member
    return Identity(
        member=replace(before, certificates=(*before.certificates, certificate)),
        certificate=certificate,
        ca=session.ca_pem,
        cert=files.copy_of(record).decode("ascii"),
        key=made.key,
        wrap_key=session.wrap_key(record.wrap, record.common_name),
    )


SUPERSEDED = "superseded"
TAKEN = "revoked by the server's list, which a copy of the authority has signed that is lost"


class Signer:
    """Comes from `Authority.unlocked()`; valid inside that block only."""

    def __init__(self, session: SigningSession) -> None:
        self._session = session

    @property
    def membership(self) -> MembershipList:
        """The members after what this signer has done."""
        return self._session.ledger.state.membership()

    def issue(
        self,
        requests: Sequence[EnrolmentRequest],
        deliver: Callable[[Identity], HandoutFile],
        *,
        reserved: Collection[IPv4Address] = (),
    ) -> tuple[IssueResult, ...]:
        """Make members, all checked before the first is made; results are in the order of the requests.

        `deliver` is called when the certificate is recorded, and writes the file atomically, 0600. `reserved` are
        addresses that are not given away: the server's own, and those of declared hosts. UsageError for a name that is
        refused or taken, for a member of this name that differs from the request, for an address in use.
        """
        planned = plan_issue(self.membership, requests, reserved)
        new = [entry for entry in planned if isinstance(entry, Planned)]
        if new:
            hand_out(self._session, "issue", new, deliver)
        names = {item.member.name for item in new}
        return tuple(self._issued(request.name, already=request.name not in names) for request in requests)

    def renew(
        self, name: str, deliver: Callable[[Identity], HandoutFile], change: RenewalRequest | None = None
    ) -> IssueResult:
        """Give a member a successor `NAME.2`, `NAME.3` …; the certificate in use works until the new one was seen.

        Successors that were handed out before and never seen are revoked (`Issued.replaced`).
        """
        planned = plan_renewal(known_member(self.membership, name), change or RenewalRequest())
        hand_out(self._session, "renew", [planned], deliver)
        return self._issued(name, replaced=planned.replaces)

    def revoke(self, names: Sequence[str], reason: str) -> RevocationResult:
        """Revoke every certificate of these members, and publish the list. The names never return.

        Once more for members that are revoked: nothing new is recorded, the answer is the same.
        """
        membership = self.membership
        members = [known_member(membership, name) for name in dict.fromkeys(names)]
        if not members:
            raise UsageError(
                "nobody was named whose certificates are to be revoked", hint="`provision vpn list` lists them all"
            )
        why = printable_text(reason, "the reason") or "no reason was given"
        lost = [_revocable(member) for member in members]
        if any(lost):
            crl = self._revoke(
                [member.name for member in members], [certificate for some in lost for certificate in some], why
            )
        else:
            with os_errors_as("the revocation list cannot be read"):
                crl = (self._session.folder / CRL).read_bytes()
        handed_out = self._session.ledger.state.delivered
        every = (entry.common_name for member in members for entry in member.certificates)
        return RevocationResult(
            common_names=tuple(item for item in every if item in handed_out),
            members=tuple(member.name for member in members),
            crl=crl,
            already=tuple(member.name for member, some in zip(members, lost, strict=True) if not some),
        )

    def publish(self) -> bytes:
        """Sign the list anew, superseded certificates on it as well; PEM."""
        old = [
            certificate
            for _, certificate in self.membership.certificates()
            if certificate.standing is CertificateStatus.SUPERSEDED
        ]
        operation = new_operation()
        begun = records.Begun(command="publish")
        self._session.ledger.write([begun, *_revocations(old, SUPERSEDED)], operation)
        return self._listed(operation)

    def take(self, pem: bytes) -> tuple[str, ...]:
        """Take over the list that a server has, of a copy of this authority that is lost, and sign the next one.

        Gives the common names that are revoked by that; what the record has never issued stays on the list.
        Raises CrlRefused for a list of another CA.
        """
        facts = pki.read_crl(pem, self._session.ca.certificate)
        ours = [entry for _, entry in self.membership.certificates() if entry.serial in facts.serials]
        lost = [item for item in ours if item.standing is not CertificateStatus.REVOKED]
        strange = facts.serials - {our.serial for our in ours} - self._session.ledger.state.taken.keys()
        taken = [records.Taken(serials=tuple(sorted(strange)))] if strange else []
        operation = new_operation()
        begun = records.Begun(command="publish")
        self._session.ledger.write([begun, *taken, *_revocations(lost, TAKEN)], operation)
        self._listed(operation, facts)
        return tuple(certificate.common_name for certificate in lost)

    def serve(self, names: ServerNames) -> bool:
        """Give the server a new certificate, if the one it has is for other names, or ends within 90 days.

        True if there is a new one: the server's computer needs it. Members go on with what they have.
        """
        if not needs_another(self._session.ledger.state.server, names, self._session.ledger.now()):
            return False
        self._session.serve(names)
        return True

    def _revoke(self, names: Sequence[str], certificates: Iterable[Certificate], why: str) -> bytes:
        operation = new_operation()
        begun = records.Begun(command="revoke", names=tuple(names))
        self._session.ledger.write([begun, *_revocations(certificates, why)], operation)
        return self._listed(operation)

    def _listed(self, operation: str, also: pki.CrlFacts | None = None) -> bytes:
        pem = self._session.publish(operation, also)
        self._session.ledger.write([records.Committed()], operation)
        return pem

    def _issued(self, name: str, *, already: bool = False, replaced: tuple[str, ...] = ()) -> IssueResult:
        state = self._session.ledger.state
        member = state.member(name)
        newest = member.good[-1]
        last = state.delivered[newest.common_name]
        return IssueResult(member, newest, HandoutFile(last.path, last.sha256), already, replaced)


def _revocable(member: Member) -> list[Certificate]:
    """What a revocation of the member is about; once for one that was never handed out, so that its name is retired."""
    good = [item for item in member.certificates if item.standing is not CertificateStatus.REVOKED]
    waits = not good and all(certificate.reason == NEVER_HANDED_OUT for certificate in member.certificates)
    return list(member.certificates) if waits else good


def _revocations(certificates: Iterable[Certificate], why: str) -> list[records.Record]:
    return [records.Revoked(common_name=certificate.common_name, reason=why) for certificate in certificates]
