"""Routers' namespaces, the links between them, units with NAT, and the internet, for computers to be plugged in.

    computer -- LAN of a router -- 4G unit or terminal == link with delay, rate, loss == internet == router of the SCC
                                == Wi-Fi bridge ================================================/

A router's namespace is kept at its rows by whoever emulates the router; here are the cables in its ports.
"""

from __future__ import annotations

import itertools
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from ipaddress import IPv4Address, IPv4Network
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.emulator import lab
from atlantis_netcfg.emulator.lab import hosts
from atlantis_netcfg.emulator.lab.frame_link import FrameLink, FrameRelay
from atlantis_netcfg.emulator.routeros.dataplane.namespace import plug_of
from atlantis_netcfg.operations.common.link_shapes import link_shapes
from atlantis_netcfg.operations.flows.intent import RouterIntent
from atlantis_netcfg.operations.pilot_network.time_server import SntpResponder
from atlantis_netcfg.routeros.render import view

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from atlantis_netcfg.inventory import Host, Inventory, model
    from atlantis_netcfg.operations.common.link_shapes import Replay

    SiteLink = tuple[str, str]
    """Site and link by name."""

_BACKBONE: Final = IPv4Network("198.18.0.0/15")
"""Between operators and the internet: addresses for tests of network devices (RFC 2544)."""
_INTERNET: Final = "net"
_TRANSLATION: Final = """
table ip unit {
  chain out {
    type nat hook postrouting priority srcnat; policy accept;
    oifname "far" masquerade
  }
}
"""
"""What a 4G unit or a satellite terminal does with the addresses behind it."""
_FORWARDING: Final = ("net.ipv4.ip_forward=1", "net.ipv4.icmp_ratelimit=0", "net.ipv6.conf.all.disable_ipv6=1")


