"""Routers' namespaces, the links between them, units with NAT, and the internet, for computers to be plugged in.

    computer -- LAN of a router -- 4G unit or terminal == link with delay, rate, loss == internet == router of the SCC
                                == Wi-Fi bridge ================================================/

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

    @contextmanager
    def guest(self, router: Host, address: IPv4Address) -> Iterator[str]:
        """Plug a computer into a router's LAN; yield its namespace. Raises MachineError."""
        namespace = self.add_host(router, f"h{self._count}", address)
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
        self._ip(internet, *(f"address add {address}/32 dev lo" for address in self.servers))
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
        internet, server, shapes = self.namespace(_INTERNET), self._serving(link), link_shapes(link, replay)
        near = (self.routers[host.name], self._device("l"))
        far = (internet if server is None else self.routers[server[0].name], self._device("l"))
        gateway = f"{link.gateway}/{link.network.prefixlen}"
        if server is None and link.address != self.inventory.pilot.vpn.endpoint:  # no public address
            near = (self._add_unit(host, link.name, gateway), "far")
            gateway = self._backbone_address(0)
        self.links[host.site, link.name] = relay.add(near, far, shapes)
        if near[1] == "far":
            self._ip(near[0], f"address add {self._backbone_address(1)} dev far", "link set far up")
            self._ip(near[0], f"route add default via {gateway.partition('/')[0]}")
        else:
            self._connect(host, link.name, near)
        if server is not None:
            self._connect(*server, far)
        else:
            self._ip(far[0], f"address add {gateway} dev {far[1]}", f"link set {far[1]} up")

    def _add_unit(self, host: Host, link: str, address: str) -> str:
        """Make a 4G unit or a terminal at a router's port, with its address there: what it forwards is translated."""
        namespace = self._add(f"u{self._count}")
        self._ip(self.routers[host.name], f"link set {plug_of(_port_of(host, link))} netns {namespace} name near")
        self._ip(namespace, f"address add {address} dev near", "link set near up")
        self.run(namespace, "nft", "-f", "-", text=_TRANSLATION)
        return namespace

    def _backbone_address(self, end: int) -> str:
        """Return the address of one end of the newest link to the internet."""
        return f"{_BACKBONE[4 * self._count + 1 + end]}/30"

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
        port, bridge = _port_of(host, link), self._device("b")
        self._ip(
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
        self._count += 1
        return f"{kind}{self._count}"

    def _ip(self, namespace: str, *lines: str) -> None:
        result = hosts.output_of(("ip", "-n", namespace, "-batch", "-"), text="\n".join([*lines, ""]))
        if result.returncode:
            raise hosts.MachineError(f"{namespace}: {result.stderr.strip()}")


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
