"""Packets through a router's namespace: sent into its ports as a neighbour would, and seen where they come out.

A packet carries its number, so that one pass sends thousands and tells each of them apart: as IP identification, and
as what NAT leaves alone (sequence number of TCP, payload of UDP and echo requests). Nobody answers: what counts is
whether the first packet of a flow arrives, and where.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import select
import socket
import struct
import time
from dataclasses import dataclass
from ipaddress import IPv4Address
from typing import TYPE_CHECKING, Final, Self

from atlantis_netcfg.emulator.lab import hosts
from atlantis_netcfg.emulator.routeros.dataplane.namespace import plug_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from types import TracebackType

    from atlantis_netcfg.emulator.routeros.dataplane.namespace import RouterNamespace

ROUTER: Final = "router"
"""Where a packet arrives that is for the router itself."""
MOST: Final = 60_000
"""Packets in one pass: each has a number of 16 bits."""
_ICMP, _TCP, _UDP = 1, 6, 17
PROTOCOLS: Final[Mapping[str, int]] = {"icmp": _ICMP, "tcp": _TCP, "udp": _UDP}
_ECHO_REQUEST: Final = 8
_MSS_OPTION: Final = (2, 4)
_MARK: Final = b"ATLANTIS"
_ETHERNET: Final = 14
"""Bytes of the header."""
_ETHERTYPE_IP: Final = 0x0800
_TUNSETIFF: Final = 0x400454CA
_TUN_WITHOUT_HEADER: Final = 0x1001
_AT_MOST: Final = 65_536
_QUIET_S: Final = 0.3
"""Nothing more arrives after so long: forwarding takes microseconds."""
_LONGEST_S: Final = 20.0
_ARRIVALS: Final = """
table ip arrivals
delete table ip arrivals
table ip arrivals {
  set numbers { typeof ip id; size 65535; }
  chain input {
    type filter hook input priority 10; policy accept;
    add @numbers { ip id }
  }
}
"""
"""Behind the router's own filter."""


FULL_MSS: Final = 1460
"""Maximum segment size that senders of TCP offer (Ethernet's MTU less two headers)."""


@dataclass(frozen=True, slots=True)
class Arrival:
    """Where a packet came out: a port, a tunnel or ROUTER; there with which source address and offered segment size."""

    place: str
    source: IPv4Address | None = None
    """None for ROUTER."""
    mss: int = 0
    """0 for ROUTER and for all but TCP."""


@dataclass(frozen=True, slots=True)
class FirstPacket:
    """The first packet of a flow; `port`: where a neighbour sends it into the router, or ROUTER: it sends itself."""

    port: str
    source: IPv4Address
    destination: IPv4Address
    protocol: str
    destination_port: int = 0
    dscp: int = 0

    def encode(self, number: int) -> bytes:
        """Return the IP packet. RFC 791, 792, 768 and 9293."""
        payload = _MARK + struct.pack("!I", number)
        source_port = 20_000 + number % 40_000
        if self.protocol == "icmp":
            body = _with_sum(struct.pack("!BBHHH", _ECHO_REQUEST, 0, 0, number, 1) + payload, 2)
        elif self.protocol == "udp":
            body = struct.pack("!HHHH", source_port, self.destination_port, 8 + len(payload), 0) + payload
        else:
            syn = struct.pack("!HHIIBBHHH", source_port, self.destination_port, number, 0, 0x60, 2, 1024, 0, 0)
            syn += struct.pack("!BBH", *_MSS_OPTION, FULL_MSS)
            pseudo = self.source.packed + self.destination.packed + struct.pack("!BBH", 0, _TCP, len(syn))
            body = _with_sum(pseudo + syn, len(pseudo) + 16)[len(pseudo) :]
        head = struct.pack(
            "!BBHHHBBH", 0x45, self.dscp << 2, 20 + len(body), number, 0, 64, PROTOCOLS[self.protocol], 0
        )
        return _with_sum(head + self.source.packed + self.destination.packed, 10) + body


def _with_sum(data: bytes, place: int) -> bytes:
    """Return data with its Internet checksum (RFC 1071) at `place`, where it has zeros."""
    padded = data + b"\0" * (len(data) % 2)
    total = sum(struct.unpack(f"!{len(padded) // 2}H", padded))
    while total >> 16:
        total = (total & 0xFFFF) + (total >> 16)
    return data[:place] + struct.pack("!H", ~total & 0xFFFF) + data[place + 2 :]