@dataclass
class PilotNetwork:
    """The networks of all sites in the rehearsal; made by `open_network`."""

    name: str
    inventory: Inventory
    routers: dict[str, str] = field(default_factory=dict)
    """Namespace of each router, by its host name."""
    links: dict[SiteLink, FrameLink] = field(default_factory=dict)
    """First end: the router whose link it is."""
    _stack: ExitStack = field(default_factory=ExitStack)
    _backbone: Iterator[tuple[IPv4Address, IPv4Address]] = field(
        default_factory=lambda: ((subnet[1], subnet[2]) for subnet in _BACKBONE.subnets(new_prefix=30))
    )
    """Addresses of both ends of each link to the internet."""
    _numbers: Iterator[int] = field(default_factory=lambda: itertools.count(1))
    """Of devices and namespaces; several threads plug computers in."""

    def namespace(self, what: str) -> str:
        """Return the namespace of a part."""
        return f"{self.name}-{what}"

    def run(self, namespace: str, *words: str, text: str | None = None) -> str:
        """Run a program in a namespace and return its output. Raises MachineError."""
        return hosts.run_in_namespace(namespace, *words, text=text)

    def plug_in(self, machine: lab.Machine, router: Host) -> None:
        """Plug a machine's cable into the LAN of its site's router until the end. Raises MachineError."""
        namespace = self.routers[router.name]
        sockets = hosts.NamespaceSockets(namespace)
        self._stack.callback(sockets.close)
        before = machine.move_cable(namespace, self._lan_bridge(router), sockets)
        self._stack.callback(machine.move_cable, *before)

    def add_host(self, router: Host, name: str, address: IPv4Address) -> str:
        """Plug a new computer into a router's LAN; return its namespace. Raises MachineError."""
        namespace, lan = self._add(name), self.inventory.sites[router.site].lan
        port = self._device("h")
        _ip(
            namespace,
            f"link add eth0 type veth peer name {port} netns {self.routers[router.name]}",
            f"address add {address}/{lan.network.prefixlen} dev eth0",
            "link set eth0 up",
        )
        _ip(self.routers[router.name], f"link set {port} master {self._lan_bridge(router)}", f"link set {port} up")
        _ip(namespace, f"route add default via {lan.gateway}")
        return namespace

    @contextmanager
    def guest(self, router: Host, address: IPv4Address) -> Iterator[str]:
        """Plug a computer into a router's LAN; yield its namespace. Raises MachineError."""
        namespace = self.add_host(router, self._device("h"), address)
        try:
            yield namespace
        finally:
            hosts.delete_namespace(namespace)

    # --- construction ----------------------------------------------------------------------------------------------

    def build(self, routers: Sequence[Host], attach: Callable[[Host, str], None], replay: Replay | None) -> None:
        """Make the namespaces and all links between them."""
        relay = FrameRelay()
        self._stack.callback(relay.close)
        internet = self._add(_INTERNET)
        _ip(internet, *(f"address add {address}/32 dev lo" for address in self.servers))
        for host in routers:
            self.routers[host.name] = self._add(f"r{len(self.routers)}", forwards=False)
            attach(host, self.routers[host.name])
        for host in routers:
            for link in self.inventory.sites[host.site].bearers:
                self._lay(relay, host, link, replay)
        for server in self.inventory.pilot.time_servers:
            self._stack.enter_context(SntpResponder(internet, str(server.address)))

    @property
    def servers(self) -> list[IPv4Address]:
        """The addresses of the internet that answer: probe targets, time servers, and refused ones."""
        links = [link for site in self.inventory.sites.values() for link in site.bearers]
        probes = [
            address for link in links for address in (*link.canaries, *(each.address for each in link.refused_probes))
        ]
        routers = {link.address for link in links}
        return [
            address
            for address in dict.fromkeys([*probes, *(server.address for server in self.inventory.pilot.time_servers)])
            if address not in routers
        ]

    def _lay(self, relay: FrameRelay, host: Host, link: model.Link, replay: Replay | None) -> None:
        """Lay one link: to the router that serves it, else to the internet, through a unit with NAT."""
        server, shapes = self._serving(link), link_shapes(link, replay)
        near = (self.routers[host.name], self._device("l"))
        far = (self.namespace(_INTERNET) if server is None else self.routers[server[0].name], self._device("l"))
        is_public = link.address == self.inventory.pilot.vpn.endpoint
        if server is None and not is_public:
            near = (self._add_unit(host, link), "far")
        self.links[host.site, link.name] = relay.add(near, far, shapes)
        if server is not None:
            self._connect(host, link.name, near)
            self._connect(*server, far)
        elif is_public:
            self._connect(host, link.name, near)
            _ip(*_up(far, f"{link.gateway}/{link.network.prefixlen}"))
        else:
            here, there = next(self._backbone)
            _ip(*_up(far, f"{here}/30"))
            _ip(*_up(near, f"{there}/30"), f"route add default via {here}")

    def _add_unit(self, host: Host, link: model.Link) -> str:
        """Make a 4G unit or a terminal at a router's port, which is its next hop: what it forwards is translated."""
        namespace = self._add(self._device("u"))
        _ip(self.routers[host.name], f"link set {plug_of(_port_of(host, link.name))} netns {namespace} name near")
        _ip(*_up((namespace, "near"), f"{link.gateway}/{link.network.prefixlen}"))
        self.run(namespace, "nft", "-f", "-", text=_TRANSLATION)
        return namespace

    def _serving(self, link: model.Link) -> tuple[Host, str] | None:
        """Return the router at the far end of a link between sites, and what it calls the link."""
        for name in self.routers:
            host = self.inventory.hosts[name]
            for served_link in self.inventory.sites[host.site].served_links:
                if served_link.network == link.network:
                    return host, served_link.name
        return None

    def _connect(self, host: Host, link: str, end: tuple[str, str]) -> None:
        """Put the end of a link into the socket of a router's port."""
        namespace, device = end
        port, bridge = _port_of(host, link), self._device("b")
        _ip(
            namespace,
            f"link add {bridge} type bridge mcast_snooping 0",
            f"link set {plug_of(port)} master {bridge}",
            f"link set {device} master {bridge}",
            f"link set {device} up",
            f"link set {bridge} up",
        )

    def _lan_bridge(self, router: Host) -> str:
        """Return the bridge of a router's LAN, of which its first LAN port is a member."""
        port = RouterIntent(self.inventory, router, self.inventory.sites[router.site].bearers[0]).lan_port
        text = self.run(self.routers[router.name], "bridge", "link", "show", "dev", port)
        return text.partition(" master ")[2].split()[0]

    def _add(self, what: str, *, forwards: bool = True) -> str:
        namespace = self.namespace(what)
        hosts.add_namespace(namespace)
        self._stack.callback(hosts.delete_namespace, namespace)
        if forwards:
            self.run(namespace, "sysctl", "-qw", *_FORWARDING)
        return namespace

    def _device(self, kind: str) -> str:
        return f"{kind}{next(self._numbers)}"


def _ip(namespace: str, *lines: str) -> None:
    hosts.ip_batch(namespace, lines)


def _up(end: tuple[str, str], address: str) -> tuple[str, str, str]:
    """Return the namespace of a device, and the lines that give it an address and bring it up."""
    namespace, device = end
    return namespace, f"address add {address} dev {device}", f"link set {device} up"


def _port_of(host: Host, link: str) -> str:
    return next(port.name for port in view.router_of(host).ports if port.link == link)


@contextmanager
def open_network(
    inventory: Inventory,
    routers: Sequence[Host],
    attach: Callable[[Host, str], None],
    replay: Replay | None = None,
) -> Iterator[PilotNetwork]:
    """Join the routers of a rehearsal until the context ends; raise MachineError.

    `attach`: brings a router's data plane into a namespace, which exists. `replay`: a measured link instead of the
    declared one.
    """
    with lab.reserve_name() as name, ExitStack() as stack:
        network = PilotNetwork(name, inventory, _stack=stack)
        network.build(routers, attach, replay)
        yield network
