"""An emulated GNSS receiver behind gpsd, behind an NMEA server on TCP, or on a serial port.

It covers what both protocols report in every state of a receiver, and servers that are absent, serve only one client,
or send nothing. It computes no positions, and uses this computer's clock. Requests that would change a receiver are
not executed but counted in `forbidden`.

The module has the receiver's state, its reports as gpsd or NMEA, and the threads that serve them.
"""

from __future__ import annotations

import json
import os
import re
import select
import socket
import threading
import time
import tty
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from enum import StrEnum
from functools import reduce
from operator import xor
from typing import TYPE_CHECKING, Any, Protocol, Self

from pydantic import BaseModel, ConfigDict, Field

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import TracebackType


__all__ = ["NOT_REHEARSED", "GnssAccess", "GnssSpec", "RunningGpsd", "RunningNmea", "RunningNmeaPort", "Speech"]


PATH = "/dev/ttyACM0"
"""Serial port of the receiver, as gpsd reports it."""
_METER = 1 / 111_195.0
"""One metre in degrees of latitude."""
_GARBAGE = bytes((0xE0 + 7 * place % 32) for place in range(64))
_QUALITY = {None: 1, 2: 2, 3: 4, 4: 5, 5: 6, 6: 1, 7: 7, 8: 8}
_INDICATOR = {None: "A", 2: "D", 3: "R", 4: "F", 5: "E", 6: "A", 7: "M", 8: "S"}
"""gpsd's status to the mode indicator of RMC."""


def encode_reports(*objects: dict[str, Any]) -> bytes:
    """Encode objects as JSON with the line ends of gpsd."""
    return b"".join(json.dumps(row, separators=(",", ":")).encode() + b"\r\n" for row in objects)


def line(body: str) -> bytes:
    """Return an NMEA sentence with its checksum."""
    return f"${body}*{reduce(xor, body.encode(), 0):02X}\r\n".encode()


@dataclass
class GnssSource:
    """Reports for one client, one at a time."""

    spec: GnssSpec
    now: Callable[[], float] = time.time
    report_count: int = 0
    _first: float = field(init=False)

    def __post_init__(self) -> None:
        """Store the time that a stale receiver repeats."""
        self._first = self.now()

    @property
    def has_next(self) -> bool:
        """Whether another report will come."""
        over = self.spec.silent_after is not None and self.report_count >= self.spec.silent_after
        return self.spec.speech is not Speech.NOTHING and not over

    @property
    def _has_fix(self) -> bool:
        is_lost = self.spec.lost_after is not None and self.report_count >= self.spec.lost_after
        return self.spec.mode > 1 and not is_lost

    @property
    def _time(self) -> datetime:
        seconds = self._first if self.spec.stale else self.now()
        return datetime.fromtimestamp(seconds + self.spec.time_offset_s, UTC)

    @property
    def _place(self) -> tuple[float, float]:
        spec = self.spec
        latitude = spec.latitude + (spec.jumping_m * _METER if self.report_count % 2 else 0.0)
        place = (spec.longitude, latitude) if spec.has_swapped_axes else (latitude, spec.longitude)
        return (0.0, 0.0) if spec.null else place

    def next(self, *, objects: bool = False, sentences: bool = False) -> bytes:
        """Return the next report: gpsd's JSON, NMEA sentences, or both."""
        whole = self._sentences() if sentences else b""
        whole += self._tpv() + self._sky() if objects else b""
        self.report_count += 1
        if self.spec.speech is Speech.GARBAGE:
            return _GARBAGE
        is_damaged = self.spec.damage_interval and not self.report_count % self.spec.damage_interval
        return whole.replace(b'"mode":', b'"mode"', 1).replace(b"A,", b"A;", 1) if is_damaged else whole

    def _tpv(self) -> bytes:
        spec, (latitude, longitude) = self.spec, self._place
        if not self._has_fix:
            return encode_reports({"class": "TPV", "device": PATH, "mode": 1})
        report: dict[str, Any] = {"class": "TPV", "device": PATH}
        if spec.status is not None:
            report["status"] = spec.status
        report["mode"] = spec.mode
        if spec.has_time:
            report |= {"time": f"{self._time:%Y-%m-%dT%H:%M:%S.%f}"[:-3] + "Z", "ept": 0.005}
        report |= {"lat": round(latitude, 9), "lon": round(longitude, 9)}
        if spec.mode > 2:  # noqa: PLR2004 - 3D
            report |= {"altHAE": 59.0, "altMSL": 5.0, "alt": 5.0, "epv": 29.9}
        return encode_reports({**report, "track": 10.0, "speed": 0.026, "eph": spec.eph_m})

    def _sky(self) -> bytes:
        spec = self.spec
        used = spec.satellites if self._has_fix else 0
        satellites = [
            {"PRN": item, "el": 40.0, "az": 30.0, "ss": 41.0, "used": item <= used} for item in range(1, used + 3)
        ]
        dop = {"hdop": spec.hdop} if self._has_fix else {}
        return encode_reports(
            {"class": "SKY", "device": PATH, **dop, "nSat": len(satellites), "uSat": used, "satellites": satellites}
        )

    def _sentences(self) -> bytes:
        spec, at = self.spec, self._time
        of_day = f"{at:%H%M%S.%f}"[:-4]
        date = f"{at:%d%m%y}"
        if not self._has_fix:
            gga, gsa = f"GPGGA,{of_day},,,,,0,00,99.99,,,,,,", "GPGSA,A,1,,,,,,,,,,,,,99.99,99.99,99.99"
            return line(gga) + (line(f"GPRMC,{of_day},V,,,,,,,{date},,,N") if spec.has_time else b"") + line(gsa)
        place = _degrees(*self._place)
        height = "5.0,M,54.0,M,," if spec.mode > 2 else ",M,,M,,"  # noqa: PLR2004 - 3D
        gga = f"GPGGA,{of_day},{place},{_QUALITY[spec.status]},{spec.satellites:02},{spec.hdop:.1f},{height}"
        rmc = f"GPRMC,{of_day},A,{place},0.05,10.0,{date},,,{_INDICATOR[spec.status]}"
        used = ",".join([f"{item:02}" for item in range(1, min(spec.satellites, 12) + 1)])
        gsa = f"GPGSA,A,{spec.mode},{used}{',' * (12 - min(spec.satellites, 12))},1.6,{spec.hdop:.1f},1.3"
        return line(gga) + (line(rmc) if spec.has_time else b"") + line(gsa)


