"""A MAVLink stream (version 1 or 2) over UDP: heartbeats, remote control channels, state of the receiver.

Names of messages and fields: MAVLink common message set, as in pymavlink. RADIO_STATUS is the telemetry radio and not
the remote control: it is not read. Any sender may use any system id, so the sender's address and the component count as
well. Frames are only received here; no message is ever built for sending.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.checklist.probes.base import Transcript

RSSI_UNKNOWN = 255
RC_RECEIVER = 0x10000
"""MAV_SYS_STATUS_SENSOR_RC_RECEIVER."""
_ARMED_FLAG = 0x80
"""MAV_MODE_FLAG_SAFETY_ARMED."""
_GROUND_STATION = 6
"""MAV_TYPE_GCS."""
_NO_AUTOPILOT = 8
"""MAV_AUTOPILOT_INVALID: a camera, a companion computer."""
_UNUSED_VALUE = 0xFFFF
"""UINT16_MAX: the channel is not used."""
_AUTOPILOT = 1
"""MAV_COMP_ID_AUTOPILOT1; a camera, a gimbal or a companion computer has another id."""
_OVERRIDES = frozenset({"RC_CHANNELS_OVERRIDE", "MANUAL_CONTROL"})
"""Messages with which a ground station replaces the remote control."""
_SET_S = 1_577_836_800
"""2020 in seconds since 1970; an earlier time means that the autopilot's clock was not set."""
_CHANNELS = 18


@dataclass(frozen=True, slots=True)
class Beat:
    """A HEARTBEAT of an autopilot."""

    at_s: float
    is_armed: bool


@dataclass(frozen=True, slots=True)
class Channels:
    """An RC_CHANNELS."""

    at_s: float
    count: int
    """`chancount`; 0: none."""
    values: tuple[int | None, ...]
    """Microseconds of the channels in `count`; None: not used."""
    boot_ms: int
    """Milliseconds from the autopilot's start to the message, by its own clock."""
    rssi: int
    """0 to 254 in a scale specific to the vehicle; 255: not known."""


@dataclass(frozen=True, slots=True)
class Receiver:
    """State of the remote control's receiver in a SYS_STATUS."""

    present: bool
    is_enabled: bool
    healthy: bool


@dataclass(frozen=True, slots=True)
class System:
    """All data of the autopilot with one system id, from the trusted address."""

    beats: tuple[Beat, ...] = ()
    channels: tuple[Channels, ...] = ()
    receiver: tuple[Receiver, ...] = ()
    ahead_s: tuple[float, ...] = ()
    """How far its clock was ahead of the listener's, for each time that it reported."""
    overrides: int = 0
    """Number of messages sent to it that replace its remote control."""
    components: tuple[int, ...] = ()
    """Components with a heartbeat other than the autopilot."""
    senders: tuple[str, ...] = ()
    """Addresses that have sent as its autopilot, including those that are not trusted."""
    is_armed: bool = False
    """Whether any message reports it as armed."""


@dataclass(frozen=True, slots=True)
class Stream:
    """All data parsed from a stream."""

    systems: Mapping[int, System] = field(default_factory=dict)
    good: int = 0
    bad: int = 0
    """Pieces that are not a frame, or have a wrong checksum."""
    versions: tuple[int, ...] = ()
    """Versions of MAVLink."""
    heard_bytes: int = 0
    ended_s: float = 0.0

    @property
    def autopilots(self) -> tuple[int, ...]:
        """System ids with an autopilot's heartbeat, from any address."""
        return tuple(sorted(number for number, system in self.systems.items() if system.senders))


@dataclass
class _SystemReader:
    """Parser state of one system."""

    beats: list[Beat] = field(default_factory=list)
    channels: list[Channels] = field(default_factory=list)
    receiver: list[Receiver] = field(default_factory=list)
    ahead_s: list[float] = field(default_factory=list)
    overrides: int = 0
    components: set[int] = field(default_factory=set)
    senders: set[str] = field(default_factory=set)
    is_armed: bool = False

    def take(self, at_s: float, began: float, message: Any) -> None:  # noqa: ANN401 - pymavlink has no types for them
        kind = message.get_type()
        if kind == "HEARTBEAT":
            self.beats.append(Beat(at_s, bool(message.base_mode & _ARMED_FLAG)))
        elif kind == "RC_CHANNELS":
            self.channels.append(_channels(at_s, message))
        elif kind == "SYS_STATUS":
            self.receiver.append(_receiver(message))
        elif kind == "SYSTEM_TIME" and message.time_unix_usec / 1e6 > _SET_S:
            self.ahead_s.append(message.time_unix_usec / 1e6 - (began + at_s))

    def whole(self) -> System:
        return System(
            tuple(self.beats),
            tuple(self.channels),
            tuple(self.receiver),
            tuple(self.ahead_s),
            self.overrides,
            tuple(sorted(self.components)),
            tuple(sorted(self.senders)),
            self.is_armed,
        )


