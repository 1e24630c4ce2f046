"""What a site's router has to let through, from the inventory alone: neither templates nor rendered rows are read.

The sources are docs/routers.md (firewall), docs/satellite.md (allow-list) and docs/vpn.md (who reaches whom). Whoever
sends must have an address that belongs behind its port: all else is refused, whatever it asks for.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from ipaddress import IPv4Address, IPv4Network
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory import model
from atlantis_netcfg.inventory.satellite_allow_list import admits, allowed_targets
from atlantis_netcfg.routeros.render import view

if TYPE_CHECKING:
    from atlantis_netcfg.inventory import Host, Inventory

DDS_QUESTION: Final = 1
"""DSCP of the echo by which a gateway asks whether DDS may cross the link in use."""
NO_ADDRESS: Final = IPv4Address(0)
"""0.0.0.0: who has no address yet."""
SSH: Final = 22
DNS, DHCP_SERVER, NTP, HTTPS = 53, 67, 123, 443


class Area(Enum):
    """Where an address is, seen from a site's router."""

    ROUTER = "the router"
    LAN = "LAN"
    MANAGEMENT = "technician's port"
    OTHER_SITE = "link to another site"
    VPN = "behind the VPN"
    INTERNET = "internet"


@dataclass(frozen=True, slots=True)
class FlowStation:
    """One end of a flow."""

    name: str
    address: IPv4Address
    area: Area
    port: str
    """Device of the router that leads to it; of the router's own addresses the one that has it."""


@dataclass(frozen=True, slots=True)
class PacketFlow:
    """What one station opens to another; `port` of ICMP (echo) is 0."""

    source: FlowStation
    destination: FlowStation
    protocol: str
    port: int = 0
    dscp: int = 0
    is_broken: bool = False
    """TCP flags that no connection begins with."""

    def __str__(self) -> str:
        what = msg("ping") if self.protocol == "icmp" else f"{self.protocol} {self.port}"
        if self.dscp or self.is_broken:
            what = msg(f"{arg(what)} with DSCP {arg(self.dscp)}" if self.dscp else f"{arg(what)} with impossible flags")
        return msg(f"{arg(self.source.name)} to {arg(self.destination.name)}, {arg(what)}")


