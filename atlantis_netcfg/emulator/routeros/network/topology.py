"""Network state of a configuration: interfaces, bridge ports, addresses, lists, active routes.

Links are up on every enabled Ethernet port and on radios with a peer. A bridge runs as soon as it is enabled, and a
tunnel only if its server accepts it. Every gateway reachable on a link responds, unless `check-gateway` has marked it
`dead` (see failover.py). Sources: Manual, Bridging and Switching; Manual, IP Routing ("Nexthop lookup": scope and
target-scope); Manual, Interface Lists.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from ipaddress import IPv4Address, IPv4Interface, IPv4Network
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.values import references

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.emulator.routeros.store import RowStore, StoredItem


MAIN = 0
"""The id of routing table `main`."""
CONNECTED_SCOPE = 10
_CONNECTED_TARGET_SCOPE = 5
_ALL = 0x2000000
_NONE, _DYNAMIC, _STATIC = _ALL + 1, _ALL + 2, _ALL + 3
_DEEPEST = 8


@dataclass(slots=True)
class Interface:
    """An interface of any kind; `master` is its bridge, if it is a bridge port."""

    id: int
    name: str
    menu: str
    is_enabled: bool
    running: bool
    master: int | None = None


@dataclass(frozen=True, slots=True)
class Local:
    """An address of the router; `on`: the configured interface, `actual`: the effective one (a port's bridge)."""

    item: int
    address: IPv4Interface
    network: IPv4Network
    on: int | None
    actual: int | None
    works: bool


@dataclass(slots=True)
class Route:
    """A route with its routing state; `hops` are (gateway address or None, interface)."""

    item: int
    destination: IPv4Network
    table: int
    distance: int
    scope: int
    target_scope: int
    gateway: IPv4Address | None
    via: int | None
    blackhole: bool
    is_connected: bool
    is_enabled: bool = True
    active: bool = False
    hops: list[tuple[IPv4Address | None, int]] = field(default_factory=list)
    way: list[tuple[IPv4Address | None, int]] = field(default_factory=list)
    """The hops as they would be if the gateway responded."""


class Topology:
    """Network state, computed once per revision of the store."""

    def __init__(
        self, store: RowStore, linked_radios: frozenset[int] = frozenset(), dead: frozenset[IPv4Address] = frozenset()
    ) -> None:
        """Compute the state; `linked_radios`: radios and tunnels with a peer, `dead`: gateways marked as dead."""
        self.store = store
        self._linked = linked_radios
        self._dead = dead
        self.revision = store.revision
        self.interfaces = {interface.id: interface for interface in self._interfaces()}
        self._assign_bridge_ports()
        self.locals = list(self._locals())
        self.routes = [*self._connected_routes(), *self._static()]
        self._decide()

    def with_all_linked(self) -> Topology:
        """Return the state in which every radio and tunnel has a peer, and every gateway responds."""
        return Topology(self.store, frozenset(self.interfaces))

    # --- interfaces ------------------------------------------------------------------------------------------------

    def _interfaces(self) -> Iterator[Interface]:
        for table in self.store.space_tables("interface"):
            for item in table.items:
                is_enabled = self.store.text(table, item, "disabled") != "yes"
                up = is_enabled and (
                    table.menu.path in ("/interface", "/interface/ethernet", "/interface/bridge")
                    or item.id in self._linked
                    or self.store.text(table, item, "disable-running-check") == "yes"
                )
                name = self.store.text(table, item, "name") or ""
                yield Interface(item.id, name, table.menu.path, is_enabled, up)

    def _assign_bridge_ports(self) -> None:
        table = self.store.table("/interface/bridge/port")
        for item in table.items:
            if self.store.text(table, item, "disabled") == "yes":
                continue
            bridge = self.store.target(table, item, "bridge")
            for port in self.port_members(item):
                if bridge in self.interfaces and port in self.interfaces and port != bridge:
                    self.interfaces[port].master = bridge

    def port_members(self, item: StoredItem) -> list[int]:
        """Return the interfaces of a bridge port row: one, or those of a list."""
        targets = list(references(item.values.get("interface", "")))
        return [
            member
            for space, number in targets
            for member in (
                [number] if space == "interface" else [i for i in self.interfaces if self.is_in_list(number, i)]
            )
        ]

    def is_in_list(self, list_id: int, interface: int, depth: int = 0) -> bool:
        """Return whether an interface belongs to an interface list."""
        if list_id in (_ALL, _STATIC):
            return True
        if list_id in (_NONE, _DYNAMIC) or depth > _DEEPEST:
            return False
        lists = self.store.table("/interface/list")
        item = lists.find(list_id)
        if item is None:
            return False
        excluded_lists = [number for _, number in references(item.values.get("exclude", ""))]
        if any(self.is_in_list(number, interface, depth + 1) for number in excluded_lists):
            return False
        included_lists = [number for _, number in references(item.values.get("include", ""))]
        return self._is_member(list_id, interface) or any(
            self.is_in_list(number, interface, depth + 1) for number in included_lists
        )

    def _is_member(self, list_id: int, interface: int) -> bool:
        table = self.store.table("/interface/list/member")
        return any(
            self.store.text(table, item, "disabled") != "yes"
            and self.store.target(table, item, "list") == list_id
            and self.store.target(table, item, "interface") == interface
            for item in table.items
        )

    def by_name(self, name: str) -> Interface | None:
        """Return the interface of that name."""
        return next((interface for interface in self.interfaces.values() if interface.name == name), None)

    def name(self, number: int | None) -> str:
        """Return an interface's name, or `*ID` if it was removed."""
        interface = self.interfaces.get(number or 0)
        return interface.name if interface is not None else f"*{number or 0:X}"

    def factory(self, name: str) -> Interface | None:
        """Return the port or radio with that factory name, even if renamed."""
        for table in self.store.space_tables("interface"):
            for item in table.items:
                if item.factory is not None and item.factory.get("name") == name:
                    return self.interfaces[item.id]
        return None

    def joins(self, item: str, other: str) -> bool:
        """Return whether two ports (factory names) belong to one bridge, and all three are up."""
        ports = (self.factory(item), self.factory(other))
        masters = {port.master for port in ports if port is not None and self.up(port.id)}
        return None not in ports and len(masters) == 1 and None not in masters

    def up(self, number: int | None) -> bool:
        """Return whether an interface exists, is enabled and running, and its bridge too."""
        interface = self.interfaces.get(number or 0)
        if interface is None or not interface.is_enabled:
            return False
        return interface.running if interface.master is None else self.up(interface.master)

    # --- addresses -------------------------------------------------------------------------------------------------

    def _locals(self) -> Iterator[Local]:
        table = self.store.table("/ip/address")
        for item in table.items:
            address = IPv4Interface(self.store.text(table, item, "address") or "0.0.0.0/0")
            base = self.store.text(table, item, "network") or str(address.network.network_address)
            on = self.store.target(table, item, "interface")
            interface = self.interfaces.get(on or 0)
            actual = interface.master or on if interface is not None else None
            works = self.store.text(table, item, "disabled") != "yes" and self.up(actual)
            network = IPv4Network(f"{base}/{address.network.prefixlen}", strict=False)
            yield Local(item.id, address, network, on, actual, works)

    def is_local(self, address: IPv4Address) -> bool:
        """Return whether the router itself has this address."""
        return any(local.works and local.address.ip == address for local in self.locals)

    # --- routes ----------------------------------------------------------------------------------------------------

    def _connected_routes(self) -> Iterator[Route]:
        for local in self.locals:
            table = self.store.table("/ip/address")
            item = table.find(local.item)
            if item is not None and self.store.text(table, item, "disabled") != "yes" and local.actual is not None:
                number = self.store.dynamic_id("/ip/route", "connect", local.item)
                route = Route(
                    number,
                    local.network,
                    MAIN,
                    0,
                    CONNECTED_SCOPE,
                    _CONNECTED_TARGET_SCOPE,
                    None,
                    local.actual,
                    False,
                    True,
                )
                route.hops = [(None, local.actual)] if local.works else []
                yield route

    def _static(self) -> Iterator[Route]:
        table = self.store.table("/ip/route")
        for item in table.items:
            read = {
                name: self.store.text(table, item, name)
                for name in ("dst-address", "distance", "scope", "target-scope")
            }
            hop = item.values.get("gateway", "").partition("@")[0]
            address = hop.partition("\x01")[0].rstrip("%")
            routing_table = self.store.target(table, item, "routing-table")
            yield Route(
                item.id,
                IPv4Network(read["dst-address"] or "0.0.0.0/0"),
                MAIN if routing_table is None else routing_table,
                int(read["distance"] or 1),
                int(read["scope"] or 30),
                int(read["target-scope"] or 10),
                IPv4Address(address) if address and ":" not in address else None,
                next((number for _, number in references(hop)), None),
                "blackhole" in item.values,
                is_connected=False,
                is_enabled=self.store.text(table, item, "disabled") != "yes",
            )

    def _decide(self) -> None:
        """Resolve next hops repeatedly: a recursive route depends on the active routes."""
        for _ in range(len(self.routes) + 2):
            before = [(route.active, list(route.hops)) for route in self.routes]
            for route in self.routes:
                if not route.is_connected:
                    route.way = self._resolve(route)
                    route.hops = [] if route.gateway in self._dead else route.way
            self._elect()
            if before == [(route.active, route.hops) for route in self.routes]:
                return

    def _resolve(self, route: Route) -> list[tuple[IPv4Address | None, int]]:
        if route.blackhole or not route.is_enabled:
            return []
        if route.gateway is None or route.via is not None:
            return [(route.gateway, route.via)] if route.via is not None and self.up(route.via) else []
        if self.is_local(route.gateway):
            return []
        best = self.lookup(route.gateway, MAIN, most_scope=route.target_scope, besides=route)
        hops = [hop for candidate in best for hop in candidate.hops]
        return [(hop or route.gateway, interface) for hop, interface in hops]

    def _elect(self) -> None:
        groups: dict[tuple[int, IPv4Network], list[Route]] = {}
        for route in self.routes:
            route.active = False
            if route.is_enabled and (route.hops or route.blackhole) and self._has_table(route.table):
                groups.setdefault((route.table, route.destination), []).append(route)
        for group in groups.values():
            best = min(route.distance for route in group)
            for route in group:
                route.active = route.distance == best

    def _has_table(self, number: int) -> bool:
        tables = self.store.table("/routing/table")
        item = tables.find(number)
        if item is None:
            return number == MAIN  # version 6 has no menu of tables, and the main one all the same
        return self.store.text(tables, item, "disabled") != "yes"

    def lookup(
        self,
        address: IPv4Address,
        table: int,
        *,
        most_scope: int = 255,
        least_prefix: int = -1,
        besides: Route | None = None,
    ) -> list[Route]:
        """Return the active routes of the longest prefix; a blackhole among them counts, without hops.

        `least_prefix`: ignore prefixes up to this length (`min-prefix` of a routing rule).
        """
        fitting = [
            route
            for route in self.routes
            if route.active
            and route is not besides
            and route.table == table
            and route.scope <= most_scope
            and route.destination.prefixlen > least_prefix
            and address in route.destination
        ]
        longest = max((route.destination.prefixlen for route in fitting), default=0)
        return [route for route in fitting if route.destination.prefixlen == longest]
