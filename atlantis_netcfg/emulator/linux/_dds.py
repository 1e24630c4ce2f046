"""What a DDS participant sends to one that has announced itself to it: its own announcement, and a heartbeat.

Bytes as DDSI-RTPS 2.5 has them (8.3.7, 9.4.5, 9.6.2), in the order of Cyclone DDS 0.10; nothing is sent anywhere.
"""

from __future__ import annotations

import socket
import struct
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from atlantis_netcfg.emulator.linux._spec import DdsSpec

__all__ = ["answers"]

_WRITER = b"\x00\x01\x00\xc2"


def answers(number: int, spec: DdsSpec, asked_by: bytes) -> tuple[bytes, ...]:
    """The messages of the participant with this number to the GUID prefix that has announced itself."""
    own = b"\x01\x10" + struct.pack(">HII", spec.domain, 0xA71A, number)
    head = b"RTPS\x02\x01\x01\x10" + own
    to_the_asker = struct.pack("<BBH", 0x0E, 1, 12) + asked_by
    beat = struct.pack("<BBH", 0x07, 1, 28) + b"\0\0\x04\xc7\0\0\x03\xc2" + struct.pack("<iIiIi", 0, 1, 0, 0, 1)
    announced = _announced(own, spec, 7410 + 250 * spec.domain + 2 * number)
    return (head + to_the_asker + announced, head + to_the_asker + beat)


def _announced(own: bytes, spec: DdsSpec, port: int) -> bytes:
    there = [struct.pack("<iI12x", 1, port) + socket.inet_aton(address) for address in spec.addresses]
    told = [
        (0x50, own + b"\x00\x00\x01\xc1"),
        (0x0F, struct.pack("<I", spec.domain)),
        (0x02, struct.pack("<iI", 120, 0)),
        *((0x32, one) for one in there),
        (0x58, struct.pack("<I", 0xFC3F)),
    ]
    listed = b"".join(struct.pack("<HH", name, len(value)) + value for name, value in told)
    payload = b"\x00\x03\0\0" + listed + struct.pack("<HH", 1, 0)
    body = struct.pack("<HH", 0, 16) + b"\x00\x01\x00\xc7" + _WRITER + struct.pack("<iI", 0, 1) + payload
    return struct.pack("<BBH", 0x15, 0x05, len(body)) + body
