"""True streams of receivers and acoustic modems by their grammars, and every way of making a wrong one of them.

Nothing here imports a probe, nor our twins: what a stream is was written down a second time, from the makers' and the
standards' words. A stream is drawn from a seed; a lie takes a true stream and gives a wrong one, or None where the
stream has nothing that the lie would change.
"""

import json
import math
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import reduce
from operator import xor
from random import Random
from typing import Any

DAY_S = 86_400
DEGREE_M = 111_195.0
LISTENED_S = 15.0


@dataclass(frozen=True)
class Stream:
    chunks: tuple[tuple[float, bytes], ...]
    began: float
    ended_s: float
    trouble: str = ""
    words: str = ""
    place: tuple[float, float] = (0.0, 0.0)
    """The middle of the geofence."""
    radius_m: float = 1000.0
    flies: bool = False


@dataclass(frozen=True)
class Epoch:
    at_s: float
    """When it comes."""
    time: float | None
    latitude: float
    longitude: float
    quality: int = 1
    used: int = 9
    hdop: float = 0.9
    dimensions: int = 3
    speed_m_s: float = 0.0
    void: bool = False
    """RMC and GLL say V, whatever GGA says."""


@dataclass(frozen=True)
class Ride:
    style: str
    epochs: tuple[Epoch, ...]
    began: float
    place: tuple[float, float]
    radius_m: float
    ended_s: float | None = None
    other: "Ride | None" = None
    """A second receiver at the same end."""
    flies: bool = False
    cut: int | None = None
    """The other end hangs up after so many epochs."""


def ride(rng: Random, style: str) -> Ride:
    """A true one: inside the geofence, at the time of the listening clock, moving as a vessel does."""
    latitude = rng.uniform(30, 60) * rng.choice((1, -1))
    longitude = rng.uniform(-25, 25)
    began = rng.uniform(1.80e9, 2.05e9)
    every_s = rng.choice((0.2, 0.5, 1.0, 1.0, 1.0))
    speed, course = rng.choice((0.0, 0.05, 1.5, 4.0)), rng.uniform(0, 2 * math.pi)
    late_s = rng.uniform(0.05, 1.5)
    quality = rng.choice((1, 1, 2, 4, 5))
    epochs = []
    for number in range(rng.randrange(8, 14)):
        at_s = 0.1 + number * every_s
        north, east = (part * speed * at_s + rng.gauss(0, 0.4) for part in (math.cos(course), math.sin(course)))
        epochs.append(
            Epoch(
                at_s,
                round(began + at_s - late_s, 1),
                latitude + north / DEGREE_M,
                longitude + east / DEGREE_M / math.cos(math.radians(latitude)),
                quality,
                rng.randrange(5, 20),
                round(rng.uniform(0.6, 2.5), 2),
                speed_m_s=speed,
            )
        )
    off = rng.uniform(-0.3, 0.3)
    radius_m = rng.uniform(300, 2000)
    return Ride(style, tuple(epochs), began, (latitude + off * radius_m / DEGREE_M, longitude), radius_m)


def checked(body: str) -> bytes:
    return f"${body}*{reduce(xor, body.encode(), 0):02X}\r\n".encode()


def _degrees(value: float, digits: int, signs: str) -> str:
    minutes = round(abs(value) * 60, 5)
    return f"{int(minutes // 60):0{digits}}{minutes % 60:08.5f},{signs[value < 0]}"


def _where(epoch: Epoch) -> str:
    return f"{_degrees(epoch.latitude, 2, 'NS')},{_degrees(epoch.longitude, 3, 'EW')}"


