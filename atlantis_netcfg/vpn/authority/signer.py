"""Operations with the CA key, under its lock: issue, renew, revoke, publish.

Certificates are created, recorded, delivered, and the delivery is recorded: in that order, and in batches. The planning
of requests is pure; all of them are checked before the first certificate is created.
"""

from __future__ import annotations

import base64
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from cryptography.hazmat.primitives.serialization import Encoding

from atlantis_netcfg.core import errors
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.vpn import identity, names, pki
from atlantis_netcfg.vpn.authority import ledger_session, model
from atlantis_netcfg.vpn.ledger import NEVER_HANDED_OUT, records

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
    from datetime import datetime
    from ipaddress import IPv4Address, IPv4Network

    from atlantis_netcfg.core.secret import Secret


_TWO_ENDS = 30
"""Longest prefix of a network with its own network and broadcast addresses (RFC 3021)."""


class AddressPool:
    """Tunnel addresses of the members during assignment, in memory. A member keeps its address.

    Addresses never used come first. The address of a revoked member is reused only if nothing else is left, the one
    unused for the longest time first, and never before the server has confirmed that the member is disconnected.
    """

    def __init__(self, membership: identity.MembershipList, reserved_addresses: Collection[IPv4Address] = ()) -> None:
        queued_names = set(membership.queued_names)
        self._used: dict[IPv4Address, str] = dict.fromkeys(reserved_addresses, "the inventory")
        self._resting: dict[IPv4Address, datetime] = {}
        for member in membership.members.values():
            since = _out_since(member, queued_names)
            if since is None:
                self._used[member.address] = f"`{member.name}`"
            else:
                self._resting[member.address] = max(since, self._resting.get(member.address, since))
        self._fresh: dict[IPv4Network, Iterator[IPv4Address]] = {}

    def free(self, member: identity.Member) -> None:
        """Release the address of a member whose certificate was never delivered: it may get the same, or another."""
        if self._used.get(member.address) == f"`{member.name}`":
            del self._used[member.address]

    def reserve(self, address: IPv4Address, pool: IPv4Network | None, name: str) -> IPv4Address:
        """Assign an address of the inventory. Raises AddressTaken."""
        if pool is not None and not _usable(address, pool):
            raise model.AddressTaken(
                f"{arg(address)} of `{arg(name)}` is not a device address in {arg(pool)}",
                hint=f"use one inside {arg(pool)}",
            )
        if (holder := self._used.get(address)) is not None:
            raise model.AddressTaken(
                f"{arg(address)} of `{arg(name)}` is in use by {arg(holder)}", hint="name another address, or none"
            )
        self._used[address] = f"`{name}`"
        return address

    def assign_next(self, pool: IPv4Network, name: str) -> IPv4Address:
        """Return the next address of a pool. Raises PoolFull."""
        for address in self._fresh.setdefault(pool, iter(pool.hosts())):
            if address not in self._used and address not in self._resting:
                return self.reserve(address, pool, name)
        resting_addresses = [item for item in self._resting if item not in self._used and _usable(item, pool)]
        if not resting_addresses:
            raise model.PoolFull(
                f"no address is left for `{arg(name)}` in {arg(pool)}",
                hint="set a larger pool for the partner, or revoke devices that are no longer used",
            )
        return self.reserve(min(resting_addresses, key=self._resting.__getitem__), pool, name)


def _usable(address: IPv4Address, pool: IPv4Network) -> bool:
    ends = (pool.network_address, pool.broadcast_address) if pool.prefixlen <= _TWO_ENDS else ()
    return address in pool and address not in ends


def _out_since(member: identity.Member, queued_names: set[str]) -> datetime | None:
    """Return when the server confirmed the revocation; None while the address is not free."""
    when = [entry.revoked for entry in member.certificates if entry.revoked is not None]
    current = len(when) < len(member.certificates) or queued_names.intersection(
        certificate.common_name for certificate in member.certificates
    )
    waits = all(item.reason == NEVER_HANDED_OUT for item in member.certificates)
    return None if current or waits else max(when)


_TEXT = 200


@dataclass(frozen=True, slots=True)
class PlannedCertificate:
    """A certificate to be created."""

    member: identity.Member
    """The member as it will be, without its new certificate."""
    common_name: str
    wrap: identity.Wrap
    key: identity.KeyType
    days: int
    request_id: str = ""
    replaces: tuple[str, ...] = ()
    """Common names to be revoked on delivery."""


