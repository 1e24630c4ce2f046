"""Partners in the VPN: names that are nobody else's there, services that exist, robots that they may see."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.declaration._draft import Draft, Part, Rule
from atlantis_netcfg.declaration._near import choices, meant
from atlantis_netcfg.declaration.model import ControlCentre, Gateway, Router, VpnServer

if TYPE_CHECKING:
    from collections.abc import Iterator
    from ipaddress import IPv4Address

    from atlantis_netcfg.declaration.findings import Finding
    from atlantis_netcfg.declaration.model import Device

__all__ = ["RULES"]

_TAKEN = {
    "default": "OpenVPN's word for a client that has no file of its own",
    "members": "what the server's firewall calls everybody",
    "server": "the server itself",
}
_PILOT = Part("pilot")


def names(draft: Draft) -> Iterator[Finding]:
    """A partner's key begins the names of its devices, and is the name of its set in the firewall."""
    for name in draft.partners:
        if name in _TAKEN:
            message = f"a partner cannot be called `{name}`: in the VPN that is {_TAKEN[name]}"
            part = Part("partner", name)
            yield draft.wrong(part, (), message, "choose another key; `full_name` is free")


def sees(draft: Draft) -> Iterator[Finding]:
    """What a partner sees is a vehicle of the pilot, once each."""
    known = draft.names("vehicle")
    for name, partner in draft.partners.items():
        part = Part("partner", name)
        for index, vehicle in enumerate(partner.sees):
            if vehicle not in known:
                hint = meant(vehicle, known, none="add it to `vehicles`")
                yield draft.wrong(part, ("sees", index), f"there is no vehicle `{vehicle}`", hint)
            elif vehicle in partner.sees[:index]:
                yield draft.wrong(part, ("sees", index), f"`{vehicle}` stands twice in this list", "remove one")


def server_inside(draft: Draft) -> Iterator[Finding]:
    """The server has an address in its own VPN."""
    if draft.pilot is None:
        return
    host = draft.pilot.vpn.server
    device = draft.devices.get(host)
    if isinstance(device, VpnServer) and device.vpn_address is None:
        message = f"`{host}` runs the VPN and has no address in it"
        hint = f"write `vpn_address:`, one of {draft.pilot.vpn.infrastructure}"
        yield draft.wrong(Part("device", host), (), message, hint)


def services(draft: Draft) -> Iterator[Finding]:
    """A service stands on a host that has an address in the VPN."""
    if draft.pilot is None:
        return
    inside = [name for name, device in draft.devices.items() if _tunnel_address(device) is not None]
    for index, service in enumerate(draft.pilot.vpn.services):
        path = ("vpn", "services", index, "host")
        device = draft.devices.get(service.host)
        if service.host not in draft.layout.hosts:
            hint = meant(service.host, inside, none="add it to hosts.yml")
            yield draft.wrong(_PILOT, path, f"there is no host `{service.host}`", hint)
        elif device is not None and _tunnel_address(device) is None and service.host != draft.pilot.vpn.server:
            message = f"partners reach services through the VPN, and `{service.host}` has no address in it"
            yield draft.wrong(_PILOT, path, message, f"hosts that have one: {choices(inside) or 'none'}")


def services_once(draft: Draft) -> Iterator[Finding]:
    """A port of a host is one service, and a name too."""
    if draft.pilot is None:
        return
    ports, called = dict[tuple[str, str, int], int](), dict[str, int]()
    for index, service in enumerate(draft.pilot.vpn.services):
        path = ("vpn", "services", index)
        first = ports.setdefault((service.host, service.transport, service.port), index)
        if first != index:
            line = draft.mark(_PILOT, "vpn", "services", first, "port").line
            message = (
                f"{service.transport} port {service.port} of `{service.host}` is already a service, in line {line}"
            )
            yield draft.wrong(_PILOT, (*path, "port"), message, "remove one")
        elif (first := called.setdefault(service.name.casefold(), index)) != index:
            line = draft.mark(_PILOT, "vpn", "services", first, "name").line
            message = f"`{service.name}` is already the name of a service, in line {line}"
            yield draft.wrong(_PILOT, (*path, "name"), message, "give each its own name")


def _tunnel_address(device: Device) -> IPv4Address | None:
    if isinstance(device, Router):
        return device.vpn_client.address if device.vpn_client is not None else None
    return device.vpn_address if isinstance(device, Gateway | VpnServer | ControlCentre) else None


RULES: tuple[Rule, ...] = (names, sees, server_inside, services, services_once)
