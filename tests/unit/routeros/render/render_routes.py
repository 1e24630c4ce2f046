"""Route selection over rendered rows, written from the manual (Routing decision, Policy Routing).

It shares no code with the package. Links are as they are in the end: of netwatch only what it does to the routes of a
canary that stays silent is looked at; when it does so is for the twin to show.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from ipaddress import IPv4Network, ip_address, ip_interface, ip_network

from atlantis_netcfg.routeros.rsc import Export

BLACKHOLE = "blackhole"
_LEAVES = re.compile(r'/ip route set \[find comment="([^"]+)"\] distance=(\d+)')


@dataclass(frozen=True)
class Route:
    network: IPv4Network
    table: str
    gateway: str
    distance: int
    scope: int
    target_scope: int
    checked: bool


@dataclass(frozen=True)
class World:
    """What is wrong outside: interfaces without link, addresses that do not answer."""

    down: frozenset[str] = frozenset()
    silent: frozenset[str] = frozenset()


class Router:
    def __init__(self, export: Export, world: World) -> None:
        self._world = world
        self._routes = [*_connected(export), *_static(export, _left(export, world))]
        self._rules = [row for row in export.statements if row.menu == "/routing/rule"]

    def exits(self, dst: str, src: str = "0.0.0.0") -> frozenset[str]:  # noqa: S104 - no address yet
        """Return the interfaces by which a packet may leave; empty: nowhere."""
        for row in self._rules:
            if not all(
                _inside(address, row.get(name)) for name, address in (("src-address", src), ("dst-address", dst))
            ):
                continue
            found = self._lookup(dst, str(row.get("table")), shortest=0 if row.get("min-prefix") == "0" else -1)
            if found or row.get("action") == "lookup-only-in-table":
                return found
        return self._lookup(dst, "main", shortest=-1)

    def _lookup(self, dst: str, table: str, *, shortest: int) -> frozenset[str]:
        usable = [route for route in self._matching(dst, table) if route.network.prefixlen > shortest]
        return frozenset(interface for route in _best(usable) for interface in self._interfaces(route))

    def _matching(self, dst: str, table: str, scope: int = 255) -> list[Route]:
        """Return the active routes to `dst` in a table: the usable ones of the lowest distance for each prefix."""
        near = [r for r in self._routes if r.table == table and r.scope <= scope and ip_address(dst) in r.network]
        candidates = [route for route in near if self._usable(route)]
        return [
            route
            for route in candidates
            if route.distance == min(r.distance for r in candidates if r.network == route.network)
        ]

    def _usable(self, route: Route) -> bool:
        if route.checked and route.gateway in self._world.silent:
            return False
        return bool(self._interfaces(route))

    def _interfaces(self, route: Route) -> frozenset[str]:
        """Resolve the gateway: itself if it is an interface, else by routes of main that the target scope admits."""
        gateway = route.gateway.removesuffix("@main")
        if not gateway[0].isdigit():
            return frozenset() if gateway in self._world.down else frozenset({gateway})
        below = self._matching(gateway, "main", route.target_scope)
        return frozenset(i for r in _best(below) for i in self._interfaces(r)) - {BLACKHOLE}


def _best(routes: list[Route]) -> list[Route]:
    longest = max((route.network.prefixlen for route in routes), default=0)
    return [route for route in routes if route.network.prefixlen == longest]


def _inside(address: str, network: str | None) -> bool:
    return network is None or ip_address(address) in ip_network(network)


def _connected(export: Export) -> Iterator[Route]:
    for row in export.statements:
        if row.menu == "/ip/address":
            network = ip_interface(str(row.get("address"))).network
            assert isinstance(network, IPv4Network)
            yield Route(network, "main", str(row.get("interface")), 0, 10, 5, checked=False)


def _left(export: Export, world: World) -> dict[str, int]:
    """Return the distance that netwatch gives to the routes of silent canaries, by their comment."""
    found = {}
    for row in export.statements:
        script = row.get("test-script") or ""
        if row.menu == "/tool/netwatch" and row.get("host") in world.silent and '"response-count" = 0' in script:
            comment, distance = _LEAVES.findall(script)[0]
            found[comment] = int(distance)
    return found


def _static(export: Export, left: dict[str, int]) -> Iterator[Route]:
    for row in export.statements:
        if row.menu != "/ip/route" or row.get("disabled") == "yes":
            continue
        yield Route(
            network=IPv4Network(str(row.get("dst-address"))),
            table=row.get("routing-table") or "main",
            gateway=BLACKHOLE if row.get("blackhole") is not None else str(row.get("gateway")),
            distance=left.get(str(row.get("comment")), int(row.get("distance") or 1)),
            scope=int(row.get("scope") or 30),
            target_scope=int(row.get("target-scope") or 10),
            checked=row.get("check-gateway") == "ping",
        )
