"""Menus without a table: the router's own state, and `/interface`, which shows rows of other menus."""

from __future__ import annotations

import re
from ipaddress import IPv4Address
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.access import FEATURES, is_allowed
from atlantis_netcfg.emulator.routeros.commands.radio import registrations
from atlantis_netcfg.emulator.routeros.environment import heard_names, mac_of
from atlantis_netcfg.emulator.routeros.software import package_file
from atlantis_netcfg.emulator.routeros.spec import Deviation
from atlantis_netcfg.emulator.routeros.values import id_text, interval
from atlantis_netcfg.emulator.routeros.views import TRAFFIC, type_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from atlantis_netcfg.emulator.routeros.core import Call, Core
    from atlantis_netcfg.emulator.routeros.network.topology import Interface
    from atlantis_netcfg.emulator.routeros.store import StoredItem, Table

Rows = list[dict[str, str]]
_CPUS = "4"
_ID = re.compile(r"\*[0-9A-F]+")

_DISK = 1073741824
"""Disk size of an RB5009UPr+S+ in bytes."""


def _format_bool(value: object) -> str:
    return "true" if value else "false"


def _interfaces(core: Core, _call: Call) -> Rows:
    octets = {} if core.live is None else core.live.octets()
    numbered_rows = [
        (item.id, _interface(core, table, item, core.topology.interfaces[item.id], octets))
        for table in core.store.space_tables("interface")
        for item in table.items
    ]
    return [row for _, row in sorted(numbered_rows, key=lambda pair: pair[0])]


def _interface(
    core: Core, table: Table, item: StoredItem, interface: Interface, octets: Mapping[int, tuple[int, int]]
) -> dict[str, str]:
    mtu = core.store.text(table, item, "mtu") or "1500"
    row = {".id": id_text(item.id), "name": interface.name, "type": type_of(interface), "mtu": mtu}
    row["actual-mtu"] = "1500" if mtu == "auto" else mtu
    if (mac := core.store.text(table, item, "mac-address")) is not None:
        row["mac-address"] = mac
    if item.factory is not None and table.menu.path != "/interface":
        row["default-name"] = item.factory["name"]
    if (comment := core.store.text(table, item, "comment")) is not None:
        row["comment"] = comment
    flags = {"running": interface.running, "disabled": not interface.is_enabled}
    if interface.master is not None:
        flags["slave"] = True
    by_model, live = core.octets.get(row.get("default-name", ""), (0, 0)), octets.get(item.id, (0, 0))
    traffic = dict.fromkeys(TRAFFIC, "0") | {
        "rx-byte": str(by_model[0] + live[0]),
        "tx-byte": str(by_model[1] + live[1]),
    }
    return row | traffic | {name: _format_bool(value) for name, value in flags.items()}


def _update(core: Core, _call: Call) -> Rows:
    """Return channel and installed version; no update check was made (Manual, Upgrading and installation)."""
    return [{"channel": "stable", "installed-version": core.spec.version}]


def _cpus(_core: Core, _call: Call) -> Rows:
    load = {"load": "1", "irq": "0", "disk": "0"}
    return [{".id": id_text(number), "cpu": f"cpu{number}", **load} for number in range(int(_CPUS))]


def _resource(core: Core, _call: Call) -> Rows:
    spec = core.spec
    return [
        {
            "uptime": interval(int(core.now() - core.started)),
            "version": f"{spec.version} (stable)" if spec.version.replace(".", "").isdecimal() else spec.version,
            "build-time": core.stamp(spec.clock),
            "factory-software": "7.8",
            "free-memory": "917504000",
            "total-memory": "1073741824",
            "cpu": spec.architecture.upper(),
            "cpu-count": _CPUS,
            "cpu-frequency": "700",
            "cpu-load": "1",
            "free-hdd-space": str(core.free_space()),
            "total-hdd-space": str(max(spec.disk_bytes, _DISK)),
            "architecture-name": spec.architecture,
            "board-name": spec.board,
            "platform": "MikroTik",
        }
    ]


