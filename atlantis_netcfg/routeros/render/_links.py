"""Ports, the links out of the site through them, and the text of a MikroTik LTE device."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from ipaddress import IPv4Address, IPv4Interface, IPv4Network
from math import ceil
from typing import TYPE_CHECKING

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory.satellite_allow_list import allowed_targets
from atlantis_netcfg.links.standing_traffic import probe_targets
from atlantis_netcfg.routeros.render import view
from atlantis_netcfg.routeros.render._environment import environment

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from jinja2 import Template

    from atlantis_netcfg.core.secret import Secret
    from atlantis_netcfg.inventory import model


WATCH_S = 5.0
"""Below the 10 s of `check-gateway`: the holding route applies before that has missed the link twice (11 s minimum)."""
_TIMEOUT_S, _METERED_TIMEOUT_S = 1.0, 3.0
_DEAR_GAP_S = 30.0
"""Seconds between two packets of a test over a link whose probe targets have a budget."""
_GAP_S = 5.0
"""Seconds between two packets over any other link. `_MOST_SILENT` and `_MOST_STEADY` limit the packets of a test."""
_MOST_SILENT, _MOST_STEADY = 40, 60


def probe_timing(link: model.Link, failover: model.Failover) -> view.JudgedLink:
    """Return how a link with probe targets is monitored.

    From the first lost request to the decision to leave the link, at least `hold_down_s` pass: its timeout, the 3 s
    that a netwatch row waits before it begins, the packets, the last timeout. At most one interval of the monitoring is
    added.

    Each probe target has three rows of `/tool netwatch` (templates/routeros/parts/netwatch.rsc.j2). One sends requests
    all the time. The first request without a reply starts the second row, which leaves the link if all of its packets
    are lost. The first reply after that starts the third row, which returns to the link if none of its packets is lost.
    """
    has_budget = link.probe_target_budget_bytes is not None
    usual_s = _DEAR_GAP_S if has_budget else _GAP_S
    silence = min(max(2, ceil(failover.hold_down_s / usual_s)), _MOST_SILENT)
    gap_s = failover.hold_down_s / silence
    steady = min(max(2, ceil(failover.fail_back_s / usual_s) + 1), _MOST_STEADY)
    watch_s = float(max(failover.metered_probe_s, link.probe_target_pause_s)) if link.metered else WATCH_S
    daily_bytes, testing_bytes = (probe_targets(len(link.canaries), each).both for each in (watch_s, usual_s))
    return view.JudgedLink(
        has_gateway_check=not link.metered,
        watch_s=watch_s,
        timeout_s=_METERED_TIMEOUT_S if link.metered else _TIMEOUT_S,
        silence=silence,
        silence_gap_s=gap_s if gap_s <= usual_s and not has_budget else failover.hold_down_s / (silence - 1),
        steady=steady,
        steady_gap_s=max(1.0, failover.fail_back_s / (steady - 1)),
        daily_bytes=round(daily_bytes),
        unsteady_bytes=round(daily_bytes + testing_bytes) if has_budget else None,
    )


def in_network(address: IPv4Address, network: IPv4Network) -> str:
    """Return an address with its network's prefix length, as in `/ip/address`."""
    return str(IPv4Interface((address, network.prefixlen)))


def ports(router: model.Router) -> tuple[view.PortView, ...]:
    """Return the ports of the inventory; other ports are left alone."""
    return tuple(_port(port) for port in router.ports)


def _port(port: model.Port) -> view.PortView:
    return view.PortView(
        name=port.name,
        purpose=port.link or port.use.value,
        is_disabled=port.use == "off",
        poe_out=port.poe.out.value if port.poe else None,
        poe_priority=port.poe.priority if port.poe else None,
    )


def management_port(name: str, router: model.Router) -> str:
    """Return the technician's port; its address already exists when the router is adopted. Raises RenderError."""
    matching_ports = [port.name for port in router.ports if port.use == "management"]
    if len(matching_ports) != 1:
        raise view.RenderError(
            f"{arg(name)} needs one port with `use: management`, but has {arg(len(matching_ports))}",
            hint=f"see `ports` in host_vars/{arg(name)}.yml",
        )
    return matching_ports[0]


def port_of(name: str, router: model.Router, link: str) -> str:
    """Return the only port that carries a link or a served link. Raises RenderError."""
    matching_ports = [port.name for port in router.ports if port.link == link]
    if len(matching_ports) != 1:
        raise view.RenderError(
            f"{arg(name)} needs one port with `use: link, link: {arg(link)}`, but has {arg(len(matching_ports))}",
            hint=f"see `ports` in host_vars/{arg(name)}.yml",
        )
    return matching_ports[0]


def uplinks(name: str, router: model.Router, site: model.Site, pilot: model.Pilot) -> tuple[view.Uplink, ...]:
    """Return the links in order of preference."""
    return tuple(
        _uplink(site, place, port_of(name, router, link.name), pilot)
        for place, link in enumerate(site.bearers, start=1)
    )