def _read(packet: bytes, place: str) -> tuple[int, Arrival] | None:
    """Return the number of one of our packets, and its arrival; None for any other, such as an ICMP error."""
    if len(packet) < 40 or packet[0] >> 4 != 4:  # noqa: PLR2004 - headers of IPv4 and of what follows it, our payload
        return None
    body, source = packet[(packet[0] & 0x0F) * 4 :], IPv4Address(packet[12:16])
    if packet[9] == _TCP:
        if body[13] != 2 or tuple(body[20:22]) != _MSS_OPTION:  # noqa: PLR2004 - SYN alone
            return None
        number, mss = struct.unpack("!I14xH", body[4:24])
        return number, Arrival(place, source, mss)
    is_ours = packet[9] == _UDP or (packet[9] == _ICMP and body[0] == _ECHO_REQUEST)
    if not is_ours or body[8:16] != _MARK:
        return None
    return struct.unpack("!I", body[16:20])[0], Arrival(place, source)


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
        self._own: dict[IPv4Address, socket.socket] = {}
        with contextlib.ExitStack() as stack:
            stack.callback(self.close)
            for port in router.ports:
                self._plugs[port] = self._open_plug(port)
            for name in router.tunnels:
                self._tunnels[name] = self._inside.call(_open_tunnel, name)
            self._introduce(neighbours)
            router.run("nft", "-f", "-", text=_ARRIVALS)
            stack.pop_all()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close all sockets."""
        for each in (*self._own.values(), *self._plugs.values()):
            each.close()
        for descriptor in self._tunnels.values():
            os.close(descriptor)
        self._plugs, self._tunnels = {}, {}
        self._inside.close()

    def _open_plug(self, port: str) -> socket.socket:
        plug = self._inside.socket(socket.SOCK_RAW, socket.AF_PACKET)
        plug.bind((plug_of(port), _ETHERTYPE_IP))
        plug.setblocking(False)
        plug.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 8 << 20)
        return plug

    def _own_socket(self, source: IPv4Address) -> socket.socket:
        """Return a socket with an address of the router, by which routing rules choose."""
        if source not in self._own:
            self._own[source] = self._inside.socket(socket.SOCK_RAW, protocol=socket.IPPROTO_RAW)
            self._own[source].bind((str(source), 0))
        return self._own[source]

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

    def send(self, packets: Iterable[FirstPacket]) -> list[frozenset[Arrival]]:
        """Send packets, once for each bench; return for each where it came out: nothing if it was dropped."""
        places: list[set[Arrival]] = []
        for number, packet in enumerate(packets):
            places.append(set())
            data = packet.encode(number)
            if packet.port == ROUTER:
                with contextlib.suppress(OSError):  # a drop of its own filter is an error of the sender
                    self._own_socket(packet.source).sendto(data, (str(packet.destination), 0))
            elif packet.port in self._tunnels:
                os.write(self._tunnels[packet.port], data)
            else:
                self._plugs[packet.port].send(self._heads[packet.port] + data)
            if number % 64 == 0:
                self._collect(places, 0.0)
        self._collect(places, _QUIET_S)
        for number in self._own_arrivals():
            if number < len(places):
                places[number].add(Arrival(ROUTER))
        return [frozenset(place) for place in places]

    def _collect(self, places: list[set[Arrival]], quiet_s: float) -> None:
        """Read what has come out until nothing more comes."""
        readers = {plug.fileno(): port for port, plug in self._plugs.items()}
        readers |= {descriptor: name for name, descriptor in self._tunnels.items()}
        end = time.monotonic() + _LONGEST_S
        while (ready := select.select(list(readers), [], [], quiet_s)[0]) and time.monotonic() < end:
            for descriptor in ready:
                port = readers[descriptor]
                with contextlib.suppress(BlockingIOError):
                    data = os.read(descriptor, _AT_MOST)
                    packet = _read(data if port in self._tunnels else data[_ETHERNET:], port)
                    if packet is not None and packet[0] < len(places):
                        places[packet[0]].add(packet[1])

    def _own_arrivals(self) -> list[int]:
        listing = json.loads(self._router.run("nft", "-j", "list", "set", "ip", "arrivals", "numbers"))
        (numbers,) = [item["set"].get("elem", []) for item in listing["nftables"] if "set" in item]
        return [int(number) for number in numbers]


def _open_tunnel(name: str) -> int:
    """Return the end of a tunnel at which a VPN program would read and write IP packets."""
    descriptor = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(descriptor, _TUNSETIFF, struct.pack("16sH", name.encode(), _TUN_WITHOUT_HEADER))
    return descriptor
