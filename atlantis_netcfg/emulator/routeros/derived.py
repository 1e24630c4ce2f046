"""Properties that the router computes: flags, status, and the rows that it makes by itself."""

from __future__ import annotations

from ipaddress import IPv4Interface
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.values import id_text, spell

if TYPE_CHECKING:
    from collections.abc import Callable

    from atlantis_netcfg.emulator.routeros.store import Item, Store
    from atlantis_netcfg.emulator.routeros.topology import Interface, Route, Topology

Properties = dict[str, str]
_TYPES = {
    "/interface": "loopback",
    "/interface/ethernet": "ether",
    "/interface/lte": "lte",
    "/interface/bridge": "bridge",
    "/interface/ovpn-client": "ovpn-out",
    "/interface/wireless": "wlan",
    "/interface/wifi": "wifi",
}
_DUMMY = "special dummy rule to show fasttrack counters"
_DUMMY_CHAINS = {
    "/ip/firewall/filter": ("forward",),
    "/ip/firewall/mangle": ("prerouting", "forward", "postrouting"),
    "/ip/firewall/raw": ("prerouting",),
}


def _truth(value: object) -> str:
    return "true" if value else "false"


def type_of(interface: Interface) -> str:
    """Return the `type` that `/interface` shows."""
    return _TYPES.get(interface.menu, interface.menu.rpartition("/")[2])


def _interface(topology: Topology, item: Item) -> Properties:
    interface = topology.interfaces[item.id]
    return {"running": _truth(interface.running), "slave": _truth(interface.master)}


def _ethernet(topology: Topology, item: Item) -> Properties:
    return {"default-name": (item.factory or {})["name"], **_interface(topology, item), "loop-protect-status": "off"}


def _radio(topology: Topology, item: Item) -> Properties:
    return {**_default_name(item), "running": _truth(topology.interfaces[item.id].running)}


def _wifi(topology: Topology, item: Item) -> Properties:
    running = topology.interfaces[item.id].running
    flags = {"bound": "true", "master": _truth(item.factory is not None), "inactive": _truth(not running)}
    return {**_default_name(item), **flags, "running": _truth(running)}


def _modem(topology: Topology, item: Item) -> Properties:
    interface = topology.interfaces[item.id]
    return {
        **_default_name(item),
        "running": _truth(interface.running),
        "inactive": _truth(interface.enabled and not interface.running),
    }


def _default_name(item: Item) -> Properties:
    return {} if item.factory is None else {"default-name": item.factory["name"]}


def _bridge(topology: Topology, item: Item) -> Properties:
    mtu = item.values.get("mtu", "auto")
    shown = {"actual-mtu": "1500" if mtu == "auto" else mtu, "l2mtu": "1598"}
    return {**shown, "dynamic": "false", "running": _truth(topology.interfaces[item.id].running)}


def _tunnel(topology: Topology, item: Item) -> Properties:
    return {"running": _truth(topology.interfaces[item.id].running), "hw-crypto": "false"}


def _port(topology: Topology, item: Item) -> Properties:
    table = topology.store.table("/interface/bridge/port")
    bridge = topology.store.target(table, item, "bridge")
    members = topology.port_members(item)
    enabled = topology.store.text(table, item, "disabled") != "yes"
    works = (
        enabled
        and topology.up(bridge)
        and any(topology.interfaces[number].enabled for number in members if number in topology.interfaces)
    )
    status = "in-bridge" if works else "inactive"
    return {"dynamic": "false", "inactive": _truth(not works), "status": status}


def _address(topology: Topology, item: Item) -> Properties:
    local = next(local for local in topology.locals if local.item == item.id)
    address = IPv4Interface(topology.store.text(topology.store.table("/ip/address"), item, "address") or "")
    shown = {"network": item.values.get("network", str(address.network.network_address))}
    shown["actual-interface"] = topology.name(local.actual if local.actual is not None else local.on)
    return {
        **shown,
        "dynamic": "false",
        "invalid": _truth(local.actual is None),
        "slave": _truth(local.actual != local.on),
    }


def _on_interface(topology: Topology, item: Item, path: str) -> bool:
    table = topology.store.table(path)
    number = topology.store.target(table, item, "interface")
    interface = topology.interfaces.get(number or 0)
    return interface is not None and interface.master is None


def _dhcp_server(topology: Topology, item: Item) -> Properties:
    return {"dynamic": "false", "invalid": _truth(not _on_interface(topology, item, "/ip/dhcp-server"))}


def _dhcp_client(topology: Topology, item: Item) -> Properties:
    disabled = topology.store.text(topology.store.table("/ip/dhcp-client"), item, "disabled") == "yes"
    fine = _on_interface(topology, item, "/ip/dhcp-client")
    status = "stopped" if disabled or not fine else "searching..."
    return {"dynamic": "false", "invalid": _truth(not fine), "status": status}


def _lease(_topology: Topology, _item: Item) -> Properties:
    return {"status": "waiting", "last-seen": "never", "radius": "false", "dynamic": "false", "blocked": "false"}


def _route_row(topology: Topology, route: Route) -> Properties:
    hops = [topology.name(via) if hop is None else f"{hop}%{topology.name(via)}" for hop, via in route.hops]
    shown = {"immediate-gw": ",".join(hops)} if hops else {}
    flags = {
        "active": _truth(route.active),
        "dynamic": _truth(route.connected),
        "inactive": _truth(route.enabled and not route.active),
    }
    return {**shown, **flags, "connect" if route.connected else "static": "true"}


