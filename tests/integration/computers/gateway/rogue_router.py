"""Another computer of the yard that gives itself out as a router: frames as it sends them, made byte by byte."""

import socket
import struct
from ipaddress import IPv4Address, IPv6Address

from atlantis_netcfg.emulator.lab import Lab

MAC = bytes.fromhex("02000000bad0")
ROUTER = IPv6Address("fe80::bad")
PREFIX = IPv6Address("2001:db8:bad::")
_ALL_NODES = IPv6Address("ff02::1")
_SEND = (
    "import socket, sys; s = socket.socket(socket.AF_PACKET, socket.SOCK_RAW); "
    "s.bind(('br0', 0)); s.send(bytes.fromhex(sys.argv[1]))"
)


def _checksum(data: bytes) -> int:
    """RFC 1071."""
    total: int = sum(struct.unpack(f"!{len(data) // 2}H", data))
    while total >> 16:
        total = (total & 0xFFFF) + (total >> 16)
    return ~total & 0xFFFF


def advertisement(lifetime_s: int = 1800) -> bytes:
    """A router advertisement to all nodes with one prefix for addresses (RFC 4861, 4.2 and 4.6.2)."""
    prefix = struct.pack("!BBBBIII", 3, 4, 64, 0xC0, lifetime_s, lifetime_s, 0) + PREFIX.packed
    body = struct.pack("!BBHBBHII", 134, 0, 0, 64, 0, lifetime_s, 0, 0) + prefix
    pseudo = ROUTER.packed + _ALL_NODES.packed + struct.pack("!II", len(body), socket.IPPROTO_ICMPV6)
    body = body[:2] + struct.pack("!H", _checksum(pseudo + body)) + body[4:]
    header = struct.pack("!IHBB", 6 << 28, len(body), socket.IPPROTO_ICMPV6, 255)
    ethernet = bytes.fromhex("333300000001") + MAC + b"\x86\xdd"
    return ethernet + header + ROUTER.packed + _ALL_NODES.packed + body


def redirect(to_mac: str, host: str, router: str, target: str, other: str) -> bytes:
    """As if from `router`: what `host` sends to `target` shall go by `other` (RFC 792)."""
    # About an echo reply, which no socket has sent: of another packet a socket that has would have to be there.
    about = _ipv4(host, target, socket.IPPROTO_ICMP, struct.pack("!BBHHH", 0, 0, 0xFFFF, 0, 0))
    body = struct.pack("!BBH4s", 5, 1, 0, IPv4Address(other).packed) + about
    body = body[:2] + struct.pack("!H", _checksum(body)) + body[4:]
    return bytes.fromhex(to_mac.replace(":", "")) + MAC + b"\x08\0" + _ipv4(router, host, socket.IPPROTO_ICMP, body)


def _ipv4(source: str, target: str, protocol: int, body: bytes) -> bytes:
    ends = IPv4Address(source).packed + IPv4Address(target).packed
    header = struct.pack("!BBHHHBBH", 0x45, 0, 20 + len(body), 0, 0, 64, protocol, 0) + ends
    return header[:10] + struct.pack("!H", _checksum(header)) + header[12:] + body


def send(ground: Lab, frame: bytes) -> None:
    """From the yard's end of the cable to all that hang on it."""
    ground.command(["python3", "-c", _SEND, frame.hex()])
