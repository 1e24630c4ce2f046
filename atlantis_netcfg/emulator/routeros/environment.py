"""Surroundings of an emulated router and how it shows them: neighbours, PoE loads, the far end of a VPN.

These are facts of the place and no settings: no command changes them, but a rehearsal can, by the emulator's control.
The names of fields are those of the manual (PoE-Out, DHCP, Neighbor discovery, OVPN, NTP).

Assumption: poe-load
"""

from __future__ import annotations

from dataclasses import replace
from ipaddress import IPv4Address, IPv4Interface
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.emulator.routeros.certificates import CertificateInfo, read_certificate
from atlantis_netcfg.emulator.routeros.core import Core, connected_clients
from atlantis_netcfg.emulator.routeros.spec import Environment
from atlantis_netcfg.emulator.routeros.values import id_text

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.emulator.routeros.store import StoredItem


__all__ = []


_Row = dict[str, str]


def update_surroundings(core: Core, changes: Mapping[str, Any]) -> dict[str, Any]:
    """Change the surroundings of a running router; omitted values are kept. Raises ValueError for invalid ones."""
    around = Environment.model_validate({**core.spec.around.model_dump(), **changes})
    core.spec = core.spec.model_copy(update={"around": around})
    core.store.revision += 1
    return around.model_dump(mode="json")


def mac_of(core: Core, address: IPv4Address) -> str:
    """Return the MAC address of an IP address; derived from it if the surroundings define none."""
    result = core.spec.around.cards.get(str(address))
    return (result or f"02:00:5E:10:{int(address) >> 8 & 255:02X}:{int(address) & 255:02X}").upper()


def tunnel_addresses(core: Core, path: str) -> list[_Row]:
    """Return the addresses assigned by the VPN server."""
    if path != "/ip/address":
        return []
    return [_tunnel_address(core, number) for number in sorted(connected_clients(core)) if core.topology.up(number)]


def _tunnel_address(core: Core, number: int) -> _Row:
    name = core.topology.name(number)
    tunnel_address = IPv4Interface(core.spec.around.tunnels[name])
    local = {"address": str(tunnel_address), "network": str(tunnel_address.network.network_address), "interface": name}
    flags = {"invalid": "false", "slave": "false", "dynamic": "true", "disabled": "false"}
    return {".id": id_text(core.store.dynamic_id("/ip/address", "ovpn", number)), **local} | {
        "actual-interface": name,
        **flags,
    }


def certificate_info(core: Core, item: StoredItem) -> CertificateInfo | None:
    """Return the contents of a `/certificate` row, with the validity that is shown; None for an unsigned template."""
    pem = core.keys.get(item.id)
    if pem is None:
        return None
    name = core.store.text(core.store.table("/certificate"), item, "name") or ""
    validity = core.spec.around.validity.get(name)
    result = read_certificate(pem)
    return result if validity is None else replace(result, not_before=validity.since, not_after=validity.until)


def alert(core: Core, item: StoredItem) -> _Row:
    """Return the unknown DHCP servers on the interface of a `/ip/dhcp-server/alert` row."""
    table = core.store.table("/ip/dhcp-server/alert")
    place = core.store.text(table, item, "interface") or ""
    valid = (core.store.text(table, item, "valid-server") or "").upper().split(",")
    on = core.store.text(table, item, "disabled") != "yes"
    strangers = [mac.upper() for mac in core.spec.around.dhcp_servers.get(place, ()) if on and mac.upper() not in valid]
    return {"unknown-server": ",".join(strangers)} if strangers else {}


def lease(core: Core, item: StoredItem) -> _Row:
    """Return whether the device of a static lease currently holds it."""
    table = core.store.table("/ip/dhcp-server/lease")
    address, mac, server = (core.store.text(table, item, name) or "" for name in ("address", "mac-address", "server"))
    status = core.spec.around.leases.get(address)
    if status is None:
        return {}
    if status != "bound":
        return {"status": status}
    bound = {"active-address": address, "active-mac-address": mac, "active-server": server}
    return {"status": "bound", "expires-after": "45m", "last-seen": "15m", **bound}


def ntp(core: Core, _item: StoredItem) -> _Row:
    """Return whether a configured server has set the clock, for `/system/ntp/client`."""
    server = core.spec.around.time_server if core.live is None else core.live.time_server()
    client, servers = core.store.table("/system/ntp/client"), core.store.table("/system/ntp/client/servers")
    on = any(core.store.text(client, item, "enabled") == "yes" for item in client.items)
    there = {core.store.text(servers, item, "address") for item in servers.items}
    if not on or server is None or server not in there:
        return {}
    return {"status": "synchronized", "synced-server": server, "synced-stratum": "2", "system-offset": "0.412"}


def heard_names(core: Core) -> list[_Row]:
    """Return the rows of `/ip/neighbor`: names on interfaces with discovery."""
    settings = core.store.table("/ip/neighbor/discovery-settings")
    result = []
    for number, neighbour in enumerate(core.spec.around.called, start=1):
        interface = core.topology.by_name(neighbour.interface)
        if (
            interface is None
            or not core.topology.up(interface.id)
            or not _listens(core, settings.items[0], interface.id)
        ):
            continue
        address = {} if neighbour.address is None else {"address": neighbour.address, "address4": neighbour.address}
        row = {
            ".id": id_text(number),
            "interface": neighbour.interface,
            **address,
            "mac-address": neighbour.mac.upper(),
        }
        row |= {
            "identity": neighbour.identity,
            "platform": neighbour.platform,
            "version": neighbour.version,
            "board": neighbour.board,
        }
        result.append({**row, "age": "12s", "discovered-by": "mndp", "unpack": "none"})
    return result


def _listens(core: Core, settings: StoredItem, interface: int) -> bool:
    """Return whether discovery is active on an interface; `discover-interface-list` may start with `!`."""
    table = core.store.table("/ip/neighbor/discovery-settings")
    number = core.store.target(table, settings, "discover-interface-list")
    text = core.store.text(table, settings, "discover-interface-list") or ""
    is_member = number is not None and core.topology.is_in_list(number, interface)
    return not is_member if text.startswith("!") else is_member


def load_of(core: Core, port: str, setting: str) -> _Row:
    """Return status and values of `/interface/ethernet/poe/monitor` for a port (Manual, PoE-Out)."""
    load = core.spec.around.loads.get(port)
    if setting == "off":
        return {"poe-out-status": "off"}
    if load is None:
        return {"poe-out-status": "waiting-for-load"}
    if load.status is not None:
        return {"poe-out-status": load.status}
    watts = load.volts * load.milliamps / 1000
    figures = {"poe-out-voltage": f"{load.volts:g}V", "poe-out-current": f"{load.milliamps}mA"}
    return {"poe-out-status": "powered-on", **figures, "poe-out-power": f"{watts:.1f}W"}
