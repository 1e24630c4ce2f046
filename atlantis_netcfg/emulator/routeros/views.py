"""Rows as `print` shows them: configured values, defaults, and values computed by the router.

Computed are flags, status, and dynamic rows.
"""

from __future__ import annotations

from ipaddress import IPv4Interface
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros import access, environment
from atlantis_netcfg.emulator.routeros.certificates import expires_after
from atlantis_netcfg.emulator.routeros.menus import Arg, Shape
from atlantis_netcfg.emulator.routeros.modem import modem_rows
from atlantis_netcfg.emulator.routeros.store import PrintedRow
from atlantis_netcfg.emulator.routeros.values import id_text, interval, references, spell

if TYPE_CHECKING:
    from collections.abc import Callable

    from atlantis_netcfg.emulator.routeros.answers import Caller
    from atlantis_netcfg.emulator.routeros.core import Core
    from atlantis_netcfg.emulator.routeros.network.topology import Interface, Route, Topology
    from atlantis_netcfg.emulator.routeros.store import RowStore, StoredItem, Table


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


def _format_bool(value: object) -> str:
    return "true" if value else "false"


def type_of(interface: Interface) -> str:
    """Return an interface's `type` in `/interface`."""
    return _TYPES.get(interface.menu, interface.menu.rpartition("/")[2])


def _interface(topology: Topology, item: StoredItem) -> Properties:
    interface = topology.interfaces[item.id]
    return {"running": _format_bool(interface.running), "slave": _format_bool(interface.master)}


def _ethernet(topology: Topology, item: StoredItem) -> Properties:
    return {"default-name": (item.factory or {})["name"], **_interface(topology, item), "loop-protect-status": "off"}


def _radio(topology: Topology, item: StoredItem) -> Properties:
    return {**_default_name(item), "running": _format_bool(topology.interfaces[item.id].running)}


def _wifi(topology: Topology, item: StoredItem) -> Properties:
    running = topology.interfaces[item.id].running
    flags = {"bound": "true", "master": _format_bool(item.factory is not None), "inactive": _format_bool(not running)}
    return {**_default_name(item), **flags, "running": _format_bool(running)}


def _modem(topology: Topology, item: StoredItem) -> Properties:
    interface = topology.interfaces[item.id]
    return {
        **_default_name(item),
        "running": _format_bool(interface.running),
        "inactive": _format_bool(interface.is_enabled and not interface.running),
    }


def _default_name(item: StoredItem) -> Properties:
    return {} if item.factory is None else {"default-name": item.factory["name"]}


def _bridge(topology: Topology, item: StoredItem) -> Properties:
    mtu = item.values.get("mtu", "auto")
    row = {"actual-mtu": "1500" if mtu == "auto" else mtu, "l2mtu": "1598"}
    return {**row, "dynamic": "false", "running": _format_bool(topology.interfaces[item.id].running)}


def _tunnel(topology: Topology, item: StoredItem) -> Properties:
    return {"running": _format_bool(topology.interfaces[item.id].running), "hw-crypto": "false"}


def _port(topology: Topology, item: StoredItem) -> Properties:
    table = topology.store.table("/interface/bridge/port")
    bridge = topology.store.target(table, item, "bridge")
    members = topology.port_members(item)
    is_enabled = topology.store.text(table, item, "disabled") != "yes"
    works = (
        is_enabled
        and topology.up(bridge)
        and any(topology.interfaces[number].is_enabled for number in members if number in topology.interfaces)
    )
    status = "in-bridge" if works else "inactive"
    return {"dynamic": "false", "inactive": _format_bool(not works), "status": status}


def _address(topology: Topology, item: StoredItem) -> Properties:
    local = next(local for local in topology.locals if local.item == item.id)
    address = IPv4Interface(topology.store.text(topology.store.table("/ip/address"), item, "address") or "")
    row = {"network": item.values.get("network", str(address.network.network_address))}
    row["actual-interface"] = topology.name(local.actual if local.actual is not None else local.on)
    return {
        **row,
        "dynamic": "false",
        "invalid": _format_bool(local.actual is None),
        "slave": _format_bool(local.actual != local.on),
    }


def _has_usable_interface(topology: Topology, item: StoredItem, path: str) -> bool:
    table = topology.store.table(path)
    number = topology.store.target(table, item, "interface")
    interface = topology.interfaces.get(number or 0)
    return interface is not None and interface.master is None


def _dhcp_server(topology: Topology, item: StoredItem) -> Properties:
    return {"dynamic": "false", "invalid": _format_bool(not _has_usable_interface(topology, item, "/ip/dhcp-server"))}


