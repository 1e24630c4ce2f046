"""Which tunnel address a member gets, and keeps."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.vpn.authority._errors import AddressTaken, PoolFull
from atlantis_netcfg.vpn.ledger import NEVER_HANDED_OUT

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator
    from datetime import datetime
    from ipaddress import IPv4Address, IPv4Network

    from atlantis_netcfg.vpn.identity import Member, MembershipList

__all__ = ["Addresses"]

_TWO_ENDS = 30
"""Longest prefix of a network that has an address of its own and one for broadcasts (RFC 3021)."""


class Addresses:
    """The addresses of a roll while new ones are given away, in memory.

    Those that nobody ever had come first. An address of a member that was revoked is given again when nothing else is
    left, the one that rests longest first, and never before the server has confirmed that the member is out.
    """

    def __init__(self, roll: MembershipList, reserved: Collection[IPv4Address] = ()) -> None:
        queued = set(roll.queued)
        self._used: dict[IPv4Address, str] = dict.fromkeys(reserved, "the declaration")
        self._resting: dict[IPv4Address, datetime] = {}
        for member in roll.members.values():
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
