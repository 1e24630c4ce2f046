"""Rules for the address plan: networks do not overlap, and every pool is inside its network.

Also helpers for an address's position in its network.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right, insort
from dataclasses import dataclass
from ipaddress import IPv4Address, IPv4Network
from typing import TYPE_CHECKING

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory import _draft
from atlantis_netcfg.inventory.model import Gateway

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from atlantis_netcfg.inventory.findings import Finding


_RESERVED_NETWORKS: tuple[tuple[IPv4Network, str], ...] = (
    (IPv4Network("0.0.0.0/8"), "this network"),
    (IPv4Network("127.0.0.0/8"), "loopback"),
    (IPv4Network("169.254.0.0/16"), "link-local addresses"),
    (IPv4Network("224.0.0.0/4"), "multicast"),
    (IPv4Network("240.0.0.0/4"), "nothing (reserved)"),
)
"""Reserved networks (RFC 6890), and multicast (RFC 5771)."""


@dataclass(frozen=True, slots=True)
class Claim:
    """A network and what in the pilot uses it."""

    network: IPv4Network
    what: str
    part: _draft.Part
    path: tuple[str | int, ...]
    end: str = ""
    """End of a Wi-Fi bridge, because both ends are one network; empty: not a bridge."""


def claims(draft: _draft.Draft) -> Iterator[Claim]:
    """Yield every network that must not overlap another; the VPN's pools are inside the VPN and left out."""
    for name, site in draft.sites.items():
        part = _draft.Part("site", name)
        yield Claim(site.lan.network, msg(f"the LAN of `{arg(name)}`"), part, ("lan", "network"))
        yield Claim(
            site.management.network, msg(f"the management network of `{arg(name)}`"), part, ("management", "network")
        )
        for index, site_link in enumerate(site.bearers):
            end = "carried" if site_link.kind.traits.bridge else ""
            what = msg(f"link `{arg(site_link.name)}` of `{arg(name)}`")
            yield Claim(site_link.network, what, part, ("bearers", index, "network"), end)
        for index, link in enumerate(site.served_links):
            what = msg(f"link `{arg(link.name)}` of `{arg(name)}`")
            yield Claim(link.network, what, part, ("served_links", index, "network"), "serving")
    for host, _, gateway in draft.valid_devices(Gateway):
        if gateway.access_point is not None:
            network, what = gateway.access_point.network, msg(f"the access point of `{arg(host)}`")
            yield Claim(network, what, _draft.Part("device", host), ("access_point", "network"))
    for name, vehicle in draft.vehicles.items():
        wifi = vehicle.endpoints.wifi
        if wifi is not None and wifi.client is not None:
            network, what = wifi.client.network, msg(f"the access point of `{arg(name)}`")
            yield Claim(network, what, _draft.Part("vehicle", name), ("endpoints", "wifi", "client", "network"))
    if draft.pilot is not None:
        yield Claim(draft.pilot.vpn.network, "the VPN", _draft.Part("pilot"), ("vpn", "network"))


class NetworkIndex:
    """An index of networks for overlap queries, for pilots with hundreds of sites.

    It relies on a property of prefixes: of two networks that overlap, one contains the other.
    """

    def __init__(self, initial_claims: Iterable[Claim] = ()) -> None:
        self._claims: list[Claim] = []
        self._by_network: dict[IPv4Network, list[int]] = {}
        self._starts: list[tuple[int, int]] = []
        self._lengths: set[int] = set()
        for claim in initial_claims:
            self.add(claim)

    def add(self, claim: Claim) -> None:
        """Add a network to the index."""
        number = len(self._claims)
        self._claims.append(claim)
        self._by_network.setdefault(claim.network, []).append(number)
        self._lengths.add(claim.network.prefixlen)
        insort(self._starts, (int(claim.network.network_address), number))

    def over(self, network: IPv4Network) -> list[Claim]:
        """Return the claims that overlap a network, in the order in which they were added."""
        first, last = int(network.network_address), int(network.broadcast_address)
        low, high = bisect_left(self._starts, (first, 0)), bisect_right(self._starts, (last, len(self._claims)))
        numbers = {number for _, number in self._starts[low:high]}
        for length in (length for length in self._lengths if length < network.prefixlen):
            numbers.update(self._by_network.get(network.supernet(new_prefix=length), ()))
        return [self._claims[number] for number in sorted(numbers)]