def _dhcp_client(topology: Topology, item: StoredItem) -> Properties:
    is_disabled = topology.store.text(topology.store.table("/ip/dhcp-client"), item, "disabled") == "yes"
    fine = _has_usable_interface(topology, item, "/ip/dhcp-client")
    status = "stopped" if is_disabled or not fine else "searching..."
    return {"dynamic": "false", "invalid": _format_bool(not fine), "status": status}


def _lease(_topology: Topology, _item: StoredItem) -> Properties:
    return {"status": "waiting", "last-seen": "never", "radius": "false", "dynamic": "false", "blocked": "false"}


def _route_row(topology: Topology, route: Route) -> Properties:
    hops = [topology.name(via) if hop is None else f"{hop}%{topology.name(via)}" for hop, via in route.hops]
    row = {"immediate-gw": ",".join(hops)} if hops else {}
    flags = {
        "active": _format_bool(route.active),
        "dynamic": _format_bool(route.is_connected),
        "inactive": _format_bool(route.is_enabled and not route.active),
    }
    return {**row, **flags, "connect" if route.is_connected else "static": "true"}


def _route(topology: Topology, item: StoredItem) -> Properties:
    route = next(route for route in topology.routes if route.item == item.id)
    return _route_row(topology, route)


def _table(topology: Topology, item: StoredItem) -> Properties:
    used = any(route.table == item.id for route in topology.routes)
    return {"dynamic": _format_bool(item.dynamic), "invalid": "false", "used": _format_bool(used)}


def _rule(topology: Topology, item: StoredItem) -> Properties:
    """Compute `inactive`: the rule's table or interface was removed."""
    table = topology.store.table("/routing/rule")
    target = topology.store.target(table, item, "table")
    looks_up = (topology.store.text(table, item, "action") or "").startswith("lookup")
    is_missing = looks_up and (target is None or topology.store.table("/routing/table").find(target) is None)
    return {"inactive": _format_bool(is_missing)}


def _firewall(topology: Topology, item: StoredItem) -> Properties:
    """Compute `invalid`: the rule names a removed interface or list."""
    values = [value for name, value in item.values.items() if name.startswith(("in-", "out-"))]
    is_invalid = any("*" in spell(value, topology.store) for value in values)
    return {"bytes": "0", "packets": "0", "dynamic": "false", "invalid": _format_bool(is_invalid)}


def _ntp(topology: Topology, item: StoredItem) -> Properties:
    is_enabled = topology.store.text(topology.store.table("/system/ntp/client"), item, "enabled") == "yes"
    return {"freq-drift": "0", "status": "waiting" if is_enabled else "stopped"}


def _dns(_topology: Topology, _item: StoredItem) -> Properties:
    return {"dynamic-servers": "", "cache-used": "25"}


def _fast_path(family: str) -> Callable[[Topology, StoredItem], Properties]:
    """Return zero counters: there is no fast path here. Assumption: settings-computed."""
    counters = {
        f"{family}-{path}-{name}": value
        for path in ("fast-path", "fasttrack")
        for name, value in (("active", "false"), ("bytes", "0"), ("packets", "0"))
    }
    return lambda _topology, _item: counters


def _snmp(_topology: Topology, _item: StoredItem) -> Properties:
    """Return the engine id (RFC 3411): MikroTik's enterprise number 14988 (IANA), 3a8c, with a text format."""
    return {"engine-id": "80003a8c04"}


def _romon(topology: Topology, item: StoredItem) -> Properties:
    """Return the configured `id`; real devices may use a port address (RoMON). Assumption: settings-computed."""
    local = topology.store.text(topology.store.table("/tool/romon"), item, "id")
    return {"current-id": local or ""}