def plan_issue(
    membership: identity.MembershipList,
    requests: Sequence[model.EnrolmentRequest],
    reserved_addresses: Collection[IPv4Address],
) -> list[PlannedCertificate | identity.Member]:
    """Plan each request, in order; an existing Member if nothing is to be created. Raises UsageError."""
    addresses = AddressPool(membership, reserved_addresses)
    members = [_find_member(membership, request) for request in requests]
    _refuse_repeated([request.name for request in requests])
    # Declared addresses first: none of the others may get one of them.
    for member in members:
        if member is not None and not member.good:
            addresses.free(member)
    address_by_name = {
        request.name: addresses.reserve(address, request.pool, request.name)
        for request, member in zip(requests, members, strict=True)
        if (address := _fixed_address(request, member)) is not None
    }
    return [
        member
        if member is not None and member.good
        else _plan_certificate(new_request, member, address_by_name, addresses)
        for new_request, member in zip(requests, members, strict=True)
    ]


def plan_renewal(member: identity.Member, change: model.RenewalRequest) -> PlannedCertificate:
    """Plan the successor of a member's certificate. Raises UsageError."""
    if not member.good:
        raise errors.UsageError(
            f"`{arg(member.name)}` was revoked: it cannot get a new certificate",
            hint="add the device under another name",
        )
    newest = member.good[-1]
    in_use = next(
        (item for item in reversed(member.good) if item.standing is identity.CertificateStatus.SEEN), member.good[0]
    )
    return PlannedCertificate(
        member=replace(
            member,
            link=change.link or member.link,
            system=change.system or member.system,
            distribution=change.distribution or member.distribution,
        ),
        common_name=_next_name(member),
        wrap=newest.wrap if change.wrap is None else change.wrap,
        key=newest.key if change.key is None else change.key,
        days=model.CLIENT_DAYS if change.days is None else change.days,
        request_id=printable_text(change.request_id, "the request's number"),
        replaces=tuple(certificate.common_name for certificate in member.good if certificate is not in_use),
    )


def known_member(membership: identity.MembershipList, name: str) -> identity.Member:
    """Return the member with that name. Raises NoSuchMember."""
    if (member := membership.members.get(name)) is not None:
        return member
    near = errors.nearest(name, membership.members)
    raise model.NoSuchMember(
        f"the record has no member `{arg(ascii(name)[1:-1][:60])}`",
        hint=f"did you mean `{arg(near)}`?" if near else "`provision vpn list` shows them all",
    )


def _find_member(membership: identity.MembershipList, request: model.EnrolmentRequest) -> identity.Member | None:
    """Return the existing member for a request, if there is one."""
    _check_request_name(request)
    member = names.check_free(request.name, request.partner, request.device, membership)
    if member is None:
        return None
    if member.good:
        _same(request, member)
    elif any(certificate.reason != NEVER_HANDED_OUT for certificate in member.certificates):
        raise names.NameTaken(
            f"`{arg(member.name)}` was revoked: {arg(member.certificates[-1].reason)}. Names cannot be used again",
            hint=f"for example device={arg(request.device)}-2",
        )
    return member


def _check_request_name(request: model.EnrolmentRequest) -> None:
    if request.partner is None:
        names.check_name(request.name, "host")
        right = request.device
    else:
        right = names.member_name(request.partner, request.device)
    if request.name != right:
        raise names.InvalidNameError(
            f"`{arg(ascii(request.name)[1:-1][:60])}` is not the name `{arg(right)}`", hint="PARTNER-DEVICE"
        )
    if request.vehicle is not None:
        printable_text(request.vehicle, "the vehicle")
    printable_text(request.request_id, "the request's number")
    if request.address is None and request.pool is None:
        raise errors.UsageError(
            f"`{arg(request.name)}` has neither an address nor a pool to take one from", hint="set its pool"
        )


def _same(request: model.EnrolmentRequest, member: identity.Member) -> None:
    """Refuse a request that differs from the existing member: a repeat changes nothing."""
    newest = member.good[-1]
    pairs = (
        ("kind", member.kind, request.kind),
        ("link", member.link, request.link),
        ("vehicle", member.vehicle or "none", request.vehicle or "none"),
        ("system", member.system or "none", request.system or member.system or "none"),
        ("distribution", member.distribution or "none", request.distribution or member.distribution or "none"),
        ("address", member.address, member.address if request.address is None else request.address),
        ("wrap", newest.wrap, request.wrap),
        ("key", newest.key, request.key),
    )
    other = [
        msg(f"{arg(word)} is {arg(has)}, not {arg(new_value)}") for word, has, new_value in pairs if has != new_value
    ]
    if request.pool is not None and member.address not in request.pool:
        other.append(msg(f"its address {arg(member.address)} is outside {arg(request.pool)}"))
    if other:
        raise model.OtherMember(
            f"`{arg(member.name)}` is already in the VPN, with other settings: {arg(join('; ', other))}",
            hint=(
                f"`provision vpn renew name={arg(member.name)}` changes link, wrap, key and system; otherwise use "
                "another name"
            ),
        )


