"""What the requests result in: pure. All of them are checked before the first certificate is made."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.suggest import nearest
from atlantis_netcfg.vpn import names
from atlantis_netcfg.vpn.authority.model import CLIENT_DAYS, AddressTaken, NoSuchMember, OtherMember, PoolFull
from atlantis_netcfg.vpn.identity import CertificateStatus, Member
from atlantis_netcfg.vpn.ledger import NEVER_HANDED_OUT

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Sequence
    from datetime import datetime
    from ipaddress import IPv4Address, IPv4Network

    from atlantis_netcfg.vpn.authority.model import EnrolmentRequest, RenewalRequest
    from atlantis_netcfg.vpn.identity import Certificate, KeyType, MembershipList, Wrap


_TWO_ENDS = 30
"""Longest prefix of a network that has an address of its own and one for broadcasts (RFC 3021)."""


class Addresses:
    """The tunnel addresses of the members while new ones are assigned, in memory. A member keeps its address.

    Those that nobody ever had come first. An address of a member that was revoked is given again when nothing else is
    left, the one that rests longest first, and never before the server has confirmed that the member is out.
    """

    def __init__(self, membership: MembershipList, reserved: Collection[IPv4Address] = ()) -> None:
        queued = set(membership.queued)
        self._used: dict[IPv4Address, str] = dict.fromkeys(reserved, "the declaration")
        self._resting: dict[IPv4Address, datetime] = {}
        for member in membership.members.values():
            since = _out_since(member, queued)
            if since is None:
                self._used[member.address] = f"`{member.name}`"
            else:
                self._resting[member.address] = max(since, self._resting.get(member.address, since))
        self._fresh: dict[IPv4Network, Iterator[IPv4Address]] = {}

    def free(self, member: Member) -> None:
        """Let go of the address of a member that was never handed out: it may take the same, or another."""
        if self._used.get(member.address) == f"`{member.name}`":
            del self._used[member.address]

    def take(self, address: IPv4Address, pool: IPv4Network | None, name: str) -> IPv4Address:
        """A declared address. Raises AddressTaken."""
        if pool is not None and not _usable(address, pool):
            raise AddressTaken(
                f"{address} of `{name}` is no device's address of {pool}", hint=f"take one inside {pool}"
            )
        if (holder := self._used.get(address)) is not None:
            raise AddressTaken(f"{address} of `{name}` is in use by {holder}", hint="name another address, or none")
        self._used[address] = f"`{name}`"
        return address

    def give(self, pool: IPv4Network, name: str) -> IPv4Address:
        """The next one of a pool. Raises PoolFull."""
        for address in self._fresh.setdefault(pool, iter(pool.hosts())):
            if address not in self._used and address not in self._resting:
                return self.take(address, pool, name)
        rested = [item for item in self._resting if item not in self._used and _usable(item, pool)]
        if not rested:
            raise PoolFull(
                f"no address is left for `{name}` in {pool}",
                hint="declare a larger pool for the partner, or revoke devices that are no longer used",
            )
        return self.take(min(rested, key=self._resting.__getitem__), pool, name)


def _usable(address: IPv4Address, pool: IPv4Network) -> bool:
    ends = (pool.network_address, pool.broadcast_address) if pool.prefixlen <= _TWO_ENDS else ()
    return address in pool and address not in ends


def _out_since(member: Member, queued: set[str]) -> datetime | None:
    """When the member was out, as the server confirmed; None while its address is not free."""
    when = [entry.revoked for entry in member.certificates if entry.revoked is not None]
    current = len(when) < len(member.certificates) or queued.intersection(
        certificate.common_name for certificate in member.certificates
    )
    waits = all(item.reason == NEVER_HANDED_OUT for item in member.certificates)
    return None if current or waits else max(when)


_TEXT = 200


@dataclass(frozen=True, slots=True)
class Planned:
    """One certificate that shall be made."""

    member: Member
    """As it will be, its new certificate aside."""
    common_name: str
    wrap: Wrap
    key: KeyType
    days: int
    request_id: str = ""
    replaces: tuple[str, ...] = ()
    """Common names to be revoked when it is handed out."""


def plan_issue(
    membership: MembershipList, requests: Sequence[EnrolmentRequest], reserved: Collection[IPv4Address]
) -> list[Planned | Member]:
    """What to make for each request, in their order; a Member where there is nothing to make. Raises UsageError."""
    addresses = Addresses(membership, reserved)
    found = [_found(membership, request) for request in requests]
    _refuse_repeated([request.name for request in requests])
    # Declared addresses first: none of the others may get one of them.
    for member in found:
        if member is not None and not member.good:
            addresses.free(member)
    taken = {
        request.name: addresses.take(address, request.pool, request.name)
        for request, member in zip(requests, found, strict=True)
        if (address := _declared(request, member)) is not None
    }
    return [
        member if member is not None and member.good else _planned(desired, member, taken, addresses)
        for desired, member in zip(requests, found, strict=True)
    ]


def plan_renewal(member: Member, change: RenewalRequest) -> Planned:
    """The successor of a member's certificate. Raises UsageError."""
    if not member.good:
        raise UsageError(
            f"`{member.name}` was revoked: it gets no certificate any more",
            hint="onboard the device under another name",
        )
    newest = member.good[-1]
    in_use = next((item for item in reversed(member.good) if item.standing is CertificateStatus.SEEN), member.good[0])
    return Planned(
        member=member if change.link is None else replace(member, link=change.link),
        common_name=_next_name(member),
        wrap=newest.wrap if change.wrap is None else change.wrap,
        key=newest.key if change.key is None else change.key,
        days=CLIENT_DAYS if change.days is None else change.days,
        request_id=printable_text(change.request_id, "the request's number"),
        replaces=tuple(certificate.common_name for certificate in member.good if certificate is not in_use),
    )


