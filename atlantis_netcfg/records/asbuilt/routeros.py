"""Queries to a RouterOS device about itself, sent together after the login, and the parsing of its replies.

Names of fields: Manual, Resource; RouterBOARD; Neighbor discovery; Bridge, Hosts table; ARP; DHCP; Ethernet, monitor.
Neighbours of a port come from four menus, joined by MAC: the bridge has the port, ARP and leases the address, neighbour
discovery the name. Discovery is off where the site's template is applied, which the record states.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.links.lte.routeros import monitor_query
from atlantis_netcfg.operations.links.session import command, rows
from atlantis_netcfg.records.asbuilt.record import CableState, Fact, Origin, PortNeighbour, PortRecord, mask_number
from atlantis_netcfg.routeros.api import Command

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from atlantis_netcfg.inventory.model import NumberMask
    from atlantis_netcfg.routeros._types import Row
    from atlantis_netcfg.routeros.api import Reply

_MENUS: Mapping[str, tuple[str, tuple[str, ...], tuple[str, ...]]] = {
    "resource": ("/system/resource", ("version", "board-name"), ()),
    "board": ("/system/routerboard", ("routerboard", "model", "serial-number", "current-firmware"), ()),
    "interfaces": ("/interface", ("name", "default-name", "type", "mac-address", "running", "disabled"), ()),
    "discovery": ("/ip/neighbor/discovery-settings", ("discover-interface-list",), ()),
    "discovered": ("/ip/neighbor", ("interface", "mac-address", "address", "identity", "board", "version"), ()),
    "bridge": ("/interface/bridge/host", ("mac-address", "on-interface", "local"), ()),
    "arp": ("/ip/arp", ("address", "mac-address", "interface", "complete"), ()),
    "leases": ("/ip/dhcp-server/lease", ("active-address", "active-mac-address", "host-name"), ("?status=bound",)),
}
"""Menus to read, with their properties and rows."""
_REQUIRED_MENUS = ("resource", "interfaces")
"""Menus that every RouterOS has: if one is refused, the record is incomplete."""
_NAME_KEYS = ("identity", "board", "version")
_RADIOS = frozenset({"wlan", "wifi"})
_PORTS = frozenset({"ether", "lte", *_RADIOS})
_TRUE = frozenset({"true", "yes"})


@dataclass(frozen=True, slots=True)
class RouterOsFacts:
    """The facts that one device reported."""

    facts: Mapping[str, Fact]
    ports: tuple[PortRecord, ...]
    elsewhere: tuple[PortNeighbour, ...]
    missing: tuple[str, ...] = ()
    """Refused menus, with the device's error text."""
    notes: tuple[str, ...] = ()


def questions(ports: Sequence[str], modem: str | None) -> tuple[Command, ...]:
    """Return all commands sent after the login; `ports` by factory names, `modem` if the board has one."""
    menus = [
        Command(f"{path}/print", ((".proplist", ",".join(names)),), where) for path, names, where in _MENUS.values()
    ]
    links = [Command("/interface/ethernet/monitor", (("numbers", port), ("once", ""))) for port in ports]
    return (*menus, *links, *((command(monitor_query(modem)),) if modem is not None else ()))


def read(
    replies: Sequence[Reply],
    ports: Sequence[str],
    modem: str | None,
    mask: NumberMask,
    host_by_address: Mapping[str, str],
) -> RouterOsFacts:
    """Parse the replies to `questions`, in order; `host_by_address` maps MAC or IP address to host or link."""
    menus = dict(zip(_MENUS, replies, strict=False))
    links = dict(zip(ports, replies[len(_MENUS) :], strict=False))
    rows_by_menu = {name: rows(reply) or () for name, reply in menus.items()}
    system = _first(rows_by_menu["resource"]) | _first(rows_by_menu["board"])
    monitor_reply = replies[len(_MENUS) + len(ports)] if modem is not None else None
    interfaces = [row for row in rows_by_menu["interfaces"] if row.get("type") in _PORTS and "default-name" in row]
    neighbours = _merge_neighbours(rows_by_menu, host_by_address)
    port_records = tuple(_port(row, links.get(row["default-name"]), neighbours) for row in interfaces)
    names = {row.get("name") for row in interfaces}
    return RouterOsFacts(
        facts={**_system_facts(system), **_modem(monitor_reply, mask)},
        ports=port_records,
        elsewhere=tuple(item.record for item in neighbours if item.interface not in names),
        missing=tuple(_refusals(menus, _REQUIRED_MENUS)),
        notes=tuple(_notes(rows_by_menu, menus, interfaces)),
    )


def _refusals(menus: Mapping[str, Reply], names: Sequence[str]) -> Iterator[str]:
    """Yield the menus that the device refused, with its message."""
    for name in names:
        trap = menus[name].trap
        if trap is not None:
            yield msg(f"the device refuses {arg(_MENUS[name][0])}: {arg(trap.message)}")


def _first(menu: Sequence[Row]) -> dict[str, str]:
    return dict(menu[0]) if menu else {}


