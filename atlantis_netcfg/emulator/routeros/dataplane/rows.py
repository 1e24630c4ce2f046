"""What a router's current rows say to Linux: devices, addresses, routes, routing rules and the firewall.

Interfaces keep their names where Linux can have them; routes are those that are active, with their resolved next hops.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.emulator.routeros.dataplane import ruleset
from atlantis_netcfg.emulator.routeros.network.topology import MAIN

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from ipaddress import IPv4Address

    from atlantis_netcfg.emulator.routeros.network.topology import Route, Topology
    from atlantis_netcfg.emulator.routeros.store import StoredItem, Table

_LINUX_NAME: Final = re.compile(r"[A-Za-z0-9_.-]{1,15}")
_MAIN_TABLE: Final = 254
_FIRST_TABLE: Final = 1
"""Number of the first routing table of the router; with the others it fits into the mark's bits for routing marks."""
_FIRST_RULE: Final = 1000
"""Priority of the first routing rule, below Linux' own table `local` and above its `main`."""


@dataclass(frozen=True, slots=True)
class NetworkState:
    """Arguments of `ip`, text for `nft -f` and settings for `sysctl` that together make the state."""

    bridges: tuple[str, ...]
    tunnels: tuple[str, ...]
    """Devices that a VPN program opens."""
    ports: tuple[str, ...]
    """All other devices: each has a plug for a cable."""
    masters: tuple[tuple[str, str], ...]
    """Each port of a bridge, and the bridge."""
    up: tuple[str, ...]
    """Devices that are enabled."""
    addresses: tuple[str, ...]
    rules: tuple[str, ...]
    routes: tuple[str, ...]
    settings: tuple[str, ...]
    firewall: str
    counters: tuple[tuple[str, str, int], ...]
    """Chain of nftables, menu and id of each row with a rule, in the order of `NftRuleset.counters`."""
    limits: tuple[str, ...]
    """Rows that Linux cannot stand for, one line each."""

    def with_default_route(self, gateway: IPv4Address, device: str) -> NetworkState:
        """Return the state in which the main table's default route leads over one link."""
        default = f"0.0.0.0/0 table {_MAIN_TABLE} "
        others = (route for route in self.routes if not route.startswith(default))
        return replace(self, routes=(*others, f"{default}metric 1 via {gateway} dev {device} onlink"))


def devices_of(topology: Topology) -> dict[int, str]:
    """Return the Linux device of each interface: its factory name, else its name, or its id if Linux cannot have it."""
    names = {item.id: item.name for item in topology.interfaces.values()}
    for table in topology.store.space_tables("interface"):
        names |= {item.id: item.factory["name"] for item in table.items if item.factory and "name" in item.factory}
    return {number: name if _LINUX_NAME.fullmatch(name) else f"if{number:x}" for number, name in names.items()}


def network_state(topology: Topology) -> NetworkState:
    """Compute the state for the rows as they are now."""
    tables = _table_numbers(topology)
    devices = devices_of(topology)
    rules = firewall(topology, firewall_rows(topology))
    kinds: dict[str, list[str]] = {"bridges": [], "tunnels": [], "ports": []}
    every = [interface for interface in topology.interfaces.values() if interface.menu != "/interface"]  # `lo`
    for interface in every:
        kind = {"/interface/bridge": "bridges", "/interface/ovpn-client": "tunnels"}.get(interface.menu, "ports")
        kinds[kind].append(devices[interface.id])
    return NetworkState(
        bridges=tuple(kinds["bridges"]),
        tunnels=tuple(kinds["tunnels"]),
        ports=tuple(kinds["ports"]),
        masters=tuple((devices[item.id], devices[item.master]) for item in every if item.master is not None),
        up=tuple(devices[item.id] for item in every if item.is_enabled),
        addresses=tuple(_addresses(topology, devices)),
        rules=tuple(_rules(topology, tables, devices)),
        routes=tuple(dict.fromkeys(line for route in topology.routes for line in _route(route, tables, devices))),
        settings=tuple(_settings(topology)),
        firewall=rules.text(),
        counters=rules.counters(),
        limits=rules.limits,
    )


def firewall(topology: Topology, rows: Iterable[ruleset.FirewallRow]) -> ruleset.NftRuleset:
    """Translate rows of the firewall, with the interfaces, lists and routing tables of a router."""
    return ruleset.translate(rows, _names(topology, _table_numbers(topology), devices_of(topology)))


def _table_numbers(topology: Topology) -> dict[int, int]:
    return {number: _FIRST_TABLE + place for place, number in enumerate(_table_ids(topology))}


def _table_ids(topology: Topology) -> Iterator[int]:
    table = topology.store.table("/routing/table")
    yield from (item.id for item in table.items if item.id != MAIN)