@dataclass(frozen=True)
class RouterIntent:
    """The intent for one router, while one of its links is in use and its tunnel, if it has one, is up."""

    inventory: Inventory
    host: Host
    link: model.Link

    @cached_property
    def router(self) -> model.Router:
        """The router's block in the inventory."""
        return view.router_of(self.host)

    @cached_property
    def site(self) -> model.Site:
        """The router's site."""
        return self.inventory.sites[self.host.site]

    @cached_property
    def link_ports(self) -> dict[str, str]:
        """The port of each link."""
        return {port.link: port.name for port in self.router.ports if port.link is not None}

    @property
    def api_port(self) -> int:
        """TCP port of the router's API."""
        return self.router.access.port

    @cached_property
    def lan_port(self) -> str:
        """The first port of the LAN."""
        return next(port.name for port in self.router.ports if port.use is model.PortUse.LAN)

    @cached_property
    def management_port(self) -> str | None:
        """The technician's port."""
        return next((port.name for port in self.router.ports if port.use is model.PortUse.MANAGEMENT), None)

    @cached_property
    def tunnel(self) -> str | None:
        """The interface of the router's own VPN client, which is called after the server's site."""
        server = self.inventory.hosts[self.inventory.pilot.vpn.server]
        return None if self.router.vpn_client is None else f"ovpn-{server.site}"

    @cached_property
    def has_server(self) -> bool:
        """Whether the VPN server is a host of this LAN."""
        return self.inventory.hosts[self.inventory.pilot.vpn.server].site == self.host.site

    @cached_property
    def remotes(self) -> tuple[IPv4Network, ...]:
        """Networks behind the VPN: tunnel addresses, LANs of other sites, and their technicians if admitted."""
        others = [site for name, site in self.inventory.sites.items() if name != self.host.site]
        prefixes = self.site.management.admit
        technicians = [site.management.network for site in others]
        return (
            self.inventory.pilot.vpn.network,
            *(site.lan.network for site in others),
            *(network for network in technicians if any(prefix.overlaps(network) for prefix in prefixes)),
        )

    @cached_property
    def own_hosts(self) -> frozenset[IPv4Address]:
        """Computers of ours in the LAN; whatever else is plugged in may be a partner's."""
        hosts = [host.device for host in self.inventory.hosts.values() if host.site == self.host.site]
        return frozenset(device.address for device in hosts if isinstance(device, model.LanBox))

    # --- decisions -------------------------------------------------------------------------------------------------

    def allows(self, flow: PacketFlow) -> bool:
        """Return whether the first packet of a flow has to arrive."""
        source, destination = flow.source.area, flow.destination.area
        if source is Area.ROUTER:
            return destination is not Area.INTERNET or self._may_leave(flow)
        if flow.is_broken or not self.belongs(flow.source):
            return False
        if destination is Area.ROUTER:
            return self._may_speak_to_router(flow)
        if destination is Area.INTERNET:
            return source in {Area.LAN, Area.MANAGEMENT, Area.OTHER_SITE} and self._may_leave(flow)
        return self._may_go_inside(flow)

    def _may_go_inside(self, flow: PacketFlow) -> bool:
        """Return whether a flow may go to the LAN, to the radios of a served link, or into the VPN."""
        source, destination = flow.source.area, flow.destination.area
        if source is Area.LAN:
            return destination is Area.VPN and self._may_enter_vpn(flow)
        if source is Area.MANAGEMENT:
            # Beside the server, technicians also reach what is behind it.
            return destination in {Area.LAN, Area.OTHER_SITE} or (destination is Area.VPN and self.has_server)
        return source is Area.VPN and destination is Area.LAN and self.tunnel is not None

    def belongs(self, source: FlowStation) -> bool:
        """Return whether an address is where packets with it may come from."""
        if source.area is Area.ROUTER or source.address == NO_ADDRESS:
            return source.area in {Area.ROUTER, Area.LAN}  # without address: it asks for one
        networks = {
            Area.LAN: (self.site.lan.network,),
            Area.MANAGEMENT: (self.site.management.network,),
            Area.OTHER_SITE: tuple(link.network for link in self.site.served_links),
            Area.VPN: self.remotes,
        }
        if source.area is Area.INTERNET:
            radio_networks = (link.network for link in self.site.served_links)
            inner = (self.site.lan.network, self.site.management.network, *self.remotes, *radio_networks)
            return not any(source.address in network for network in inner)
        return any(source.address in network for network in networks[source.area])

    def _may_speak_to_router(self, flow: PacketFlow) -> bool:
        source, what = flow.source, (flow.protocol, flow.port)
        management = {("tcp", SSH), ("tcp", self.api_port), ("icmp", 0)}
        if what in management and self._may_manage(source):
            return True
        if source.address == NO_ADDRESS:
            return what == ("udp", DHCP_SERVER)
        if source.area is Area.LAN:
            return what in {("icmp", 0), ("udp", DNS), ("udp", DHCP_SERVER), ("tcp", DNS)}
        radios = [link.network for link in self.site.bearers if link.kind is model.LinkKind.WIFI_PTP]
        is_radio = source.port in self.link_ports.values() and any(source.address in network for network in radios)
        return flow.protocol == "icmp" and (source.area is Area.OTHER_SITE or is_radio)  # to test the bridge

    def _may_manage(self, source: FlowStation) -> bool:
        if not any(source.address in prefix for prefix in self.site.management.admit):
            return False
        return source.area in {Area.MANAGEMENT, Area.LAN, Area.VPN}

    def _may_enter_vpn(self, flow: PacketFlow) -> bool:
        if self.tunnel is None and not self.has_server:
            return False
        if flow.source.address in self.own_hosts or flow.destination.address in self.inventory.pilot.vpn.network:
            return True
        dds = self.inventory.pilot.dds
        is_dds = dds is not None and flow.protocol == "udp" and flow.port in dds.ports
        # Beside the server any datagram passes the router: the server is where datagrams are judged.
        return flow.protocol == "icmp" or is_dds or (self.has_server and flow.protocol == "udp")

    def link_to(self, flow: PacketFlow) -> model.Link:
        """Return the link by which packets leave: that of the destination's network, else the one in use.

        What the router sends with the address of a link goes over that link, but for the VPN.
        """
        links = [link for link in self.site.bearers if flow.destination.address in link.network]
        if flow.source.area is Area.ROUTER and flow.destination.address != self.inventory.pilot.vpn.endpoint:
            links += [link for link in self.site.bearers if flow.source.address == link.address]
        return links[0] if links else self.link

    def _may_leave(self, flow: PacketFlow) -> bool:
        link, sender = self.link_to(flow), flow.source.area
        dds = self.inventory.pilot.dds
        if sender is not Area.ROUTER and flow.dscp == DDS_QUESTION and dds is not None and not link.carries(dds):
            return False
        if not link.kind.traits.allow_list:
            return True
        if flow.destination.address in link.network and sender in {Area.MANAGEMENT, Area.ROUTER}:
            return True  # the terminal's own pages cost no airtime
        targets = [
            target
            for target in allowed_targets(self.inventory.pilot, link)
            if target.address not in link.canaries or (sender is Area.ROUTER and flow.protocol == "icmp")
        ]
        port = None if flow.protocol == "icmp" else flow.port
        transport = model.Transport.TCP if flow.protocol == "tcp" else model.Transport.UDP
        return admits(targets, flow.destination.address, port, transport)

    def goes_first(self, flow: PacketFlow, link: model.Link) -> bool:
        """Return whether a packet is control traffic on a slow link, or of a host with a share of its own there."""
        if not link.thin:
            return False
        vpn, what = self.inventory.pilot.vpn, (flow.protocol, flow.port)
        if flow.destination.address == vpn.endpoint and what == (vpn.transport.value, vpn.port):
            return True
        shares = set(model.TrafficClass) - {model.TrafficClass.CONTROL}
        hosts = {row.address for row in self.site.lan.reservations if row.traffic in shares}
        return flow.source.address in hosts or what in {("udp", DNS), ("udp", NTP)}

    def forwarded_to(self, flow: PacketFlow) -> IPv4Address | None:
        """Return the LAN host to which a packet for an outer address is forwarded, whoever sends it."""
        if flow.source.area is Area.ROUTER or flow.destination.address not in {
            link.address for link in self.site.bearers
        }:
            return None
        services = [(forward.transport.value, forward.port, forward.to) for forward in self.router.forwards]
        qualify = self.inventory.pilot.qualify
        if qualify is not None and self.inventory.hosts[qualify.reflector].site == self.host.site:
            services.append(("udp", qualify.port, qualify.reflector))
        name = next((to for transport, port, to in services if (transport, port) == (flow.protocol, flow.port)), None)
        device = None if name is None else self.inventory.hosts[name].device
        return device.address if isinstance(device, model.LanBox) else None
