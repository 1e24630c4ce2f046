"""What receivers say, made by hand: sentences with right checksums, gpsd's objects, one datum a second."""

import json
from collections.abc import Iterable
from datetime import UTC, datetime, timedelta
from typing import Any

from atlantis_netcfg.checklist.probes import Transcript
from atlantis_netcfg.checklist.probes.gps import GpsExpectation
from atlantis_netcfg.checklist.probes.gps.nmea import checksum
from atlantis_netcfg.inventory.model import Geofence, GpsDriver

NOW = datetime(2026, 11, 20, 10, 15, tzinfo=UTC)
"""When the listening begins."""
LATITUDE, LONGITUDE = 41.68642, -8.8388265
FENCE = Geofence(latitude=41.6864, longitude=-8.8388, radius_m=1000.0)

WANTED = {
    GpsDriver.GPSD: GpsExpectation(
        "Sparus", GpsDriver.GPSD, "gpsd at 10.64.1.22:2947", "10.64.1.22:2947", "coastal-gateway", FENCE
    ),
    GpsDriver.NMEA_TCP: GpsExpectation(
        "Girona 500", GpsDriver.NMEA_TCP, "NMEA from 10.64.1.21:10110", "10.64.1.21:10110", "coastal-gateway", FENCE
    ),
    GpsDriver.NMEA_SERIAL: GpsExpectation(
        "Zarco", GpsDriver.NMEA_SERIAL, "NMEA from /dev/ttyUSB0 of gw", "/dev/ttyUSB0 of gw", "gw", FENCE
    ),
}

Chunks = tuple[tuple[float, bytes], ...]


def heard(chunks: Iterable[tuple[float, bytes]], ended_s: float | None = None, **more: Any) -> Transcript:  # noqa: ANN401
    known = tuple(chunks)
    last = known[-1][0] if known else 15.0
    more.setdefault("trouble", None)
    return Transcript(chunks=known, began=NOW.timestamp(), ended_s=last + 0.1 if ended_s is None else ended_s, **more)


def bytewise(transcript: Transcript) -> Transcript:
    pieces = tuple((at, data[place : place + 1]) for at, data in transcript.chunks for place in range(len(data)))
    return Transcript(transcript.trouble, transcript.words, pieces, transcript.began, transcript.ended_s)


def whole(transcript: Transcript) -> Transcript:
    """All of it in one piece, when the last of it came."""
    if not transcript.chunks:
        return transcript
    pieces = ((transcript.chunks[-1][0], transcript.data),)
    return Transcript(transcript.trouble, transcript.words, pieces, transcript.began, transcript.ended_s)


def said(*objects: dict[str, Any]) -> bytes:
    return b"".join(json.dumps(one, separators=(",", ":")).encode() + b"\r\n" for one in objects)


PATH = "/dev/ttyACM0"
VERSION = {"class": "VERSION", "release": "3.22", "rev": "3.22", "proto_major": 3, "proto_minor": 14}
WATCH = {"class": "WATCH", "enable": True, "json": True, "nmea": False, "raw": 0, "scaled": False}
DEVICE = {"class": "DEVICE", "path": PATH, "driver": "NMEA0183", "activated": "2026-11-20T10:14:00.000Z"}
SKY = {"class": "SKY", "device": PATH, "hdop": 0.9, "nSat": 11, "uSat": 9}


def greeting(*devices: dict[str, Any]) -> bytes:
    return said(VERSION, {"class": "DEVICES", "devices": list(devices)}, WATCH)


def tpv(second: float, **other: Any) -> dict[str, Any]:  # noqa: ANN401
    """A report of gpsd 3.22; None leaves a field out."""
    time = (NOW + timedelta(seconds=second)).strftime("%Y-%m-%dT%H:%M:%S.%f")[:-3] + "Z"
    fields = {"class": "TPV", "device": PATH, "mode": 3, "time": time, "lat": LATITUDE, "lon": LONGITUDE, "eph": 17.1}
    return {name: value for name, value in {**fields, **other}.items() if value is not None}


NO_FIX = {"class": "TPV", "device": PATH, "mode": 1}


def gpsd(*reports: dict[str, Any], sky: dict[str, Any] | None = SKY, every_s: float = 1.0) -> Chunks:
    """A session: greeting, then a report a second; the receiver's second is 0.2 s older than its arrival."""
    extra = said(sky) if sky else b""
    return ((0.05, greeting(DEVICE)), *((0.2 + at * every_s, said(one) + extra) for at, one in enumerate(reports)))


def fixes(count: int = 5, **other: Any) -> list[dict[str, Any]]:  # noqa: ANN401
    return [tpv(second, **other) for second in range(count)]


def framed(body: str) -> bytes:
    return f"${body}*{checksum(body.encode()):02X}\r\n".encode()


def clock(second: float, of: str = "%H%M%S") -> str:
    return (NOW + timedelta(seconds=second)).strftime(of)


PLACE = "4141.18520,N,00850.32959,W"
NOWHERE = ",,,"


def gga(  # noqa: PLR0913, PLR0917 - fields of a sentence
    second: float, place: str = PLACE, quality: int = 1, hdop: float = 0.9, talker: str = "GP", used: str = "09"
) -> bytes:
    used, height = (used, "5.0,M,54.0,M,,") if quality else ("00", ",,,,,")
    return framed(f"{talker}GGA,{clock(second)}.00,{place},{quality},{used},{hdop},{height}")


def rmc(  # noqa: PLR0913, PLR0917 - fields of a sentence
    second: float, place: str = PLACE, status: str = "A", mode: str = "A", talker: str = "GP", knots: float = 0.05
) -> bytes:
    date = clock(second, "%d%m%y")
    return framed(f"{talker}RMC,{clock(second)}.00,{status},{place},{knots},10.0,{date},,,{mode}")


def gll(second: float, place: str = PLACE, status: str = "A", mode: str = "A") -> bytes:
    return framed(f"GPGLL,{place},{clock(second)}.00,{status},{mode}")


def gns(second: float, modes: str = "AA", used: str = "14") -> bytes:
    return framed(f"GNGNS,{clock(second)}.00,{PLACE},{modes},{used},0.6,5.0,54.0,,,V")


def tagged(lines: bytes, tag: str = "s:GP0001,c:1795169700") -> bytes:
    """The lines as a ship's multiplexer passes them on."""
    block = f"\\{tag}*{checksum(tag.encode()):02X}\\".encode()
    return b"".join(block + line + b"\n" for line in lines.splitlines())


def gsa(mode: int = 3, talker: str = "GP") -> bytes:
    used = "01,02,03,04,05,06,07,08,09,,," if mode > 1 else ",,,,,,,,,,,"
    return framed(f"{talker}GSA,A,{mode},{used},1.6,0.9,1.3")


def epoch(second: float, place: str = PLACE, quality: int = 1, mode: str = "A", dimensions: int = 3) -> bytes:
    return gga(second, place, quality) + rmc(second, place, "A", mode) + gsa(dimensions)


def no_fix(second: float) -> bytes:
    return gga(second, NOWHERE, 0, 99.99) + rmc(second, NOWHERE, "V", "N") + gsa(1)


def nmea(*epochs: bytes, every_s: float = 1.0) -> Chunks:
    """The stream from the middle of a sentence on; an epoch comes 0.2 s after its second."""
    return ((0.02, b"1.6,0.9,1.3*3F\r\n"), *((0.2 + at * every_s, one) for at, one in enumerate(epochs)))