def _uplink(site: model.Site, place: int, port: str, pilot: model.Pilot) -> view.Uplink:
    link = site.bearers[place - 1]
    targets = allowed_targets(pilot, link)
    later = site.bearers[place:]
    return view.Uplink(
        name=link.name,
        port=port,
        address=str(link.address),
        interface_address=in_network(link.address, link.network),
        network=str(link.network),
        gateway=str(link.gateway),
        kind=link.kind,
        place=place,
        probe_targets=tuple(str(probe_target) for probe_target in link.canaries),
        targets=tuple(_targets(target for target in targets if target.address not in link.canaries)),
        probing=probe_timing(link, site.failover) if link.canaries and later else None,
        later=tuple(str(other.address) for other in later),
        up_bps=round(link.rate.up_kbps * 1000),
        thin=link.thin,
        dds=pilot.dds is None or link.carries(pilot.dds),
    )


def _targets(targets: Iterable[model.AllowedTarget]) -> Iterator[view.PingTarget]:
    for target in targets:
        transport = None if target.port is None else target.transport.value
        yield view.PingTarget(target.name, str(target.address), target.port, transport)


def served_links(name: str, router: model.Router, site: model.Site) -> tuple[view.LinkView, ...]:
    """Return the links that end here and carry another site's traffic."""
    return tuple(
        view.LinkView(
            name=link.name,
            port=port_of(name, router, link.name),
            address=str(link.address),
            interface_address=in_network(link.address, link.network),
            network=str(link.network),
        )
        for link in site.served_links
    )


_PORT, _MODEM = "ether1", "lte1"
"""Factory names: outdoor devices have one Ethernet port and one modem (Manual, LTE/5G)."""
_API_SSL = 8729


@dataclass(frozen=True, slots=True)
class LteView:
    """Template data for one LTE device."""

    name: str
    title: str
    time_zone: str
    port: str
    modem: str
    profile: str
    """Profile name of `/interface/lte/apn`."""
    apn: str | None
    user: str | None
    password: Secret | None
    pin: Secret | None
    roaming: bool
    bands: tuple[int, ...]
    management: view.ManagementView


def lte(inventory: view.InventoryView, host: view.DeclaredHost) -> str:
    """Render the desired text of one LTE device, secrets in clear: never print it. Raises RenderError."""
    return _template().render(lte=lte_view(inventory, host))


@cache
def _template() -> Template:
    return environment().get_template("routeros/lte.rsc.j2")


def lte_view(inventory: view.InventoryView, host: view.DeclaredHost) -> LteView:
    """Prepare the template data. Raises RenderError."""
    device, link = _box(host), lte_link(inventory, host)
    sim, access = device.sim, device.access
    return LteView(
        name=host.name,
        title=inventory.sites[host.site].title,
        time_zone=inventory.pilot.time_zone,
        port=_PORT,
        modem=_MODEM,
        profile="atlantis",
        apn=sim.apn,
        user=sim.user,
        password=sim.password,
        pin=sim.pin,
        roaming=sim.roaming,
        bands=sim.bands,
        management=view.ManagementView(
            port=_PORT,
            address=in_network(device.address, link.network),
            network=str(link.network),
            admit=(str(link.network),),
            api_port=(access.port if access is not None else None) or _API_SSL,
            certificate=API_CERTIFICATE,
        ),
    )


def lte_link(inventory: view.InventoryView, host: view.DeclaredHost) -> model.Link:
    """Return the link whose gateway is the LTE device. Raises RenderError."""
    device = _box(host)
    for link in inventory.sites[host.site].bearers:
        if link.device == host.name or link.gateway == device.address:
            return link
    raise view.RenderError(
        f"{arg(host.name)} is the gateway of no link of {arg(host.site)}",
        hint=f"see `bearers` in group_vars/{arg(host.site)}.yml: one needs `device: {arg(host.name)}`",
    )


def lte_prerequisites(inventory: view.InventoryView, host: view.DeclaredHost) -> tuple[view.Prerequisite, ...]:
    """Return the modem, port and certificate that must exist on the device because its text refers to them."""
    link = lte_link(inventory, host).name
    return (
        view.Prerequisite("/certificate", API_CERTIFICATE, "service api-ssl uses it"),
        view.Prerequisite("/interface/ethernet", _PORT, msg(f"it carries the cable of {arg(link)}")),
        view.Prerequisite("/interface/lte", _MODEM, "it leads to the 4G network"),
    )


def _box(host: view.DeclaredHost) -> model.LteRouter:
    if host.device.kind != "lte_router" or host.device.driver != "routeros":
        raise view.RenderError(
            f"{arg(host.name)} is not an LTE device with driver routeros, which this configuration needs"
        )
    return host.device


API_CERTIFICATE = "atlantis-api"
"""Created on the device during adoption; service api-ssl presents it and we pin it."""