def _fixed_address(request: model.EnrolmentRequest, member: identity.Member | None) -> IPv4Address | None:
    """Return the predetermined address: from the inventory, or that of a member never delivered."""
    if member is None:
        return request.address
    if member.good:
        return None
    keeps = request.pool is None or member.address in request.pool
    return request.address if request.address is not None or not keeps else member.address


def _plan_certificate(
    request: model.EnrolmentRequest,
    member: identity.Member | None,
    address_by_name: dict[str, IPv4Address],
    addresses: AddressPool,
) -> PlannedCertificate:
    address = address_by_name.get(request.name)
    if address is None:
        assert request.pool is not None  # noqa: S101 - _check has refused it
        address = addresses.assign_next(request.pool, request.name)
    certificates = () if member is None else member.certificates
    new_member = identity.Member(
        request.name,
        request.kind,
        request.partner,
        request.device,
        address,
        request.link,
        request.vehicle,
        certificates,
        request.system,
        request.distribution,
    )
    return PlannedCertificate(
        new_member, _next_name(new_member), request.wrap, request.key, request.days, request.request_id
    )


def _next_name(member: identity.Member) -> str:
    """Return the next common name; none is used twice, even if its certificate was never delivered."""
    used: tuple[identity.Certificate, ...] = member.certificates
    return member.name if not used else f"{member.name}.{len(used) + 1}"


def _refuse_repeated(request_names: list[str]) -> None:
    counts = Counter(request_names)
    if twice := next((name for name, count in counts.items() if count > 1), None):
        raise errors.UsageError(f"`{arg(twice)}` is here twice", hint="remove one of them")


def printable_text(message: str, what: str) -> str:
    """Check that a user's text is printable, short and on one line. Raises UsageError."""
    if not message.isprintable() or len(message) > _TEXT:
        raise errors.UsageError(
            f"{arg(what)} must be a short text on one line: {arg(ascii(message)[:_TEXT])}", hint="write a word or two"
        )
    return message


BATCH = 100
"""Certificates per batch: two disk syncs each. No more than these must be recreated after a killed command."""
REPLACED_REASON = "replaced before it was seen in use"


@dataclass(frozen=True, slots=True)
class _MadeCertificate:
    """A certificate known only to this process."""

    plan: PlannedCertificate
    record: records.IssueRecord
    key: Secret


def hand_out(
    session: ledger_session.SigningSession,
    command: records.Command,
    plans: Sequence[PlannedCertificate],
    deliver: Callable[[identity.Identity], model.EnrolmentFile],
) -> None:
    """Create and deliver these certificates; each is in the ledger on disk before `deliver` is called.

    If anything fails, delivered certificates stay valid, the rest is withdrawn, and the error is raised again.
    """
    operation = ledger_session.new_operation()
    try:
        session.ledger.write([records.BeginRecord(command=command, names=_names(plans))], operation)
        for start in range(0, len(plans), BATCH):
            _issue_batch(session, operation, plans[start : start + BATCH], deliver)
        # Also without a revocation: by the number of its list a server knows a record that is older than this one.
        session.publish(operation)
        session.ledger.write([records.CommitRecord()], operation)
    except Exception:
        # Best effort, while the disk is as it is: the next command looks again.
        if session.ledger.usable:
            with suppress(errors.NetcfgError, OSError):
                session.recover(was_killed=False)
        raise


def _names(plans: Sequence[PlannedCertificate]) -> tuple[str, ...]:
    return tuple(item.member.name for item in plans)


def _issue_batch(
    session: ledger_session.SigningSession,
    operation: str,
    plans: Sequence[PlannedCertificate],
    deliver: Callable[[identity.Identity], model.EnrolmentFile],
) -> None:
    certificates = [_make_certificate(session, item) for item in plans]
    session.ledger.write([entry.record for entry in certificates], operation)
    new_records: list[records.Record] = []
    try:
        with model.os_errors_as("the certificates cannot be written"):
            model.restore_copies(session.folder, [item.record for item in certificates])
        for item in certificates:
            with model.os_errors_as(msg(f"the enrolment package of `{arg(item.plan.member.name)}` cannot be written")):
                file = deliver(_identity(session, item))
            new_records.extend(_delivery_records(item.plan, file))
    finally:
        if new_records:
            session.ledger.write(new_records, operation)


