"""An emulated SeaTrac beacon: ASCII-hex frames with checksum, settings, status, and pings of another beacon."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

from pydantic import Field

from atlantis_netcfg.emulator.acoustic._line import LineSpec, ModemLine

if TYPE_CHECKING:
    from collections.abc import Mapping

_READS = (0x01, 0x02, 0x10, 0x11, 0x15, 0x21, 0x3A)
_PING, _PING_RESPONSE, _PING_ERROR, _NAV_RESPONSE = 0x40, 0x42, 0x43, 0x52
_OK, _BUSY, _TIMEOUT, _IDLE = 0x00, 0x30, 0x34, 0x3B
_NUMBERS = range(1, 16)


def _crc_table() -> tuple[int, ...]:
    """Return the table of CRC-16 0x8005 reflected; coded unlike our driver's, so that errors cannot cancel out."""
    table = []
    for byte in range(256):
        bits = int(f"{byte:08b}"[::-1], 2) << 8
        for _ in range(8):
            bits = ((bits << 1) ^ 0x8005 if bits & 0x8000 else bits << 1) & 0xFFFF
        table.append(int(f"{bits:016b}"[::-1], 2))
    return tuple(table)


_TABLE = _crc_table()


def _checksum(payload: bytes) -> bytes:
    value = 0
    for byte in payload:
        value = (value >> 8) ^ _TABLE[(value ^ byte) & 0xFF]
    return struct.pack("<H", value)


class SeatracSpec(LineSpec):
    """Settings of a beacon and its surroundings; default: healthy, idle, in air, another beacon in range."""

    beacon: int = 1
    part: int = 795
    """Part number: 795 is an X150, 843 an X110."""
    serial_number: int = 1
    sound_speed_mps: float = 1500.0
    auto_sound_speed: bool = True
    supply_v: float = 15.2
    depth_m: float | None = None
    """Depth in metres; None: depends on `in_water`."""
    environment: bool = True
    """Whether the status includes supply, depth and sound speed."""
    state: int = Field(default=_IDLE, ge=0, le=255)
    """Transceiver state: 0x3B idle, 0x3A stopped, 0x3C transmitting."""
    busy: bool = False
    """The beacon rejects pings as busy."""
    wrong_sum: tuple[int, ...] = ()
    """Commands whose responses have a wrong checksum."""
    every_sum_wrong: bool = False
    missing: tuple[int, ...] = ()
    """Read commands without a response."""
    status_every_s: float | None = None
    """Interval of unsolicited status messages; None: only on request."""
    hears: tuple[int, ...] = (2,)
    """Beacons whose responses to pings of the vehicle's own software are reported."""
    fix_every_s: float = Field(default=0.05, gt=0)
    fixes: int | None = Field(default=None, ge=0)
    """Number of rounds of such responses for each client; None: unlimited."""
    range_m: float = 14.1
    fit_error: float = 0.4
    suspect: bool = False
    """The beacon's filter does not trust its own position."""
    frozen: bool = False
    """The first fix is repeated."""
    navigates: bool = False
    """The vehicle sends NAV_QUERY instead of pings; the responses contain the same fix."""
    answers_to: int | None = None
    """Beacon to which the received responses are addressed; None: this beacon."""
    ranges_only: bool = False
    """The fix has no direction, as from an X110."""
    in_water: bool = False
    """Whether it may transmit; a ping in air causes damage."""
    reaches: tuple[int, ...] = (2,)
    """Beacons that respond to a ping."""

    @property
    def depth(self) -> float:
        """Displayed depth in m."""
        return self.depth_m if self.depth_m is not None else (1.2 if self.in_water else 0.0)

    def records(self) -> Mapping[int, bytes]:
        """Return responses to read commands, without number and checksum."""
        all_records = {
            0x01: struct.pack("<I", 123456),
            0x02: self._info(),
            0x10: self._status(),
            0x11: bytes([int(self.environment)]),
            0x15: self._settings(),
            0x21: bytes(50),
            0x3A: bytes([self.state]),
        }
        return {number: record for number, record in all_records.items() if number not in self.missing}

    def _info(self) -> bytes:
        hardware = struct.pack("<HBIHH", self.part, 1, self.serial_number, 0, 0)
        firmware = struct.pack("<?HBBHI", True, self.part, 2, 2, 1000, 0)
        return struct.pack("<IB", 123456, 1) + hardware + firmware + firmware

    def _status(self) -> bytes:
        head = struct.pack("<BQ", int(self.environment), 123_456_000)
        if not self.environment:
            return head
        depth, sound = round(self.depth * 10), round(self.sound_speed_mps * 10)
        return head + struct.pack("<HhiiH", round(self.supply_v * 1000), 152, 1013, depth, sound)

    def _settings(self) -> bytes:
        record = bytearray(110)
        record[1] = int(self.environment)
        record[28] = int(self.auto_sound_speed)
        struct.pack_into("<H", record, 35, round(self.sound_speed_mps * 10))
        record[96] = self.beacon
        return bytes(record)

    def fix(self, remote: int, turn: int = 0) -> bytes:
        """Return the record of a ping response: range, direction, position; the vehicle yaws between turns."""
        flags = (0b001 if self.ranges_only else 0b111) | (0b10000 if self.suspect else 0)
        to = self.beacon if self.answers_to is None else self.answers_to
        yaw = 0 if self.frozen else turn % 3600
        depth, sound = max(0, round(self.depth * 10)), round(self.sound_speed_mps * 10)
        head = struct.pack("<BBBBhhhHHh", to, remote, flags, 0x05, yaw, 0, 0, depth, sound, 900)
        time_s = self.range_m / self.sound_speed_mps
        distance = struct.pack("<IiH", round(time_s * 2 * 16000), round(time_s * 1e7), round(self.range_m * 10))
        if self.ranges_only:
            return head + distance
        angles = struct.pack("<B4hhhh", 4, 900, 900, 900, 900, 130, -70, round(self.fit_error * 100))
        east, north = (min(32_767, round(part * self.range_m / 14.1)) for part in (31, 137))
        return head + distance + angles + struct.pack("<hhh", east, north, depth)


