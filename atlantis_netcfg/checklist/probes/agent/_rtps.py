"""Which DDS participants of this computer answer at an address: one announces itself at their ports, and leaves.

It is a participant without topics (DDSI-RTPS 8.5.3). Whoever takes it in announces itself to the port that it names,
and speaks to its identity, which is made up anew each time: nobody who has only bound a port can know that.
"""

from __future__ import annotations

import os
import socket
import struct
import time
from typing import Any

from atlantis_netcfg.checklist.probes.agent._shared import no_answer, packed

__all__ = ["discover"]

_LEASE_S = 10
_AGAIN_S = 1.0
_MOST = 40
"""Datagrams that are kept: two of each participant."""
_WRITER = b"\x00\x01\x00\xc2"
"""SPDP's (9.3.1.5)."""
_ENDPOINTS = 0x3F
"""Participants, publications and subscriptions are announced, and heard of (9.3.2)."""


def discover(question: dict[str, Any]) -> dict[str, Any]:
    """Announce a participant, and give the fields of `Discovered`. Raises NoAnswer."""
    prefix, where = os.urandom(12), question["address"]
    kept: dict[tuple[bytes, bool], list[Any]] = {}
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as wire:
        try:
            _own(where)
            wire.bind(("", 0))  # Fast DDS without a profile answers an address of its own computer by the loopback
            local = wire.getsockname()[1]
            ends, due = time.monotonic() + question["within_s"], 0.0
            while time.monotonic() < ends:
                if time.monotonic() >= due:
                    _tell(wire, question, _hello(prefix, where, local, question["domain"]))
                    due = time.monotonic() + _AGAIN_S
                wire.settimeout(max(min(due, ends) - time.monotonic(), 0.001))
                try:
                    data, source = wire.recvfrom(65535)
                except socket.timeout:
                    continue
                if data[:4] == b"RTPS" and (prefix in data or _WRITER in data) and len(kept) < _MOST:
                    kept.setdefault((data[8:20], prefix in data), [source[0], packed(data)])
            _tell(wire, question, _bye(prefix))
        except OSError as error:
            raise no_answer(error, where) from None
    return {"trouble": None, "words": "", "prefix": prefix.hex(), "datagrams": list(kept.values())}


def _own(address: str) -> None:
    """Raise OSError if the computer does not have this address."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as there:
        there.bind((address, 0))


def _tell(wire: socket.socket, question: dict[str, Any], message: bytes) -> None:
    for port in question["ports"]:
        wire.sendto(message, (question["address"], port))


def _hello(prefix: bytes, address: str, port: int, domain: int) -> bytes:
    """SPDP's DATA with the parameters of a participant, of which no number is longer than it must be (9.6.2.2)."""
    there = struct.pack("<iI12x", 1, port) + socket.inet_aton(address)
    result = (
        (0x15, b"\x02\x01\0\0"),
        (0x16, b"\0" * 4),
        (0x50, prefix + b"\x00\x00\x01\xc1"),
        (0x02, struct.pack("<iI", _LEASE_S, 0)),
        (0x31, there),
        (0x32, there),
        (0x58, struct.pack("<I", _ENDPOINTS)),
        (0x0F, struct.pack("<I", domain)),
    )
    return _message(prefix, 0x05, 1, b"", result)


def _bye(prefix: bytes) -> bytes:
    """The participant is no more: key and status stand in the inline QoS, and the key follows (9.6.3.8, 9.6.3.9)."""
    guid = prefix + b"\x00\x00\x01\xc1"
    return _message(prefix, 0x0B, 2, _listed(((0x70, guid), (0x71, b"\0\0\0\x03"))), ((0x50, guid),))


def _listed(result: tuple[tuple[int, bytes], ...]) -> bytes:
    """Parameters by their numbers, and what ends them (9.4.2.11)."""
    return b"".join(struct.pack("<HH", name, len(value)) + value for name, value in result) + struct.pack("<HH", 1, 0)


def _message(prefix: bytes, flags: int, number: int, inline: bytes, result: tuple[tuple[int, bytes], ...]) -> bytes:
    body = struct.pack("<HH", 0, 16) + b"\0" * 4 + _WRITER + struct.pack("<iI", 0, number) + inline
    body += b"\x00\x03\0\0" + _listed(result)
    return b"RTPS\x02\x01\0\0" + prefix + struct.pack("<BBH", 0x15, flags, len(body)) + body
