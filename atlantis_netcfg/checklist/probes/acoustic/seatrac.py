"""Parser and encoder for a Blueprint SeaTrac beacon: frames in ASCII-hex, and the records that we read.

Commands begin with `#`, responses with `$`; then a number, its record (little-endian), and a CRC-16 (polynomial 0x8005
reflected, start 0) over both, low byte first, all as hex digits (devices.md 5.2). Record layouts are those of public
drivers: settings and status of DUNE, Rust and Python clients, the acoustic fix of two C++ ones. Input that does not
match is skipped, and nothing here raises.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.core.messages import arg, msg

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

ALIVE, INFO, STATUS, SETTINGS, TRANSCEIVER = 0x01, 0x02, 0x10, 0x15, 0x3A
PING, PING_RESPONSE, PING_ERROR, NAV_QUERY_RESPONSE = 0x40, 0x42, 0x43, 0x52

_COMMAND = re.compile(rb"#((?:[0-9A-F]{2}){3,})\n\r")
_ANSWER = re.compile(rb"\$((?:[0-9A-Fa-f]{2}){3,})[\r\n]")
_RANGE, _USBL, _POSITION, _SUSPECT = 1, 2, 4, 16
"""Flags of a fix: RANGE_VALID, USBL_VALID, POSITION_VALID, POSITION_FLT_ERROR."""
_ENVIRONMENT = 1


@dataclass(frozen=True, slots=True)
class SeatracAnswer:
    """A response frame with a correct checksum."""

    number: int
    record: bytes
    end: int
    """Offset of its end in the stream."""


@dataclass(frozen=True, slots=True)
class SeatracSettings:
    """The settings of a beacon that we use."""

    beacon: int
    sound_speed_mps: float
    auto_sound_speed: bool
    """Whether the beacon computes it from temperature, pressure and salinity."""


@dataclass(frozen=True, slots=True)
class BeaconStatus:
    """Environment values measured by a beacon; None: not included by its settings."""

    supply_v: float | None = None
    depth_m: float | None = None
    sound_speed_mps: float | None = None


@dataclass(frozen=True, slots=True)
class SeatracFix:
    """Position computed by a beacon from a response that it received."""

    to: int
    """Beacon that the response was addressed to; 0: all of them."""
    beacon: int
    """Beacon that responded."""
    range_m: float | None
    azimuth_deg: float | None
    elevation_deg: float | None
    fit_error: float | None
    rssi_db: float
    position_m: tuple[float, float, float] | None
    """East, north and down from this beacon, in metres."""
    suspect: bool
    """The beacon's own filter considers the position wrong."""


def crc16(data: bytes) -> int:
    """Compute the checksum of a frame."""
    value = 0
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = (value >> 1) ^ 0xA001 if value & 1 else value >> 1
    return value


def command(payload: bytes) -> bytes:
    """Encode a command; as in DUNE, it ends with LF and CR in this order."""
    return b"#" + (payload + crc16(payload).to_bytes(2, "little")).hex().upper().encode() + b"\n\r"


def payload_of(data: bytes) -> bytes | None:
    """Return number and record of exactly one command; None if invalid or if the checksum is wrong."""
    match = _COMMAND.fullmatch(data)
    return _check_payload(match[1]) if match else None


def _check_payload(digits: bytes) -> bytes | None:
    raw = bytes.fromhex(digits.decode())
    payload, checksum = raw[:-2], int.from_bytes(raw[-2:], "little")
    return payload if crc16(payload) == checksum else None


def answers(data: bytes) -> tuple[SeatracAnswer, ...]:
    """Return every complete response in a stream, in order."""
    return tuple(_answers(data))


def _answers(data: bytes) -> Iterator[SeatracAnswer]:
    for match in _ANSWER.finditer(data):
        if payload := _check_payload(match[1]):
            yield SeatracAnswer(payload[0], payload[1:], match.end())


def count_damaged(data: bytes) -> int:
    """Count the responses with a wrong checksum."""
    return sum(_check_payload(match[1]) is None for match in _ANSWER.finditer(data))


def last(replies: Sequence[SeatracAnswer], number: int) -> bytes | None:
    """Return the record of the last response with a number; None if there is none."""
    return next((answer.record for answer in reversed(replies) if answer.number == number), None)


def settings(record: bytes) -> SeatracSettings | None:
    """Read the settings record: 110 bytes, of which later firmware may append more."""
    if len(record) < 110:  # noqa: PLR2004 - the whole of the known record
        return None
    (sound,) = struct.unpack_from("<H", record, 35)
    return SeatracSettings(beacon=record[96], sound_speed_mps=sound / 10, auto_sound_speed=bool(record[28] & 1))


def status(record: bytes) -> BeaconStatus | None:
    """Read a status record: flags, a clock, and the groups that the flags name; the environment comes first."""
    if len(record) < 9:  # noqa: PLR2004 - flags and clock
        return None
    if not record[0] & _ENVIRONMENT or len(record) < 9 + 14:
        return BeaconStatus()
    supply, _, _, depth, sound = struct.unpack_from("<HhiiH", record, 9)
    return BeaconStatus(supply / 1000, depth / 10, sound / 10)


def info(record: bytes) -> str | None:
    """Format part, serial number and firmware. Record: uptime, section, hardware, boot loader, application."""
    try:
        _, _, part, _, serial = struct.unpack_from("<IBHBI", record)
        _, _, major, minor, build = struct.unpack_from("<?HBBH", record, 4 + 1 + 11 + 11)
    except struct.error:
        return None
    model = {795: "X150", 843: "X110"}.get(part, f"part {part}")
    return msg(f"SeaTrac {arg(model)}, serial number {arg(serial)}, firmware {arg(major)}.{arg(minor)}.{arg(build)}")


def fix(record: bytes) -> SeatracFix | None:
    """Parse the acoustic fix at the start of the response to a ping or NAV_QUERY; None if it is truncated."""
    try:
        return _fix(record)
    except struct.error:
        return None


def _fix(record: bytes) -> SeatracFix:
    to, beacon, flags, _, _, _, _, own_depth, _, rssi = struct.unpack_from("<BBBBhhhHHh", record)
    at = 16
    range_m = azimuth = elevation = error = position = None
    if flags & _RANGE:
        range_m = struct.unpack_from("<IiH", record, at)[2] / 10
        at += 10
    if flags & _USBL:
        at += 1 + 2 * struct.unpack_from("<B", record, at)[0]
        azimuth, elevation, error = (
            value / scale for value, scale in zip(_three(record, at), (10, 10, 100), strict=True)
        )
        at += 6
    if flags & _POSITION:
        east, north, depth = (value / 10 for value in _three(record, at))
        # The record has the other beacon's depth below the surface.
        position = (east, north, depth - own_depth / 10)
    return SeatracFix(to, beacon, range_m, azimuth, elevation, error, rssi / 10, position, bool(flags & _SUSPECT))


def _three(record: bytes, at: int) -> tuple[int, int, int]:
    first, second, third = struct.unpack_from("<hhh", record, at)
    return first, second, third
