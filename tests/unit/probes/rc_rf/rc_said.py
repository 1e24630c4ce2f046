"""MAVLink frames of an autopilot, as pymavlink packs them, and what was listened to of them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from pymavlink.dialects.v20 import common

from atlantis_netcfg.probes import Transcript
from atlantis_netcfg.probes.rc_rf import Wanted

if TYPE_CHECKING:
    from collections.abc import Iterable

WANTED = Wanted("Stork", "coastal-gateway", 14550)
RC = common.MAV_SYS_STATUS_SENSOR_RC_RECEIVER
ARMED = common.MAV_MODE_FLAG_SAFETY_ARMED
UNUSED = 0xFFFF
CENTRED = [1500] * 8


class Says:
    """One system; `version` 1 or 2 of MAVLink."""

    def __init__(self, system: int = 1, version: int = 2) -> None:
        self._packer: Any = common.MAVLink(None, srcSystem=system, srcComponent=1)
        self._version = version

    def _packed(self, message: Any) -> bytes:  # noqa: ANN401
        frame = bytes(message.pack(self._packer, force_mavlink1=self._version == 1))
        self._packer.seq = (self._packer.seq + 1) % 256
        return frame

    def heartbeat(self, mode: int = 0x51, kind: int = 2, autopilot: int = 3) -> bytes:
        return self._packed(self._packer.heartbeat_encode(kind, autopilot, mode, 0, 3))

    def channels(self, *values: int, count: int | None = None, rssi: int = 200) -> bytes:
        given = list(values or CENTRED)
        told = len(given) if count is None else count
        return self._packed(self._packer.rc_channels_encode(1000, told, *given, *[UNUSED] * (18 - len(given)), rssi))

    def status(self, present: int = RC, enabled: int = RC, health: int = RC) -> bytes:
        return self._packed(self._packer.sys_status_encode(present, enabled, health, 250, 16200, -1, -1, *[0] * 6))

    def radio(self) -> bytes:
        return self._packed(self._packer.radio_status_encode(190, 180, 100, 40, 35, 0, 0))

    def second(self, *values: int, mode: int = 0x51, **channels: Any) -> list[bytes]:  # noqa: ANN401
        """What an autopilot sends in a second."""
        return [self.heartbeat(mode), self.status(), self.radio(), self.channels(*values, **channels)]


def heard(seconds: Iterable[Iterable[bytes]], ended_s: float | None = None, **more: Any) -> Transcript:  # noqa: ANN401
    """Datagrams of one second after the other, 0.1 s apart."""
    chunks = tuple(
        (0.5 + second + 0.1 * place, datagram)
        for second, datagrams in enumerate(seconds)
        for place, datagram in enumerate(datagrams)
    )
    last = chunks[-1][0] + 0.1 if chunks else 8.0
    more.setdefault("trouble", None)
    return Transcript(chunks=chunks, began=1.8e9, ended_s=last if ended_s is None else ended_s, **more)


def bytewise(transcript: Transcript) -> Transcript:
    pieces = tuple((at, data[place : place + 1]) for at, data in transcript.chunks for place in range(len(data)))
    return Transcript(transcript.trouble, transcript.words, pieces, transcript.began, transcript.ended_s)


def moving(says: Says, axes: int = 4, seconds: int = 12) -> list[list[bytes]]:
    way = (1500, 1900, 1500, 1100)
    return [
        says.second(*[way[(second + axis) % 4] if axis < axes else 1500 for axis in range(8)])
        for second in range(seconds)
    ]
