"""Every station of a site opens many kinds of flows to every other one: what arrives is compared with the intent."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, replace
from ipaddress import IPv4Address
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.emulator.routeros.dataplane import packets
from atlantis_netcfg.inventory import model
from atlantis_netcfg.operations.flows.intent import (
    DDS_QUESTION,
    DHCP_SERVER,
    DNS,
    HTTPS,
    NTP,
    SSH,
    Area,
    PacketFlow,
    RouterIntent,
    Station,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.emulator.routeros.dataplane.namespace import RouterNamespace
    from atlantis_netcfg.emulator.routeros.dataplane.rows import NetworkState
    from atlantis_netcfg.inventory import Host, Inventory

_STRANGERS: Final = (IPv4Address("198.51.100.200"), IPv4Address("192.0.2.77"))
"""Addresses of nobody (RFC 5737)."""
_NARROW_MSS: Final = 1300
_DEFAULT_ROUTE: Final = "0.0.0.0/0 table 254 "


@dataclass(frozen=True, slots=True)
class Difference:
    """A flow that did not do what the inventory intends."""

    flow: PacketFlow
    expected: frozenset[packets.Arrival]
    """Where its first packet should come out; empty: nowhere."""
    actual: frozenset[packets.Arrival]


@dataclass(frozen=True, slots=True)
class MatrixResult:
    """One router with one link in use."""

    router: str
    link: str
    flows: int
    passed: int
    """Flows that arrived, as intended."""
    differences: tuple[Difference, ...]


def try_flows(
    inventory: Inventory, host: Host, link: model.Link, namespace: RouterNamespace, state: NetworkState
) -> MatrixResult:
    """Send the first packet of every flow through the router's namespace; `state`: its rows, with the tunnel up."""
    intent = RouterIntent(inventory, host, link)
    namespace.apply(_with_link_in_use(state, intent))
    flows = list(_flows(intent))
    with packets.PacketBench(namespace, _neighbours(intent)) as bench:
        arrivals = bench.send(
            packets.FirstPacket(
                packets.ROUTER if flow.source.area is Area.ROUTER else flow.source.port,
                flow.source.address,
                flow.destination.address,
                flow.protocol,
                flow.port,
                flow.dscp,
            )
            for flow in flows
        )
    expectations = [_expected(intent, flow) for flow in flows]
    differences = tuple(
        Difference(flow, expected, actual)
        for flow, expected, actual in zip(flows, expectations, arrivals, strict=True)
        if expected != actual
    )
    passed = sum(bool(expected) and expected == actual for expected, actual in zip(expectations, arrivals, strict=True))
    return MatrixResult(host.name, link.name, len(flows), passed, differences)


def _with_link_in_use(state: NetworkState, intent: RouterIntent) -> NetworkState:
    """Lead the default route over the link, as after a change of link."""
    port = intent.link_ports[intent.link.name]
    default = f"{_DEFAULT_ROUTE}metric 1 via {intent.link.gateway} dev {port} onlink"
    others = (route for route in state.routes if not route.startswith(_DEFAULT_ROUTE))
    return replace(state, routes=(*others, default))


def _expected(intent: RouterIntent, flow: PacketFlow) -> frozenset[packets.Arrival]:
    """Return where a packet has to come out, with which source after NAT, and which segment size it may offer."""
    source, site = flow.source, intent.site
    if intent.forwarded_to(flow) is not None:
        # From the LAN too, its replies come back through the router.
        address = site.lan.gateway if source.address in site.lan.network else source.address
        return frozenset({packets.Arrival(intent.lan_port, address, _mss(intent, flow, intent.lan_port))})
    if not intent.allows(flow):
        return frozenset()
    if flow.destination.area is Area.ROUTER:
        return frozenset({packets.Arrival(packets.ROUTER)})
    place, address = flow.destination.port, source.address
    if flow.destination.area is Area.INTERNET:
        link = intent.link_to(flow)
        place, address = intent.link_ports[link.name], link.address
    elif flow.destination.area is Area.SERVED and source.address in site.management.network:
        address = next(link.address for link in site.served_links if intent.link_ports[link.name] == place)
    return frozenset({packets.Arrival(place, address, _mss(intent, flow, place))})


def _mss(intent: RouterIntent, flow: PacketFlow, place: str) -> int:
    """Return the segment size offered at the far end: satellite and tunnel leave room for their own headers."""
    if flow.protocol != "tcp":
        return 0
    satellites = [link.name for link in intent.site.bearers if link.kind.traits.allow_list]
    narrow = {intent.tunnel, *(intent.link_ports[name] for name in satellites)}
    ways = {place} if flow.source.area is Area.ROUTER else {place, flow.source.port}
    return _NARROW_MSS if narrow & ways else packets.FULL_MSS


# --- stations ------------------------------------------------------------------------------------------------------


