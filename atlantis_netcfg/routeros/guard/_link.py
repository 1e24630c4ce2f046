"""The router's address and the ports for the technician's cable."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.routeros.guard import _state
from atlantis_netcfg.routeros.guard._route import return_route
from atlantis_netcfg.routeros.menus import MENUS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.routeros._types import Row

_TUNNEL = "/interface/ovpn-client"


def interfaces(state: _state.State) -> frozenset[str]:
    """Return the interfaces on the path, bridge members included."""
    row = state.address_row()
    names = {return_route(state).interface, row.get("interface") if row is not None else None} - {None}
    members = {port.get("interface") for port in state.all("/interface/bridge/port") if port.get("bridge") in names}
    return frozenset(name for name in names | members if name)


def objections(before: _state.State, after: _state.State) -> Iterator[str]:
    """Yield changes to our address, its interface and the ports behind it."""
    row = before.address_row()
    if row is None or _state.is_set(row, "disabled"):
        return
    yield from _address(before, after, row)
    for name in sorted({row.get("interface", ""), return_route(before).interface or ""} - {""}):
        yield from _ports(before, after, name)
    yield from _vlans(before, after)
    yield from _dhcp(before, after, row)
    yield from _tunnel(before, after)


def _address(before: _state.State, after: _state.State, row: Row) -> Iterator[str]:
    now = after.address_row()
    name = MENUS["/ip/address"].name_of(row)
    if now is None:
        yield f"/ip address: {name}, which your session uses, would be removed: add it to the inventory"
    elif _state.is_set(now, "disabled"):
        yield f"/ip address: {name}, which your session uses, would be disabled: leave it enabled"
    elif _is_cut_off(before, after, row.get("interface", ""), now.get("interface", "")):
        yield (
            f"/ip address: {before.path.local}, which your session uses, would move from {row.get('interface')} to "
            f"{now.get('interface')}, where your cable is not plugged in: run this from another port, or correct "
            f"the ports in the inventory"
        )


def _is_cut_off(before: _state.State, after: _state.State, old: str, new: str) -> bool:
    """Return True if the address moves to an interface that some previously usable port does not reach."""
    there = after.interface(new)
    has_moved = there is not None and _identity(before, old) != _state.identity(*there)
    return has_moved and not before.ports(old) <= after.ports(new)


def _identity(state: _state.State, name: str) -> str:
    interface = state.interface(name)
    return _state.identity(*interface) if interface is not None else name


def _ports(before: _state.State, after: _state.State, name: str) -> Iterator[str]:
    """Yield changes to an interface of the path, and to the bridge ports behind it."""
    interface = before.interface(name)
    if interface is None:
        return
    menu, row = interface
    now = next((each for each in after.all(menu) if each.get(".id") == row.get(".id")), None)
    title = MENUS[menu].title
    if now is None:
        yield msg(f"{arg(title)}: {arg(name)}, which your session uses, would be removed: add it to the inventory")
    elif _state.is_set(now, "disabled") and not _state.is_set(row, "disabled"):
        yield msg(f"{arg(title)}: {arg(name)}, which your session uses, would be disabled: leave it enabled")
    elif (bridge := after.bridge_of(now.get("name", name))) and before.bridge_of(name) != bridge:
        yield from _check_bridge_join(before, after, name, bridge)
    else:
        lost_ports = before.ports(name) - after.ports(now.get("name", name))
        yield from (_describe_lost_port(before, name, port) for port in sorted(lost_ports))


def _check_bridge_join(before: _state.State, after: _state.State, name: str, bridge: str) -> Iterator[str]:
    """Yield an objection if a port joins a bridge that does not have our address afterwards."""
    now = after.address_row()
    if now is None or now.get("interface") != bridge:
        yield (
            f"/interface bridge port: {name}, by which you come, would join {bridge}, and {before.path.local} on it "
            f"would no longer answer: keep {name} out of the bridge, or move the address to {bridge}"
        )


def _describe_lost_port(before: _state.State, bridge: str, port: str) -> str:
    names = {
        _state.identity(menu, row): row.get("name", port) for menu in _state.INTERFACES for row in before.all(menu)
    }
    return (
        f"/interface bridge port: {names.get(port, port)} would no longer lead to {bridge}, and your cable may be in "
        f"it: keep it in the bridge and enabled"
    )


def _vlans(before: _state.State, after: _state.State) -> Iterator[str]:
    """Yield an objection if a bridge starts VLAN filtering: we do not read the VLAN table that admits traffic."""
    for row in before.all("/interface/bridge"):
        now = next((each for each in after.all("/interface/bridge") if each.get(".id") == row.get(".id")), row)
        name = row.get("name")
        if (
            name in interfaces(before)
            and _state.is_set(now, "vlan-filtering")
            and not _state.is_set(row, "vlan-filtering")
        ):
            text = f"/interface bridge: {name}, by which you come, would begin to filter VLANs"
            yield msg(f"{arg(text)}: do that from another port")


def _dhcp(before: _state.State, after: _state.State, row: Row) -> Iterator[str]:
    """Yield an objection if the DHCP client of our dynamic address is lost."""
    name = row.get("interface", "")
    if not _state.is_set(row, "dynamic") or name not in {
        each.get("interface") for each in before.enabled_rows("/ip/dhcp-client")
    }:
        return
    client_identities = {_identity(after, each.get("interface", "")) for each in after.enabled_rows("/ip/dhcp-client")}
    if _identity(before, name) not in client_identities:
        address = before.path.local
        yield f"/ip dhcp-client: the client on {name} gave the router {address}, and would go: keep it enabled"


def _tunnel(before: _state.State, after: _state.State) -> Iterator[str]:
    """Yield an objection if the tunnel that carries our session is changed."""
    for row in before.enabled_rows(_TUNNEL):
        if row.get("name") not in interfaces(before):
            continue
        now = next((each for each in after.all(_TUNNEL) if each.get(".id") == row.get(".id")), None)
        fields = [each.name for each in MENUS[_TUNNEL].fields if each.name not in ("comment", "name", "disabled")]
        changed_fields = [name for name in fields if now is not None and _form(name, row) != _form(name, now)]
        if changed_fields:
            yield (
                f"/interface ovpn-client: {row.get('name')} carries your session, "
                f"and its {', '.join(changed_fields)} would "
                f"change: change that from the site"
            )


def _form(name: str, row: Row) -> str:
    return MENUS[_TUNNEL].form(name, row)
