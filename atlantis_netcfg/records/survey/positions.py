"""The current position, or the reason why it is unknown: from gpsd or from typed input.

A fix is accepted if it is recent, its geometry is good, and the receiver has measured it. Its age counts from the
moment at which its time stamp first arrived, so a receiver that repeats the same fix becomes stale. If no fix is
accepted there is no position: nothing is interpolated, and the previous position is not kept.
"""

from __future__ import annotations

import re
import select
import socket
import subprocess
import threading
import time
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Final, Protocol

from atlantis_netcfg.checklist.probes.base import Transcript
from atlantis_netcfg.checklist.probes.gps import GPSD_PORT, gpsd
from atlantis_netcfg.checklist.probes.gps.judge import NULL_DEGREES, POOR_EPH_M, POOR_HDOP, distance_m
from atlantis_netcfg.checklist.probes.gps.record import Nature
from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.messages import arg

if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import Self

    from atlantis_netcfg.checklist.probes.gps.record import Report

MAX_AGE_S: Final = 2.0
MAX_HDOP: Final = POOR_HDOP
_AGAIN_S: Final = 5.0
"""Seconds until a gpsd that disconnected or did not respond is contacted again."""
_CONNECT_S: Final = 3.0
_MOST: Final = 65536
_OTHER_RECEIVER_S: Final = 10.0
"""Silence of the first receiver in seconds after which a second one is used."""


class NoPosition(StrEnum):
    """Reason why there is no position."""

    NO_GPSD = "gpsd does not respond"
    NO_REPORT = "no report from the receiver"
    NO_FIX = "no fix"
    NO_TIME = "the fix has no time"
    OLD = "the fix is too old"
    POOR = "poor geometry"
    NOT_MEASURED = "the receiver has not measured it"
    NULL = "latitude and longitude are 0"
    NOT_TYPED = "no position was entered"


@dataclass(frozen=True, slots=True)
class TrackPosition:
    """A position and its known accuracy."""

    latitude: float
    longitude: float
    age_s: float = 0.0
    hdop: float | None = None
    place: str = ""

    def distance_m(self, other: TrackPosition) -> float:
        """Return the great-circle distance in metres."""
        return distance_m(self.latitude, self.longitude, other.latitude, other.longitude)


class PositionSource(Protocol):
    """A source of positions."""

    name: str

    def position(self) -> TrackPosition | NoPosition:
        """Return the current position, or why there is none."""


@dataclass(slots=True)
class GpsdStream:
    """Parser of gpsd's stream; `feed` takes bytes and the time at which they arrived."""

    max_age_s: float = MAX_AGE_S
    max_hdop: float = MAX_HDOP
    _rest: bytes = b""
    _sky: bytes = b""
    """Last satellite report: the geometry of the fixes that follow."""
    _device: str | None = None
    _last: Report | None = None
    _hdop: float | None = None
    _since_s: float = 0.0
    """Time at which the last report's timestamp was first received."""
    _heard_s: float = 0.0

    def feed(self, at_s: float, data: bytes) -> None:
        """Parse the bytes that arrived at `at_s`."""
        *whole, self._rest = (self._rest + data).split(b"\n")
        if len(self._rest) > _MOST:
            self._rest = b""
        for line in whole:
            if b'"class":"SKY"' in line:
                self._sky = line + b"\n"
            elif b'"class":"TPV"' in line:
                self._process_line(at_s, line + b"\n")

    def _process_line(self, at_s: float, line: bytes) -> None:
        result = gpsd.read(Transcript(None, chunks=((0.0, self._sky + line),)))
        for report in result.reports:
            if self._device not in {None, result.device} and at_s - self._heard_s < _OTHER_RECEIVER_S:
                continue
            whole = not report.has_fix or (report.latitude is not None and report.time is not None)
            # Within an epoch gpsd may tell a mode alone, or a position before its time: the whole report follows.
            if not whole and self._last is not None and self._last.time is not None:
                continue
            self._device, self._heard_s, self._hdop = result.device, at_s, result.hdop
            if self._last is None or self._last.stamp is None or report.stamp != self._last.stamp:
                self._since_s = at_s
            self._last = report

    def position(self, now_s: float) -> TrackPosition | NoPosition:
        """Return the position at `now_s`, on the clock of `feed`."""
        report = self._last
        if report is None or (not report.has_fix and now_s - self._heard_s > self.max_age_s):
            return NoPosition.NO_REPORT
        if not report.has_fix:
            return NoPosition.NO_FIX
        if report.time is None or report.latitude is None or report.longitude is None:
            return NoPosition.NO_TIME
        age_s = max(0.0, now_s - self._since_s)
        reason = self._reject_reason(report, age_s)
        if reason is not None:
            return reason
        return TrackPosition(report.latitude, report.longitude, round(age_s, 3), self._hdop)

    def _reject_reason(self, report: Report, age_s: float) -> NoPosition | None:
        if age_s > self.max_age_s:
            return NoPosition.OLD
        if report.nature is not Nature.MEASURED:
            return NoPosition.NOT_MEASURED
        if not report.possible or max(abs(report.latitude or 0.0), abs(report.longitude or 0.0)) < NULL_DEGREES:
            return NoPosition.NULL
        poor = self._hdop is not None and self._hdop > self.max_hdop
        return NoPosition.POOR if poor or (report.eph_m is not None and report.eph_m > POOR_EPH_M) else None