def _degrees(latitude: float, longitude: float) -> str:
    north, east = "N" if latitude >= 0 else "S", "E" if longitude >= 0 else "W"
    return f"{_minutes(latitude, 2)},{north},{_minutes(longitude, 3)},{east}"


def _minutes(degrees: float, digits: int) -> str:
    hundred_thousandths = round(abs(degrees) * 60 * 100_000)
    whole, minutes = divmod(hundred_thousandths, 60 * 100_000)
    return f"{whole:0{digits}}{minutes / 100_000:08.5f}"


_VERSION = {"class": "VERSION", "release": "3.22", "rev": "3.22", "proto_major": 3, "proto_minor": 14}
_REQUEST = re.compile(r"\?(VERSION|DEVICES|POLL|WATCH|DEVICE);|\?(WATCH|DEVICE)=([^}\n]*[}\n]);?", re.DOTALL)
_FLAG = r'"%s"\s*:\s*([^,}\s]*)'


class GnssClient:
    """A client's connection to gpsd."""

    def __init__(self, spec: GnssSpec) -> None:
        self.spec = spec
        self.state = {"enable": False, "json": False, "nmea": False}
        """Options of the client's WATCH request."""
        self.greeting = encode_reports(_VERSION)
        self._activated = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S.000Z")

    def hear(self, data: bytes) -> tuple[bytes, list[str]]:
        """Return the response, and the requests that are invalid or would have changed the receiver."""
        text = data.decode("utf-8", "replace").removesuffix("\n").removesuffix("\r") + "\n"
        answer = b""
        forbidden: list[str] = []
        while text.startswith("?") or (answer and text.strip()):
            match = _REQUEST.match(text)
            if match is None:
                words = json.dumps(f"Unrecognized request '{text}'")
                return answer + b'{"class":"ERROR","message":' + words.encode() + b"}\r\n", [*forbidden, text]
            answer += self._answer(match[1] or match[2], match[3])
            forbidden += [match[0]] if match[2] == "DEVICE" else []
            text = text[match.end() :].lstrip()
        return answer, forbidden

    def _answer(self, name: str, value: str | None) -> bytes:
        if name == "VERSION":
            return encode_reports(_VERSION)
        if name == "DEVICES":
            return encode_reports(self._devices())
        if name == "DEVICE":
            return encode_reports(self._device()) if self.spec.device else b""
        if name == "POLL":
            now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S.000Z")
            return encode_reports({"class": "POLL", "time": now, "active": 0, "tpv": [], "gst": [], "sky": []})
        if value is not None:
            self._watch(value)
        settings = {"raw": 0, "scaled": False, "timing": False, "split24": False, "pps": False}
        return encode_reports(self._devices(), {"class": "WATCH", **self.state, **settings})

    def _watch(self, value: str) -> None:
        self.state["enable"] = True
        for name in self.state:
            if result := re.search(_FLAG % name, value):
                self.state[name] = result[1] == "true"

    def _device(self) -> dict[str, Any]:
        return {"class": "DEVICE", "path": PATH, "driver": "NMEA0183", "activated": self._activated, "flags": 1}

    def _devices(self) -> dict[str, Any]:
        return {"class": "DEVICES", "devices": [self._device()] if self.spec.device else []}


