"""The reports of an emulated receiver, as gpsd 3.22 tells them and as NMEA sentences."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import reduce
from operator import xor
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.emulator.gnss.spec import Speech

if TYPE_CHECKING:
    from collections.abc import Callable

    from atlantis_netcfg.emulator.gnss.spec import GnssSpec

__all__ = ["PATH", "Source", "line", "said"]

PATH = "/dev/ttyACM0"
"""The receiver's port, as gpsd names it."""
_METER = 1 / 111_195.0
"""In degrees of latitude."""
_GARBAGE = bytes((0xE0 + 7 * place % 32) for place in range(64))
_QUALITY = {None: 1, 2: 2, 3: 4, 4: 5, 5: 6, 6: 1, 7: 7, 8: 8}
_INDICATOR = {None: "A", 2: "D", 3: "R", 4: "F", 5: "E", 6: "A", 7: "M", 8: "S"}
"""gpsd's status to the quality of GGA and the mode indicator of RMC."""


def said(*objects: dict[str, Any]) -> bytes:
    """Objects as gpsd ends them."""
    return b"".join(json.dumps(one, separators=(",", ":")).encode() + b"\r\n" for one in objects)


def line(body: str) -> bytes:
    """A sentence with its checksum."""
    return f"${body}*{reduce(xor, body.encode(), 0):02X}\r\n".encode()


@dataclass
class Source:
    """What one client hears, report by report."""

    spec: GnssSpec
    now: Callable[[], float] = time.time
    told: int = 0
    _first: float = field(init=False)

    def __post_init__(self) -> None:
        """Remember the time that a stale receiver repeats."""
        self._first = self.now()

    @property
    def speaks(self) -> bool:
        """Whether another report comes at all."""
        over = self.spec.silent_after is not None and self.told >= self.spec.silent_after
        return self.spec.speech is not Speech.NOTHING and not over

    @property
    def _fixed(self) -> bool:
        lost = self.spec.lost_after is not None and self.told >= self.spec.lost_after
        return self.spec.mode > 1 and not lost

    @property
    def _time(self) -> datetime:
        seconds = self._first if self.spec.stale else self.now()
        return datetime.fromtimestamp(seconds + self.spec.time_offset_s, UTC)

    @property
    def _place(self) -> tuple[float, float]:
        spec = self.spec
        latitude = spec.latitude + (spec.jumping_m * _METER if self.told % 2 else 0.0)
        place = (spec.longitude, latitude) if spec.swapped else (latitude, spec.longitude)
        return (0.0, 0.0) if spec.null else place

    def next(self, *, objects: bool = False, sentences: bool = False) -> bytes:
        """The next report: as gpsd's JSON, as NMEA sentences, or as both."""
        whole = self._sentences() if sentences else b""
        whole += self._tpv() + self._sky() if objects else b""
        self.told += 1
        if self.spec.speech is Speech.GARBAGE:
            return _GARBAGE
        damaged = self.spec.damaged and not self.told % self.spec.damaged
        return whole.replace(b'"mode":', b'"mode"', 1).replace(b"A,", b"A;", 1) if damaged else whole

    def _tpv(self) -> bytes:
        spec, (latitude, longitude) = self.spec, self._place
        if not self._fixed:
            return said({"class": "TPV", "device": PATH, "mode": 1})
        report: dict[str, Any] = {"class": "TPV", "device": PATH}
        if spec.status is not None:
            report["status"] = spec.status
        report["mode"] = spec.mode
        if spec.timed:
            report |= {"time": f"{self._time:%Y-%m-%dT%H:%M:%S.%f}"[:-3] + "Z", "ept": 0.005}
        report |= {"lat": round(latitude, 9), "lon": round(longitude, 9)}
        if spec.mode > 2:  # noqa: PLR2004 - 3D
            report |= {"altHAE": 59.0, "altMSL": 5.0, "alt": 5.0, "epv": 29.9}
        return said({**report, "track": 10.0, "speed": 0.026, "eph": spec.eph_m})

    def _sky(self) -> bytes:
        spec = self.spec
        used = spec.satellites if self._fixed else 0
        seen = [{"PRN": one, "el": 40.0, "az": 30.0, "ss": 41.0, "used": one <= used} for one in range(1, used + 3)]
        dop = {"hdop": spec.hdop} if self._fixed else {}
        return said({"class": "SKY", "device": PATH, **dop, "nSat": len(seen), "uSat": used, "satellites": seen})

    def _sentences(self) -> bytes:
        spec, at = self.spec, self._time
        of_day = f"{at:%H%M%S.%f}"[:-4]
        date = f"{at:%d%m%y}"
        if not self._fixed:
            gga, gsa = f"GPGGA,{of_day},,,,,0,00,99.99,,,,,,", "GPGSA,A,1,,,,,,,,,,,,,99.99,99.99,99.99"
            return line(gga) + (line(f"GPRMC,{of_day},V,,,,,,,{date},,,N") if spec.timed else b"") + line(gsa)
        place = _degrees(*self._place)
        height = "5.0,M,54.0,M,," if spec.mode > 2 else ",M,,M,,"  # noqa: PLR2004 - 3D
        gga = f"GPGGA,{of_day},{place},{_QUALITY[spec.status]},{spec.satellites:02},{spec.hdop:.1f},{height}"
        rmc = f"GPRMC,{of_day},A,{place},0.05,10.0,{date},,,{_INDICATOR[spec.status]}"
        used = ",".join([f"{one:02}" for one in range(1, min(spec.satellites, 12) + 1)])
        gsa = f"GPGSA,A,{spec.mode},{used}{',' * (12 - min(spec.satellites, 12))},1.6,{spec.hdop:.1f},1.3"
        return line(gga) + (line(rmc) if spec.timed else b"") + line(gsa)


def _degrees(latitude: float, longitude: float) -> str:
    north, east = "N" if latitude >= 0 else "S", "E" if longitude >= 0 else "W"
    return f"{_minutes(latitude, 2)},{north},{_minutes(longitude, 3)},{east}"


def _minutes(degrees: float, digits: int) -> str:
    hundred_thousandths = round(abs(degrees) * 60 * 100_000)
    whole, minutes = divmod(hundred_thousandths, 60 * 100_000)
    return f"{whole:0{digits}}{minutes / 100_000:08.5f}"
