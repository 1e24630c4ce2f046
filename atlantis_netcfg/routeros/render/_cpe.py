"""View and text of one end of a Wi-Fi bridge, for either family of radio menus."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from math import ceil
from typing import TYPE_CHECKING

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory import channels
from atlantis_netcfg.routeros.render import view
from atlantis_netcfg.routeros.render._environment import environment
from atlantis_netcfg.routeros.render._links import API_CERTIFICATE, in_network

if TYPE_CHECKING:
    from jinja2 import Template

    from atlantis_netcfg.inventory import model

_BRIDGE = "bridge-ptp"
_RADIO_NAMES = {"wireless": "wlan1", "wifi": "wifi1"}
_LEGACY_BANDS = {
    "802.11a": "5ghz-a",
    "802.11g": "2ghz-b/g",
    "802.11n": "{}",
    "802.11ac": "5ghz-a/n/ac",
}
_LEGACY_N = {"2ghz": "2ghz-b/g/n", "5ghz": "5ghz-a/n"}
_STEP_MHZ = 20
_LONG_M = 2000
"""Distance in metres from which the `wifi` menus need a setting (Manual, Configuring outdoor CPE to AP links)."""
_SMALLEST_CELL_KM = 10
"""Minimum of `nv2-cell-radius`; below 10 km RouterOS refuses it (Manual, Nv2)."""
_WEATHER_MHZ = (5600, 5650)
"""Frequencies of weather radars: an access point listens for ten minutes before it transmits (ETSI EN 301 893)."""


@dataclass(frozen=True, slots=True)
class CpeView:
    """Template data for one end of the bridge."""

    name: str
    title: str
    peer: str
    time_zone: str
    time_servers: tuple[view.NamedAddress, ...]
    bridge: str
    port: str
    """The only Ethernet port; it carries power and the router's cable."""
    radio: view.RadioView
    management: view.ManagementView
    network: str
    """Network of the link: both routers and both radios."""
    gateway: str
    """The router that serves the link: route to the time servers and to the link's own technician."""
    routes: tuple[view.NamedAddress, ...]
    """Other networks that manage the device, each with the address of the router on that route."""


def cpe(inventory: view.InventoryView, host: view.DeclaredHost, family: str) -> str:
    """Render the desired text of one end, secrets in clear: never print it. Raises RenderError.

    `family`: `wireless` or `wifi`, the radio menus of the device.
    """
    return _template().render(cpe=cpe_view(inventory, host, family))


@cache
def _template() -> Template:
    return environment().get_template("routeros/cpe.rsc.j2")


def cpe_view(inventory: view.InventoryView, host: view.DeclaredHost, family: str) -> CpeView:
    """Prepare the template data. Raises RenderError."""
    device, site = _cpe_of(host), inventory.sites[host.site]
    carried_site, link, serving, served_link = _ends(inventory, host, device)
    behind = inventory.sites[carried_site].management.network
    networks = (served_link.network, behind, inventory.sites[serving].management.network)
    return CpeView(
        name=host.name,
        title=site.title,
        peer=device.ptp.peer,
        time_zone=inventory.pilot.time_zone,
        time_servers=tuple(
            view.NamedAddress(server.name, str(server.address)) for server in inventory.pilot.time_servers
        ),
        bridge=_BRIDGE,
        port=device.port,
        radio=_radio(host.name, device.ptp, family),
        management=view.ManagementView(
            port=device.port,
            address=in_network(device.access.address, served_link.network),
            network=str(served_link.network),
            admit=tuple(dict.fromkeys(map(str, networks))),
            api_port=device.access.port,
            certificate=API_CERTIFICATE,
        ),
        network=str(served_link.network),
        gateway=str(served_link.address),
        routes=(view.NamedAddress(str(behind), str(link.address)),),
    )


def radio_name(family: str) -> str:
    """Return the factory name of a device's first radio; `family`: `wireless` or `wifi`."""
    return _RADIO_NAMES[family]


def cpe_prerequisites(inventory: view.InventoryView, host: view.DeclaredHost) -> tuple[view.Prerequisite, ...]:
    """Return the port and certificate that must exist on the device because its text refers to them."""
    device = _cpe_of(host)
    peer = inventory.hosts[device.ptp.peer].name if device.ptp.peer in inventory.hosts else device.ptp.peer
    return (
        view.Prerequisite("/certificate", API_CERTIFICATE, "service api-ssl uses it"),
        view.Prerequisite("/interface/ethernet", device.port, msg(f"it carries the bridge cable to {arg(peer)}")),
    )