def _route(topology: Topology, item: Item) -> Properties:
    route = next(route for route in topology.routes if route.item == item.id)
    return _route_row(topology, route)


def _table(topology: Topology, item: Item) -> Properties:
    used = any(route.table == item.id for route in topology.routes)
    return {"dynamic": _truth(item.dynamic), "invalid": "false", "used": _truth(used)}


def _rule(topology: Topology, item: Item) -> Properties:
    """A lookup in a table that has gone, or an interface that has gone, makes the rule inactive."""
    table = topology.store.table("/routing/rule")
    target = topology.store.target(table, item, "table")
    looks_up = (topology.store.text(table, item, "action") or "").startswith("lookup")
    gone = looks_up and (target is None or topology.store.table("/routing/table").find(target) is None)
    return {"inactive": _truth(gone)}


def _firewall(topology: Topology, item: Item) -> Properties:
    """A rule that names an interface or list that has gone is invalid."""
    spelled = [value for name, value in item.values.items() if name.startswith(("in-", "out-"))]
    gone = any("*" in spell(value, topology.store) for value in spelled)
    return {"bytes": "0", "packets": "0", "dynamic": "false", "invalid": _truth(gone)}


def _ntp(topology: Topology, item: Item) -> Properties:
    enabled = topology.store.text(topology.store.table("/system/ntp/client"), item, "enabled") == "yes"
    return {"freq-drift": "0", "status": "waiting" if enabled else "stopped"}


def _dns(_topology: Topology, _item: Item) -> Properties:
    return {"dynamic-servers": "", "cache-used": "25"}


def _fast_path(family: str) -> Callable[[Topology, Item], Properties]:
    """Nothing takes it here. Assumption: settings-computed."""
    shown = {
        f"{family}-{path}-{name}": value
        for path in ("fast-path", "fasttrack")
        for name, value in (("active", "false"), ("bytes", "0"), ("packets", "0"))
    }
    return lambda _topology, _item: shown


def _snmp(_topology: Topology, _item: Item) -> Properties:
    """MikroTik's enterprise number is 14988 (IANA), 3a8c; the form of RFC 3411 with a text of the router's own."""
    return {"engine-id": "80003a8c04"}


def _romon(topology: Topology, item: Item) -> Properties:
    """The `id`, or the address of a port (manual, RoMON). Assumption: settings-computed."""
    local = topology.store.text(topology.store.table("/tool/romon"), item, "id")
    return {"current-id": local or ""}


_COMPUTED: dict[str, Callable[[Topology, Item], Properties]] = {
    "/interface/bridge": _bridge,
    "/interface/bridge/port": _port,
    "/interface/ethernet": _ethernet,
    "/interface/lte": _modem,
    "/interface/ovpn-client": _tunnel,
    "/interface/wifi": _wifi,
    "/interface/wireless": _radio,
    "/ip/address": _address,
    "/ip/dhcp-server": _dhcp_server,
    "/ip/dhcp-client": _dhcp_client,
    "/ip/dhcp-server/lease": _lease,
    "/ip/dns": _dns,
    "/ip/route": _route,
    "/ip/settings": _fast_path("ipv4"),
    "/ipv6/settings": _fast_path("ipv6"),
    "/snmp": _snmp,
    "/tool/romon": _romon,
    "/system/ntp/client": _ntp,
    "/routing/table": _table,
    "/routing/rule": _rule,
    "/ip/firewall/filter": _firewall,
    "/ip/firewall/mangle": _firewall,
    "/ip/firewall/nat": _firewall,
    "/ip/firewall/raw": _firewall,
}


def properties(topology: Topology, path: str, item: Item) -> Properties:
    """Return what the router computes for a row."""
    compute = _COMPUTED.get(path)
    return compute(topology, item) if compute is not None else {}


def dynamic_rows(topology: Topology, path: str) -> list[Properties]:
    """Return the rows of a menu that nobody configured; they refuse every command but print."""
    if path == "/ip/route":
        return [_connected_row(topology, route) for route in topology.routes if route.connected]
    if path in _DUMMY_CHAINS and _uses_fasttrack(topology.store):
        return [_dummy(topology.store, path, chain) for chain in _DUMMY_CHAINS[path]]
    return []


def _connected_row(topology: Topology, route: Route) -> Properties:
    local = next(
        local
        for local in topology.locals
        if topology.store.dynamic_id("/ip/route", "connect", local.item) == route.item
    )
    return {
        ".id": id_text(route.item),
        "dst-address": str(route.destination),
        "routing-table": "main",
        "gateway": topology.name(route.via),
        "distance": "0",
        "scope": str(route.scope),
        "target-scope": str(route.target_scope),
        "local-address": f"{local.address.ip}%{topology.name(local.actual)}",
        **_route_row(topology, route),
        "disabled": "false",
    }


def _uses_fasttrack(store: Store) -> bool:
    table = store.table("/ip/firewall/filter")
    rules = (item for item in table.items if store.text(table, item, "disabled") != "yes")
    return any(store.text(table, item, "action") == "fasttrack-connection" for item in rules)


def _dummy(store: Store, path: str, chain: str) -> Properties:
    number = store.dynamic_id(path, f"fasttrack {chain}", 0)
    flags = {"dynamic": "true", "invalid": "false", "disabled": "false"}
    return {
        ".id": id_text(number),
        "chain": chain,
        "action": "passthrough",
        "comment": _DUMMY,
        "bytes": "0",
        "packets": "0",
        **flags,
    }
