"""Routers' namespaces, the links between them, operators with NAT, and the internet, for computers to be plugged in.

    computer -- LAN of a router == link with delay, rate and loss == operator -- internet == uplink == router of the SCC
                                == Wi-Fi bridge ===================================================/

A router's namespace is kept at its rows by whoever emulates the router; here are the cables in its ports.
"""

from __future__ import annotations

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
from atlantis_netcfg.operations.pilot_network.time_server import TimeServer
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
_OPERATOR: Final = """
table ip operator {
  chain out {
    type nat hook postrouting priority srcnat; policy accept;
    oifname "far" masquerade
  }
}
"""
"""What a mobile or satellite operator does with a customer's private address."""
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
    _count: int = 0

    def namespace(self, what: str) -> str:
        """Return the namespace of a part."""
        return f"{self.name}-{what}"

    def run(self, namespace: str, *words: str, text: str | None = None) -> str:
        """Run a program in a namespace and return its output. Raises MachineError."""
        result = hosts.output_of(("ip", "netns", "exec", namespace, *words), text=text)
        if result.returncode:
            raise hosts.MachineError(f"{' '.join(words)}: {result.stderr.strip() or result.returncode}")
        return result.stdout

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
        self._ip(
            namespace,
            f"link add eth0 type veth peer name {port} netns {self.routers[router.name]}",
            f"address add {address}/{lan.network.prefixlen} dev eth0",
            "link set eth0 up",
        )
        self._ip(self.routers[router.name], f"link set {port} master {self._lan_bridge(router)}", f"link set {port} up")
        self._ip(namespace, f"route add default via {lan.gateway}")
        return namespace

    # --- construction ----------------------------------------------------------------------------------------------

    def build(self, routers: Sequence[Host], attach: Callable[[Host, str], None], replay: Replay | None) -> None:
        """Make the namespaces and all links between them."""
        relay = FrameRelay()
        self._stack.callback(relay.close)
        internet = self._add(_INTERNET)
        self._ip(internet, *(f"address add {address}/32 dev lo" for address in self._servers()))
        for host in routers:
            self.routers[host.name] = self._add(f"r{len(self.routers)}", forwards=False)
            attach(host, self.routers[host.name])
        for host in routers:
            for link in self.inventory.sites[host.site].bearers:
                self._lay(relay, host, link, replay)
        for server in self.inventory.pilot.time_servers:
            self._stack.enter_context(TimeServer(internet, str(server.address)))

    def _servers(self) -> list[IPv4Address]:
        """Return the addresses of the internet that answer: probe targets, time servers, and refused ones."""
        links = [link for site in self.inventory.sites.values() for link in site.bearers]
        probes = [
            address for link in links for address in (*link.canaries, *(each.address for each in link.refused_probes))
        ]
        own = {link.address for link in links}
        return [
            address
            for address in dict.fromkeys([*probes, *(server.address for server in self.inventory.pilot.time_servers)])
            if address not in own
        ]

    def _lay(self, relay: FrameRelay, host: Host, link: model.Link, replay: Replay | None) -> None:
        """Lay one link: to the router that serves it, else through an operator to the internet."""
        server = self._serving(link)
        if server is not None:
            place = self.routers[server[0].name]
        elif link.address == self.inventory.pilot.vpn.endpoint:  # a public address
            place = self.namespace(_INTERNET)
        else:
            place = self._add_operator()
        near, far = (self.routers[host.name], self._device("l")), (place, self._device("l"))
        self.links[host.site, link.name] = relay.add(near, far, link_shapes(link, replay))
        self._connect(host, link.name, near)
        if server is not None:
            self._connect(*server, far)
        else:
            self._ip(
                place, f"address add {link.gateway}/{link.network.prefixlen} dev {far[1]}", f"link set {far[1]} up"
            )

    def _serving(self, link: model.Link) -> tuple[Host, str] | None:
        """Return the router at the far end of a link between sites, and what it calls the link."""
        for name in self.routers:
            host = self.inventory.hosts[name]
            for served in self.inventory.sites[host.site].served_links:
                if served.network == link.network:
                    return host, served.name
        return None

    def _connect(self, host: Host, link: str, end: tuple[str, str]) -> None:
        """Put the end of a link into the socket of a router's port."""
        namespace, device = end
        port = next(port.name for port in view.router_of(host).ports if port.link == link)
        bridge = self._device("b")
        self._ip(
            namespace,
            f"link add {bridge} type bridge mcast_snooping 0",
            f"link set {plug_of(port)} master {bridge}",
            f"link set {device} master {bridge}",
            f"link set {device} up",
            f"link set {bridge} up",
        )

    def _add_operator(self) -> str:
        """Make an operator: it forwards from its customer to the internet, with an address of its own."""
        namespace, internet, port = self._add(f"o{self._count}"), self.namespace(_INTERNET), self._device("o")
        first = int(_BACKBONE.network_address) + 4 * self._count
        here, there = IPv4Address(first + 1), IPv4Address(first + 2)
        self._ip(
            namespace,
            f"link add far type veth peer name {port} netns {internet}",
            f"address add {there}/30 dev far",
            "link set far up",
            f"route add default via {here}",
        )
        self._ip(internet, f"address add {here}/30 dev {port}", f"link set {port} up")
        self.run(namespace, "nft", "-f", "-", text=_OPERATOR)
        return namespace

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
        self._count += 1
        return f"{kind}{self._count}"

    def _ip(self, namespace: str, *lines: str) -> None:
        result = hosts.output_of(("ip", "-n", namespace, "-batch", "-"), text="\n".join([*lines, ""]))
        if result.returncode:
            raise hosts.MachineError(f"{namespace}: {result.stderr.strip()}")


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
