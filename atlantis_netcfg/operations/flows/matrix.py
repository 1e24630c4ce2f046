"""Every station of a site opens many kinds of flows to every other one: what arrives is compared with the intent."""

from __future__ import annotations

from collections import defaultdict
from contextlib import closing
from dataclasses import dataclass
from ipaddress import IPv4Address
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.emulator.routeros.dataplane import bench, packets
from atlantis_netcfg.inventory import model
from atlantis_netcfg.operations.flows import intent as intents
from atlantis_netcfg.operations.flows.intent import Area, FlowStation, PacketFlow, RouterIntent

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from atlantis_netcfg.emulator.routeros.dataplane.namespace import RouterNamespace
    from atlantis_netcfg.emulator.routeros.dataplane.rows import NetworkState
    from atlantis_netcfg.inventory import Host, Inventory

_STRANGERS: Final = (IPv4Address("198.51.100.200"), IPv4Address("192.0.2.77"))
"""Addresses of nobody (RFC 5737)."""
_EVERYBODY: Final = IPv4Address("255.255.255.255")
_NARROW_MSS: Final = 1300
_FIRST_PORT: Final = 20_000
"""Lowest port of those who begin flows."""


@dataclass(frozen=True, slots=True)
class FlowOutcome:
    """How a packet comes out of the router."""

    place: str
    source: IPv4Address | None = None
    """After source NAT; None at the router itself."""
    mss: int = 0
    """Segment size that TCP may offer; 0 for others."""
    is_first: bool = False
    """Control traffic on a slow link: it is marked, so that its queue lets it go first."""

    def __str__(self) -> str:
        words = (
            self.place,
            msg(f"from {arg(self.source)}") if self.source is not None else "",
            msg(f"with MSS {arg(self.mss)}") if self.mss else "",
            msg("marked") if self.is_first else "",
        )
        return join(" ", filter(None, words))


@dataclass(frozen=True, slots=True)
class FlowDifference:
    """What became of a flow, beside what the inventory intends."""

    flow: PacketFlow
    is_reply: bool
    """It is about the reply: the first packet arrived."""
    intention: FlowOutcome | None
    """None: it has to be dropped."""
    actual: tuple[FlowOutcome, ...]

    @property
    def is_as_intended(self) -> bool:
        """Whether the packet did what is intended."""
        return self.actual == (() if self.intention is None else (self.intention,))


@dataclass(frozen=True, slots=True)
class MatrixResult:
    """One router with one link in use."""

    link: str
    flows: int
    arrivals: int
    """Flows that arrived, as intended."""
    replies: int
    """Replies to them that were sent."""
    differences: tuple[FlowDifference, ...]


def try_flows(
    inventory: Inventory, host: Host, link: model.Link, namespace: RouterNamespace, state: NetworkState
) -> MatrixResult:
    """Send the first packet of every flow through the router's namespace, then the replies to those that arrived.

    `state`: the router's rows, with the tunnel up.
    """
    intent = RouterIntent(inventory, host, link)
    namespace.apply(state.with_default_route(link.gateway, intent.link_ports[link.name]))
    flows = list(_flows(intent))
    if 2 * len(flows) > packets.MOST:
        raise RuntimeError(f"{len(flows)} flows and their replies cannot be told apart")
    numbers, expectations = range(len(flows)), [_expected_outcome(intent, flow) for flow in flows]
    with closing(bench.PacketBench(namespace, _neighbours(intent))) as stand:
        arrivals = stand.send((_entry(flow.source), _packet(flow, number)) for number, flow in enumerate(flows))
        outcomes = [_outcomes(arrivals.get(number, ()), is_reply=False) for number in numbers]
        good = [number for number in numbers if expectations[number] and outcomes[number] == (expectations[number],)]
        replies = dict(_replies(intent, flows, good, arrivals))
        returns = stand.send((place, packet.reply(len(flows) + number)) for number, (place, packet) in replies.items())
    first = (FlowDifference(flows[number], False, expectations[number], outcomes[number]) for number in numbers)
    second = (
        FlowDifference(
            flows[number],
            True,
            _expected_reply(intent, flows[number]),
            _outcomes(returns.get(len(flows) + number, ()), is_reply=True),
        )
        for number in replies
    )
    differences = tuple(item for item in (*first, *second) if not item.is_as_intended)
    return MatrixResult(link.name, len(flows), len(good), len(replies), differences)


# --- packets -------------------------------------------------------------------------------------------------------


def _entry(station: FlowStation) -> str:
    return bench.ROUTER if station.area is Area.ROUTER else station.port


