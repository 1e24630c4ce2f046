"""Packets between any two ends of the VPN, and what has arrived: seen by packet sockets, not by who sent it.

An end hears only what is for its own address. The server's own packet socket stands before its firewall, so there an
answer is the proof. Nothing listens for TCP: the answer is a reset. UDP is echoed.
"""

import selectors
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from ipaddress import IPv4Address

from matrix_stand import Vpn
from waiting import HANG_S

from atlantis_netcfg.vpn.policy import Flow, Party, Protocol

_ETH_P_IP = 0x0800
_OUTGOING = 4
_IP_PKTINFO = 8
_SO_RCVBUFFORCE = 33
_SOURCE_PORT = 40001
_NUMBERS = {Protocol.ICMP: 1, Protocol.TCP: 6, Protocol.UDP: 17}


@dataclass(frozen=True)
class Heard:
    """A packet at its destination: the port is the one that is no sender's of ours, of ICMP its type."""

    protocol: Protocol
    source: str
    destination: str
    port: int
    answer: bool


class Probes:
    """All ends at once; `ends` are addresses by namespace."""

    def __init__(self, made: Vpn, ends: Mapping[str, str], ports: Iterable[int]) -> None:
        self.ends = ends
        self.heard: set[Heard] = set()
        self.patience_s = HANG_S
        self._changed = threading.Condition()
        self._selector = selectors.DefaultSelector()
        self._senders: dict[tuple[str, Protocol], socket.socket] = {}
        for who, address in ends.items():
            self._end(made, who, address, ports)
        self._ended = threading.Event()
        thread = threading.Thread(target=self._listen, daemon=True)
        thread.start()
        for end in (self._selector.close, thread.join, self._ended.set):
            made.stack.callback(end)

    def _end(self, made: Vpn, who: str, address: str, ports: Iterable[int]) -> None:
        watch = made.socket(who, socket.AF_PACKET, socket.SOCK_DGRAM, socket.htons(_ETH_P_IP))
        watch.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, 1 << 24)
        self._selector.register(watch, selectors.EVENT_READ, address)
        for port in ports:
            echo = made.socket(who, socket.AF_INET, socket.SOCK_DGRAM)
            echo.setsockopt(socket.IPPROTO_IP, _IP_PKTINFO, 1)
            echo.bind(("", port))
            self._selector.register(echo, selectors.EVENT_READ, None)
        for protocol in (Protocol.ICMP, Protocol.TCP):
            raw = made.socket(who, socket.AF_INET, socket.SOCK_RAW, _NUMBERS[protocol])
            raw.bind((address, 0))
            self._senders[who, protocol] = raw
        udp = made.socket(who, socket.AF_INET, socket.SOCK_DGRAM)
        udp.bind((address, _SOURCE_PORT))
        self._senders[who, Protocol.UDP] = udp

    def send(self, who: str, destination: str, flow: Flow) -> None:
        """One packet, the first of its flow."""
        data = b"probe"
        if flow.protocol is Protocol.ICMP:
            data = _icmp()
        elif flow.protocol is Protocol.TCP:
            data = _syn(self.ends[who], destination, flow.port or 0)
        port = (flow.port or 0) if flow.protocol is Protocol.UDP else 0
        self._senders[who, flow.protocol].sendto(data, (destination, port))

    def wait(self, until: Callable[[], object]) -> bool:
        """Wait for what arrivals make true; False if it does not come."""
        end = time.monotonic() + self.patience_s
        with self._changed:
            while not until() and time.monotonic() < end:
                self._changed.wait(0.05)
            return bool(until())

    def _listen(self) -> None:
        while not self._ended.is_set():
            for key, _ in self._selector.select(0.1):
                if key.data is None:
                    _echo(key.fileobj)  # type: ignore[arg-type]
                else:
                    self._read(key.fileobj, key.data)  # type: ignore[arg-type]

    def _read(self, watch: socket.socket, own: str) -> None:
        packet, address = watch.recvfrom(65536)
        if address[2] == _OUTGOING or (seen := _seen(packet)) is None or seen.destination != own:
            return
        with self._changed:
            self.heard.add(seen)
            self._changed.notify_all()


def _echo(echo: socket.socket) -> None:
    """Answer from the address that was asked."""
    data, control, _, asker = echo.recvmsg(2048, 64)
    told = [(level, kind, b"\0\0\0\0" + value[4:8] + b"\0\0\0\0") for level, kind, value in control]
    echo.sendmsg([data], told, 0, asker)


def asked(source: Party, destination: Party, flow: Flow) -> Heard:
    """What the destination hears of a flow."""
    return Heard(flow.protocol, str(source.address), str(destination.address), flow.port or 8, answer=False)


def answered(source: Party, destination: Party, flow: Flow) -> Heard:
    """What the source hears of it."""
    return Heard(flow.protocol, str(destination.address), str(source.address), flow.port or 0, answer=True)


def _seen(packet: bytes) -> Heard | None:
    head = (packet[0] & 0x0F) * 4
    protocol = next((one for one, number in _NUMBERS.items() if number == packet[9]), None)
    if protocol is None or packet[0] >> 4 != 4:
        return None
    source, destination = (str(IPv4Address(packet[at : at + 4])) for at in (12, 16))
    if protocol is Protocol.ICMP:
        return Heard(protocol, source, destination, packet[head], answer=packet[head] == 0)
    sport, dport = struct.unpack("!HH", packet[head : head + 4])
    answer = dport == _SOURCE_PORT
    return Heard(protocol, source, destination, sport if answer else dport, answer)


def _icmp() -> bytes:
    head = struct.pack("!BBHHH", 8, 0, 0, 7, 1)
    return struct.pack("!BBHHH", 8, 0, checksum(head), 7, 1)


def _syn(source: str, destination: str, port: int) -> bytes:
    def segment(check: int) -> bytes:
        return struct.pack("!HHIIBBHHH", _SOURCE_PORT, port, 1, 0, 5 << 4, 2, 1024, check, 0)

    pseudo = IPv4Address(source).packed + IPv4Address(destination).packed + struct.pack("!BBH", 0, 6, 20)
    return segment(checksum(pseudo + segment(0)))


def checksum(data: bytes) -> int:
    """RFC 1071."""
    total: int = sum(struct.unpack(f"!{len(data) // 2}H", data))
    while total >> 16:
        total = (total & 0xFFFF) + (total >> 16)
    return ~total & 0xFFFF


def datagram(source: str, destination: str, port: int) -> bytes:
    """A whole IPv4 packet with UDP in it, for a raw socket, as somebody sends it who lies about his address."""
    udp = struct.pack("!HHHH", _SOURCE_PORT, port, 13, 0) + b"false"
    return (
        struct.pack("!BBHHHBBH", 0x45, 0, 20 + len(udp), 0, 0, 64, 17, 0)
        + IPv4Address(source).packed
        + IPv4Address(destination).packed
        + udp
    )
