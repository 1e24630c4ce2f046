"""What a router sends over one of its links: every frame is looked at beyond the 4G unit or the terminal."""

from __future__ import annotations

import itertools
import socket
import time
from collections import Counter
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from ipaddress import IPv4Address
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.emulator.lab import hosts
from atlantis_netcfg.emulator.lab.frame_link import ETHERNET
from atlantis_netcfg.emulator.routeros.dataplane import packets
from atlantis_netcfg.inventory.satellite_allow_list import allowed_targets

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from atlantis_netcfg.emulator.lab.frame_link import FrameLink
    from atlantis_netcfg.inventory import Host, model
    from atlantis_netcfg.operations.pilot_network.network import PilotNetwork

_IPV4, _ARP = b"\x08\x00", b"\x08\x06"
_FRAGMENT: Final = 0x1FFF
"""Of the 16 bits with flags and offset: the offset (RFC 791)."""
_STRANGE_PORT: Final = 53
"""No target of an allow-list has it: the routers use no DNS."""
_SOURCE_PORT: Final = 40_000
_ARRIVAL_S: Final = 2.0
"""A packet from the LAN is on the link within this time."""
_POLL_S: Final = 0.02
_PROBES = itertools.count(1000)
"""Numbers of probes, above those of strangers."""


@dataclass(frozen=True, slots=True)
class Destination:
    """Where a packet goes."""

    protocol: str
    """Name or number; of what is not IPv4: its Ethernet type."""
    address: IPv4Address
    port: int | None = None
    """Of TCP and UDP, except later fragments."""

    def __str__(self) -> str:
        return f"{self.address} {self.protocol}" + ("" if self.port is None else f" {self.port}")


@dataclass(slots=True)
class LinkWatch:
    """What was sent over a link from its router."""

    counts: Counter[Destination] = field(default_factory=Counter)
    numbers: set[int] = field(default_factory=set)
    """Of our own packets."""

    def see(self, frame: bytes) -> None:
        """Count a frame; ARP stays on the link."""
        kind, packet = frame[ETHERNET - 2 : ETHERNET], frame[ETHERNET:]
        if kind == _ARP:
            return
        if kind != _IPV4:
            self.counts[Destination(f"0x{kind.hex()}", IPv4Address(0))] += 1
            return
        self.counts[_destination(packet)] += 1
        if (ours := packets.decode(packet)) is not None:
            self.numbers.add(ours.number)

    def strangers(self, pilot: model.Pilot, link: model.Link) -> list[str]:
        """Return what the allow-list of a link does not have, one line each."""
        targets = allowed_targets(pilot, link)
        return [
            msg(f"{arg(link.name)} has carried packets that are not allowed: {arg(count)} to {arg(destination)}")
            for destination, count in self.counts.items()
            if not any(_is_allowed(target, destination) for target in targets)
        ]


@contextmanager
def watch_link(link: FrameLink) -> Iterator[LinkWatch]:
    """Watch what is sent from the first end of a link."""
    watch = LinkWatch()
    link.watch = watch.see
    try:
        yield watch
    finally:
        link.watch = None


def send_strangers(network: PilotNetwork, router: Host, link: model.Link) -> int:
    """Send what no allow-list has to all addresses of the internet, from the LAN and the router; return how many.

    Raises MachineError.
    """
    source = network.inventory.sites[router.site].lan.dhcp.last
    addresses = (*network.servers, network.inventory.pilot.vpn.endpoint)
    places = [
        (address, protocol, number)
        for number, (address, protocol) in enumerate(itertools.product(addresses, ("icmp", "tcp", "udp")), 1)
    ]
    with network.guest(router, source) as namespace:
        for name, sender in ((namespace, source), (network.routers[router.name], link.address)):
            send(
                name,
                (
                    packets.FlowPacket(sender, address, protocol, number, _SOURCE_PORT, _STRANGE_PORT)
                    for address, protocol, number in places
                ),
            )
    return 2 * len(places)


def sees_probe(watch: LinkWatch, network: PilotNetwork, router: Host) -> bool:
    """Send a packet from a router's LAN to the VPN's server; return whether it is on the link. Raises MachineError."""
    vpn, source, number = network.inventory.pilot.vpn, network.inventory.sites[router.site].lan.dhcp.last, next(_PROBES)
    with network.guest(router, source) as namespace:
        send(namespace, [packets.FlowPacket(source, vpn.endpoint, vpn.transport.value, number, number, vpn.port)])
        end = time.monotonic() + _ARRIVAL_S
        while number not in watch.numbers and time.monotonic() < end:
            time.sleep(_POLL_S)
    return number in watch.numbers


def no_probe(link: model.Link) -> str:
    """Return the line for people about a probe that was not seen."""
    return msg(f"a packet from the LAN to the VPN server was not sent over {arg(link.name)}")


def send(namespace: str, flow_packets: Iterable[packets.FlowPacket]) -> None:
    """Send packets from a namespace; what its own filter drops, or has no route, is not sent."""
    inside = hosts.NamespaceSockets(namespace)
    with inside.socket(socket.SOCK_RAW, protocol=socket.IPPROTO_RAW) as raw:
        for packet in flow_packets:
            with suppress(OSError):
                raw.sendto(packet.encode(), (str(packet.destination), 0))
    inside.close()


def _destination(packet: bytes) -> Destination:
    protocol, header = {1: "icmp", 6: "tcp", 17: "udp"}.get(packet[9], str(packet[9])), 4 * (packet[0] & 15)
    has_port = protocol in {"tcp", "udp"} and not int.from_bytes(packet[6:8]) & _FRAGMENT
    port = int.from_bytes(packet[header + 2 : header + 4]) if has_port else None
    return Destination(protocol, IPv4Address(packet[16:20]), port)


def _is_allowed(target: model.AllowedTarget, destination: Destination) -> bool:
    if target.address != destination.address:
        return False
    return target.port is None or (
        target.transport.value == destination.protocol and destination.port in {target.port, None}
    )
