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
from atlantis_netcfg.computers.reflector import stop_step
from atlantis_netcfg.inventory.model import ServerComputer, VpnServer
from atlantis_netcfg.routeros.render import environment

if TYPE_CHECKING:
    from atlantis_netcfg.inventory import Host, Inventory

SERVICE = "atlantis-dds-link.service"
_UNIT = f"/etc/systemd/system/{SERVICE}"


@dataclass(frozen=True, slots=True)
class DdsLink:
    """Echo test by which a gateway learns whether DDS may use the active link."""

    endpoint: str
    """Target of the echoes, which are limited to two hops."""
    server: str
    """Address of the VPN server in the tunnel."""
    interface: str = "tun0"
    every_s: int = 5
    remembered_s: int = 12
    """Seconds for which a refusal counts: two echoes may be lost."""


def links_without_dds(inventory: Inventory, site: str) -> tuple[str, ...]:
    """Return the links of a site on which its computers must not send DDS."""
    dds = inventory.pilot.dds
    if dds is None or inventory.router_of(site) is None:
        return ()
    return tuple(link.name for link in inventory.sites[site].bearers if not link.carries(dds))


def dds_link(inventory: Inventory, host: Host) -> DdsLink | None:
    """Return the echo test of a computer with a tunnel, at a site where some links forbid DDS."""
    assert isinstance(host.device, ServerComputer)  # noqa: S101 - `gateway_base` checks it
    if host.device.vpn_address is None or not links_without_dds(inventory, host.site):
        return None
    vpn = inventory.pilot.vpn
    server = inventory.hosts[vpn.server].device
    assert isinstance(server, VpnServer)  # noqa: S101 - a rule of the inventory
    return DdsLink(str(vpn.endpoint), str(server.vpn_address or vpn.endpoint))


def dds_link_unit(link: DdsLink | None) -> parts.Configuration:
    """Build the unit that sends the echo (pure); None: the step that removes it."""
    away = stop_step("stop checking whether DDS may use the active link", SERVICE)
    if link is None:
        return parts.Configuration(absent=(_UNIT,), steps=(away,))
    text = environment().get_template("gateway/dds-link.service.j2").render(link=link)
    unit = parts.Unit(SERVICE, enabled=True, active=True, after=(_UNIT,))
    return parts.Configuration(files=(parts.File(_UNIT, text),), steps=(away,), units=(unit,))