def _packet(flow: PacketFlow, number: int) -> packets.FlowPacket:
    return packets.FlowPacket(
        flow.source.address,
        flow.destination.address,
        flow.protocol,
        number,
        _FIRST_PORT + number,
        flow.port,
        flags=packets.SYN | packets.FIN if flow.is_broken else packets.SYN,
        mss=packets.FULL_MSS if flow.protocol == "tcp" else 0,
        dscp=flow.dscp,
    )


def _outcomes(arrivals: Sequence[bench.PacketArrival], *, is_reply: bool) -> tuple[FlowOutcome, ...]:
    """Return what came out; replies of the router itself to first packets do not count."""
    return tuple(
        FlowOutcome(item.place)
        if item.packet is None
        else FlowOutcome(item.place, item.packet.source, item.packet.mss, item.is_marked)
        for item in arrivals
        if is_reply or item.packet is None or not item.packet.is_reply
    )


def _replies(
    intent: RouterIntent,
    flows: Sequence[PacketFlow],
    good: Sequence[int],
    arrivals: Mapping[int, Sequence[bench.PacketArrival]],
) -> Iterator[tuple[int, tuple[str, packets.FlowPacket]]]:
    """Yield the flows whose replies pass the router again: where they arrived, and as what."""
    for number in good:
        flow, arrival = flows[number], arrivals[number][0]
        # What turns round on a bridge is replied to without the router, and an impostor's reply goes to the real one.
        is_direct = arrival.place == flow.source.port and intent.forwarded_to(flow) is None
        if arrival.packet is not None and not is_direct and intent.belongs(flow.source):
            yield number, (arrival.place, arrival.packet)


# --- expectations --------------------------------------------------------------------------------------------------


def _expected_outcome(intent: RouterIntent, flow: PacketFlow) -> FlowOutcome | None:
    """Return where a packet has to come out, with which source after NAT, and which segment size it may offer."""
    source, site = flow.source, intent.site
    if intent.forwarded_to(flow) is not None:
        # From the LAN too, its replies come back through the router.
        address = site.lan.gateway if source.address in site.lan.network else source.address
        return FlowOutcome(intent.lan_port, address, _mss(intent, flow, _entry(source), intent.lan_port))
    if not intent.allows(flow):
        return None
    if flow.destination.area is Area.ROUTER:
        return FlowOutcome(bench.ROUTER)
    place, address, is_first = flow.destination.port, source.address, False
    if flow.destination.area is Area.INTERNET:
        link = intent.link_to(flow)
        place, address, is_first = intent.link_ports[link.name], link.address, intent.goes_first(flow, link)
    elif flow.destination.area is Area.OTHER_SITE and source.address in site.management.network:
        address = next(link.address for link in site.served_links if intent.link_ports[link.name] == place)
    return FlowOutcome(place, address, _mss(intent, flow, _entry(source), place), is_first)


def _expected_reply(intent: RouterIntent, flow: PacketFlow) -> FlowOutcome:
    """Return where the reply to a flow has to come out: as from whom the flow was sent to."""
    if flow.source.area is Area.ROUTER:
        return FlowOutcome(bench.ROUTER)
    server, source = intent.forwarded_to(flow), flow.source
    way_in = intent.lan_port if server is not None else flow.destination.port
    if server is None and flow.destination.area is Area.INTERNET:
        way_in = intent.link_ports[intent.link_to(flow).name]
    mss = _mss(intent, flow, way_in, source.port)
    return FlowOutcome(source.port, flow.destination.address, mss)


def _mss(intent: RouterIntent, flow: PacketFlow, *ways: str) -> int:
    """Return the segment size offered at the far end: satellite and tunnel leave room for their own headers."""
    if flow.protocol != "tcp":
        return 0
    satellites = [link.name for link in intent.site.bearers if link.kind.traits.allow_list]
    narrow = {intent.tunnel, *(intent.link_ports[name] for name in satellites)}
    return _NARROW_MSS if narrow & set(ways) else packets.FULL_MSS


# --- stations ------------------------------------------------------------------------------------------------------


