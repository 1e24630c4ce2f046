"""View and text of one switch."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory import model
from atlantis_netcfg.routeros.render import view
from atlantis_netcfg.routeros.render._cpe import access_point, radio_name
from atlantis_netcfg.routeros.render._environment import environment
from atlantis_netcfg.routeros.render._links import API_CERTIFICATE, in_network
from atlantis_netcfg.routeros.render._router import managers, tunnel

if TYPE_CHECKING:
    from collections.abc import Iterator

    from jinja2 import Template


@dataclass(frozen=True, slots=True)
class BridgedPort:
    """A port of the bridge: an Ethernet port, or the radio."""

    name: str
    purpose: str
    is_isolated: bool
    """The port forwards nothing to the other isolated ports."""


@dataclass(frozen=True, slots=True)
class SwitchView:
    """Template data for one switch."""

    name: str
    title: str
    time_zone: str
    time_servers: tuple[view.NamedAddress, ...]
    bridge: str
    ports: tuple[view.PortView, ...]
    bridge_ports: tuple[BridgedPort, ...]
    management: view.ManagementView
    """Managers: the router, and anyone permitted to manage who comes by the LAN."""
    gateway: str
    access_point: view.RadioView | None


def switch(inventory: view.InventoryView, host: view.DeclaredHost) -> str:
    """Render the desired text of one switch, secrets in clear: never print it. Raises RenderError."""
    return _template().render(switch=switch_view(inventory, host))


@cache
def _template() -> Template:
    return environment().get_template("routeros/switch.rsc.j2")


def switch_view(inventory: view.InventoryView, host: view.DeclaredHost) -> SwitchView:
    """Prepare the template data. Raises RenderError."""
    device, site = _switch_of(host), inventory.sites[host.site]
    radio = None if device.access_point is None else access_point(device.access_point)
    return SwitchView(
        name=host.name,
        title=site.title,
        time_zone=inventory.pilot.time_zone,
        time_servers=tuple(
            view.NamedAddress(server.name, str(server.address)) for server in inventory.pilot.time_servers
        ),
        bridge=view.BRIDGE,
        ports=_ports(device),
        bridge_ports=tuple(_bridge_ports(device, radio)),
        management=view.ManagementView(
            port=device.uplink,
            address=in_network(device.access.address, site.lan.network),
            network=str(site.lan.network),
            admit=(f"{site.lan.gateway}/32", *_by_the_lan(inventory, host.site)),
            api_port=device.access.port,
            certificate=API_CERTIFICATE,
        ),
        gateway=str(site.lan.gateway),
        access_point=radio,
    )


def switch_prerequisites(host: view.DeclaredHost) -> tuple[view.Prerequisite, ...]:
    """Return the ports, certificate and radio that must exist on the device because its text refers to them."""
    device = _switch_of(host)
    prerequisites = [
        view.Prerequisite("/certificate", API_CERTIFICATE, "service api-ssl uses it"),
        *(
            view.Prerequisite(
                "/interface/ethernet", port.name, msg(f"the inventory has it as a port for {arg(port.purpose)}")
            )
            for port in _ports(device)
        ),
    ]
    if device.access_point is not None:
        menus = device.access_point.menus
        prerequisites.append(
            view.Prerequisite(f"/interface/{menus}", radio_name(menus), "the inventory has it as an access point")
        )
    return tuple(prerequisites)


def _switch_of(host: view.DeclaredHost) -> model.Switch:
    if host.device.kind != "switch":
        raise view.RenderError(
            f"{arg(host.name)} is a {arg(host.device.kind)}; only a switch can have a switch configuration"
        )
    return host.device


def _ports(device: model.Switch) -> tuple[view.PortView, ...]:
    return tuple(
        view.PortView(
            name=port.name,
            purpose=port.use.value,
            is_disabled=port.use is model.SwitchPortUse.OFF,
            poe_out=port.poe.out.value if port.poe else None,
            poe_priority=port.poe.priority if port.poe else None,
        )
        for port in device.ports
    )


_PURPOSES = {model.SwitchPortUse.UPLINK: "to the router", model.SwitchPortUse.LAN: "LAN"}


def _bridge_ports(device: model.Switch, radio: view.RadioView | None) -> Iterator[BridgedPort]:
    for port in device.ports:
        if port.use is not model.SwitchPortUse.OFF:
            purpose = _PURPOSES[port.use]
            yield BridgedPort(port.name, msg(f"{arg(purpose)}, isolated") if port.isolated else purpose, port.isolated)
    if radio is not None:
        yield BridgedPort(radio.name, "access point", radio.is_isolated)


def _by_the_lan(inventory: view.InventoryView, site: str) -> Iterator[str]:
    """Yield the networks of managers that come in by the LAN, possibly through the VPN server in it."""
    for host in view.hosts_of(inventory, site):
        if isinstance(host.device, model.Router):
            end = tunnel(inventory, host.device)
            all_managers = managers(inventory, host, end.interface if end is not None else None)
            yield from dict.fromkeys(manager.network for manager in all_managers if manager.interfaces == "LAN")