def _delivery_records(plan: PlannedCertificate, file: model.EnrolmentFile) -> Iterator[records.Record]:
    yield records.DeliveryRecord(common_name=plan.common_name, path=file.path, sha256=file.sha256)
    for old in plan.replaces:
        yield records.RevocationRecord(common_name=old, reason=REPLACED_REASON)


def _make_certificate(session: ledger_session.SigningSession, plan: PlannedCertificate) -> _MadeCertificate:
    key = pki.new_key(plan.key)
    certificate = pki.new_client(
        session.ca, key.public_key(), plan.common_name, pki.new_serial(), plan.days, session.ledger.now()
    )
    member = plan.member
    record = records.IssueRecord(
        name=member.name,
        device_kind=member.kind,
        partner=member.partner,
        device=member.device,
        address=member.address,
        link=member.link,
        vehicle=member.vehicle,
        system=member.system,
        distribution=member.distribution,
        common_name=plan.common_name,
        serial=certificate.serial_number,
        sha256=pki.sha256(certificate),
        not_before=certificate.not_valid_before_utc,
        not_after=certificate.not_valid_after_utc,
        wrap=plan.wrap,
        key=plan.key,
        request_id=plan.request_id,
        der=base64.b64encode(certificate.public_bytes(Encoding.DER)).decode("ascii"),
    )
    return _MadeCertificate(plan, record, pki.key_pem(key))


def _identity(session: ledger_session.SigningSession, new_certificate: _MadeCertificate) -> identity.Identity:
    record = new_certificate.record
    certificate = identity.Certificate(
        common_name=record.common_name,
        serial=record.serial,
        sha256=record.sha256,
        not_before=record.not_before,
        not_after=record.not_after,
        wrap=record.wrap,
        key=record.key,
        standing=identity.CertificateStatus.ISSUED,
    )
    before = new_certificate.plan.member
    return identity.Identity(
        member=replace(before, certificates=(*before.certificates, certificate)),
        certificate=certificate,
        ca=session.ca_pem,
        cert=model.copy_of(record).decode("ascii"),
        key=new_certificate.key,
        wrap_key=session.wrap_key(record.wrap, record.common_name),
    )


SUPERSEDED_REASON = "superseded"
LOST_COPY_REASON = "revoked by the server's revocation list, signed by a lost copy of the authority"