@dataclass
class _MavlinkReading:
    began: float
    address: str | None
    """Address whose datagrams are accepted; None: any."""
    systems: dict[int, _SystemReader] = field(default_factory=dict)
    versions: set[int] = field(default_factory=set)
    good: int = 0
    bad: int = 0

    def take(self, at_s: float, sender: str, message: Any) -> None:  # noqa: ANN401 - as above
        kind = message.get_type()
        if kind == "BAD_DATA":
            self.bad += 1
            return
        self.good += 1
        if kind.startswith("UNKNOWN"):
            return
        self.versions.add(1 if message.get_msgbuf()[0] == _MAVLINK_1 else 2)
        if kind in _OVERRIDES:
            self._system_reader(message.target if kind == "MANUAL_CONTROL" else message.target_system).overrides += 1
            return
        item = self._system_reader(message.get_srcSystem())
        if kind == "HEARTBEAT" and not self._beats(item, sender, message):
            return
        if message.get_srcComponent() == _AUTOPILOT and self.address in {None, sender}:
            item.take(at_s, self.began, message)

    def _system_reader(self, number: int) -> _SystemReader:
        return self.systems.setdefault(number, _SystemReader())

    @staticmethod
    def _beats(item: _SystemReader, sender: str, message: Any) -> bool:  # noqa: ANN401 - as above
        """Record the sender of a heartbeat; return False if it is not an autopilot's."""
        if message.type == _GROUND_STATION or message.autopilot == _NO_AUTOPILOT:
            return False
        item.is_armed = item.is_armed or bool(message.base_mode & _ARMED_FLAG)
        if message.get_srcComponent() != _AUTOPILOT:
            item.components.add(message.get_srcComponent())
            return False
        item.senders.add(sender)
        return True


_MAVLINK_1 = 0xFE


def read(transcript: Transcript, address: str | None = None) -> Stream:
    """Parse the datagrams, also frames that span several of them. Raises nothing.

    `address`: trusted sender; datagrams of others only show that these exist, or are armed.
    """
    # Takes a twentieth of a second to load, and only who has a vehicle with an autopilot needs it.
    from pymavlink.dialects.v20 import common  # noqa: PLC0415

    parsers: dict[str, Any] = {}
    reading = _MavlinkReading(transcript.began, address)
    has_senders = len(transcript.senders) == len(transcript.chunks)
    senders = transcript.senders if has_senders else ("",) * len(transcript.chunks)
    for (at_s, data), sender in zip(transcript.chunks, senders, strict=True):
        if sender not in parsers:
            parsers[sender] = common.MAVLink(None)
            parsers[sender].robust_parsing = True
        for message in parsers[sender].parse_buffer(data) or ():
            reading.take(at_s, sender, message)
    systems = {number: reading.systems[number].whole() for number in sorted(reading.systems)}
    versions = tuple(sorted(reading.versions))
    return Stream(systems, reading.good, reading.bad, versions, len(transcript.data), transcript.ended_s)


def _channels(at_s: float, message: Any) -> Channels:  # noqa: ANN401 - as above
    count = min(int(message.chancount), _CHANNELS)
    raw = (int(getattr(message, f"chan{number}_raw")) for number in range(1, count + 1))
    values = tuple(None if value == _UNUSED_VALUE else value for value in raw)
    return Channels(at_s, count, values, int(message.time_boot_ms), int(message.rssi))


def _receiver(message: Any) -> Receiver:  # noqa: ANN401 - as above
    return Receiver(
        bool(message.onboard_control_sensors_present & RC_RECEIVER),
        bool(message.onboard_control_sensors_enabled & RC_RECEIVER),
        bool(message.onboard_control_sensors_health & RC_RECEIVER),
    )


def enough(system: int) -> bytes:
    """Return the pattern that ends listening: 2 heartbeats, 5 channel messages and 1 autopilot state."""
    heartbeat, status, channels = (_frame(system, number) for number in (0, 1, 65))
    return rb"(?s)\A(?=(?:.*?%s){2})(?=(?:.*?%s){5})(?=.*?%s)" % (heartbeat, channels, status)


def _frame(system: int, message: int) -> bytes:
    """Return the pattern of a frame header: MAVLink 2 has four bytes between mark and system, MAVLink 1 two."""
    sender, number = re.escape(bytes([system, _AUTOPILOT])), re.escape(bytes([message]))
    return rb"(?:\xfd.{4}%s%s\x00\x00|\xfe.{2}%s%s)" % (sender, number, sender, number)