def _clock(epoch: Epoch, form: str) -> str:
    if epoch.time is None:
        return ""
    hundredths = round(epoch.time * 100)
    whole = datetime.fromtimestamp(hundredths // 100, UTC).strftime(form)
    return f"{whole}.{hundredths % 100:02}" if form == "%H%M%S" else whole


_LETTER = {0: "N", 1: "A", 2: "D", 4: "R", 5: "F", 6: "E", 7: "M", 8: "S"}


def _gga(talker: str, epoch: Epoch) -> bytes:
    if not epoch.quality:
        return checked(f"{talker}GGA,{_clock(epoch, '%H%M%S')},,,,,0,00,99.99,,,,,,")
    height = "5.0" if epoch.dimensions == 3 else ""
    fix = f"{epoch.quality},{epoch.used:02},{epoch.hdop:.2f},{height},M,54.0,M,,"
    return checked(f"{talker}GGA,{_clock(epoch, '%H%M%S')},{_where(epoch)},{fix}")


def _gns(talker: str, epoch: Epoch) -> bytes:
    modes = _LETTER[epoch.quality] + ("N" if epoch.quality in {0, 8} else _LETTER[epoch.quality])
    where = _where(epoch) if epoch.quality else ",,,"
    height = "5.0" if epoch.dimensions == 3 else ""
    return checked(
        f"{talker}GNS,{_clock(epoch, '%H%M%S')},{where},{modes},{epoch.used:02},{epoch.hdop:.2f},{height},54.0,,"
    )


def _rmc(talker: str, epoch: Epoch, *, lettered: bool = True) -> bytes:
    status = "V" if epoch.void or not epoch.quality else "A"
    where = _where(epoch) if epoch.quality else ",,,"
    letter = f",{'N' if status == 'V' else _LETTER[epoch.quality]}" if lettered else ""
    knots = epoch.speed_m_s * 3600 / 1852
    at, on = _clock(epoch, "%H%M%S"), _clock(epoch, "%d%m%y")
    return checked(f"{talker}RMC,{at},{status},{where},{knots:.2f},77.5,{on},,{letter}")


def _gll(talker: str, epoch: Epoch) -> bytes:
    status = "V" if epoch.void or not epoch.quality else "A"
    where = _where(epoch) if epoch.quality else ",,,"
    return checked(f"{talker}GLL,{where},{_clock(epoch, '%H%M%S')},{status},{_LETTER[epoch.quality]}")


def _gsa(talker: str, epoch: Epoch, mode: int | None = None, system: str = "") -> bytes:
    told = (epoch.dimensions if epoch.quality else 1) if mode is None else mode
    used = ",".join(f"{one:02}" for one in range(1, 9 if told > 1 else 1)) or ""
    blanks = "," * (12 - (8 if told > 1 else 1))
    return checked(f"{talker}GSA,A,{told},{used}{blanks},1.6,{epoch.hdop:.2f},1.3{system}")


def _zda(epoch: Epoch) -> bytes:
    return checked(f"GPZDA,{_clock(epoch, '%H%M%S')},{_clock(epoch, '%d,%m,%Y')},00,00")


def _ublox(epoch: Epoch) -> bytes:
    glonass = _gsa("GN", epoch, 1 if epoch.quality and epoch.used % 2 else None, ",2")
    views = checked("GPGSV,1,1,02,05,40,083,46,07,12,300,31")
    systems = _gsa("GN", epoch, system=",1") + glonass
    return _rmc("GN", epoch) + _gga("GN", epoch) + systems + views + _gll("GN", epoch)


def _tagged(lines: bytes, tag: str) -> bytes:
    block = f"\\{tag}*{reduce(xor, tag.encode(), 0):02X}\\".encode()
    return b"".join(block + line + b"\r\n" for line in lines.splitlines())


STYLES: Mapping[str, tuple[Callable[[Epoch], bytes], frozenset[str]]] = {
    "u-blox": (
        _ublox,
        frozenset({"date", "speed", "count", "nature", "dimensions", "void", "time"}),
    ),
    "garmin": (
        lambda e: _rmc("GP", e) + _gga("GP", e) + _gsa("GP", e) + _gll("GP", e),
        frozenset({"date", "speed", "count", "nature", "dimensions", "void", "time"}),
    ),
    "sirf": (
        lambda e: _gga("GP", e) + _gsa("GP", e) + _rmc("GP", e, lettered=False),
        frozenset({"date", "speed", "count", "nature", "dimensions", "void", "time"}),
    ),
    "GLONASS without a fix": (
        lambda e: _gga("GP", e) + _rmc("GP", e) + _gsa("GP", e) + _gsa("GL", e, 1),
        frozenset({"date", "speed", "count", "nature", "void", "time", "dimensions"}),
    ),
    "RMC alone": (lambda e: _rmc("GP", e), frozenset({"date", "speed", "nature", "void", "time"})),
    "GLL alone": (lambda e: _gll("GP", e), frozenset({"nature", "void", "time"})),
    "GGA alone": (lambda e: _gga("GP", e), frozenset({"count", "nature", "time"})),
    "GGA and ZDA": (lambda e: _zda(e) + _gga("II", e), frozenset({"date", "count", "nature", "time"})),
    "GNS": (lambda e: _gns("GN", e) + _rmc("GN", e), frozenset({"date", "speed", "count", "nature", "void", "time"})),
    "multiplexer": (
        lambda e: _tagged(_ublox(e), "s:GP0001"),
        frozenset({"date", "speed", "count", "nature", "dimensions", "void", "time", "sources"}),
    ),
}
"""How a receiver speaks, and what of an epoch it tells."""
_STATUS = {2: 2, 4: 3, 5: 4, 6: 5, 7: 7, 8: 8}


def _gpsd(epoch: Epoch, version: str, path: str) -> bytes:
    fixed = epoch.quality and not epoch.void
    report: dict[str, Any] = {"class": "TPV", "device": path, "mode": epoch.dimensions if fixed else 1}
    if fixed:
        if epoch.quality in _STATUS or version == "3.25":
            report["status"] = _STATUS.get(epoch.quality, 1)
        if epoch.time is not None:
            stamp = datetime.fromtimestamp(round(epoch.time * 1000) / 1000, UTC)
            report["time"] = f"{stamp:%Y-%m-%dT%H:%M:%S}.{round(epoch.time * 1000) % 1000:03}Z"
        report |= {"lat": round(epoch.latitude, 9), "lon": round(epoch.longitude, 9), "speed": epoch.speed_m_s}
        report["eph"] = round(epoch.hdop * 19, 2)
    sky: dict[str, Any] = {"class": "SKY", "device": path, "hdop": epoch.hdop}
    seen = [{"PRN": one, "used": one <= epoch.used} for one in range(1, epoch.used + 4)]
    sky |= {"satellites": seen} if version == "3.17" else {"nSat": len(seen), "uSat": epoch.used, "satellites": seen}
    return _objects(report, sky)


def _objects(*objects: dict[str, Any]) -> bytes:
    return b"".join(json.dumps(one, separators=(",", ":")).encode() + b"\r\n" for one in objects)


VERSIONS = ("3.17", "3.22", "3.25")
GPSD_TELLS = frozenset({"date", "speed", "count", "nature", "dimensions", "time", "sources"})


def stream(ridden: Ride) -> Stream:
    said: Callable[[Epoch], bytes]
    if ridden.style in VERSIONS:
        path = "/dev/ttyACM0"
        device = {"class": "DEVICE", "path": path, "activated": "2026-11-20T10:14:00.000Z"}
        greeting = {"class": "VERSION", "release": ridden.style}, {"class": "DEVICES", "devices": [device]}
        first = _objects(*greeting, {"class": "WATCH", "enable": True})

        def said(epoch: Epoch) -> bytes:
            return _gpsd(epoch, ridden.style, path)

        def other(epoch: Epoch) -> bytes:
            return _gpsd(epoch, ridden.style, "/dev/ttyUSB9")
    else:
        said, first = STYLES[ridden.style][0], b"0.9,1.3*3F\r\n"

        def other(epoch: Epoch) -> bytes:
            return _tagged(_ublox(epoch), "s:GP0002")

    mine = ridden.epochs if ridden.cut is None else ridden.epochs[: ridden.cut]
    chunks = [(0.02, first), *((one.at_s, said(one)) for one in mine)]
    if ridden.other is not None:
        chunks += [(one.at_s + 0.01, other(one)) for one in ridden.other.epochs]
    chunks.sort(key=lambda chunk: chunk[0])
    ended_s = ridden.ended_s if ridden.ended_s is not None else chunks[-1][0] + 0.1
    hung_up = "the other end hung up" if ridden.cut is not None else ""
    return Stream(tuple(chunks), ridden.began, ended_s, "", hung_up, ridden.place, ridden.radius_m, flies=ridden.flies)


def _all(ridden: Ride, **changes: Any) -> Ride:  # noqa: ANN401 - fields of an epoch
    return replace(ridden, epochs=tuple(replace(one, **changes) for one in ridden.epochs))


def _shifted(ridden: Ride, seconds: float) -> Ride:
    epochs = tuple(replace(one, time=None if one.time is None else one.time + seconds) for one in ridden.epochs)
    return replace(ridden, epochs=epochs)


def _aside(rng: Random, ridden: Ride) -> tuple[float, float]:
    """Some way outside the geofence, by degrees."""
    away = (ridden.radius_m * rng.uniform(2.2, 50) + 500) / DEGREE_M
    return (away, 0.0) if rng.random() < 0.5 else (0.0, away / math.cos(math.radians(ridden.place[0])))


def _moved(ridden: Ride, north: float, east: float, every: int = 1) -> Ride:
    return replace(
        ridden,
        epochs=tuple(
            replace(one, latitude=one.latitude + north, longitude=one.longitude + east) if number % every == 0 else one
            for number, one in enumerate(ridden.epochs)
        ),
    )


def _frozen(rng: Random, ridden: Ride) -> Ride:
    first = ridden.epochs[rng.randrange(2)]
    return replace(ridden, epochs=tuple(replace(first, at_s=one.at_s * 2) for one in ridden.epochs))


def _standing(rng: Random, ridden: Ride) -> Ride:
    first, speed = ridden.epochs[0], rng.uniform(1.5, 12)
    later = (replace(one, at_s=one.at_s * 2, time=(one.time or 0) + one.at_s) for one in ridden.epochs)
    held = replace(ridden, epochs=tuple(later))
    return _all(held, latitude=first.latitude, longitude=first.longitude, speed_m_s=speed)


def _paced(rng: Random, ridden: Ride) -> Ride:
    # What it moves away from our clock within the tolerance of both is no lie.
    least = 1 + 14 / (ridden.epochs[-1].at_s - ridden.epochs[0].at_s)
    pace, began = max(least, rng.uniform(8, 40)), ridden.epochs[0].time or 0
    middle = ridden.epochs[len(ridden.epochs) // 2].at_s
    epochs = (replace(one, time=round(began + middle + pace * (one.at_s - middle), 1)) for one in ridden.epochs)
    return replace(ridden, epochs=tuple(epochs))


def _looped(rng: Random, ridden: Ride) -> Ride:
    size = rng.randrange(3, 6)
    once = [ridden.epochs[number % size] for number in range(3 * size)]
    gap = ridden.epochs[1].at_s - ridden.epochs[0].at_s
    # A loop shorter than half a second is no loop but rounding.
    epochs = tuple(
        replace(one, at_s=0.1 + number * max(gap, 0.5), time=(ridden.epochs[0].time or 0) + (number % size) * 0.5)
        for number, one in enumerate(once)
    )
    return replace(ridden, epochs=epochs)


def _lost(rng: Random, ridden: Ride) -> Ride:
    at = rng.randrange(1, len(ridden.epochs) - 1)
    kept = ridden.epochs[:at]
    return replace(ridden, epochs=(*kept, *(replace(one, quality=0, used=0) for one in ridden.epochs[at:])))


def _second(rng: Random, ridden: Ride) -> Ride:
    return replace(ridden, other=_moved(ridden, *_aside(rng, ridden)))


def _swapped(ridden: Ride) -> Ride:
    epochs = (replace(one, latitude=one.longitude, longitude=one.latitude) for one in ridden.epochs)
    return replace(ridden, epochs=tuple(epochs))


def _sign(rng: Random, ridden: Ride) -> Ride:
    name = rng.choice(("latitude", "longitude"))
    if abs(getattr(ridden.epochs[0], name)) < 0.1:
        name = "latitude"
    return replace(ridden, epochs=tuple(replace(one, **{name: -getattr(one, name)}) for one in ridden.epochs))


def _some(rng: Random, ridden: Ride, **changes: Any) -> Ride:  # noqa: ANN401 - fields of an epoch
    """One of the last five, or all of them."""
    odd = rng.randrange(len(ridden.epochs) - 5, len(ridden.epochs))
    every = rng.random() < 0.5
    return replace(
        ridden,
        epochs=tuple(
            replace(one, **changes) if every or number == odd else one for number, one in enumerate(ridden.epochs)
        ),
    )


RIDES: Mapping[str, tuple[frozenset[str], Callable[[Random, Ride], Ride]]] = {
    "frozen": (frozenset({"time"}), _frozen),
    "position frozen, speed goes on": (frozenset({"speed"}), _standing),
    "stopped": (frozenset(), lambda rng, one: replace(one, ended_s=one.epochs[-1].at_s + rng.uniform(4, 11))),
    "replayed, seconds": (frozenset({"time"}), lambda rng, one: _shifted(one, -rng.uniform(8, 120))),
    "replayed, hours": (frozenset({"time"}), lambda rng, one: _shifted(one, -rng.uniform(3600, 40_000))),
    "replayed, days": (
        frozenset({"time", "date"}),
        lambda rng, one: _shifted(one, -DAY_S * rng.randrange(1, 900) - rng.choice((0.0, rng.uniform(0, DAY_S)))),
    ),
    "replayed, a whole hour": (frozenset({"time"}), lambda rng, one: _shifted(one, -3600.0 * rng.randrange(1, 11))),
    "week rolled over": (frozenset({"date"}), lambda rng, one: _shifted(one, -1024 * 7 * DAY_S * rng.randrange(1, 3))),
    "future": (frozenset({"time"}), lambda rng, one: _shifted(one, rng.uniform(8, 40_000))),
    "replayed, another pace": (frozenset({"time"}), _paced),
    "replayed, in a loop": (frozenset({"time"}), _looped),
    "without a time": (frozenset({"time"}), lambda _, one: _all(one, time=None)),
    "foreign place": (frozenset(), lambda rng, one: _moved(one, *_aside(rng, one))),
    "foreign place now and then": (frozenset(), lambda rng, one: _moved(one, *_aside(rng, one), every=2)),
    "swapped": (frozenset(), lambda _, one: _swapped(one)),
    "sign lost": (frozenset(), _sign),
    "zeros": (frozenset(), lambda _, one: _all(one, latitude=0.0, longitude=0.0)),
    "simulated": (frozenset({"nature"}), lambda rng, one: _some(rng, one, quality=8)),
    "typed in": (frozenset({"nature"}), lambda rng, one: _some(rng, one, quality=7)),
    "no satellites": (
        frozenset({"count"}),
        lambda rng, one: _all(one, used=rng.randrange(3) if one.style not in VERSIONS else 0),
    ),
    "no fix": (frozenset(), lambda _, one: _all(one, quality=0, used=0)),
    "fix lost": (frozenset(), _lost),
    "void against fix": (frozenset({"void"}), lambda _, one: _all(one, void=True)),
    "error wider than the site": (
        frozenset({"count"}),
        lambda rng, one: _all(one, hdop=rng.choice((120.0, 99.99 * 2))),
    ),
    "two dimensions in the air": (
        frozenset({"dimensions"}),
        lambda _, one: replace(_all(one, dimensions=2), flies=True),
    ),
    "half-answered": (frozenset(), lambda rng, one: replace(one, cut=rng.randrange(3))),
    "two receivers": (frozenset({"sources"}), _second),
}
"""What a lie needs of a receiver's way to speak, and the lie."""


def _spoilt(rng: Random, heard: Stream) -> Stream:
    """Most lines lose their end, as by a bad cable."""
    spoilt = []
    for at_s, data in heard.chunks:
        lines = data.splitlines(keepends=True)
        for number, line in enumerate(lines):
            if rng.random() < 0.85 and len(line) > 12:
                place = rng.randrange(2, len(line) - 8)
                lines[number] = line[:place] + b"\r\n"
        spoilt.append((at_s, b"".join(lines)))
    return replace(heard, chunks=tuple(spoilt))


FOREIGN = (
    b"SSH-2.0-OpenSSH_9.2p1\r\n",
    b"HTTP/1.0 400 Bad Request\r\nContent-Length: 0\r\n\r\n",
    b"+++AT?S:23:INITIATION LISTEN 16384\r\n",
    b"$3A3B5373\r\n",
    b'{"class":"HELLO"}\n',
    bytes(range(128, 256)) + b"\n",
    b"!AIVDM,1,1,,A,14eG;o@034o8sd<L9i:a;WF>062D,0*7D\r\n",
    b"",
)
TROUBLES = ("refused", "silent", "unreachable", "busy", "denied", "closed", "no place")


def _foreign(rng: Random, heard: Stream) -> Stream:
    said = rng.choice(FOREIGN)
    return replace(heard, chunks=tuple((0.1 * number, said) for number in range(1, 12) if said), ended_s=LISTENED_S)


def _unheard(rng: Random, heard: Stream) -> Stream:
    return replace(heard, chunks=(), trouble=rng.choice(TROUBLES), words="in the system's words", ended_s=0.1)


STREAMS: Mapping[str, Callable[[Random, Stream], Stream]] = {
    "damaged": _spoilt,
    "another service": _foreign,
    "` received at": _unheard,
}
"""Lies that need no receiver."""


def row(ridden: Ride) -> dict[str, str]:
    """A ride as a RouterOS device tells its last moment."""
    last = ridden.epochs[-1]
    told = {"valid": "no" if not last.quality or last.void else "yes", "satellites": str(last.used)}
    if last.time is not None:
        told["date-and-time"] = f"{datetime.fromtimestamp(last.time, UTC):%Y-%m-%d %H:%M:%S}"
    fixed = last.quality and not last.void
    told |= {"latitude": f"{last.latitude:.6f}" if fixed else "none"}
    told |= {"longitude": f"{last.longitude:.6f}" if fixed else "none"}
    told |= {"fix-quality": str(last.quality), "horizontal-dilution": f"{last.hdop:.1f}"}
    if last.dimensions == 3:
        told["altitude"] = "5.000000 m"
    age_s = max(0.0, (ridden.ended_s or last.at_s) - last.at_s)
    return {**told, "data-age": f"{age_s:.0f}s"}


ROUTEROS_TELLS = frozenset({"date", "count", "nature", "dimensions", "time", "void"})
NO_STREAM = frozenset(
    {
        *("frozen", "position frozen, speed goes on", "replayed, another pace", "replayed, in a loop", "half-answered"),
        *("two receivers", "foreign place now and then", "fix lost"),
    }
)
"""Lies that need more than one report."""


# Acoustic modems.


@dataclass(frozen=True)
class Sound:
    """One fix of a USBL."""

    at_s: float
    clock_s: float
    measured_s: float
    remote: int
    position: tuple[float, float, float]
    range_m: float
    rssi: int = -54
    integrity: int = 130
    accuracy: float = 0.05
    to: int = 0
    """SeaTrac: for whom the answer is."""
    suspect: bool = False
    flags: int = 0b111
    yaw: int = 0


@dataclass(frozen=True)
class Modem:
    language: str
    """`evologics` or `seatrac`."""
    own: int
    began: float
    fixes: tuple[Sound, ...]
    ended_s: float
    answers: Mapping[str, Any] = field(default_factory=dict)
    """What its own words would be otherwise."""
    without: frozenset[str] = frozenset()
    """Questions that it does not answer."""
    extra: bytes = b""
    """In front of all answers."""
    framed: bool = True
    damaged: bool = False
    at_once: bool = False
    response: int = 0x42


def modem(rng: Random, language: str, own: int, remote: int) -> Modem:
    """A true one: the other modem moves some metres between fixes that come every few seconds."""
    began = rng.uniform(1.80e9, 2.05e9)
    base = began if rng.random() < 0.3 else rng.uniform(20.0, 9e5)
    far, bearing, every_s = rng.uniform(2, 700), rng.uniform(0, 6.28), rng.uniform(1.2, 4.0)
    fixes = []
    for number in range(rng.randrange(3, 8)):
        at_s = 0.5 + number * every_s + rng.uniform(0, 0.2)
        away = far + rng.gauss(0, 0.01 * far)
        angle = bearing + rng.gauss(0, 0.02)
        down = rng.uniform(0, 0.3) * away
        flat = math.sqrt(away * away - down * down)
        position = (flat * math.cos(angle), flat * math.sin(angle), down)
        clock_s = base + at_s
        fixes.append(
            Sound(
                at_s,
                clock_s,
                clock_s - rng.uniform(0.05, 1.0),
                remote,
                position,
                away * rng.uniform(0.99, 1.01),
                rng.randrange(-80, -25),
                rng.randrange(101, 200),
                rng.uniform(0.001, 0.2),
                to=own if rng.random() < 0.9 else 0,
                yaw=rng.randrange(3600),
            )
        )
    ended_s = fixes[-1].at_s + rng.uniform(0.1, 5.0)
    response = 0x52 if rng.random() < 0.4 else 0x42
    return Modem(language, own, began, tuple(fixes), ended_s, framed=rng.random() < 0.7, response=response)


def _framed(command: str, body: bytes) -> bytes:
    return b"+++%b:%d:%b\r\n" % (command.encode(), len(body), body)


_LISTING = (
    "Source Level: 3\r\nSource Level Control: 0\r\nGain: 0\r\nCarrier Waveform ID: {carrier}\r\n"
    "Local Address: {own}\r\nHighest Address: {highest}\r\nCluster Size: 10\r\n"
    "Packet Time: 750\r\nRetry Count: 3\r\nRetry Timeout: 1500\r\n"
    "Wake Up Active Time: 12\r\nWake Up Period: 12\r\nPromiscuous Mode: 1\r\nSound Speed: {sound}\r\n"
    "IM Retry Count: 1\r\nPool Size: 16384\r\nHold Timeout: 0\r\nIdle Timeout: 120\r\n"
)


def _at_answers(one: Modem) -> bytes:
    told = {
        "own": one.own,
        "highest": 14,
        "carrier": 2,
        "sound": 1500,
        "state": "INITIATION LISTEN 16384",
        **one.answers,
    }
    answers = {
        "AT?S": told["state"],
        "AT&V": _LISTING.format(**told),
        "AT?AL": str(told.get("queried", told["own"])),
        "AT?L": "3",
        "AT?ZU": "1",
        "AT?E": "-54",
        "AT?I": "146",
        "AT?T": "9377",
        "ATI0": "EXAMPLE",
        "ATI1": "EXAMPLE",
        "AT?BV": "24.1",
    }
    return b"".join(_framed(name, text.encode()) for name, text in answers.items() if name not in one.without)


def _at_fix(one: Modem, fix: Sound) -> bytes:
    x, y, z = fix.position
    place = f"{x:.4f},{y:.4f},{z:.4f}"
    text = (
        f"USBLLONG,{fix.clock_s:.6f},{fix.measured_s:.6f},{fix.remote},{place},{place},0.0000,-0.0000,0.0000,"
        f"{fix.range_m / 1500 * 1e6:.0f},{fix.rssi},{fix.integrity},{fix.accuracy:.4f}"
    )
    return _framed("AT", text.encode()) if one.framed else text.encode() + b"\r\n"


def crc(payload: bytes) -> bytes:
    """CRC-16/ARC by its definition: the polynomial 0x8005, bits the other way round."""
    value = 0
    for byte in payload:
        for bit in range(8):
            odd = (value ^ (byte >> bit)) & 1
            value = (value >> 1) ^ (0xA001 if odd else 0)
    return struct.pack("<H", value)


def _hex(number: int, record: bytes, *, damaged: bool = False) -> bytes:
    payload = bytes([number]) + record
    check = crc(payload)
    return b"$" + (payload + (bytes(b ^ 0x5A for b in check) if damaged else check)).hex().upper().encode() + b"\r\n"


def _beacon_answers(one: Modem) -> bytes:
    told = {"own": one.own, "sound": 1500.0, "state": 0x3B, **one.answers}
    settings = bytearray(110)
    settings[1], settings[28], settings[96] = 1, 1, told["own"]
    struct.pack_into("<H", settings, 35, round(told["sound"] * 10))
    status = struct.pack("<BQHhiiH", 1, 123_456, 15_200, 152, 1013, 12, round(told["sound"] * 10))
    firmware = struct.pack("<?HBBHI", True, 795, 2, 2, 1000, 0)
    info = struct.pack("<IBHBIHH", 123_456, 1, 795, 1, 7, 0, 0) + firmware + firmware
    answers = {
        "alive": (0x01, struct.pack("<I", 123_456)),
        "info": (0x02, info),
        "settings": (0x15, bytes(settings)),
        "status": (0x10, status),
        "transceiver": (0x3A, bytes([told["state"]])),
    }
    kept = (pair for name, pair in answers.items() if name not in one.without)
    return b"".join(_hex(number, record, damaged=one.damaged) for number, record in kept)


def _beacon_fix(one: Modem, fix: Sound) -> bytes:
    flags = fix.flags | (0b10000 if fix.suspect else 0)
    own_depth = 12
    record = struct.pack("<BBBBhhhHHh", fix.to, fix.remote, flags, 5, fix.yaw, 0, 0, own_depth, 15_000, 900)
    if flags & 1:
        seconds = fix.range_m / 1500
        record += struct.pack("<IiH", round(seconds * 32_000), round(seconds * 1e7), round(fix.range_m * 10))
    if flags & 2:
        record += struct.pack("<B4hhhh", 4, 900, 900, 900, 900, 130, -70, 40)
    if flags & 4:
        east, north, down = (round(part * 10) for part in fix.position)
        record += struct.pack("<hhh", *(max(-32_768, min(32_767, part)) for part in (east, north, down + own_depth)))
    return _hex(one.response, record + (b"\x00\x01" if one.response == 0x52 else b""), damaged=one.damaged)


def spoken(one: Modem) -> Stream:
    answers = _at_answers(one) if one.language == "evologics" else _beacon_answers(one)
    told = _at_fix if one.language == "evologics" else _beacon_fix
    chunks = [(0.1, one.extra + answers), *((fix.at_s, told(one, fix)) for fix in one.fixes)]
    if one.at_once:
        chunks = [(0.1, b"".join(data for _, data in chunks))]
    return Stream(tuple(chunk for chunk in chunks if chunk[1]), one.began, one.ended_s)


def _each(one: Modem, **changes: Any) -> Modem:  # noqa: ANN401 - fields of a fix
    return replace(one, fixes=tuple(replace(fix, **changes) for fix in one.fixes))


def _delayed(one: Modem, seconds: float) -> Modem:
    return replace(one, fixes=tuple(replace(fix, measured_s=fix.clock_s - seconds) for fix in one.fixes))


def _repeated(rng: Random, one: Modem) -> Modem:
    first = one.fixes[0]
    fixes = tuple(replace(first, at_s=fix.at_s) for fix in one.fixes)
    return replace(one, fixes=fixes[: rng.randrange(2, len(fixes) + 1)])


def _round(rng: Random, one: Modem) -> Modem:
    size = rng.randrange(2, len(one.fixes)) if len(one.fixes) > 2 else 2
    number = range(2 * size)
    step = one.fixes[1].at_s - one.fixes[0].at_s
    fixes = tuple(replace(one.fixes[at % size], at_s=0.5 + at * step) for at in number)
    return replace(one, fixes=fixes, ended_s=fixes[-1].at_s + 0.5)


def _ended(rng: Random, one: Modem) -> Modem:
    return replace(one, ended_s=one.fixes[-1].at_s + rng.uniform(11.5, 60))


def _far(rng: Random, one: Modem) -> Modem:
    away = rng.uniform(2100, 6000) if one.language == "evologics" else rng.uniform(2050, 3000)
    return _each(one, range_m=away, position=(away * 0.6, away * 0.8, 0.0))


def _elsewhere(rng: Random, one: Modem) -> Modem:
    factor = rng.choice((0.1, 0.3, 2.5, 6.0))
    fixes = (
        replace(fix, position=(fix.position[0] * factor, fix.position[1] * factor, fix.position[2] * factor))
        for fix in one.fixes
    )
    moved = replace(one, fixes=tuple(fixes))
    least = min(abs(math.hypot(*fix.position) - fix.range_m) for fix in moved.fixes)
    return moved if least > 2.5 else _each(one, position=(90.0, 90.0, 0.0), range_m=5.0)


def _another_day(rng: Random, one: Modem) -> Modem:
    base = one.began - rng.uniform(60, 3e8)
    fixes = (replace(fix, clock_s=base + fix.at_s, measured_s=base + fix.at_s - 0.3) for fix in one.fixes)
    return replace(one, fixes=tuple(fixes))


EVOLOGICS, SEATRAC = frozenset({"evologics"}), frozenset({"seatrac"})
BOTH = EVOLOGICS | SEATRAC
FIXES: Mapping[str, tuple[frozenset[str], Callable[[Random, Modem], Modem]]] = {
    "one fix repeated": (BOTH, _repeated),
    "a log in a loop": (BOTH, _round),
    "ended": (BOTH, _ended),
    "measured long ago": (EVOLOGICS, lambda rng, one: _delayed(one, rng.choice((rng.uniform(12, 90), 8004.0)))),
    "measured in the future": (EVOLOGICS, lambda rng, one: _delayed(one, -rng.uniform(1, 5000))),
    "a log of another day": (EVOLOGICS, _another_day),
    "delayed fixes arrive all at once": (
        EVOLOGICS,
        lambda _, one: replace(one, at_once=True, fixes=tuple(_stretched(one.fixes)), ended_s=1.0),
    ),
    "zeros": (BOTH, lambda _, one: _each(one, range_m=0.0, position=(0.0, 0.0, 0.0))),
    "a range of nothing": (BOTH, lambda _, one: _each(one, range_m=0.0)),
    "a position of nothing": (BOTH, lambda _, one: _each(one, position=(0.0, 0.0, 0.0))),
    "kilometres away": (BOTH, _far),
    "a position that the sound's time denies": (BOTH, _elsewhere),
    "absurd accuracy": (EVOLOGICS, lambda rng, one: _each(one, accuracy=rng.choice((-1.0, 9.0, 99.0, 1e6)))),
    "integrity of nothing": (EVOLOGICS, lambda rng, one: _each(one, integrity=rng.choice((0, -5)))),
    "signal of nothing": (EVOLOGICS, lambda rng, one: _each(one, rssi=rng.choice((0, 30, -999)))),
    "of a foreign modem": (BOTH, lambda rng, one: _each(one, remote=rng.choice((5, 9, 13)))),
    "of itself": (BOTH, lambda _, one: _each(one, remote=one.own)),
    "somebody else's modem": (
        BOTH,
        lambda rng, one: replace(_each(one, to=0), answers={"own": rng.choice((5, 9, 13))}),
    ),
    "for another beacon": (SEATRAC, lambda rng, one: _each(one, to=rng.choice((5, 9, 13)))),
    "not trusted": (SEATRAC, lambda _, one: _each(one, suspect=True)),
    "nothing valid": (SEATRAC, lambda _, one: _each(one, flags=0)),
    "wrong sums": (SEATRAC, lambda _, one: replace(one, damaged=True)),
    "nobody pings": (BOTH, lambda _, one: replace(one, fixes=())),
    "half of the fields": (EVOLOGICS, lambda _, one: replace(one, fixes=(), extra=_cut(one))),
}


def _stretched(fixes: Sequence[Sound]) -> list[Sound]:
    first = fixes[0].clock_s
    return [replace(fix, clock_s=first + 6 * n, measured_s=first + 6 * n - 0.3) for n, fix in enumerate(fixes)]


def _cut(one: Modem) -> bytes:
    return b"".join(_at_fix(replace(one, framed=False), fix).rpartition(b",")[0] + b"\r\n" for fix in one.fixes)


_STATES = (
    *("OFFLINE READY", "OFFLINE ALARM", "OFFLINE TERMINATED", "OFFLINE CONNECTION FAILED", "NOISE"),
    *("DEAF", "ASLEEP 4"),
)
_EVERY = frozenset(
    {
        *("AT?S", "AT&V", "AT?AL", "AT?L", "AT?ZU", "AT?E", "AT?I", "AT?T", "ATI0", "ATI1", "AT?BV"),
        *("alive", "info", "settings", "status", "transceiver"),
    }
)
STATES: Mapping[str, tuple[frozenset[str], Callable[[Random, Modem], Modem]]] = {
    "another address": (BOTH, lambda rng, one: replace(one, answers={"own": rng.choice((3, 5, 9))})),
    "two modems, the right one last": (BOTH, lambda rng, one: replace(one, extra=_stranger(rng, one))),
    "address and listing differ": (
        EVOLOGICS,
        lambda rng, one: replace(one, answers={"queried": rng.choice((3, 5, 9))}),
    ),
    "no address": (EVOLOGICS, lambda _, one: replace(one, without=frozenset({"AT&V", "AT?AL"}))),
    "no state": (
        BOTH,
        lambda _, one: replace(one, without=frozenset({"AT?S"} if one.language == "evologics" else {"transceiver"})),
    ),
    "no settings": (SEATRAC, lambda _, one: replace(one, without=frozenset({"settings"}))),
    "a state in which nobody hears": (
        BOTH,
        lambda rng, one: replace(one, answers={"state": rng.choice(_STATES) if one.language == "evologics" else 0x3A}),
    ),
    "sound of air": (BOTH, lambda rng, one: replace(one, answers={"sound": rng.choice((340, 900, 2400))})),
    "beyond the highest address": (EVOLOGICS, lambda _, one: replace(one, answers={"highest": 0})),
    "busy": (EVOLOGICS, lambda _, one: replace(one, answers={"state": "BUSY EXAMPLE"})),
    "answers inside a message": (EVOLOGICS, lambda _, one: replace(one, without=_EVERY, extra=_inside(one))),
    "wrong sums": (SEATRAC, lambda _, one: replace(one, damaged=True)),
    "the other maker's language": (BOTH, lambda _, one: replace(one, without=_EVERY, fixes=(), extra=_other(one))),
}


def _stranger(rng: Random, one: Modem) -> bytes:
    other = replace(one, own=rng.choice((3, 5, 9)))
    return _at_answers(other) if one.language == "evologics" else _beacon_answers(other)


def _inside(one: Modem) -> bytes:
    body = b"RECVIM,9,1,2,ack,312,14,11,0.03,\r\n" + _at_answers(one) + b"\r\n"
    return _framed("AT", body)


def _other(one: Modem) -> bytes:
    return _beacon_answers(one) if one.language == "evologics" else _at_answers(one)