def known_member(membership: MembershipList, name: str) -> Member:
    """The member of that name. Raises NoSuchMember."""
    if (member := membership.members.get(name)) is not None:
        return member
    near = nearest(name, membership.members)
    raise NoSuchMember(
        f"the record has no member `{ascii(name)[1:-1][:60]}`",
        hint=f"did you mean `{near}`?" if near else "`provision vpn list` shows them all",
    )


def _found(membership: MembershipList, request: EnrolmentRequest) -> Member | None:
    """The member that the request is about, if there is one."""
    _check(request)
    member = names.check_free(request.name, request.partner, request.device, membership)
    if member is None:
        return None
    if member.good:
        _same(request, member)
    elif any(certificate.reason != NEVER_HANDED_OUT for certificate in member.certificates):
        raise names.NameTaken(
            f"`{member.name}` was revoked: {member.certificates[-1].reason}. Names never return",
            hint=f"device={request.device}-2, for instance",
        )
    return member


def _check(request: EnrolmentRequest) -> None:
    if request.partner is None:
        names.check_name(request.name, "host")
        right = request.device
    else:
        right = names.member_name(request.partner, request.device)
    if request.name != right:
        raise names.NameRefused(f"`{ascii(request.name)[1:-1][:60]}` is not the name `{right}`", hint="PARTNER-DEVICE")
    if request.vehicle is not None:
        printable_text(request.vehicle, "the vehicle")
    printable_text(request.request_id, "the request's number")
    if request.address is None and request.pool is None:
        raise UsageError(
            f"`{request.name}` has neither an address nor a pool to take one from", hint="declare its pool"
        )


def _same(request: EnrolmentRequest, member: Member) -> None:
    """Refuse a request that differs from the existing member of that name: nothing of it is changed in passing."""
    newest = member.good[-1]
    pairs = (
        ("kind", member.kind, request.kind),
        ("link", member.link, request.link),
        ("vehicle", member.vehicle or "none", request.vehicle or "none"),
        ("address", member.address, member.address if request.address is None else request.address),
        ("wrap", newest.wrap, request.wrap),
        ("key", newest.key, request.key),
    )
    other = [f"{word} is {has}, not {requested}" for word, has, requested in pairs if has != requested]
    if request.pool is not None and member.address not in request.pool:
        other.append(f"its address {member.address} is outside of {request.pool}")
    if other:
        raise OtherMember(
            f"`{member.name}` is in the VPN already, and otherwise: {'; '.join(other)}",
            hint=f"`provision vpn renew name={member.name}` changes link, wrap and key; for the rest take another name",
        )


def _declared(request: EnrolmentRequest, member: Member | None) -> IPv4Address | None:
    """The address that is not ours to choose: declared, or what a member got that was never handed out."""
    if member is None:
        return request.address
    if member.good:
        return None
    keeps = request.pool is None or member.address in request.pool
    return request.address if request.address is not None or not keeps else member.address


def _planned(
    request: EnrolmentRequest, member: Member | None, taken: dict[str, IPv4Address], addresses: Addresses
) -> Planned:
    address = taken.get(request.name)
    if address is None:
        assert request.pool is not None  # noqa: S101 - _check has refused it
        address = addresses.give(request.pool, request.name)
    certificates = () if member is None else member.certificates
    planned = Member(
        request.name,
        request.kind,
        request.partner,
        request.device,
        address,
        request.link,
        request.vehicle,
        certificates,
    )
    return Planned(planned, _next_name(planned), request.wrap, request.key, request.days, request.request_id)


def _next_name(member: Member) -> str:
    """A common name is never used twice, also where the one before was never handed out."""
    used: tuple[Certificate, ...] = member.certificates
    return member.name if not used else f"{member.name}.{len(used) + 1}"


def _refuse_repeated(requested: list[str]) -> None:
    counts = Counter(requested)
    if twice := next((name for name, count in counts.items() if count > 1), None):
        raise UsageError(f"`{twice}` is listed twice", hint="leave one of them out")


def printable_text(message: str, what: str) -> str:
    """A person's words, as they may be printed. Raises UsageError."""
    if not message.isprintable() or len(message) > _TEXT:
        raise UsageError(f"{what} is no short text in one line: {ascii(message)[:_TEXT]}", hint="write a word or two")
    return message