class Signer:
    """Created by `Authority.unlock()`; valid only inside that block."""

    def __init__(self, session: ledger_session.SigningSession) -> None:
        self._session = session

    @property
    def membership(self) -> identity.MembershipList:
        """The members, including the changes of this signer."""
        return self._session.ledger.state.membership()

    def issue(
        self,
        requests: Sequence[model.EnrolmentRequest],
        deliver: Callable[[identity.Identity], model.EnrolmentFile],
        *,
        reserved_addresses: Collection[IPv4Address] = (),
    ) -> tuple[model.IssueResult, ...]:
        """Create members, all checked before the first is created; results are in the order of the requests.

        `deliver` is called after the certificate is recorded, and writes the file atomically, 0600.
        `reserved_addresses` are not assigned: the server's own, and those of hosts in the inventory. UsageError for a
        name that is refused or taken, for a member of this name that differs from the request, for an address in use.
        """
        plan_items = plan_issue(self.membership, requests, reserved_addresses)
        new = [entry for entry in plan_items if isinstance(entry, PlannedCertificate)]
        if new:
            hand_out(self._session, "issue", new, deliver)
        names = {item.member.name for item in new}
        return tuple(self._issue_result(request.name, already=request.name not in names) for request in requests)

    def renew(
        self,
        name: str,
        deliver: Callable[[identity.Identity], model.EnrolmentFile],
        change: model.RenewalRequest | None = None,
    ) -> model.IssueResult:
        """Issue a successor `NAME.2`, `NAME.3` …; the current certificate works until the new one is seen.

        Successors that were delivered before and never seen are revoked (`IssueRecord.replaced`).
        """
        plan = plan_renewal(known_member(self.membership, name), change or model.RenewalRequest())
        hand_out(self._session, "renew", [plan], deliver)
        return self._issue_result(name, replaced_names=plan.replaces)

    def revoke(self, names: Sequence[str], reason: str) -> model.RevocationResult:
        """Revoke every certificate of these members, and publish the list. Their names are never reused.

        For members already revoked, nothing new is recorded, and the result is the same.
        """
        membership = self.membership
        members = [known_member(membership, name) for name in dict.fromkeys(names)]
        if not members:
            raise errors.UsageError("no member to revoke was given", hint="`provision vpn list` lists them all")
        why = printable_text(reason, "the reason") or "no reason was given"
        certificate_groups = [_revocable(member) for member in members]
        if any(certificate_groups):
            crl = self._revoke(
                [member.name for member in members],
                [certificate for some in certificate_groups for certificate in some],
                why,
            )
        else:
            with model.os_errors_as("the revocation list cannot be read"):
                crl = (self._session.folder / model.CRL).read_bytes()
        handed_out = self._session.ledger.state.delivered
        every = (entry.common_name for member in members for entry in member.certificates)
        return model.RevocationResult(
            common_names=tuple(item for item in every if item in handed_out),
            members=tuple(member.name for member in members),
            crl=crl,
            already=tuple(member.name for member, some in zip(members, certificate_groups, strict=True) if not some),
        )

    def publish(self) -> bytes:
        """Sign a new list that also contains superseded certificates; PEM."""
        old = [
            certificate
            for _, certificate in self.membership.certificates()
            if certificate.standing is identity.CertificateStatus.SUPERSEDED
        ]
        operation = ledger_session.new_operation()
        begin_record = records.BeginRecord(command="publish")
        self._session.ledger.write([begin_record, *_revocations(old, SUPERSEDED_REASON)], operation)
        return self._publish_list(operation)

    def take(self, pem: bytes) -> tuple[str, ...]:
        """Take over a server's list, made by a lost copy of this authority, and sign the next one.

        Return the common names revoked by that; serials that the record has never issued stay on the list. Raises
        InvalidCrlError for a list of another CA.
        """
        facts = pki.read_crl(pem, self._session.ca.certificate)
        ours = [entry for _, entry in self.membership.certificates() if entry.serial in facts.serials]
        revoked_certificates = [item for item in ours if item.standing is not identity.CertificateStatus.REVOKED]
        strange = facts.serials - {our.serial for our in ours} - self._session.ledger.state.taken.keys()
        takeover_records = [records.TakeoverRecord(serials=tuple(sorted(strange)))] if strange else []
        operation = ledger_session.new_operation()
        begin_record = records.BeginRecord(command="publish")
        self._session.ledger.write(
            [begin_record, *takeover_records, *_revocations(revoked_certificates, LOST_COPY_REASON)], operation
        )
        self._publish_list(operation, facts)
        return tuple(certificate.common_name for certificate in revoked_certificates)

    def serve(self, names: model.ServerNames) -> bool:
        """Issue a new server certificate if the current one is for other names, or expires within 90 days.

        Return True if there is a new one, which the server's computer needs. Members are not affected.
        """
        if not ledger_session.needs_another(self._session.ledger.state.server, names, self._session.ledger.now()):
            return False
        self._session.serve(names)
        return True

    def _revoke(self, names: Sequence[str], certificates: Iterable[identity.Certificate], why: str) -> bytes:
        operation = ledger_session.new_operation()
        begin_record = records.BeginRecord(command="revoke", names=tuple(names))
        self._session.ledger.write([begin_record, *_revocations(certificates, why)], operation)
        return self._publish_list(operation)

    def _publish_list(self, operation: str, also: pki.CrlFacts | None = None) -> bytes:
        pem = self._session.publish(operation, also)
        self._session.ledger.write([records.CommitRecord()], operation)
        return pem

    def _issue_result(
        self, name: str, *, already: bool = False, replaced_names: tuple[str, ...] = ()
    ) -> model.IssueResult:
        state = self._session.ledger.state
        member = state.member(name)
        newest = member.good[-1]
        last = state.delivered[newest.common_name]
        return model.IssueResult(member, newest, model.EnrolmentFile(last.path, last.sha256), already, replaced_names)


def _revocable(member: identity.Member) -> list[identity.Certificate]:
    """Return certificates to revoke; of a member never delivered, all of them once, to retire its name."""
    good = [item for item in member.certificates if item.standing is not identity.CertificateStatus.REVOKED]
    waits = not good and all(certificate.reason == NEVER_HANDED_OUT for certificate in member.certificates)
    return list(member.certificates) if waits else good


def _revocations(certificates: Iterable[identity.Certificate], why: str) -> list[records.Record]:
    return [records.RevocationRecord(common_name=certificate.common_name, reason=why) for certificate in certificates]
