"""A MAVLink stream (version 1 or 2) as it arrives by UDP: heartbeats, remote control channels, state of the receiver.

Names of messages and fields: MAVLink common message set, as pymavlink has it. RADIO_STATUS is the telemetry radio and
not the remote control: it is not read. Frames are only received here, and nothing is ever made to be sent.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.probes.answers import Transcript

__all__ = ["RC_RECEIVER", "RSSI_UNKNOWN", "Beat", "Channels", "Heard", "Receiver", "System", "enough", "read"]

RSSI_UNKNOWN = 255
RC_RECEIVER = 0x10000
"""MAV_SYS_STATUS_SENSOR_RC_RECEIVER."""
_ARMED = 0x80
"""MAV_MODE_FLAG_SAFETY_ARMED."""
_GROUND_STATION = 6
"""MAV_TYPE_GCS."""
_NO_AUTOPILOT = 8
"""MAV_AUTOPILOT_INVALID: a camera, a companion computer."""
_UNUSED = 0xFFFF
"""UINT16_MAX: the channel is not used."""
_CHANNELS = 18


@dataclass(frozen=True, slots=True)
class Beat:
    """A HEARTBEAT of an autopilot."""

    at_s: float
    armed: bool


@dataclass(frozen=True, slots=True)
class Channels:
    """An RC_CHANNELS."""

    at_s: float
    count: int
    """`chancount`: 0 is none."""
    values: tuple[int | None, ...]
    """Microseconds of those that count; None: not used."""
    rssi: int
    """0 to 254 in a scale of this very vehicle; 255: not known."""


@dataclass(frozen=True, slots=True)
class Receiver:
    """What a SYS_STATUS says of the remote control's receiver."""

    present: bool
    enabled: bool
    healthy: bool


@dataclass(frozen=True, slots=True)
class System:
    """All that one system id has said."""

    beats: tuple[Beat, ...] = ()
    channels: tuple[Channels, ...] = ()
    receiver: tuple[Receiver, ...] = ()


@dataclass(frozen=True, slots=True)
class Heard:
    """All that was understood."""

    systems: Mapping[int, System] = field(default_factory=dict)
    good: int = 0
    bad: int = 0
    """Pieces that are no frame, or have a wrong checksum."""
    versions: tuple[int, ...] = ()
    """Of MAVLink."""
    heard_bytes: int = 0
    ended_s: float = 0.0

    @property
    def autopilots(self) -> tuple[int, ...]:
        """System ids with an autopilot's heartbeat."""
        return tuple(sorted(number for number, system in self.systems.items() if system.beats))


@dataclass
class _Reading:
    beats: dict[int, list[Beat]] = field(default_factory=dict)
    channels: dict[int, list[Channels]] = field(default_factory=dict)
    receiver: dict[int, list[Receiver]] = field(default_factory=dict)
    sources: set[int] = field(default_factory=set)
    versions: set[int] = field(default_factory=set)
    good: int = 0
    bad: int = 0

    def take(self, at_s: float, message: Any) -> None:  # noqa: ANN401 - pymavlink has no types for them
        kind = message.get_type()
        if kind == "BAD_DATA":
            self.bad += 1
            return
        self.good += 1
        if kind.startswith("UNKNOWN"):
            return
        number = message.get_srcSystem()
        self.sources.add(number)
        self.versions.add(1 if message.get_msgbuf()[0] == _MAVLINK_1 else 2)
        if kind == "HEARTBEAT" and message.type != _GROUND_STATION and message.autopilot != _NO_AUTOPILOT:
            self.beats.setdefault(number, []).append(Beat(at_s, bool(message.base_mode & _ARMED)))
        elif kind == "RC_CHANNELS":
            self.channels.setdefault(number, []).append(_channels(at_s, message))
        elif kind == "SYS_STATUS":
            self.receiver.setdefault(number, []).append(_receiver(message))


_MAVLINK_1 = 0xFE


def read(heard: Transcript) -> Heard:
    """Understand the datagrams, also where frames go over their borders. Raises nothing."""
    # Takes a twentieth of a second to load, and only who has a vehicle with an autopilot needs it.
    from pymavlink.dialects.v20 import common  # noqa: PLC0415

    parser, reading = common.MAVLink(None), _Reading()
    parser.robust_parsing = True
    for at_s, data in heard.chunks:
        for message in parser.parse_buffer(data) or ():
            reading.take(at_s, message)
    systems = {
        number: System(
            tuple(reading.beats.get(number, ())),
            tuple(reading.channels.get(number, ())),
            tuple(reading.receiver.get(number, ())),
        )
        for number in sorted(reading.sources)
    }
    versions = tuple(sorted(reading.versions))
    return Heard(systems, reading.good, reading.bad, versions, len(heard.data), heard.ended_s)


def _channels(at_s: float, message: Any) -> Channels:  # noqa: ANN401 - as above
    count = min(int(message.chancount), _CHANNELS)
    raw = (int(getattr(message, f"chan{number}_raw")) for number in range(1, count + 1))
    return Channels(at_s, count, tuple(None if value == _UNUSED else value for value in raw), int(message.rssi))


def _receiver(message: Any) -> Receiver:  # noqa: ANN401 - as above
    return Receiver(
        bool(message.onboard_control_sensors_present & RC_RECEIVER),
        bool(message.onboard_control_sensors_enabled & RC_RECEIVER),
        bool(message.onboard_control_sensors_health & RC_RECEIVER),
    )


def enough(system: int) -> bytes:
    """What ends the listening early: two heartbeats, five times the channels and one state of the expected system."""
    heartbeat, status, channels = (_frame(system, number) for number in (0, 1, 65))
    return rb"(?s)\A(?=(?:.*?%s){2})(?=(?:.*?%s){5})(?=.*?%s)" % (heartbeat, channels, status)


def _frame(system: int, message: int) -> bytes:
    """The header of a frame: MAVLink 2 has four bytes between mark and system, MAVLink 1 two."""
    sender, number = re.escape(bytes([system])), re.escape(bytes([message]))
    return rb"(?:\xfd.{4}%s.%s\x00\x00|\xfe.{2}%s.%s)" % (sender, number, sender, number)
