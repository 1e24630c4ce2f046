"""First packets of flows and their replies, as bytes (RFC 791, 792, 768 and 9293).

Each carries its number: as IP identification, and as what NAT leaves alone (sequence number of TCP, payload of UDP and
echo requests), so that thousands are told apart wherever they come out.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, replace
from ipaddress import IPv4Address
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Mapping

MOST: Final = 65_000
"""Numbers are of 16 bits."""
FIN, SYN, ACK = 0x01, 0x02, 0x10
FULL_MSS: Final = 1460
"""Maximum segment size that senders of TCP offer: Ethernet's MTU less two headers."""
_NUMBERS: Final[Mapping[str, int]] = {"icmp": 1, "tcp": 6, "udp": 17}
_PROTOCOLS: Final = {number: name for name, number in _NUMBERS.items()}
_ECHO_REPLY, _ECHO_REQUEST = 0, 8
_MSS_OPTION: Final = (2, 4)
_MARK: Final = b"ATLANTIS"
HEADER: Final = 20
"""Bytes of an IP header without options."""
_SMALLEST: Final = 2 * HEADER
"""Bytes of IP header, and of what follows it in our packets, at least."""


@dataclass(frozen=True, slots=True)
class FlowPacket:
    """A packet that begins a flow or replies to one."""

    source: IPv4Address
    destination: IPv4Address
    protocol: str
    """`icmp` (echo), `tcp` or `udp`."""
    number: int
    source_port: int = 0
    """Of ICMP: the identifier."""
    destination_port: int = 0
    flags: int = SYN
    """Of TCP."""
    ack_number: int = 0
    """Of TCP."""
    mss: int = FULL_MSS
    """Of TCP; 0 for others."""
    dscp: int = 0
    is_reply: bool = False
    """Of UDP it does not show."""

    def reply(self, number: int) -> FlowPacket:
        """Return what the destination would answer."""
        answer = replace(self, source=self.destination, destination=self.source, number=number, dscp=0)
        if self.protocol == "icmp":
            return replace(answer, is_reply=True)
        answer = replace(answer, source_port=self.destination_port, destination_port=self.source_port)
        if self.protocol == "udp":
            return answer
        return replace(answer, flags=SYN | ACK, ack_number=self.number + 1, mss=FULL_MSS, is_reply=True)

    def encode(self) -> bytes:
        """Return the IP packet."""
        payload = _MARK + struct.pack("!I", self.number)
        if self.protocol == "icmp":
            kind = _ECHO_REPLY if self.is_reply else _ECHO_REQUEST
            body = _with_sum(struct.pack("!BBHHH", kind, 0, 0, self.source_port, 1) + payload, 2)
        elif self.protocol == "udp":
            body = struct.pack("!HHHH", self.source_port, self.destination_port, 8 + len(payload), 0) + payload
        else:
            ports = struct.pack("!HH", self.source_port, self.destination_port)
            rest = struct.pack("!IIBBHHH", self.number, self.ack_number, 0x60, self.flags, 1024, 0, 0)
            segment = ports + rest + struct.pack("!BBH", *_MSS_OPTION, self.mss)
            pseudo = self.source.packed + self.destination.packed + struct.pack("!BBH", 0, 6, len(segment))
            body = _with_sum(pseudo + segment, len(pseudo) + 16)[len(pseudo) :]
        size, protocol = HEADER + len(body), _NUMBERS[self.protocol]
        head = struct.pack("!BBHHHBBH", 0x45, self.dscp << 2, size, self.number, 0, 64, protocol, 0)
        return _with_sum(head + self.source.packed + self.destination.packed, 10) + body


def decode(data: bytes) -> FlowPacket | None:
    """Return one of our packets; None for any other, such as an ICMP error or what the router itself replies."""
    if len(data) < _SMALLEST or data[0] != 0x45 or data[9] not in _PROTOCOLS:  # noqa: PLR2004 - IPv4 without options
        return None
    body, protocol = data[HEADER:], _PROTOCOLS[data[9]]
    packet = FlowPacket(IPv4Address(data[12:16]), IPv4Address(data[16:20]), protocol, 0, mss=0, dscp=data[1] >> 2)
    source_port, port = struct.unpack("!HH", body[:4])
    if protocol == "tcp":
        number, ack_number = struct.unpack("!II", body[4:12])
        if body[12] != 0x60 or tuple(body[20:22]) != _MSS_OPTION:  # noqa: PLR2004 - one option, the segment size
            return None
        (mss,) = struct.unpack("!H", body[22:24])
        is_reply = body[13] == SYN | ACK
        values = {"source_port": source_port, "destination_port": port, "flags": body[13], "mss": mss}
        return replace(packet, number=number, ack_number=ack_number, is_reply=is_reply, **values)
    if body[8:16] != _MARK:
        return None
    (number,) = struct.unpack("!I", body[16:20])
    if protocol == "udp":
        return replace(packet, number=number, source_port=source_port, destination_port=port)
    (identifier,) = struct.unpack("!H", body[4:6])
    return replace(packet, number=number, source_port=identifier, is_reply=body[0] == _ECHO_REPLY)


def _with_sum(data: bytes, place: int) -> bytes:
    """Return data with its Internet checksum (RFC 1071) at `place`, where it has zeros."""
    even_data = data + b"\0" * (len(data) % 2)
    total = sum(struct.unpack(f"!{len(even_data) // 2}H", even_data))
    while total >> 16:
        total = (total & 0xFFFF) + (total >> 16)
    return data[:place] + struct.pack("!H", ~total & 0xFFFF) + data[place + 2 :]
