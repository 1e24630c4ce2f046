"""An emulated autopilot: the MAVLink stream that its companion computer forwards by UDP.

It sends the messages about the remote control, in real frames of version 1 or 2 packed by pymavlink. It executes no
command: every received datagram is counted in `forbidden`.

The module has its specification, its messages, and the thread that sends them.
"""

from __future__ import annotations

import math
import os
import secrets
import select
import socket
import threading
import time
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Self

from pydantic import BaseModel, ConfigDict, Field

if TYPE_CHECKING:
    from collections.abc import Iterator
    from types import TracebackType


__all__ = ["NOT_REHEARSED", "AutopilotSpec", "RunningAutopilot"]


_ARMED_FLAG = 0x80
_STABILIZE = 0x51
"""Mode flags of a stationary vehicle: custom mode, stabilised, remote control."""
_RC_RECEIVER = 0x10000
_GYRO = 0x1
_UNUSED_CHANNEL = 0xFFFF
_STATION = 255
_TURN_S = 2.0
"""Seconds for one full cycle of the remote control's sticks."""


@dataclass
class Rounds:
    """Frames, one round at a time."""

    spec: AutopilotSpec
    round_count: int = 0
    _frames: int = 0
    _packers: dict[int, Any] = field(default_factory=dict)

    def next(self) -> list[bytes]:
        """Return the frames of the next round; empty if it is silent."""
        spec = self.spec
        self.round_count += 1
        if spec.silent or (spec.silent_after is not None and self.round_count > spec.silent_after):
            return []
        if spec.garbage:
            return [b"$GPGGA,not,MAVLink*00\r\n"]
        return [self._damage_frame(frame) for frame in self._build_frames()]

    def _build_frames(self) -> Iterator[bytes]:
        spec = self.spec
        is_armed = spec.is_armed or (spec.armed_after is not None and self.round_count > spec.armed_after)
        if spec.heartbeat:
            yield self._pack(spec.system_id, "heartbeat", 2, 3, _STABILIZE | (_ARMED_FLAG if is_armed else 0), 0, 3)
        if spec.status:
            yield self._pack(spec.system_id, "sys_status", *self._sensors(), 250, 16200, -1, -1, *[0] * 6)
        # The telemetry radio's own level, which is not the remote control's.
        yield self._pack(spec.system_id, "radio_status", 190, 180, 100, 40, 35, 0, 0)
        has_stopped = spec.channels_stop_after is not None and self.round_count > spec.channels_stop_after
        if spec.channels is not None and not has_stopped:
            yield self._pack(spec.system_id, "rc_channels", *self._channels(spec.channels))
        if spec.ground_station:
            yield self._pack(_STATION, "heartbeat", 6, 8, 0, 0, 4)
        if spec.other_system is not None:
            yield self._pack(spec.other_system, "heartbeat", 2, 3, _STABILIZE, 0, 3)

    def _sensors(self) -> tuple[int, int, int]:
        spec = self.spec
        bits = (spec.receiver_present, spec.receiver_enabled, spec.receiver_healthy)
        present, enabled_bits, healthy = (_GYRO | (_RC_RECEIVER if bit else 0) for bit in bits)
        return present, enabled_bits, healthy

    def _channels(self, count: int) -> tuple[int, ...]:
        spec, at_s = self.spec, self.round_count * self.spec.every_s
        values = [1500 if number < count else _UNUSED_CHANNEL for number in range(18)]
        for number in range(min(spec.moving, count)):
            values[number] = 1500 + round(400 * math.sin(2 * math.pi * (at_s / _TURN_S + number / 4)))
        if spec.odd_us is not None and count > 2:  # noqa: PLR2004 - channel 3
            values[2] = spec.odd_us
        rssi = spec.rssi - (spec.rssi_swing if self.round_count % 2 else 0)
        return (round(at_s * 1000), count, *values, max(rssi, 0))

    def _pack(self, system: int, message: str, *values: int) -> bytes:
        packer = self._packers.get(system)
        if packer is None:
            # Takes a twentieth of a second to load.
            from pymavlink.dialects.v20 import common  # noqa: PLC0415

            packer = self._packers[system] = common.MAVLink(None, srcSystem=system, srcComponent=1)
        frame = getattr(packer, f"{message}_encode")(*values).pack(packer, force_mavlink1=self.spec.version == 1)
        # Whoever writes to a link counts its frames; pack alone does not.
        packer.seq = (packer.seq + 1) % 256
        return bytes(frame)

    def _damage_frame(self, frame: bytes) -> bytes:
        self._frames += 1
        if self.spec.corruption_interval and not self._frames % self.spec.corruption_interval:
            return frame[:-1] + bytes([frame[-1] ^ 0x5A])
        return frame


_LONGEST = 65535
_IP_RECVERR = 11
"""Value from ip(7); the socket module has the name only from Python 3.14."""