def _stations(intent: RouterIntent) -> Iterator[Station]:
    """Yield the stations that exist: each of them sends and is sent to."""
    site, ports = intent.site, intent.link_ports
    for address in sorted(intent.own_hosts)[:2]:
        yield Station(f"own host {address}", address, Area.LAN, intent.lan_port)
    guests = [item.address for item in site.lan.reservations if item.address not in intent.own_hosts]
    for address in [*guests[:2], site.lan.dhcp.first]:
        yield Station(f"LAN guest {address}", address, Area.LAN, intent.lan_port)
    if intent.management_port is not None:
        yield Station("technician", site.management.technician, Area.MANAGEMENT, intent.management_port)
    for served in site.served_links:
        yield Station(f"far end of {served.name}", _other(served), Area.SERVED, ports[served.name])
    yield from _members(intent)
    outside = [*_STRANGERS, *(server.address for server in intent.inventory.pilot.time_servers)]
    endpoint = intent.inventory.pilot.vpn.endpoint
    if endpoint not in {link.address for link in site.bearers}:
        outside.append(endpoint)
    for address in dict.fromkeys(outside):
        yield Station(f"internet {address}", address, Area.INTERNET, ports[intent.link.name])
    for link in site.bearers:
        yield Station(f"next hop of {link.name}", link.gateway, Area.INTERNET, ports[link.name])


def _members(intent: RouterIntent) -> Iterator[Station]:
    """Yield stations behind the VPN: one of each network, and one of each prefix that may manage the router."""
    port = intent.tunnel or (intent.lan_port if intent.has_server else None)
    if port is None:
        return
    networks = [
        *intent.remotes,
        *(
            prefix
            for prefix in intent.site.management.admit
            if any(prefix.subnet_of(network) for network in intent.remotes)
        ),
    ]
    for network in dict.fromkeys(networks):
        address = network[200 if network.num_addresses > 256 else 20]  # noqa: PLR2004 - a /24
        yield Station(f"VPN {address}", address, Area.VPN, port)


def _other(link: model.ServedLink) -> IPv4Address:
    return next(address for address in link.network.hosts() if address != link.address)


def _routers(intent: RouterIntent) -> Iterator[Station]:
    site, ports = intent.site, intent.link_ports
    yield Station("router in the LAN", site.lan.gateway, Area.ROUTER, intent.lan_port)
    if intent.management_port is not None:
        address = intent.router.access.address
        yield Station("router at the technician's port", address, Area.ROUTER, intent.management_port)
    addresses = {link.name: link.address for link in site.bearers} | {
        link.name: link.address for link in site.served_links
    }
    for name, address in addresses.items():
        yield Station(f"router at {name}", address, Area.ROUTER, ports[name])


def _impostors(intent: RouterIntent) -> Iterator[Station]:
    """Yield senders whose address belongs behind another port."""
    site, ports = intent.site, intent.link_ports
    stations = {station.area: station for station in _stations(intent)}
    for area, station in stations.items():
        places = {other.area: other.port for other in stations.values() if other.port != station.port}
        for place, port in places.items():
            if area is not Area.INTERNET:
                yield Station(f"{station.name} as seen from {place.value}", station.address, place, port)
    for link in site.bearers:
        yield Station(f"stranger at {link.name}", _STRANGERS[1], Area.INTERNET, ports[link.name])
        yield Station(f"LAN address at {link.name}", site.lan.network[30], Area.INTERNET, ports[link.name])


def _flows(intent: RouterIntent) -> Iterator[PacketFlow]:
    stations = list(_stations(intent))
    senders = {(station.address, station.port): station for station in (*stations, *_impostors(intent))}
    dds = intent.inventory.pilot.dds
    ports = {
        "icmp": (0,),
        "tcp": (SSH, DNS, 80, HTTPS, intent.api_port, intent.inventory.pilot.vpn.port, 5201),
        "udp": (
            DNS,
            DDS_QUESTION,
            DHCP_SERVER,
            NTP,
            intent.inventory.pilot.vpn.port,
            862,
            7400,
            *(() if dds is None else (dds.ports[0],)),
            33_000,
        ),
    }
    routers = list(_routers(intent))
    for source in (*senders.values(), *routers):
        for destination in (*stations, *(routers if source not in routers else ())):
            if source.address == destination.address or _are_beside(source, destination):
                continue
            for protocol, numbers in ports.items():
                for port in dict.fromkeys(numbers):
                    yield PacketFlow(source, destination, protocol, port)
            if destination.area is Area.INTERNET:
                yield PacketFlow(source, destination, "icmp", dscp=DDS_QUESTION)


def _are_beside(source: Station, destination: Station) -> bool:
    """Return whether packets between two stations do not pass the router, or not by themselves."""
    if destination.area is Area.ROUTER:
        return False
    if source.port == destination.port:
        return source.area is destination.area or source.area is Area.VPN
    return source.area is Area.INTERNET and destination.area is Area.INTERNET


def _neighbours(intent: RouterIntent) -> dict[str, list[IPv4Address]]:
    """Return the addresses that each port reaches directly."""
    result = defaultdict(list)
    for link in intent.site.bearers:
        result[intent.link_ports[link.name]].append(link.gateway)
    for station in _stations(intent):
        if station.area in {Area.LAN, Area.MANAGEMENT, Area.SERVED}:
            result[station.port].append(station.address)
    if intent.has_server:
        server = intent.inventory.hosts[intent.inventory.pilot.vpn.server].device
        result[intent.lan_port] += [server.address] if isinstance(server, model.LanBox) else []
    return result
