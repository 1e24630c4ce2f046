"""The words of the policy, and the answer that follows from a list of permissions."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from ipaddress import IPv4Address, IPv4Network

__all__ = ["ANYTHING", "PING", "Flow", "Party", "Permission", "Policy", "Protocol", "Traffic", "Zone", "zone_of"]


class Protocol(StrEnum):
    """What the firewall tells apart; of ICMP the echo, as errors pass with what they are about."""

    ICMP = "icmp"
    TCP = "tcp"
    UDP = "udp"


@dataclass(frozen=True, slots=True)
class Flow:
    """What the one who begins sends, to which port; ICMP has none."""

    protocol: Protocol
    port: int | None = None


@dataclass(frozen=True, slots=True)
class Traffic:
    """Flows of one kind. No protocol: every flow; no ports: every port."""

    protocol: Protocol | None = None
    ports: range | None = None

    def holds(self, flow: Flow) -> bool:
        """Whether a flow is of this kind."""
        if self.protocol is None:
            return True
        return flow.protocol is self.protocol and (self.ports is None or flow.port in self.ports)


ANYTHING = Traffic()
PING = Traffic(Protocol.ICMP)


@dataclass(frozen=True, slots=True)
class Zone:
    """Addresses that are treated alike, under the name of their set in the firewall."""

    name: str
    networks: tuple[IPv4Network, ...]

    def holds(self, address: IPv4Address) -> bool:
        """Whether an address lies in it."""
        return any(address in network for network in self.networks)


@dataclass(frozen=True, slots=True)
class Permission:
    """Who may begin what with whom. No source or destination: the server itself."""

    source: Zone | None
    destination: Zone | None
    traffic: Traffic
    why: str
    """A few words, in the firewall a comment."""


@dataclass(frozen=True, slots=True)
class Party:
    """One end of a flow."""

    name: str
    address: IPv4Address


@dataclass(frozen=True)
class Policy:
    """The complete answer."""

    server: Party
    server_addresses: frozenset[IPv4Address]
    """Of the tunnel and of its LAN: whatever is sent to them, the server itself receives."""
    members: Mapping[str, tuple[IPv4Network, ...]]
    """Whom the server admits, by name: the tunnel address, and of a site's router also what lies behind it."""
    beside: Zone
    """The LAN in which the server stands, and what its router joins to it: reached without the tunnel."""
    permissions: tuple[Permission, ...]

    @cached_property
    def admitted(self) -> Zone:
        """Every address that may be met at the other end of the tunnel."""
        return zone_of("p_members", (network for networks in self.members.values() for network in networks))

    @property
    def zones(self) -> tuple[Zone, ...]:
        """Every zone that a permission names, once; the firewall has a set for each."""
        named = (
            zone
            for permission in self.permissions
            for zone in (permission.source, permission.destination)
            if zone is not None
        )
        return tuple({zone.name: zone for zone in named}.values())

    def allows(self, source: Party, destination: Party, flow: Flow) -> bool:
        """Whether the source may begin this flow, and gets its answers."""
        ends = (source.address, destination.address)
        if not all(self._known(address) for address in ends):
            return False
        if not any(self.admitted.holds(address) for address in ends):
            return True  # without the tunnel
        return any(
            permission.traffic.holds(flow)
            and self._is(permission.source, source.address)
            and self._is(permission.destination, destination.address)
            for permission in self.permissions
        )

    def _known(self, address: IPv4Address) -> bool:
        return address in self.server_addresses or self.admitted.holds(address) or self.beside.holds(address)

    def _is(self, zone: Zone | None, address: IPv4Address) -> bool:
        local = address in self.server_addresses
        return local if zone is None else not local and zone.holds(address)


def zone_of(name: str, networks: Iterable[IPv4Network]) -> Zone:
    """Sorted, each network once and none inside another: a set of the firewall takes no overlap."""
    found = set(networks)
    wide = [item for item in found if item.prefixlen < item.max_prefixlen]
    return Zone(
        name,
        tuple(
            sorted(network for network in found if not any(network != net and network.subnet_of(net) for net in wide))
        ),
    )