class RunningAutopilot:
    """Sends to `host` and `port` during the context, with or without a listener.

    Port 0: a free port, chosen when the context begins. It is not reserved, because the listener needs it. Counters of
    rounds in the specification restart with each new listener.
    """

    host = "127.0.0.1"

    def __init__(self, spec: AutopilotSpec, port: int = 0) -> None:
        self.spec = spec
        self.port = port
        self.forbidden: list[bytes] = []
        """Datagrams received; an autopilot of this kind should receive none."""
        self._rounds = Rounds(spec)
        self._rest = b""
        self._thread = threading.Thread(target=self._run, name="twin of an autopilot", daemon=True)

    def __enter__(self) -> Self:
        self.port = self.port or _free_port(self.host)
        self._stop, self._stopper = os.pipe()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((self.host, 0))
        # Without it the system does not tell a socket that is not connected that nobody listens.
        self._socket.setsockopt(socket.IPPROTO_IP, _IP_RECVERR, 1)
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        os.close(self._stopper)
        self._thread.join()
        os.close(self._stop)
        self._socket.close()

    @property
    def source(self) -> tuple[str, int]:
        """Source address of the datagrams."""
        host, port = self._socket.getsockname()
        return str(host), int(port)

    def _run(self) -> None:
        due = time.monotonic()
        ends: list[socket.socket | int] = [self._stop, self._socket]
        while True:
            ready = select.select(ends, [], [], max(0.0, due - time.monotonic()))[0]
            if self._stop in ready:
                return
            if self._socket in ready:
                self._hear()
            if time.monotonic() >= due:
                due += self.spec.every_s
                self._send(self._split_datagrams(self._rounds.next()))

    def _split_datagrams(self, frames: list[bytes]) -> list[bytes]:
        if not self.spec.split:
            return frames
        whole = self._rest + b"".join(frames)
        cut = len(whole) // 16 * 16
        self._rest = whole[cut:]
        return [whole[place : place + 16] for place in range(0, cut, 16)]

    def _hear(self) -> None:
        """Read received datagrams and socket errors; an error means that an earlier datagram had no listener."""
        with suppress(BlockingIOError):
            while True:
                self._socket.recvmsg(0, _LONGEST, socket.MSG_ERRQUEUE | socket.MSG_DONTWAIT)
                self._restart()
        with suppress(OSError):
            self.forbidden.append(self._socket.recv(_LONGEST, socket.MSG_DONTWAIT))

    def _send(self, datagrams: list[bytes]) -> None:
        try:
            for datagram in datagrams:
                self._socket.sendto(datagram, (self.host, self.port))
        except ConnectionRefusedError:
            self._restart()

    def _restart(self) -> None:
        self._rounds, self._rest = Rounds(self.spec), b""


_PORTS = range(20_000, 30_000)
"""Ports below the kernel's ephemeral range, so that no other program gets one by chance."""
_used_ports: set[int] = set()


def _free_port(host: str) -> int:
    """Return a port without listener, unused by other emulators of this process."""
    while True:
        port = secrets.choice(_PORTS)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe, suppress(OSError):
            probe.bind((host, port))
            if port not in _used_ports:
                _used_ports.add(port)
                return port


class AutopilotSpec(BaseModel):
    """An autopilot, its remote control, and the stream that its companion computer forwards."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    system_id: int = Field(default=1, ge=1, le=255)
    version: int = Field(default=2, ge=1, le=2)
    """MAVLink version."""
    every_s: float = Field(default=0.1, gt=0)
    """Seconds between two rounds of all messages. Autopilots send heartbeats once a second; rehearsals are faster."""
    is_armed: bool = False
    armed_after: int | None = None
    """Number of rounds after which the vehicle is armed; None: `is_armed` alone decides."""
    heartbeat: bool = True
    channels: int | None = Field(default=16, ge=0, le=18)
    """Value of `chancount`; None: the stream has no RC_CHANNELS."""
    channels_stop_after: int | None = None
    """Number of rounds with RC_CHANNELS; later rounds have none. None: unlimited."""
    moving: int = Field(default=4, ge=0, le=18)
    """Number of channels that follow the moving sticks; all others are constant."""
    odd_us: int | None = None
    """Value of channel 3 in microseconds; None: as for the other channels."""
    rssi: int = Field(default=200, ge=0, le=255)
    """Received signal strength; 255: unknown."""
    rssi_swing: int = Field(default=0, ge=0, le=254)
    """Amount by which `rssi` is lower in every other round."""
    status: bool = True
    """False: the stream has no SYS_STATUS."""
    receiver_present: bool = True
    receiver_enabled: bool = True
    receiver_healthy: bool = True
    ground_station: bool = False
    """The same stream also contains a ground station (system 255)."""
    other_system: int | None = None
    """System id of another, disarmed vehicle in the same stream; None: there is none."""
    corruption_interval: int = 0
    """Interval, in frames, at which one is corrupted; 0: none."""
    garbage: bool = False
    """Datagrams of another program, without MAVLink frames."""
    silent: bool = False
    silent_after: int | None = None
    """Number of rounds after which nothing more is sent; None: unlimited."""
    split: bool = False
    """Frames cross datagram boundaries, as with a serial-to-UDP bridge."""


NOT_REHEARSED = ("a remote control: its radio and range, the autopilot's failsafe, and motors that start",)