class _Talk:
    """One client's connection."""

    def __init__(self, beacon: RunningSeatrac) -> None:
        self.beacon, self.spec = beacon, beacon.spec
        self.rounds = self.statuses = 0

    def hear(self, waiting: bytes) -> tuple[list[bytes], bytes]:
        *lines, rest = waiting.replace(b"\r", b"\n").split(b"\n")
        return [answer for line in lines if line for answer in self._answers(line)], rest

    def _answers(self, line: bytes) -> list[bytes]:
        self.beacon.inputs.append(line)
        payload = _payload(line)
        if payload is None:
            # As on the wire: what is damaged is not answered.
            self.beacon.damaged.append(line)
            return []
        if payload[0] == _PING and len(payload) == 3 and payload[1] in _NUMBERS:  # noqa: PLR2004 - number, beacon, kind
            return self._ping(payload[1])
        if payload[0] not in _READS or len(payload) > 1:
            self.beacon.forbidden.append(line)
            return []
        record = self.spec.records().get(payload[0])
        return [] if record is None else [self._frame(payload[0], record)]

    def _ping(self, remote: int) -> list[bytes]:
        if self.spec.busy:
            return [self._frame(_PING, bytes([_BUSY, remote]))]
        self.beacon.transmitted.append(remote)
        if not self.spec.in_water:
            self.beacon.transmitted_in_air.append(remote)
        acknowledgement = self._frame(_PING, bytes([_OK, remote]))
        if remote in self.spec.reaches:
            return [acknowledgement, self._frame(_PING_RESPONSE, self.spec.fix(remote, len(self.beacon.transmitted)))]
        return [acknowledgement, self._frame(_PING_ERROR, bytes([_TIMEOUT, remote]))]

    def _report(self, remote: int) -> bytes:
        record = self.spec.fix(remote, self.rounds)
        # Behind the fix of a NAV_QUERY: no further fields are asked for, and the answer is for this beacon.
        return (
            self._frame(_NAV_RESPONSE, record + b"\x00\x01")
            if self.spec.navigates
            else self._frame(_PING_RESPONSE, record)
        )

    def _frame(self, number: int, record: bytes) -> bytes:
        payload = bytes([number]) + record
        check = _checksum(payload)
        if self.spec.every_sum_wrong or number in self.spec.wrong_sum:
            check = bytes(byte ^ 0xFF for byte in check)
        return b"$" + (payload + check).hex().upper().encode() + b"\r\n"

    def tell(self, now_s: float) -> tuple[bytes, float | None]:
        data, due = b"", []
        spec = self.spec
        if spec.hears and spec.fixes != self.rounds:
            if now_s >= (self.rounds + 1) * spec.fix_every_s:
                self.rounds += 1
                data += b"".join(self._report(remote) for remote in spec.hears)
            due.append((self.rounds + 1) * spec.fix_every_s)
        if spec.status_every_s is not None:
            if now_s >= (self.statuses + 1) * spec.status_every_s:
                self.statuses += 1
                data += self._frame(0x10, spec.records()[0x10])
            due.append((self.statuses + 1) * spec.status_every_s)
        return data, min(due, default=None)


def _payload(line: bytes) -> bytes | None:
    """Return number and record of a command; None if it is no command or its checksum is wrong."""
    try:
        raw = bytes.fromhex(line.removeprefix(b"#").decode("ascii"))
    except ValueError:
        return None
    whole = line.startswith(b"#") and len(raw) > 2  # noqa: PLR2004 - a number before the sum
    return raw[:-2] if whole and _checksum(raw[:-2]) == raw[-2:] else None


class RunningSeatrac(ModemLine):
    """The beacon in a thread."""

    def __init__(self, spec: SeatracSpec) -> None:
        super().__init__(spec)
        self.spec = spec
        self.inputs: list[bytes] = []
        """All lines received."""
        self.damaged: list[bytes] = []
        """Lines that are not a command with a correct checksum."""
        self.forbidden: list[bytes] = []
        """Received commands that are neither reads nor pings."""
        self.transmitted: list[int] = []
        """Beacons pinged."""
        self.transmitted_in_air: list[int] = []
        """Beacons pinged while this beacon was not in the water, which would damage it."""

    def talker(self) -> _Talk:
        """Return a handler for the frame protocol."""
        return _Talk(self)