class Speech(StrEnum):
    """Kind of output."""

    POSITIONS = "positions"
    NOTHING = "nothing"
    """Open port without data."""
    GARBAGE = "garbage"
    """Unreadable data, as with a wrong baud rate or from another program."""


class GnssAccess(StrEnum):
    """How its server treats clients."""

    OPEN = "served"
    UNREACHABLE = "refused"
    """Connections are refused: no process listens on the port."""
    IN_USE = "in use"
    """The only connection is in use: every other client is disconnected at once."""
    MUTE = "mute"
    """The connection is accepted, but nothing is sent, not even a greeting."""


class GnssSpec(BaseModel):
    """A receiver, and the program or port that forwards its data."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    latitude: float = 41.68642
    """Position in the port of Viana do Castelo, from the pilot's report."""
    longitude: float = -8.83883
    mode: int = Field(default=3, ge=1, le=3)
    """1: no fix; 2: 2D fix; 3: 3D fix."""
    every_s: float = Field(default=0.2, gt=0)
    """Seconds between two reports. Real receivers send one a second; rehearsals use a shorter interval."""
    time_offset_s: float = 0.0
    """Offset of the receiver's time from this computer's."""
    has_time: bool = True
    """False: positions without a time (gpsd), or GGA without RMC, which has no date (NMEA)."""
    stale: bool = False
    """The same position with the same time is repeated."""
    silent_after: int | None = None
    """Number of reports after which nothing more is sent; None: unlimited."""
    lost_after: int | None = None
    """Number of reports with a fix; later reports have none. None: unlimited."""
    has_swapped_axes: bool = False
    """Latitude and longitude are swapped."""
    jumping_m: float = 0.0
    """Metres by which every other report is shifted north."""
    null: bool = False
    """The fix is at 0, 0."""
    status: int | None = None
    """gpsd status: 2 DGPS, 3 and 4 RTK, 5 dead reckoning, 7 surveyed, 8 simulated; None: a plain fix."""
    eph_m: float = 17.1
    hdop: float = 0.9
    satellites: int = Field(default=9, ge=0, le=99)
    speech: Speech = Speech.POSITIONS
    access: GnssAccess = GnssAccess.OPEN
    device: bool = True
    """False: gpsd runs without a receiver."""
    damage_interval: int = 0
    """Interval, in reports, at which one is corrupted (checksum, JSON); 0: none."""
    piecewise: bool = False
    """Output is sent byte by byte."""


_AT_MOST = 4096


class _Running:
    """Base class: a thread, and the pipe that ends it."""

    def __init__(self, spec: GnssSpec) -> None:
        self.spec = spec
        self.inputs: list[bytes] = []
        """All data received from clients."""
        self.forbidden: list[str] = []
        """Received requests that must never be sent to a receiver."""
        self._thread = threading.Thread(target=self._run, name="twin of a GNSS receiver", daemon=True)

    def __enter__(self) -> Self:
        self._stop, self._stopper = os.pipe()
        self._open()
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        os.close(self._stopper)
        self._thread.join()
        os.close(self._stop)
        self._close()

    def _open(self) -> None:
        raise NotImplementedError

    def _close(self) -> None:
        raise NotImplementedError

    def _run(self) -> None:
        raise NotImplementedError


class _GnssListener(Protocol):
    """Sends reports to one connection and handles its input."""

    def greet(self) -> bytes: ...
    def hear(self, data: bytes) -> tuple[bytes, list[str]]: ...
    def report(self) -> bytes: ...


class _GpsdClient:
    def __init__(self, spec: GnssSpec) -> None:
        self._client, self._source = GnssClient(spec), GnssSource(spec)

    def greet(self) -> bytes:
        return self._client.greeting

    def hear(self, data: bytes) -> tuple[bytes, list[str]]:
        return self._client.hear(data)

    def report(self) -> bytes:
        watch = self._client.state
        if not (watch["enable"] and self._client.spec.device and self._source.has_next):
            return b""
        return self._source.next(objects=watch["json"], sentences=watch["nmea"])


class _NmeaClient:
    def __init__(self, spec: GnssSpec) -> None:
        self._source = GnssSource(spec)

    def greet(self) -> bytes:
        del self
        return b""

    def hear(self, data: bytes) -> tuple[bytes, list[str]]:
        """Count all input as sent to the receiver."""
        del self
        return b"", [data.decode("ascii", "replace")]

    def report(self) -> bytes:
        return self._source.next(sentences=True) if self._source.has_next else b""


