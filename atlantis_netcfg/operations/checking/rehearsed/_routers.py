"""What stands around the RouterOS twins of a rehearsal when all is well, and what a fault does to them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.operations.checking.rehearsed._computer import ROUTER_MAC
from atlantis_netcfg.render import router_view
from atlantis_netcfg.site.model import Gateway, Router

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.site import Declaration, Host

__all__ = ["Act", "surroundings"]


@dataclass(frozen=True, slots=True)
class Act:
    """One command to a twin, and the one that takes it back."""

    twin: str
    do: str
    arguments: Mapping[str, Any]
    back: tuple[str, Mapping[str, Any]]


def surroundings(declaration: Declaration, host: Host) -> dict[str, Any]:
    """Describe the place of a router: who is in its LAN, what it feeds, that its tunnel and its time server answer."""
    assert isinstance(host.device, Router)  # noqa: S101 - the caller has looked
    site, client, tunnel = declaration.sites[host.site], host.device.vpn_client, router_view(declaration, host).tunnel
    tunnels = {}
    if client is not None and tunnel is not None:
        tunnels[tunnel.interface] = f"{client.address}/{declaration.pilot.vpn.network.prefixlen}"
    return {
        "cards": _cards(declaration, host.site) | {str(site.lan.gateway): ROUTER_MAC},
        "loads": dict.fromkeys(_fed(declaration, host.name), {}),
        "leases": {str(one.address): "bound" for one in site.lan.reservations},
        "tunnels": tunnels,
        "time_server": str(declaration.pilot.time_servers[0].address),
    }


def _cards(declaration: Declaration, site: str) -> dict[str, str]:
    cards = {str(one.address): one.mac for one in declaration.sites[site].lan.reservations}
    for host in declaration.site_hosts(site):
        if isinstance(host.device, Gateway) and host.device.mac is not None:
            cards[str(host.device.address)] = host.device.mac
    return cards


def _fed(declaration: Declaration, router: str) -> list[str]:
    """Ports on which a box hangs that the router feeds."""
    sources = (getattr(host.device, "powered_by", None) for host in declaration.hosts.values())
    return [source.port for source in sources if source is not None and source.device == router]