class GpsdSource:
    """Positions of a gpsd over TCP (`address`) or over stdin/stdout of a `command`, read by a thread."""

    def __init__(self, name: str, address: tuple[str, int] | None = None, command: Sequence[str] = ()) -> None:
        self.name = name
        self.trouble = ""
        """Error output of the program when it last ended, from OpenSSH."""
        self._address, self._command = address, command
        self._stream: GpsdStream | None = None
        """None: no gpsd is connected."""
        self._lock = threading.Lock()
        self._stop, self._stopper = socket.socketpair()
        self._thread = threading.Thread(target=self._listen, name="gpsd", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stopper.close()
        self._thread.join()
        self._stop.close()

    def position(self) -> TrackPosition | NoPosition:
        """See `PositionSource.position`."""
        with self._lock:
            return NoPosition.NO_GPSD if self._stream is None else self._stream.position(time.monotonic())

    def _listen(self) -> None:
        """Connect, read until the other end disconnects, and reconnect, for ever."""
        while True:
            with suppress(OSError), ExitStack() as stack:
                self._receive_reports(self._connect(stack))
            with self._lock:
                self._stream = None
            if select.select([self._stop], [], [], _AGAIN_S)[0]:
                return

    def _connect(self, stack: ExitStack) -> socket.socket:
        if self._address is not None:
            return stack.enter_context(socket.create_connection(self._address, _CONNECT_S))
        ours, theirs = socket.socketpair()
        stack.enter_context(ours)
        with theirs:
            handle = theirs.fileno()
            process = subprocess.Popen(  # noqa: S603 - OpenSSH with options of ours
                self._command, stdin=handle, stdout=handle, stderr=subprocess.PIPE, start_new_session=True
            )
        stack.callback(self._end, process)
        return ours

    def _end(self, process: subprocess.Popen[bytes]) -> None:
        """Terminate the program, and keep its last error output."""
        process.terminate()
        try:
            _, complaints = process.communicate(timeout=_CONNECT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            _, complaints = process.communicate(timeout=_CONNECT_S)
        lines = complaints.decode("utf-8", "replace").strip().splitlines()
        self.trouble = lines[-1].strip() if lines else ""

    def _receive_reports(self, wire: socket.socket) -> None:
        wire.sendall(gpsd.WATCH)
        while self._stop not in (ready := select.select([wire, self._stop], [], [])[0]):
            data = wire.recv(_MOST) if wire in ready else b""
            if not data:
                return
            with self._lock:
                self._stream = self._stream or GpsdStream()
                self._stream.feed(time.monotonic(), data)


_ADDRESS = re.compile(r"(?P<host>[A-Za-z0-9.-]+|\[[0-9A-Fa-f:]+\])(?::(?P<port>\d{1,5}))?")


def parse_gpsd_address(text: str) -> tuple[str, int]:
    """Read `gps=HOST` or `gps=HOST:PORT`. Raises UsageError."""
    match = _ADDRESS.fullmatch(text)
    port = int(match["port"] or GPSD_PORT) if match is not None else 0
    if match is None or not 0 < port < 65536:  # noqa: PLR2004 - ports have 16 bits
        raise UsageError(
            f"`gps={arg(text)}` is not a gpsd address",
            hint="use `gps=gateway`, `gps=here`, or an address with or without its port: `gps=192.0.2.7:2947`",
        )
    return match["host"].strip("[]"), port


_POSITION = re.compile(
    r"(?:(?P<place>[^:]{1,60}):)?\s*(?P<latitude>[+-]?\d{1,2}(?:\.\d+)?)\s*[,;\s]\s*(?P<longitude>[+-]?\d{1,3}(?:\.\d+)?)"
)


def parse_position(text: str, named_places: dict[str, TrackPosition]) -> TrackPosition | None:
    """Parse `41.6864, -8.8388`, `pier: 41.6864, -8.8388`, or the name of a place typed before.

    A named position is stored in `named_places`. Returns None for any other text.
    """
    match = _POSITION.fullmatch(text.strip())
    if match is None:
        return named_places.get(text.strip())
    latitude, longitude = float(match["latitude"]), float(match["longitude"])
    if abs(latitude) > 90 or abs(longitude) > 180:  # noqa: PLR2004 - degrees
        return None
    position = TrackPosition(latitude, longitude, place=(match["place"] or "").strip())
    if position.place:
        named_places[position.place] = position
    return position