def _routerboard(core: Core, _call: Call) -> Rows:
    firmware = dict.fromkeys(("current-firmware", "upgrade-firmware"), core.spec.version)
    board = {"routerboard": "true", "board-name": core.spec.board, "model": core.spec.board}
    return [board | {"serial-number": core.spec.serial_number, "factory-firmware": "7.8"} | firmware]


def _packages(core: Core, _call: Call) -> Rows:
    stamp = core.stamp(core.spec.clock)
    return [
        {
            ".id": id_text(number),
            "name": name,
            "version": core.spec.version,
            "build-time": stamp,
            "scheduled": "",
            "disabled": "false",
        }
        for number, name in enumerate(core.spec.packages, start=1)
    ]


def _device_mode(core: Core, _call: Call) -> Rows:
    mode = core.spec.device_mode
    arguments = core.schema.arguments("/system/device-mode", "update")
    features = {name: _format_bool(is_allowed(core.spec, name)) for name in FEATURES if name in arguments}
    mode_name = mode.mode.value if core.schema.at_least("7.17") else "enterprise"
    return [{"mode": mode_name, "flagged": _format_bool(mode.is_flagged), "flagging-enabled": "true", **features}]


def _history(core: Core, _call: Call) -> Rows:
    entries = core.history.entries if core.deviates(Deviation.HISTORY_ORDER) else reversed(core.history.entries)
    nameless = core.deviates(Deviation.HISTORY_NAMES)
    return [
        {
            ".id": id_text(entry.number),
            "action": entry.action,
            "by": entry.by,
            "policy": entry.policy,
            "time": entry.time,
            "undo": _ID.sub("0", entry.undo) if nameless else entry.undo,
            "redo": _ID.sub("0", entry.redo) if nameless else entry.redo,
            "undoable": _format_bool(not entry.undone),
            "redoable": _format_bool(entry.undone),
            "floating-undo": _format_bool(entry.floating),
        }
        for entry in entries
    ]


def _active_users(core: Core, _call: Call) -> Rows:
    rows = [
        {
            ".id": id_text(caller.number),
            "when": core.stamp(core.moment(caller.since)),
            "name": caller.user,
            "address": caller.address,
            "via": "api" if caller.via == "api-ssl" else caller.via,
            "group": caller.group,
            "radius": "false",
        }
        for caller in core.sessions.values()
    ]
    return rows[::-1] if core.deviates(Deviation.SESSIONS) else rows


def _safe_mode(core: Core, call: Call) -> Rows:
    holder = core.history.holder
    if holder is None:
        return [{"enabled": "false", "current": "false"}]
    current = holder.number == call.caller.number
    owner = f"{holder.via}:{holder.user}@{holder.address}"
    return [{"enabled": "true", "user": holder.user, "current": _format_bool(current), "owner": owner}]


def _files(core: Core, _call: Call) -> Rows:
    return [
        {
            ".id": id_text(file.number),
            "name": name,
            "last-modified": file.modified_at,
            **({"type": "directory"} if file.folder else _file(name, file.contents)),
        }
        for name, file in sorted(core.files.items())
    ]


def _file(name: str, contents: str) -> dict[str, str]:
    return {
        "type": next((kind for ending, kind in _FILE_TYPES.items() if name.endswith(ending)), ".txt file"),
        "size": str(len(contents.encode(errors="surrogateescape"))),
        **_contents(name, contents),
    }


_FILE_TYPES = {".rsc": "script", ".backup": "backup", ".npk": "package"}


def _contents(name: str, contents: str) -> dict[str, str]:
    """Return a file's text; for a package its header, for a damaged one nothing (Manual, Files)."""
    if not name.endswith(".npk"):
        return {"contents": contents}
    package = package_file(contents)
    if package is None:
        return {}
    return {
        "package-name": package.name,
        "package-version": package.version,
        "package-architecture": package.architecture,
    }


