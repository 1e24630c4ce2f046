"""From the declaration to the view of a MikroTik LTE box, and to its text."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

from atlantis_netcfg.render._declared import RenderError
from atlantis_netcfg.render._environment import environment
from atlantis_netcfg.render._links import in_network
from atlantis_netcfg.render._router import API_CERTIFICATE
from atlantis_netcfg.render.view import ManagementView, Prerequisite

if TYPE_CHECKING:
    from jinja2 import Template

    from atlantis_netcfg.core.secret import Secret
    from atlantis_netcfg.declaration.model import Bearer, LteRouter
    from atlantis_netcfg.render._declared import Declared, DeclaredHost

_PORT, _MODEM = "ether1", "lte1"
"""Factory names: the boxes for outdoors have one cable and one modem (Manual, LTE/5G)."""
_API_SSL = 8729


@dataclass(frozen=True, slots=True)
class LteView:
    """One LTE box, whole."""

    name: str
    title: str
    time_zone: str
    port: str
    modem: str
    profile: str
    """Of `/interface/lte/apn`."""
    apn: str | None
    user: str | None
    password: Secret | None
    pin: Secret | None
    roaming: bool
    bands: tuple[int, ...]
    management: ManagementView


def lte(declaration: Declared, host: DeclaredHost) -> str:
    """Render the whole desired text of one box, secrets in clear: never print it. Raises RenderError."""
    return _template().render(lte=lte_view(declaration, host))


@cache
def _template() -> Template:
    return environment().get_template("routeros/lte.rsc.j2")


def lte_view(declaration: Declared, host: DeclaredHost) -> LteView:
    """Prepare what the template sees. Raises RenderError."""
    device, bearer = _box(host), lte_bearer(declaration, host)
    sim, access = device.sim, device.access
    return LteView(
        name=host.name,
        title=declaration.sites[host.site].title,
        time_zone=declaration.pilot.time_zone,
        port=_PORT,
        modem=_MODEM,
        profile="atlantis",
        apn=sim.apn,
        user=sim.user,
        password=sim.password,
        pin=sim.pin,
        roaming=sim.roaming,
        bands=sim.bands,
        management=ManagementView(
            port=_PORT,
            address=in_network(device.address, bearer.network),
            network=str(bearer.network),
            admit=(str(bearer.network),),
            api_port=(access.port if access is not None else None) or _API_SSL,
            certificate=API_CERTIFICATE,
        ),
    )


def lte_bearer(declaration: Declared, host: DeclaredHost) -> Bearer:
    """Return the link whose gateway the box is. Raises RenderError."""
    device = _box(host)
    for bearer in declaration.sites[host.site].bearers:
        if bearer.device == host.name or bearer.gateway == device.address:
            return bearer
    raise RenderError(
        f"{host.name} is the gateway of no link of {host.site}",
        hint=f"see `bearers` in group_vars/{host.site}.yml: one has `device: {host.name}`",
    )


def lte_prerequisites(declaration: Declared, host: DeclaredHost) -> tuple[Prerequisite, ...]:
    """Say what must be on the device before its text can be written: modem, port and certificate that it refers to."""
    link = lte_bearer(declaration, host).name
    return (
        Prerequisite("/certificate", API_CERTIFICATE, "service api-ssl presents it"),
        Prerequisite("/interface/ethernet", _PORT, f"the cable of {link} comes in by it"),
        Prerequisite("/interface/lte", _MODEM, "it is the way to the 4G network"),
    )


def _box(host: DeclaredHost) -> LteRouter:
    if host.device.kind != "lte_router" or host.device.driver != "routeros":
        raise RenderError(f"{host.name} is no LTE box with driver routeros, and only such a one has this configuration")
    return host.device
