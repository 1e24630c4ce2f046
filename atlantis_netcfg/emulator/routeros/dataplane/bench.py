"""Packets through a router's namespace: sent into its ports as neighbours would, and seen where they come out."""

from __future__ import annotations

import contextlib
import json
import os
import select
import socket
import time
from collections import defaultdict
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.emulator.lab import frame_link, hosts
from atlantis_netcfg.emulator.routeros.dataplane import packets
from atlantis_netcfg.emulator.routeros.dataplane.namespace import plug_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from ipaddress import IPv4Address

    from atlantis_netcfg.emulator.routeros.dataplane.namespace import RouterNamespace

ROUTER: Final = "router"
"""Where a packet arrives that is for the router itself, and where its own packets begin."""
_ETHERTYPE_IP: Final = 0x0800
_AT_MOST: Final = 65_536
_BURST: Final = 64
"""Packets that are sent before what has come out is read: no buffer overflows."""
_QUIET_S: Final = 0.2
"""Nothing more arrives after so long: forwarding takes microseconds."""
_LONGEST_S: Final = 20.0
_ARRIVALS: Final = """
table ip arrivals
delete table ip arrivals
table ip arrivals {
  set own { typeof ip id; size 65535; }
  set marked { typeof ip id; size 65535; }
  chain input {
    type filter hook input priority 10; policy accept;
    add @own { ip id }
  }
  chain postrouting {
    type filter hook postrouting priority -140; policy accept;
    meta mark & 0xff00 != 0 add @marked { ip id }
  }
}
"""
"""Behind the router's own filter and mangle."""


@dataclass(frozen=True, slots=True)
class PacketArrival:
    """Where a packet came out, and how: `place` is a port, a tunnel, or ROUTER, which shows nothing else."""

    place: str
    packet: packets.FlowPacket | None = None
    is_marked: bool = False
    """It had a packet mark, by which a queue would let it go first."""


class PacketBench:
    """The neighbours of a router at all its ports and tunnels.

    `neighbours`: addresses that each port reaches directly. The namespace must be new: tracked connections of before
    would let packets pass.
    """

    def __init__(self, router: RouterNamespace, neighbours: Mapping[str, Iterable[IPv4Address]]) -> None:
        self._router = router
        self._inside = hosts.NamespaceSockets(router.name)
        self._plugs: dict[str, socket.socket] = {}
        self._tunnels: dict[str, int] = {}
        self._heads: dict[str, bytes] = {}
        self._own_sockets: dict[IPv4Address, socket.socket] = {}
        with contextlib.ExitStack() as stack:
            stack.callback(self.close)
            for port in router.ports:
                self._plugs[port] = self._open_plug(port)
            for name in router.tunnels:
                self._tunnels[name] = self._inside.call(partial(frame_link.open_device, frame_link.TUN), name)
            self._introduce(neighbours)
            router.run("nft", "-f", "-", text=_ARRIVALS)
            stack.pop_all()

    def close(self) -> None:
        """Close all sockets."""
        for each in (*self._own_sockets.values(), *self._plugs.values()):
            each.close()
        for descriptor in self._tunnels.values():
            os.close(descriptor)
        self._own_sockets, self._plugs, self._tunnels = {}, {}, {}
        self._inside.close()

    def send(self, batch: Iterable[tuple[str, packets.FlowPacket]]) -> dict[int, list[PacketArrival]]:
        """Send packets into their ports, or from ROUTER; return by number where each came out."""
        arrivals: dict[int, list[tuple[str, packets.FlowPacket]]] = defaultdict(list)
        for count, (port, packet) in enumerate(batch, 1):
            self._send(port, packet)
            if count % _BURST == 0:
                self._collect(arrivals, 0.0)
        self._collect(arrivals, _QUIET_S)
        marked_numbers = self._numbers("marked")
        result = {
            number: [PacketArrival(place, packet, number in marked_numbers) for place, packet in items]
            for number, items in arrivals.items()
        }
        for number in self._numbers("own"):
            result.setdefault(number, []).append(PacketArrival(ROUTER))
        return result

    def _send(self, port: str, packet: packets.FlowPacket) -> None:
        data = packet.encode()
        if port == ROUTER:
            with contextlib.suppress(OSError):  # a drop of its own filter is an error of the sender
                self._own_socket(packet.source).sendto(data, (str(packet.destination), 0))
        elif port in self._tunnels:
            os.write(self._tunnels[port], data)
        elif port in self._plugs:  # else its rows have no such port: nothing gets in there
            self._plugs[port].send(self._heads[port] + data)

    def _collect(self, arrivals: dict[int, list[tuple[str, packets.FlowPacket]]], quiet_s: float) -> None:
        """Read what has come out until nothing more comes."""
        readers = {plug.fileno(): port for port, plug in self._plugs.items()}
        readers |= {descriptor: name for name, descriptor in self._tunnels.items()}
        end = time.monotonic() + _LONGEST_S
        while (ready := select.select(list(readers), [], [], quiet_s)[0]) and time.monotonic() < end:
            for descriptor in ready:
                port = readers[descriptor]
                with contextlib.suppress(BlockingIOError):
                    data = os.read(descriptor, _AT_MOST)
                    packet = packets.decode(data if port in self._tunnels else data[frame_link.ETHERNET :])
                    if packet is not None:
                        arrivals[packet.number].append((port, packet))

    def _numbers(self, name: str) -> set[int]:
        """Return the numbers in one of our sets, and empty it."""
        listing = json.loads(self._router.run("nft", "-j", "list", "set", "ip", "arrivals", name))
        (numbers,) = [item["set"].get("elem", []) for item in listing["nftables"] if "set" in item]
        self._router.run("nft", "flush", "set", "ip", "arrivals", name)
        return {int(number) for number in numbers}

    def _open_plug(self, port: str) -> socket.socket:
        plug = self._inside.socket(socket.SOCK_RAW, socket.AF_PACKET)
        plug.bind((plug_of(port), _ETHERTYPE_IP))
        plug.setblocking(False)
        return plug

    def _own_socket(self, source: IPv4Address) -> socket.socket:
        """Return a socket with an address of the router, by which routing rules choose."""
        if source not in self._own_sockets:
            self._own_sockets[source] = self._inside.socket(socket.SOCK_RAW, protocol=socket.IPPROTO_RAW)
            self._own_sockets[source].bind((str(source), 0))
        return self._own_sockets[source]

    def _introduce(self, neighbours: Mapping[str, Iterable[IPv4Address]]) -> None:
        """Let router and neighbours know each other's hardware addresses."""
        links = {link["ifname"]: link for link in json.loads(self._router.run("ip", "-j", "link"))}
        for number, port in enumerate(self._plugs):
            far = bytes([2, 0, 0x5E, 0, 0xFF, number])
            on = links[port].get("master", port)
            self._heads[port] = bytes.fromhex(links[on]["address"].replace(":", "")) + far + b"\x08\0"
            for address in neighbours.get(port, ()):
                words = f"ip neigh replace {address} lladdr {far.hex(':')} dev {on} nud permanent"
                self._router.run(*words.split())
            if on != port:
                self._router.run(*f"bridge fdb replace {far.hex(':')} dev {port} master static".split())