def _addresses(topology: Topology, devices: dict[int, str]) -> Iterator[str]:
    for local in topology.locals:
        if local.works and local.actual is not None:
            broadcast = f" broadcast {local.network.broadcast_address}" if local.network.prefixlen < 31 else ""  # noqa: PLR2004 - RFC 3021
            yield f"{local.address.ip}/{local.network.prefixlen}{broadcast} dev {devices[local.actual]}"


def _route(route: Route, tables: dict[int, int], devices: dict[int, str]) -> Iterator[str]:
    """Yield the line of an active route; Linux adds connected ones by itself."""
    if not route.active or (route.is_connected and route.table == MAIN):
        return
    table = _MAIN_TABLE if route.table == MAIN else tables[route.table]
    if not route.hops:
        yield f"blackhole {route.destination} table {table} metric {route.distance}"
        return
    hops = [
        f"via {gateway} dev {devices[interface]} onlink" if gateway is not None else f"dev {devices[interface]}"
        for gateway, interface in dict.fromkeys(route.hops)
    ]
    way = hops[0] if len(hops) == 1 else " ".join(f"nexthop {hop}" for hop in hops)
    yield f"{route.destination} table {table} metric {route.distance} {way}"


def _rules(topology: Topology, tables: dict[int, int], devices: dict[int, str]) -> Iterator[str]:
    """Yield routing rules; a rule that may look up in one table only is followed by one that ends the search."""
    store = topology.store
    table = store.table("/routing/rule")
    for place, item in enumerate(table.items):
        if store.text(table, item, "disabled") == "yes":
            continue
        selector = _selector(topology, table, item, tables, devices)
        action = store.text(table, item, "action")
        priority = _FIRST_RULE + 2 * place
        if action in ("drop", "unreachable"):
            yield f"priority {priority} {selector} {'blackhole' if action == 'drop' else action}"
            continue
        number = store.target(table, item, "table")
        least = store.text(table, item, "min-prefix")
        suppress = "" if least is None else f" suppress_prefixlength {least}"
        name = _MAIN_TABLE if number in (None, MAIN) else tables[number]
        yield f"priority {priority} {selector} table {name}{suppress}"
        if action == "lookup-only-in-table":
            yield f"priority {priority + 1} {selector} unreachable"


def _selector(
    topology: Topology, table: Table, item: StoredItem, tables: dict[int, int], devices: dict[int, str]
) -> str:
    store = topology.store
    words = [f"from {store.text(table, item, 'src-address') or 'all'}"]
    if destination := store.text(table, item, "dst-address"):
        words.append(f"to {destination}")
    if (interface := store.target(table, item, "interface") or 0) in devices:
        words.append(f"iif {devices[interface]}")
    if (mark := store.target(table, item, "routing-mark")) is not None:
        words.append(f"fwmark {tables.get(mark, 0):#x}/{ruleset.ROUTING_MARKS:#x}")
    return " ".join(words)


def _settings(topology: Topology) -> Iterator[str]:
    table = topology.store.table("/ip/settings")
    item = next(iter(table.items), None)
    values = {"strict": 1, "loose": 2}
    text = None if item is None else topology.store.text(table, item, "rp-filter")
    yield f"net.ipv4.conf.all.rp_filter={values.get(text or '', 0)}"
    forward = None if item is None else topology.store.text(table, item, "ip-forward")
    yield f"net.ipv4.ip_forward={int(forward != 'no')}"


def firewall_rows(topology: Topology) -> list[ruleset.FirewallRow]:
    """Return all rows of the firewall, menu by menu, in their order."""
    store = topology.store
    return [
        ruleset.FirewallRow(menu, {name: store.text(table, item, name) or "" for name in item.values}, item.id)
        for menu in ruleset.MENUS
        for table in [store.table(menu)]
        for item in table.items
    ]


def _names(topology: Topology, tables: dict[int, int], devices: dict[int, str]) -> ruleset.RowReferences:
    store = topology.store
    lists = store.table("/interface/list")
    members = {
        store.text(lists, item, "name") or "": tuple(
            interface.name for interface in topology.interfaces.values() if topology.is_in_list(item.id, interface.id)
        )
        for item in lists.items
    }
    addresses: dict[str, list[str]] = {}
    entries = store.table("/ip/firewall/address-list")
    for item in entries.items:
        address = store.text(entries, item, "address") or ""
        # DNS names match nothing: nothing is resolved here.
        if store.text(entries, item, "disabled") != "yes" and address[:1].isdecimal():
            addresses.setdefault(store.text(entries, item, "list") or "", []).append(address)
    routing = store.table("/routing/table")
    return ruleset.RowReferences(
        devices={interface.name: devices[interface.id] for interface in topology.interfaces.values()},
        interface_lists=members,
        address_lists=addresses,
        tables={
            store.text(routing, item, "name") or "": tables[item.id] for item in routing.items if item.id in tables
        },
    )