def disjoint(draft: _draft.Draft) -> Iterator[Finding]:
    """Require that no two networks of the pilot overlap; each network is reported at most once."""
    network_index = NetworkIndex()
    for claim in claims(draft):
        others = [other for other in network_index.over(claim.network) if not _is_same_bridge(claim, other)]
        if others:
            first = others[0]
            more = msg(f" and {arg(len(others) - 1)} more" if len(others) > 1 else "")
            where = msg(
                f"{arg(first.network)} of {arg(first.what)} ({arg(draft.where(first.part, *first.path))}){arg(more)}"
            )
            message = msg(f"{arg(claim.network)} of {arg(claim.what)} overlaps {arg(where)}")
            yield draft.finding_at(claim.part, claim.path, message, "give it a separate network")
        network_index.add(claim)


def _is_same_bridge(claim: Claim, other: Claim) -> bool:
    return {claim.end, other.end} == {"carried", "serving"} and claim.network == other.network


def usable(draft: _draft.Draft) -> Iterator[Finding]:
    """Report a network in a block that devices cannot use."""
    for claim in claims(draft):
        for block, purpose in _RESERVED_NETWORKS:
            if claim.network.overlaps(block):
                message = msg(
                    f"{arg(claim.network)} of {arg(claim.what)} overlaps {arg(block)}, which is for {arg(purpose)}"
                )
                yield draft.finding_at(
                    claim.part,
                    claim.path,
                    message,
                    "choose a network from 10.0.0.0/8, or the one given by the provider",
                )
                break


def pools(draft: _draft.Draft) -> Iterator[Finding]:
    """Require that the VPN's pools are inside the VPN's network and do not overlap."""
    if draft.pilot is None:
        return
    vpn = draft.pilot.vpn
    infrastructure = (msg("infrastructure"), vpn.infrastructure, _draft.Part("pilot"), ("vpn", "infrastructure"))
    partners = [
        (f"`{name}`", partner.vpn_pool, _draft.Part("partner", name), ("vpn_pool",))
        for name, partner in draft.partners.items()
    ]
    earlier_pools: list[tuple[str, IPv4Network, _draft.Part, tuple[str, ...]]] = []
    for what, pool, part, path in (infrastructure, *partners):
        if not pool.subnet_of(vpn.network):
            where = draft.where(_draft.Part("pilot"), "vpn", "network")
            message = msg(
                f"the pool {arg(pool)} of {arg(what)} is not inside the VPN's network {arg(vpn.network)} ({arg(where)})"
            )
            yield draft.finding_at(part, path, message, msg(f"choose a part of {arg(vpn.network)}"))
        for other, other_pool, other_part, other_path in earlier_pools:
            if pool.overlaps(other_pool):
                where = draft.where(other_part, *other_path)
                message = msg(
                    f"the pool {arg(pool)} of {arg(what)} overlaps {arg(other_pool)} of {arg(other)} ({arg(where)})"
                )
                yield draft.finding_at(part, path, message, "give it a separate pool")
        earlier_pools.append((what, pool, part, path))


RULES: tuple[_draft.Rule, ...] = (disjoint, usable, pools)

_POINT_TO_POINT = 31


def why_unusable(address: IPv4Address, network: IPv4Network) -> str | None:
    """Return why a device cannot use the address; None if it can. A /31 has two usable addresses (RFC 3021)."""
    if address not in network:
        return msg(f"is outside {arg(network)}")
    if network.prefixlen >= _POINT_TO_POINT:
        return None
    if address == network.network_address:
        return msg(f"is the network's own address in {arg(network)}")
    if address == network.broadcast_address:
        return msg(f"is the broadcast address of {arg(network)}")
    return None


def example_in(network: IPv4Network) -> str:
    """Return a hint that names usable addresses of the network."""
    if network.prefixlen >= _POINT_TO_POINT:
        return msg(f"choose {arg(network.network_address)} or {arg(network.broadcast_address)}")
    return msg(f"choose one from {arg(network.network_address + 1)} to {arg(network.broadcast_address - 1)}")