def _log(core: Core, _call: Call) -> Rows:
    return [
        {".id": id_text(line.number), "time": line.time, "topics": line.topics, "message": line.message}
        for line in core.log
    ]


def _poe(core: Core, _call: Call) -> Rows:
    table = core.store.table("/interface/ethernet")
    names = [name for name in table.args if name.startswith(("poe-", "power-cycle"))]
    return [
        {".id": id_text(item.id), "name": core.store.text(table, item, "name") or ""}
        | {name: table.args[name].kind.show(value) for name in names if (value := core.store.text(table, item, name))}
        for item in table.items
        if (item.factory or {})["name"] in core.spec.poe_ports
    ]


def _arp(core: Core, _call: Call) -> Rows:
    """Return the ARP entries: neighbours of the spec in a local network that respond.

    Names of fields: Manual, ARP. A real entry ages when nothing is sent. Assumption: arp-entry
    """
    neighbours = []
    for local in core.topology.locals:
        if not local.works or local.actual is None:
            continue
        for text in core.spec.answering:
            address = IPv4Address(text)
            if address in local.network and address != local.address.ip and core.topology.up(local.actual):
                neighbours.append((core.topology.name(local.actual), address))
    return [
        {
            ".id": id_text(number),
            "address": str(address),
            "mac-address": mac_of(core, address),
            "interface": interface,
            "published": "false",
            "status": "reachable",
            "invalid": "false",
            "DHCP": "false",
            "dynamic": "true",
            "complete": "true",
            "disabled": "false",
        }
        for number, (interface, address) in enumerate(neighbours, start=1)
    ]


def _bridge_hosts(core: Core, _call: Call) -> Rows:
    """Return hosts learned on bridge ports, and the ports' own addresses, which are `local` (Manual, Bridge)."""
    bridge_ports, ethernet = core.store.table("/interface/bridge/port"), core.store.table("/interface/ethernet")
    cards = {item.id: item for item in ethernet.items}
    hosts = []
    for item in bridge_ports.items:
        bridge = core.store.target(bridge_ports, item, "bridge")
        for number in core.topology.port_members(item):
            if number not in cards or not core.topology.up(bridge) or not core.topology.interfaces[number].running:
                continue
            place = {"on-interface": core.topology.name(number), "bridge": core.topology.name(bridge)}
            card = cards[number]
            macs = core.spec.around.plugged.get((card.factory or {})["name"], ())
            hosts.append((core.store.text(ethernet, card, "mac-address") or "", place, True))
            hosts += [(mac.upper(), place, False) for mac in macs]
    flags = {"dynamic": "true", "invalid": "false", "external": "false", "disabled": "false"}
    return [
        {".id": id_text(number), "mac-address": mac, **place, "local": _format_bool(local), **flags}
        for number, (mac, place, local) in enumerate(hosts, start=1)
    ]


def connections(core: Core, _call: Call) -> Rows:
    """Return the tracked connections of a live data plane."""
    rows = [] if core.live is None else core.live.connections()
    return [{".id": id_text(number), **row} for number, row in enumerate(rows, start=1)]


COMPUTED_MENUS: dict[str, Callable[[Core, Call], Rows]] = {
    "/file": _files,
    "/interface": _interfaces,
    "/interface/bridge/host": _bridge_hosts,
    "/interface/ethernet/poe": _poe,
    "/interface/wifi/registration-table": registrations,
    "/interface/wireless/registration-table": registrations,
    "/ip/arp": _arp,
    "/ip/firewall/connection": connections,
    "/ip/neighbor": lambda core, _call: heard_names(core),
    "/log": _log,
    "/safe-mode": _safe_mode,
    "/system/device-mode": _device_mode,
    "/system/history": _history,
    "/system/package": _packages,
    "/system/package/update": _update,
    "/system/resource": _resource,
    "/system/resource/cpu": _cpus,
    "/system/routerboard": _routerboard,
    "/user/active": _active_users,
}