def _stations(intent: RouterIntent) -> Iterator[FlowStation]:
    """Yield the stations that exist: each of them sends and is sent to."""
    site, ports = intent.site, intent.link_ports
    for address in sorted(intent.own_hosts)[:2]:
        yield FlowStation(msg(f"own host {arg(address)}"), address, Area.LAN, intent.lan_port)
    guests = [item.address for item in site.lan.reservations if item.address not in intent.own_hosts]
    for address in [*guests[:2], site.lan.dhcp.first]:
        yield FlowStation(msg(f"LAN guest {arg(address)}"), address, Area.LAN, intent.lan_port)
    if intent.management_port is not None:
        yield FlowStation(msg("technician"), site.management.technician, Area.MANAGEMENT, intent.management_port)
    for radio_link in site.served_links:
        name = msg(f"far end of {arg(radio_link.name)}")
        yield FlowStation(name, _other(radio_link), Area.OTHER_SITE, ports[radio_link.name])
    yield from _members(intent)
    outside = [*_STRANGERS, *(server.address for server in intent.inventory.pilot.time_servers)]
    endpoint = intent.inventory.pilot.vpn.endpoint
    if endpoint not in {link.address for link in site.bearers}:
        outside.append(endpoint)
    for address in dict.fromkeys(outside):
        yield FlowStation(msg(f"internet {arg(address)}"), address, Area.INTERNET, ports[intent.link.name])
    for link in site.bearers:
        yield FlowStation(msg(f"next hop of {arg(link.name)}"), link.gateway, Area.INTERNET, ports[link.name])


def _members(intent: RouterIntent) -> Iterator[FlowStation]:
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
        yield FlowStation(msg(f"VPN {arg(address)}"), address, Area.VPN, port)


def _other(link: model.ServedLink) -> IPv4Address:
    return next(address for address in link.network.hosts() if address != link.address)


def _routers(intent: RouterIntent) -> Iterator[FlowStation]:
    site, ports = intent.site, intent.link_ports
    yield FlowStation(msg("router in the LAN"), site.lan.gateway, Area.ROUTER, intent.lan_port)
    if intent.management_port is not None:
        address = intent.router.access.address
        yield FlowStation(msg("router at the technician's port"), address, Area.ROUTER, intent.management_port)
    addresses = {link.name: link.address for link in site.bearers} | {
        link.name: link.address for link in site.served_links
    }
    for name, address in addresses.items():
        yield FlowStation(msg(f"router at {arg(name)}"), address, Area.ROUTER, ports[name])


def _impostors(intent: RouterIntent) -> Iterator[FlowStation]:
    """Yield senders whose address belongs behind another port."""
    site, ports = intent.site, intent.link_ports
    stations = {station.area: station for station in _stations(intent)}
    for area, station in stations.items():
        places = {other.area: other.port for other in stations.values() if other.port != station.port}
        for place, port in places.items():
            if area is not Area.INTERNET:
                yield FlowStation(
                    msg(f"{arg(station.name)} as seen from {arg(place.value)}"), station.address, place, port
                )
    for link in site.bearers:
        yield FlowStation(msg(f"stranger at {arg(link.name)}"), _STRANGERS[1], Area.INTERNET, ports[link.name])
        yield FlowStation(
            msg(f"LAN address at {arg(link.name)}"), site.lan.network[30], Area.INTERNET, ports[link.name]
        )


def _flows(intent: RouterIntent) -> Iterator[PacketFlow]:
    stations = list(_stations(intent))
    everybody = FlowStation(msg("everybody in the LAN"), _EVERYBODY, Area.ROUTER, intent.lan_port)
    yield PacketFlow(
        FlowStation(msg("LAN host without address"), intents.NO_ADDRESS, Area.LAN, intent.lan_port),
        everybody,
        "udp",
        intents.DHCP_SERVER,
    )
    senders = {(station.address, station.port): station for station in (*stations, *_impostors(intent))}
    dds = intent.inventory.pilot.dds
    ports = {
        "icmp": (0,),
        "tcp": (intents.SSH, intents.DNS, 80, intents.HTTPS, intent.api_port, intent.inventory.pilot.vpn.port, 5201),
        "udp": (
            intents.DNS,
            intents.DDS_QUESTION,
            intents.DHCP_SERVER,
            intents.NTP,
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
            if source not in routers and _can_be_broken(intent, destination):
                yield PacketFlow(source, destination, "tcp", intents.DNS, is_broken=True)
            if destination.area is Area.INTERNET:
                yield PacketFlow(source, destination, "icmp", dscp=intents.DDS_QUESTION)


def _can_be_broken(intent: RouterIntent, destination: FlowStation) -> bool:
    """Return whether the router has to drop what no connection begins with.

    Beside the VPN server it sees one direction only, and a terminal's own pages are accepted before that is looked at.
    """
    terminals = [link.network for link in intent.site.bearers if link.kind.traits.allow_list]
    is_beside_server = destination.area is Area.VPN and intent.has_server
    return not is_beside_server and not any(destination.address in network for network in terminals)


def _are_beside(source: FlowStation, destination: FlowStation) -> bool:
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
        if station.area in {Area.LAN, Area.MANAGEMENT, Area.OTHER_SITE}:
            result[station.port].append(station.address)
    if intent.has_server:
        server = intent.inventory.hosts[intent.inventory.pilot.vpn.server].device
        result[intent.lan_port] += [server.address] if isinstance(server, model.LanBox) else []
    return result
