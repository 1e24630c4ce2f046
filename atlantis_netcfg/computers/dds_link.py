"""Block the DDS traffic of a gateway on links of its site where DDS is not allowed.

The gateway cannot see which link carries its traffic, but its router can. The router rejects a certain echo request
exactly where DDS is not allowed (templates/routeros/parts/firewall.rsc.j2). A unit sends that echo continuously, and
the firewall of the gateway drops DDS before the tunnel while rejections arrive. The tunnel stays idle, and its
keep-alives continue.

Marking the packets for the router to drop does not work: `passtos` of OpenVPN copies the mark of the last packet to
all later ones, pings and handshakes included. A dropped packet also counts as sent, so that no ping would be due.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.computers import parts
from atlantis_netcfg.computers.reflector import taken_away
from atlantis_netcfg.inventory.model import ServerComputer, VpnServer
from atlantis_netcfg.routeros.render import environment

if TYPE_CHECKING:
    from atlantis_netcfg.inventory import Declaration, Host

SERVICE = "atlantis-dds-link.service"
_UNIT = f"/etc/systemd/system/{SERVICE}"


@dataclass(frozen=True, slots=True)
class DdsLink:
    """Echo test by which a gateway learns whether DDS may use the active link."""

    endpoint: str
    """Where the echoes are sent; they get two hops far."""
    server: str
    """The VPN's server in the tunnel."""
    interface: str = "tun0"
    every_s: int = 5
    remembered_s: int = 12
    """A refusal counts for so long: two echoes may be lost."""


def links_without_dds(declaration: Declaration, site: str) -> tuple[str, ...]:
    """Return the links of a site on which its computers must not send DDS."""
    dds = declaration.pilot.dds
    if dds is None or declaration.router_of(site) is None:
        return ()
    return tuple(bearer.name for bearer in declaration.sites[site].bearers if not bearer.carries(dds))


def dds_link(declaration: Declaration, host: Host) -> DdsLink | None:
    """Return the echo test of a computer with a tunnel, at a site where some links forbid DDS."""
    assert isinstance(host.device, ServerComputer)  # noqa: S101 - `gateway_base` has looked
    if host.device.vpn_address is None or not links_without_dds(declaration, host.site):
        return None
    vpn = declaration.pilot.vpn
    server = declaration.hosts[vpn.server].device
    assert isinstance(server, VpnServer)  # noqa: S101 - a rule of the declaration
    return DdsLink(str(vpn.endpoint), str(server.vpn_address or vpn.endpoint))


def dds_link_unit(link: DdsLink | None) -> parts.Configuration:
    """Build the unit that sends the echo (pure); None: the step that removes it."""
    away = taken_away("stop asking whether DDS may cross the link in use", SERVICE)
    if link is None:
        return parts.Configuration(absent=(_UNIT,), steps=(away,))
    text = environment().get_template("gateway/dds-link.service.j2").render(link=link)
    unit = parts.Unit(SERVICE, enabled=True, active=True, after=(_UNIT,))
    return parts.Configuration(files=(parts.File(_UNIT, text),), steps=(away,), units=(unit,))
