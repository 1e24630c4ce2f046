"""The frames of one round of an emulated autopilot, packed by pymavlink."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.emulator.mavlink.spec import AutopilotSpec

__all__ = ["Rounds"]

_ARMED = 0x80
_STABILIZE = 0x51
"""Mode flags of a vehicle that stands: custom mode, stabilised, remote control."""
_RC_RECEIVER = 0x10000
_GYRO = 0x1
_UNUSED = 0xFFFF
_STATION = 255
_TURN_S = 2.0
"""The sticks go round once in this time."""


@dataclass
class Rounds:
    """All frames, round by round."""

    spec: AutopilotSpec
    sent: int = 0
    """Rounds."""
    _frames: int = 0
    _packers: dict[int, Any] = field(default_factory=dict)

    def next(self) -> list[bytes]:
        """The frames of the next round; none: it is silent."""
        spec = self.spec
        self.sent += 1
        if spec.silent or (spec.silent_after is not None and self.sent > spec.silent_after):
            return []
        if spec.garbage:
            return [b"$GPGGA,not,MAVLink*00\r\n"]
        return [self._damaged(frame) for frame in self._round()]

    def _round(self) -> Iterator[bytes]:
        spec = self.spec
        armed = spec.armed or (spec.armed_after is not None and self.sent > spec.armed_after)
        if spec.heartbeat:
            yield self._packed(spec.system_id, "heartbeat", 2, 3, _STABILIZE | (_ARMED if armed else 0), 0, 3)
        if spec.status:
            yield self._packed(spec.system_id, "sys_status", *self._sensors(), 250, 16200, -1, -1, *[0] * 6)
        # The telemetry radio's own level, which is not the remote control's.
        yield self._packed(spec.system_id, "radio_status", 190, 180, 100, 40, 35, 0, 0)
        stopped = spec.channels_stop_after is not None and self.sent > spec.channels_stop_after
        if spec.channels is not None and not stopped:
            yield self._packed(spec.system_id, "rc_channels", *self._channels(spec.channels))
        if spec.ground_station:
            yield self._packed(_STATION, "heartbeat", 6, 8, 0, 0, 4)
        if spec.other_system is not None:
            yield self._packed(spec.other_system, "heartbeat", 2, 3, _STABILIZE, 0, 3)

    def _sensors(self) -> tuple[int, int, int]:
        spec = self.spec
        bits = (spec.receiver_present, spec.receiver_enabled, spec.receiver_healthy)
        present, enabled, healthy = (_GYRO | (_RC_RECEIVER if bit else 0) for bit in bits)
        return present, enabled, healthy

    def _channels(self, count: int) -> tuple[int, ...]:
        spec, at_s = self.spec, self.sent * self.spec.every_s
        values = [1500 if number < count else _UNUSED for number in range(18)]
        for number in range(min(spec.moving, count)):
            values[number] = 1500 + round(400 * math.sin(2 * math.pi * (at_s / _TURN_S + number / 4)))
        if spec.odd_us is not None and count > 2:  # noqa: PLR2004 - channel 3
            values[2] = spec.odd_us
        rssi = spec.rssi - (spec.rssi_swing if self.sent % 2 else 0)
        return (round(at_s * 1000), count, *values, max(rssi, 0))

    def _packed(self, system: int, message: str, *values: int) -> bytes:
        packer = self._packers.get(system)
        if packer is None:
            # Takes a twentieth of a second to load.
            from pymavlink.dialects.v20 import common  # noqa: PLC0415

            packer = self._packers[system] = common.MAVLink(None, srcSystem=system, srcComponent=1)
        frame = getattr(packer, f"{message}_encode")(*values).pack(packer, force_mavlink1=self.spec.version == 1)
        # Whoever writes to a link counts its frames; pack alone does not.
        packer.seq = (packer.seq + 1) % 256
        return bytes(frame)

    def _damaged(self, frame: bytes) -> bytes:
        self._frames += 1
        if self.spec.corrupted and not self._frames % self.spec.corrupted:
            return frame[:-1] + bytes([frame[-1] ^ 0x5A])
        return frame