def _cpe_of(host: view.DeclaredHost) -> model.Cpe:
    if host.device.kind != "cpe":
        raise view.RenderError(
            f"{arg(host.name)} is a {arg(host.device.kind)}; only a CPE can have a CPE configuration"
        )
    return host.device


def _ends(
    inventory: view.InventoryView, host: view.DeclaredHost, device: model.Cpe
) -> tuple[str, model.Link, str, model.ServedLink]:
    """Return the site reached through the bridge with its link, and the site that serves it with its link."""
    ends = {host.name, device.ptp.peer}
    for carried_site, site in inventory.sites.items():
        for link in site.bearers:
            if not link.kind.traits.bridge or link.device not in ends:
                continue
            for serving, other in inventory.sites.items():
                for served_link in other.served_links:
                    if served_link.carries == carried_site and {link.device, served_link.device} == ends:
                        return carried_site, link, serving, served_link
    raise view.RenderError(
        f"{arg(host.name)} is not an end of a link: no `wifi_ptp` link with a served link names {arg(host.name)} and "
        f"{arg(device.ptp.peer)}",
        hint="see `bearers` and `served_links` of the two sites in group_vars",
    )


def _radio(name: str, ptp: model.Ptp, family: str) -> view.RadioView:
    legacy = family == "wireless"
    if (ptp.standard == "802.11ax") if legacy else (ptp.protocol != "802.11"):
        raise view.RenderError(
            f"{arg(name)}: the `{arg(family)}` menus do not support {arg(ptp.protocol)} with {arg(ptp.standard)}"
        )
    distance_m = ptp.distance_m or 0
    return replace(
        _plain(ptp, family),
        is_ap=ptp.mode == "access_point",
        protocol=ptp.protocol.value,
        cell_radius_km=max(_SMALLEST_CELL_KM, ceil(distance_m / 1000)),
        distance_km=ceil(distance_m / 1000) if distance_m > _LONG_M else None,
    )


def access_point(radio: model.RouterAccessPoint) -> view.RadioView:
    """Return the view of a router's radio, which vehicles join."""
    return replace(_plain(radio, radio.menus), is_isolated=radio.isolated)


def _plain(radio: model.WifiRadio, family: str) -> view.RadioView:
    """Return the view of a plain 802.11 access point."""
    legacy = family == "wireless"
    country = channels.name_in_routeros(radio.country)
    low = radio.frequency_mhz - radio.width_mhz // 2
    weather = low < _WEATHER_MHZ[1] and radio.frequency_mhz + radio.width_mhz // 2 > _WEATHER_MHZ[0]
    return view.RadioView(
        name=radio_name(family),
        family=family,
        is_ap=True,
        ssid=radio.ssid,
        protocol="802.11",
        band=_band(radio, legacy=legacy),
        frequency_mhz=radio.frequency_mhz,
        width=_width(radio, legacy=legacy),
        country=country if legacy else country.capitalize(),
        installation="outdoor" if radio.outdoor else "indoor",
        skip_dfs="disabled" if weather else "10min-cac",
        key=radio.key,
        authentication=f"{radio.wpa}-psk",
        tx_power_dbm=radio.tx_power_dbm,
        antenna_gain_dbi=radio.antenna_gain_dbi,
    )


def _band(radio: model.WifiRadio, *, legacy: bool) -> str:
    if not legacy:
        return f"{radio.band}-{radio.standard.removeprefix('802.11')}"
    return _LEGACY_BANDS[radio.standard].format(_LEGACY_N[radio.band])


def _width(radio: model.WifiRadio, *, legacy: bool) -> str:
    """Return the width with the position of the control channel: `C`, and each `e` is 20 MHz beside it."""
    if radio.width_mhz == _STEP_MHZ:
        return "20mhz"
    sizes = "/".join(str(size) for size in (20, 40, 80) if size <= radio.width_mhz) + "mhz"
    if not legacy and radio.width_mhz > 2 * _STEP_MHZ:
        return sizes  # the newer menus have no words for the place in wider channels
    low = channels.lower_edge(radio.country, radio.band, radio.frequency_mhz, radio.width_mhz, outdoors=radio.outdoor)
    letters = ["e"] * (radio.width_mhz // _STEP_MHZ)
    letters[round(radio.frequency_mhz - _STEP_MHZ // 2 - low) // _STEP_MHZ] = "C"
    return f"{sizes}-{''.join(letters)}"