_COMPUTED_MENUS: dict[str, Callable[[Topology, StoredItem], Properties]] = {
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


def properties(topology: Topology, path: str, item: StoredItem) -> Properties:
    """Return the computed properties of a row."""
    compute = _COMPUTED_MENUS.get(path)
    return compute(topology, item) if compute is not None else {}


def dynamic_rows(topology: Topology, path: str) -> list[Properties]:
    """Return the dynamic rows of a menu; they refuse every command except print."""
    if path == "/ip/route":
        return [_connected_row(topology, route) for route in topology.routes if route.is_connected]
    if path in _DUMMY_CHAINS and _uses_fasttrack(topology.store):
        return [_fasttrack_dummy_row(topology.store, path, chain) for chain in _DUMMY_CHAINS[path]]
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


def _uses_fasttrack(store: RowStore) -> bool:
    table = store.table("/ip/firewall/filter")
    rules = (item for item in table.items if store.text(table, item, "disabled") != "yes")
    return any(store.text(table, item, "action") == "fasttrack-connection" for item in rules)


def _fasttrack_dummy_row(store: RowStore, path: str, chain: str) -> Properties:
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


HIDDEN_TEXT = "*****"
"""Text shown instead of a secret to a group without policy `sensitive`."""
TRAFFIC = tuple(f"{way}-{what}" for what in ("byte", "packet", "drop", "error") for way in ("rx", "tx"))
"""Counters of an interface (Manual, CLI reference, `/interface`). Our own sessions are counted as bytes of their

incoming port; no other traffic passes through an emulated router.
"""
_COUNTERS = ("bytes", "packets", *TRAFFIC)


def applies(store: RowStore, table: Table, item: StoredItem, arg: Arg) -> bool:
    """Return whether an argument currently applies to a row (not `pvid` on a bridge without VLAN filtering)."""
    if arg.shown_if is None:
        return True
    name, expected_value = arg.shown_if
    return store.text(table, item, name) in expected_value.split("|")


def factory_value(item: StoredItem, arg: Arg) -> str | None:
    """Return a row's factory value of an argument, or the default of a new row."""
    return (item.factory or {}).get(arg.name, arg.default)


def _printed_row(store: RowStore, table: Table, item: StoredItem) -> PrintedRow:
    """Return all arguments of a row, cached until its content is replaced."""
    if item.print_cache is None or item.print_cache.values is not item.values:
        args = [arg for arg in table.args.values() if not arg.never and applies(store, table, item, arg)]
        values = {arg.name: item.values.get(arg.name, arg.default) for arg in args}
        row = {arg.name: arg.kind.show(value) for arg in args if (value := values[arg.name]) is not None}
        referring = tuple(arg for arg in args if any(references(values[arg.name] or "")))
        secrets = tuple(arg.name for arg in args if arg.secret and values[arg.name])
        item.print_cache = PrintedRow(item.values, row, referring, secrets)
    return item.print_cache


def item_row(core: Core, path: str, table: Table, item: StoredItem, *, sensitive: bool) -> dict[str, str]:
    """Return one row as the API prints it, counters included."""
    printed_row = _printed_row(core.store, table, item)
    row: dict[str, str] = {} if table.menu.shape is Shape.SETTINGS else {".id": id_text(item.id)}
    row.update(printed_row.row)
    for arg in printed_row.references:
        row[arg.name] = arg.kind.show(spell(item.values[arg.name], core.store))
    if not sensitive:
        row.update(dict.fromkeys(printed_row.secrets, HIDDEN_TEXT))
    row.update(dict.fromkeys(table.menu.flags, "false"))
    if table.menu.builtin_flag:
        row[table.menu.builtin_flag] = "true" if item.factory is not None else "false"
    if item.dynamic:
        row["dynamic"] = "true"
    row.update(properties(core.topology, path, item))
    extra = _OF_CORE.get(path)
    if extra is not None:
        row.update(extra(core, item))
    return row


def _schedule(core: Core, item: StoredItem) -> dict[str, str]:
    """Compute owner and run count; a job blocked by the device-mode is marked only by a comment."""
    row = {"owner": "*sys", "run-count": str(core.run_counts.get(item.id, 0))}
    return row if access.is_allowed(core.spec, "scheduler") else {**row, ".about": access.INACTIVE}


def _clock(core: Core, _item: StoredItem) -> dict[str, str]:
    now = core.time()
    return {
        "time": now.strftime("%H:%M:%S"),
        "date": core.stamp().partition(" ")[0],
        "gmt-offset": "+00:00",
        "dst-active": "false",
    }


def _service(core: Core, _item: StoredItem) -> dict[str, str]:
    return {"dynamic": "false"} if core.schema.at_least("7.19") else {}


def _certificate(core: Core, item: StoredItem) -> dict[str, str]:
    """Compute the certificate's properties; an unsigned template has none."""
    certificate, now = environment.certificate_info(core, item), core.time()
    if certificate is None:
        return {}
    return {
        "serial-number": certificate.serial,
        "fingerprint": certificate.fingerprint,
        "invalid-before": core.stamp(certificate.not_before),
        "invalid-after": core.stamp(certificate.not_after),
        "expires-after": expires_after(certificate.not_after, now),
        "private-key": "true" if certificate.private_key else "false",
        "authority": "true" if certificate.authority else "false",
        "expired": "true" if certificate.not_after < now else "false",
    }


def _ssh_key(core: Core, item: StoredItem) -> dict[str, str]:
    """Compute a key's properties per version (tikoci/quickchr, test/lab/ssh-keys: 7.12, 7.15, 7.20.8, 7.23.1)."""
    key, since = access.public_key(core, item.values.get("key", "")), core.schema.at_least
    if key is None:
        return {}
    row = {"key-type": key.algorithm, **({"bits": str(key.bits)} if since("7.15") else {"RSA": "false"})}
    row |= {"fingerprint": key.fingerprint} if since("7.20.8") else {}
    return row | {"info" if since("7.21") else "key-owner": key.comment}


def _timeout_property(core: Core, item: StoredItem) -> dict[str, str]:
    when = core.expires.get(item.id)
    return {} if when is None else {"timeout": interval(max(0, round(when - core.now())))}


def _netwatch(core: Core, item: StoredItem) -> dict[str, str]:
    """Compute the status; `unknown` if the row is disabled or not started (Manual, Netwatch: status)."""
    row = core.watched.rows.get(item.id)
    if row is None:
        return {"status": "unknown"}
    sent_count, answer_count = row.last
    counts = (
        {"sent-count": sent_count, "response-count": answer_count, "loss-count": sent_count - answer_count}
        if row.test_count
        else {}
    )
    tests = {"done-tests": row.test_count, "failed-tests": row.failure_count}
    state = {"status": row.status, "since": core.stamp(core.moment(row.since))}
    return state | {name: str(count) for name, count in (tests | counts).items()}


def _packet_counter(path: str) -> Callable[[Core, StoredItem], dict[str, str]]:
    def count_packets(core: Core, item: StoredItem) -> dict[str, str]:
        if core.live is None and path not in _COUNTING_MENUS:
            return {}
        packets, octets = core.met.get((path, item.id), (0, 0))
        return {"packets": str(packets), "bytes": str(octets)}

    return count_packets


_COUNTING_MENUS = ("/ip/firewall/filter", "/ip/firewall/mangle")
"""Menus whose rules count packets without a live data plane."""
_OF_CORE: dict[str, Callable[[Core, StoredItem], dict[str, str]]] = {
    "/certificate": _certificate,
    "/ip/firewall/address-list": _timeout_property,
    "/ip/dhcp-server/alert": environment.alert,
    "/ip/dhcp-server/lease": environment.lease,
    "/ip/firewall/filter": _packet_counter("/ip/firewall/filter"),
    "/ip/firewall/mangle": _packet_counter("/ip/firewall/mangle"),
    "/ip/firewall/nat": _packet_counter("/ip/firewall/nat"),
    "/ip/firewall/raw": _packet_counter("/ip/firewall/raw"),
    "/ip/service": _service,
    "/system/clock": _clock,
    "/system/ntp/client": environment.ntp,
    "/system/scheduler": _schedule,
    "/tool/netwatch": _netwatch,
    "/user/ssh-keys": _ssh_key,
}


def made_rows(core: Core, path: str) -> list[dict[str, str]]:
    """Return the rows that the router creates; they refuse every command except print."""
    if path == "/ip/service" and core.schema.at_least("7.19"):
        return [_connection(core, caller) for caller in core.sessions.values()]
    lacking = _lacking(core, path)
    return [
        {name: value for name, value in row.items() if name not in lacking}
        for row in (
            *dynamic_rows(core.topology, path),
            *modem_rows(core, path),
            *environment.tunnel_addresses(core, path),
        )
    ]


def _lacking(core: Core, path: str) -> set[str]:
    """Return the properties that this version lacks: RouterOS 6 has no `routing-table`."""
    table = core.store.table(path)
    return set(table.menu.by_name) - set(table.args)


def _connection(core: Core, caller: Caller) -> dict[str, str]:
    """Return the row of a service connection; from 7.19 `/ip/service` lists them (Manual, Services)."""
    return {
        ".id": id_text(core.store.dynamic_id("/ip/service", "session", caller.number)),
        "name": caller.via,
        "proto": "tcp",
        "local": core.spec.management.local,
        "remote": caller.address,
        "connection": "true",
        "dynamic": "true",
        "disabled": "false",
        "invalid": "false",
    }


def rows(core: Core, path: str, *, sensitive: bool = True) -> list[dict[str, str]]:
    """Return all rows of a menu; dynamic ones first where RouterOS lists them first."""
    if core.live is not None:
        core.live.count_packets(path)
    table = core.store.table(path)
    local = [item_row(core, path, table, item, sensitive=sensitive) for item in table.items]
    extra_rows = made_rows(core, path)
    return [*extra_rows, *local] if path.startswith("/ip/firewall/") else [*local, *extra_rows]


def without_counters(row: dict[str, str]) -> dict[str, str]:
    """Remove the counters, which `print` shows only with `stats`."""
    return {name: value for name, value in row.items() if name not in _COUNTERS}