class _GnssServer(_Running):
    """A TCP server; `host` and `port` are its address (or, when refusing, an address without listener)."""

    host = "127.0.0.1"

    def __init__(self, spec: GnssSpec, port: int = 0) -> None:
        super().__init__(spec)
        self.port = port
        self._clients: dict[socket.socket, _GnssListener] = {}

    def _listener(self) -> _GnssListener:
        raise NotImplementedError

    def _open(self) -> None:
        self._door = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._door.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._door.bind((self.host, self.port))
        self.port = self._door.getsockname()[1]
        # A port that is bound and does not listen refuses, and nobody else can get it meanwhile.
        if self.spec.access is not GnssAccess.UNREACHABLE:
            self._door.listen()

    def _close(self) -> None:
        for client in self._clients:
            client.close()
        self._door.close()

    def _run(self) -> None:
        due = time.monotonic()
        while True:
            waiting: list[socket.socket | int] = [self._stop, *self._clients]
            if self.spec.access is not GnssAccess.UNREACHABLE:
                waiting.append(self._door)
            ready = select.select(waiting, [], [], max(0.0, due - time.monotonic()))[0]
            if self._stop in ready:
                return
            if self._door in ready:
                self._admit()
            for client in [item for item in self._clients if item in ready]:
                self._hear(client)
            if time.monotonic() >= due:
                # Who was kept from telling tells on from now: a receiver does not make up for what it has left out.
                due = max(due + self.spec.every_s, time.monotonic() + self.spec.every_s / 2)
                for client, listener in list(self._clients.items()):
                    self._send(client, listener.report())

    def _admit(self) -> None:
        client = self._door.accept()[0]
        if self.spec.access is GnssAccess.IN_USE:
            client.close()
            return
        self._clients[client] = self._listener()
        self._send(client, self._clients[client].greet())

    def _hear(self, client: socket.socket) -> None:
        try:
            data = client.recv(_AT_MOST)
        except OSError:
            data = b""
        if not data:
            del self._clients[client]
            client.close()
            return
        self.inputs.append(data)
        answer, forbidden = self._clients[client].hear(data)
        self.forbidden += forbidden
        self._send(client, answer)

    def _send(self, client: socket.socket, data: bytes) -> None:
        if self.spec.access is GnssAccess.MUTE:
            return
        size = 1 if self.spec.piecewise else len(data)
        try:
            for place in range(0, len(data), size or 1):
                client.sendall(data[place : place + size])
        except OSError:
            # It has gone; the next reading of it says so as well.
            return


class RunningGpsd(_GnssServer):
    """An emulated gpsd with one receiver."""

    def _listener(self) -> _GnssListener:
        return _GpsdClient(self.spec)


class RunningNmea(_GnssServer):
    """A server that forwards a receiver's sentences to every client."""

    def _listener(self) -> _GnssListener:
        return _NmeaClient(self.spec)


class RunningNmeaPort(_Running):
    """A receiver on a serial port with path `path`."""

    path = ""

    def _open(self) -> None:
        self._ours, self._theirs = os.openpty()
        tty.setraw(self._theirs)
        self.path = os.ttyname(self._theirs)
        # Our own hold on the far end would look like somebody who has the port; the near end survives without it.
        os.close(self._theirs)
        os.set_blocking(self._ours, False)

    def _close(self) -> None:
        os.close(self._ours)

    def _run(self) -> None:
        source = GnssSource(self.spec)
        while not select.select([self._stop], [], [], self.spec.every_s)[0]:
            if not self._is_open():
                # Bytes of a receiver are lost where nobody has the port open; its mood begins anew with the next one.
                source = GnssSource(self.spec)
                continue
            self._hear()
            if source.has_next:
                self._send(source.next(sentences=True))

    def _is_open(self) -> bool:
        poll = select.poll()
        poll.register(self._ours, 0)
        return not any(event & select.POLLHUP for _, event in poll.poll(0))

    def _hear(self) -> None:
        with suppress(OSError):
            data = os.read(self._ours, _AT_MOST)
            self.inputs.append(data)
            self.forbidden.append(data.decode("ascii", "replace"))

    def _send(self, data: bytes) -> None:
        """Write to the port; as on a real one, bytes are lost if the reader is too slow."""
        size = 1 if self.spec.piecewise else len(data)
        with suppress(OSError):
            for place in range(0, len(data), size):
                os.write(self._ours, data[place : place + size])


NOT_REHEARSED = ("a GNSS receiver: the sky, its antenna and cable, the time to its first fix",)
