"""MAVLink frames of an autopilot, as pymavlink packs them, and what was listened to of them."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

from pymavlink.dialects.v20 import common

from atlantis_netcfg.checklist.probes import Transcript
from atlantis_netcfg.checklist.probes.rc_rf import RcExpectation

SENDER, STRANGER = "10.64.1.24", "10.64.1.77"
"""Stork's companion computer, and another computer of the LAN."""
BEGAN = 1.8e9
WANTED = RcExpectation("Stork", "coastal-gateway", 14550, address=SENDER)
RC = common.MAV_SYS_STATUS_SENSOR_RC_RECEIVER
ARMED = common.MAV_MODE_FLAG_SAFETY_ARMED
UNUSED = 0xFFFF
CENTRED = [1500] * 8


class Says:
    """One component of a system, its autopilot unless said otherwise; `version` 1 or 2 of MAVLink."""

    def __init__(self, system: int = 1, version: int = 2, component: int = 1) -> None:
        self._packer: Any = common.MAVLink(None, srcSystem=system, srcComponent=component)
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

    def time(self, unix_s: float) -> bytes:
        return self._packed(self._packer.system_time_encode(round(unix_s * 1e6), 1000))

    def override(self, *values: int) -> bytes:
        """What a ground station sends in place of the remote control."""
        return self._packed(self._packer.rc_channels_override_encode(1, 1, *(values or CENTRED)))

    def second(self, *values: int, mode: int = 0x51, **channels: Any) -> list[bytes]:  # noqa: ANN401
        """What an autopilot sends in a second."""
        return [self.heartbeat(mode), self.status(), self.radio(), self.channels(*values, **channels)]


def heard(
    seconds: Iterable[Iterable[bytes | tuple[str, bytes]]],
    ended_s: float | None = None,
    *,
    count: Callable[[float], float] = float,
    sender: str = SENDER,
    cut: int = 0,
    **more: Any,  # noqa: ANN401
) -> Transcript:
    """Datagrams of one second after the other, 0.1 s apart, from `sender` or whoever stands beside one.

    `count`: what an autopilot has counted at a moment, in seconds; `cut`: frames are cut after so many bytes.
    """
    given = [
        (0.5 + second + 0.1 * place, one if isinstance(one, tuple) else (sender, one))
        for second, datagrams in enumerate(seconds)
        for place, one in enumerate(datagrams)
    ]
    sent = [(at, who, _counted(datagram, count(at))) for at, (who, datagram) in given]
    whole = [
        (at, who, piece)
        for at, who, datagram in sent
        for piece in ((datagram[:cut], datagram[cut:]) if cut else (datagram,))
    ]
    last = whole[-1][0] + 0.1 if whole else 8.0
    return Transcript(
        **{"trouble": None, **more},
        chunks=tuple((at, piece) for at, _, piece in whole),
        began=BEGAN,
        ended_s=last if ended_s is None else ended_s,
        senders=tuple(who for _, who, _ in whole),
    )


def _counted(datagram: bytes, seconds: float) -> bytes:
    """The same, if it is RC_CHANNELS, with the autopilot's count at this moment."""
    parser: Any = common.MAVLink(None)
    parser.robust_parsing = True
    (message, *others) = parser.parse_buffer(datagram) or [None]
    if message is None or others or message.get_type() != "RC_CHANNELS":
        return datagram
    packer: Any = common.MAVLink(None, srcSystem=message.get_srcSystem(), srcComponent=message.get_srcComponent())
    packer.seq = message.get_seq()
    message.time_boot_ms = round(seconds * 1000)
    return bytes(message.pack(packer, force_mavlink1=datagram[0] == 0xFE))


def bytewise(transcript: Transcript) -> Transcript:
    told = zip(transcript.chunks, transcript.senders, strict=True)
    pieces = [(at, data[place : place + 1], who) for (at, data), who in told for place in range(len(data))]
    return replace(
        transcript, chunks=tuple((at, piece) for at, piece, _ in pieces), senders=tuple(who for *_, who in pieces)
    )


def moving(says: Says, axes: int = 4, seconds: int = 12) -> list[list[bytes]]:
    way = (1500, 1900, 1500, 1100)
    return [
        says.second(*[way[(second + axis) % 4] if axis < axes else 1500 for axis in range(8)])
        for second in range(seconds)
    ]


def together(says: Says, *signs: int, seconds: int = 12) -> list[list[bytes]]:
    """Channels that follow one movement, the same way or the other; 0: the channel rests."""
    way = (0, 300, 100, -200, -400, 50)
    return [says.second(*[1500 + sign * way[second % len(way)] for sign in signs]) for second in range(seconds)]
