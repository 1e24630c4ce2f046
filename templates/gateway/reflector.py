"""atlantis: answers the checklist of the other computers of the pilot. Takes NAME ADDRESS PORT.

It answers a message of ours with its token, the name of this computer, and the way by which the message arrived here;
whatever else comes is not answered. An answer is never longer than its message, so that nobody is flooded by it. The
address may come later than this program: it is that of the VPN.
"""

# ruff: noqa: INP001 - a program of the gateway and of the control centre, for Python 3.8

from __future__ import annotations

import contextlib
import json
import re
import socket
import struct
import sys

MESSAGE = re.compile(rb"atlantis-reflect ([0-9a-f]{32}) *")
IP_PKTINFO = 8
IP_FREEBIND = 15
LONGEST = 512


def arrival(ancillary: list[tuple[int, int, bytes]]) -> tuple[str, str]:
    """Name of the interface by which a message came, and the address that it was sent to (ip(7), IP_PKTINFO)."""
    for level, kind, data in ancillary:
        if (level, kind) == (socket.IPPROTO_IP, IP_PKTINFO):
            number, _, address = struct.unpack_from("=I4s4s", data)
            with contextlib.suppress(OSError):
                return socket.if_indextoname(number), socket.inet_ntoa(address)
    return "?", "?"


def answer(message: bytes, name: str, source: str, ancillary: list[tuple[int, int, bytes]]) -> bytes | None:
    """Give what is sent back; nothing where it is no message of ours."""
    found = MESSAGE.fullmatch(message)
    if found is None:
        return None
    interface, address = arrival(ancillary)
    rows = {"token": found.group(1).decode(), "host": name, "from": source, "to": address, "by": interface}
    text = json.dumps(rows, separators=(",", ":")).encode()
    return text if len(text) <= len(message) else None


def serve(name: str, address: str, port: int) -> None:
    """Answer for ever."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as here:
        here.setsockopt(socket.IPPROTO_IP, IP_FREEBIND, 1)
        here.setsockopt(socket.IPPROTO_IP, IP_PKTINFO, 1)
        here.bind((address, port))
        while True:
            message, ancillary, _, source = here.recvmsg(LONGEST, 256)
            text = answer(message, name, source[0], ancillary)
            if text is not None:
                with contextlib.suppress(OSError):  # no way back at this moment: who has asked hears nothing
                    here.sendto(text, source)


if __name__ == "__main__":
    serve(sys.argv[1], sys.argv[2], int(sys.argv[3]))
