"""What the templates of `gateway_base` see: words and numbers, a pure function of the declaration."""

from __future__ import annotations

from dataclasses import dataclass
from ipaddress import collapse_addresses
from typing import TYPE_CHECKING

from atlantis_netcfg.declaration.model import DdsPath, Gateway

if TYPE_CHECKING:
    from collections.abc import Iterable
    from ipaddress import IPv4Network

    from atlantis_netcfg.declaration import Declaration, Host
    from atlantis_netcfg.declaration.model import GpsTime, TimeServer

__all__ = ["BaseView", "DdsPorts", "Neighbour", "base_view"]


@dataclass(frozen=True, slots=True)
class DdsPorts:
    """The UDP ports of the pilot's domain, by the formula of DDSI-RTPS 9.6.2.3 with its default numbers."""

    domain: int
    participants: int
    admitted: tuple[str, ...]
    """From where."""

    @property
    def first_port(self) -> int:
        """Multicast discovery."""
        return 7400 + 250 * self.domain

    @property
    def last_port(self) -> int:
        """Unicast data of the last participant: two ports for each, from the tenth on."""
        return self.first_port + 10 + 2 * self.participants - 1


@dataclass(frozen=True, slots=True)
class Neighbour:
    """Another computer of the pilot."""

    name: str
    address: str
    domain: str | None
    """Of its LAN; None where it is reached over the VPN."""


@dataclass(frozen=True, slots=True)
class BaseView:
    """One gateway."""

    name: str
    site: str
    domain: str
    time_zone: str
    router: str
    time_servers: tuple[TimeServer, ...]
    gps: GpsTime | None
    lan: str
    ssh_from: tuple[str, ...]
    ssh_port: int
    dds: DdsPorts | None
    metered: tuple[str, ...]
    """Links of the site on which every byte costs."""
    watchdog_s: int | None
    neighbours: tuple[Neighbour, ...]


def base_view(declaration: Declaration, host: Host) -> BaseView:
    """Of a host that is a gateway."""
    device = host.device
    assert isinstance(device, Gateway)  # noqa: S101 - callers choose gateways
    site = declaration.sites[host.site]
    lan, vpn = site.lan.network, declaration.pilot.vpn.network
    return BaseView(
        name=host.name,
        site=host.site,
        domain=site.lan.domain,
        time_zone=declaration.pilot.time_zone,
        router=str(site.lan.gateway),
        time_servers=declaration.pilot.time_servers,
        gps=device.gps,
        lan=str(lan),
        ssh_from=_collapsed((*site.management.admit, lan, vpn)),
        ssh_port=device.ssh.port,
        dds=_dds(declaration, (lan, vpn)),
        metered=tuple(bearer.name for bearer in site.bearers if bearer.metered),
        watchdog_s=device.watchdog_s,
        neighbours=_neighbours(declaration, host),
    )


def _dds(declaration: Declaration, near: Iterable[IPv4Network]) -> DdsPorts | None:
    dds = declaration.pilot.dds
    if dds is None:
        return None
    far = [site.lan.network for site in declaration.sites.values()] if dds.over is DdsPath.LAN else []
    return DdsPorts(dds.domain, dds.participants, _collapsed((*near, *far)))


def _collapsed(networks: Iterable[IPv4Network]) -> tuple[str, ...]:
    """Without those that lie in others: nft refuses overlapping elements of a set."""
    return tuple(str(network) for network in collapse_addresses(networks))


def _neighbours(declaration: Declaration, host: Host) -> tuple[Neighbour, ...]:
    """Those of the LAN by their addresses there, gateways and servers of other sites by those in the VPN."""
    lan = declaration.sites[host.site].lan
    found = {
        reservation.name: Neighbour(reservation.name, str(reservation.address), lan.domain)
        for reservation in lan.reservations
    }
    for name, other in declaration.hosts.items():
        address = getattr(other.device, "address", None)
        tunnel = getattr(other.device, "vpn_address", None)
        if other.site == host.site and address is not None and address in lan.network:
            found[name] = Neighbour(name, str(address), lan.domain)
        elif other.site != host.site and tunnel is not None:
            found[name] = Neighbour(name, str(tunnel), None)
    found.pop(host.name, None)
    return tuple(found.values())