def _system_facts(system: Mapping[str, str]) -> dict[str, Fact]:
    model = system.get("model") or system.get("board-name")
    return {
        "model": _fact(model, "the device reports no model"),
        "serial": _fact(system.get("serial-number"), "the board reports no serial number"),
        "version": _fact(system.get("version"), "the device reports no version"),
        "boot_firmware": _fact(system.get("current-firmware"), "the board has no boot loader of its own"),
    }


def _fact(value: str | None, why_not: str) -> Fact:
    return Fact(value=value, origin=Origin.READ) if value else Fact(value=None, origin=Origin.NOT_READ, note=why_not)


def _modem(reply: Reply | None, mask: NumberMask) -> dict[str, Fact]:
    """Return a modem's model and firmware, and its and its SIM's numbers, masked as required."""
    if reply is None:
        return {}
    row = _first(rows(reply) or ())
    silent = "the modem does not report it now"
    model = " ".join(row[name] for name in ("manufacturer", "model") if row.get(name))
    numbers = {name: mask_number(row[name], mask) if row.get(name) else None for name in ("imei", "iccid")}
    modem_facts = {"modem": _fact(model, silent), "modem_firmware": _fact(row.get("revision"), silent)}
    return modem_facts | {name: _fact(number, silent) for name, number in numbers.items()}


@dataclass(slots=True)
class _NeighbourReading:
    """The data of one MAC address, merged from several menus."""

    mac: str
    interface: str = ""
    by: list[str] = field(default_factory=list)
    address: str | None = None
    name: str | None = None
    declared_host: str | None = None

    @property
    def record(self) -> PortNeighbour:
        return PortNeighbour(
            mac=self.mac, by=tuple(self.by), address=self.address, name=self.name, declared=self.declared_host
        )


def _merge_neighbours(
    rows_by_menu: Mapping[str, Sequence[Row]], host_by_address: Mapping[str, str]
) -> list[_NeighbourReading]:
    """Return every neighbour once; for the port, the bridge's entry precedes that of ARP, which names the bridge."""
    everyone: dict[str, _NeighbourReading] = {}
    for each in _find_neighbours(rows_by_menu):
        item = everyone.setdefault(each.mac, each)
        item.by = list(dict.fromkeys((*item.by, *each.by)))
        item.interface = item.interface or each.interface
        item.address = item.address or each.address
        item.name = item.name or each.name
    for item in everyone.values():
        item.declared_host = host_by_address.get(item.mac) or host_by_address.get(item.address or "")
    return sorted(everyone.values(), key=lambda item: item.mac)


def _find_neighbours(rows_by_menu: Mapping[str, Sequence[Row]]) -> Iterator[_NeighbourReading]:
    """Yield each row as a neighbour, the menus in order of reliability."""
    for row in rows_by_menu["bridge"]:
        if row.get("mac-address") and row.get("local") not in _TRUE:
            yield _NeighbourReading(row["mac-address"].upper(), row.get("on-interface", ""), ["bridge"])
    for row in rows_by_menu["discovered"]:
        if row.get("mac-address"):
            # A port of a bridge is named with it: `ether4,bridge-lan`.
            port, name = (
                row.get("interface", "").partition(",")[0],
                " ".join(row[key] for key in _NAME_KEYS if row.get(key)),
            )
            by = ["neighbour discovery"]
            yield _NeighbourReading(row["mac-address"].upper(), port, by, row.get("address") or None, name or None)
    for row in rows_by_menu["leases"]:
        if row.get("active-mac-address"):
            mac, address = row["active-mac-address"].upper(), row.get("active-address")
            yield _NeighbourReading(mac, "", ["DHCP lease"], address, row.get("host-name") or None)
    for row in rows_by_menu["arp"]:
        if row.get("mac-address") and row.get("complete", "true") in _TRUE:
            yield _NeighbourReading(row["mac-address"].upper(), row.get("interface", ""), ["ARP"], row.get("address"))


def _port(row: Row, monitor_reply: Reply | None, neighbours: Sequence[_NeighbourReading]) -> PortRecord:
    status = _first(rows(monitor_reply) or ()) if monitor_reply is not None else {}
    link = {"link-ok": CableState.UP, "no-link": CableState.DOWN}.get(status.get("status", ""))
    if link is None:
        link = (
            CableState.UNKNOWN
            if "running" not in row
            else CableState.UP
            if row["running"] in _TRUE
            else CableState.DOWN
        )
    port_name = row.get("name", row["default-name"])
    return PortRecord(
        name=row["default-name"],
        mac=(row.get("mac-address") or "").upper() or None,
        link=link,
        speed=status.get("rate") if link is CableState.UP else None,
        neighbours=tuple(item.record for item in neighbours if item.interface == port_name),
    )


def _notes(
    rows_by_menu: Mapping[str, Sequence[Row]], menus: Mapping[str, Reply], interfaces: Sequence[Row]
) -> Iterator[str]:
    """Yield the reasons why neighbours may be missing."""
    listens = _first(rows_by_menu["discovery"]).get("discover-interface-list")
    if listens == "none":
        yield "neighbour discovery is off on the device, so it learns no names"
    yield from _refusals(menus, ("board", "bridge", "arp"))
    rename_notes = [
        msg(f"{arg(row['default-name'])} is called {arg(row['name'])}")
        for row in interfaces
        if row["default-name"] != row["name"]
    ]
    yield from rename_notes
