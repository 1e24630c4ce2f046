"""What every source of positions is reduced to, whatever it speaks, and what is expected of it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.checklist.probes.results import Transcript
    from atlantis_netcfg.declaration.model import Geofence, GpsDriver

__all__ = ["DAY_S", "Nature", "Reception", "Report", "Wanted", "at_day", "lines", "median"]

DAY_S = 86_400.0


@dataclass(frozen=True, slots=True)
class Wanted:
    """What is expected of one endpoint, and how it is called in sentences."""

    name: str
    """Of the row: `Sparus`."""
    driver: GpsDriver
    source: str
    """`gpsd at 10.64.1.22:2947`."""
    end: str
    """What is connected to: `10.64.1.22:2947`, `/dev/ttyUSB0 of coastal-gateway`."""
    place: str
    """Who listens: `coastal-gateway`, `this computer`."""
    fence: Geofence | None
    three: bool = False
    """Two dimensions are not enough: it flies."""
    clear_sky: bool = True
    reports: int = 5
    max_age_s: float = 3.0


class Nature(StrEnum):
    """How a position came about, as far as it is told."""

    MEASURED = "measured"
    DEAD_RECKONING = "dead reckoning"
    """Worked out from heading and speed (gpsd status 5, GGA quality 6, mode indicator E)."""
    MANUAL = "set by hand"
    """Typed in or surveyed, not measured (gpsd status 7, GGA quality 7, mode indicator M)."""
    SIMULATED = "simulated"
    """gpsd status 8, GGA quality 8, mode indicator S."""


@dataclass(frozen=True, slots=True)
class Report:
    """One position, or the word that there is none."""

    at_s: float
    """When it came, seconds since the listening began."""
    mode: int | None = None
    """1 no fix, 2 and 3 the fix's dimensions (gpsd's words, and those of GSA); None: not told."""
    latitude: float | None = None
    longitude: float | None = None
    """Decimal degrees, north and east positive."""
    time: float | None = None
    """Of the position by the receiver, seconds since 1970; None: not told, or without its date."""
    of_day: float | None = None
    """Seconds since midnight UTC, where there is a time without a date."""
    nature: Nature = Nature.MEASURED
    eph_m: float | None = None
    """Estimated horizontal error: gpsd works it out from the geometry, so it compares, and does not measure."""
    speed_m_s: float | None = None
    """Over ground."""

    @property
    def fixed(self) -> bool:
        """Whether the receiver claims a fix."""
        return self.mode is not None and self.mode >= 2  # noqa: PLR2004 - 2D

    @property
    def possible(self) -> bool:
        """Whether the position is one on this planet."""
        return (
            self.latitude is not None
            and self.longitude is not None
            and math.isfinite(self.latitude)
            and math.isfinite(self.longitude)
            and abs(self.latitude) <= 90  # noqa: PLR2004 - the poles
            and abs(self.longitude) <= 180  # noqa: PLR2004 - the date line
        )

    @property
    def stamp(self) -> float | None:
        """What of its time is told, to see whether it goes on."""
        return self.time if self.time is not None else self.of_day


@dataclass(frozen=True, slots=True)
class Reception:
    """All that was understood of what a source said."""

    reports: tuple[Report, ...] = ()
    """Of one receiver, in the order in which they came."""
    understood: bool = False
    """Whether anything of the source's language came at all."""
    heard_bytes: int = 0
    good: int = 0
    """Sentences or objects that were whole."""
    bad: int = 0
    """Those that were not: checksum, JSON."""
    devices: tuple[str, ...] | None = None
    """Receivers that gpsd has open; None: not told."""
    others: tuple[str, ...] = ()
    """Receivers whose reports were left aside."""
    rivals: tuple[Report, ...] = ()
    """The last fix of each of those that has one, and where one receiver tells two positions at a time, the other."""
    device: str = ""
    version: str = ""
    satellites: int | None = None
    """Used for the last fix."""
    hdop: float | None = None
    single: bool = False
    """The source tells its latest position and no stream of them."""
    zone_s: float = 0.0
    """By so much may its time be ahead of UTC: the source runs in a time zone, and may tell its time in it."""
    complaints: tuple[str, ...] = ()
    """Errors in the source's own words."""
    began: float = 0.0
    """Seconds since 1970 by the clock of the computer that listened; 0: not known."""
    ended_s: float = 0.0

    fixes: tuple[Report, ...] = field(init=False)
    """The fixes at the end that nothing interrupts."""

    def __post_init__(self) -> None:
        """Find them."""
        start = len(self.reports)
        while start and self.reports[start - 1].fixed:
            start -= 1
        object.__setattr__(self, "fixes", self.reports[start:])

    @property
    def losses(self) -> int:
        """How often a fix was followed by none."""
        return sum(
            report.fixed and not then.fixed for report, then in zip(self.reports, self.reports[1:], strict=False)
        )

    @property
    def clock_ahead_s(self) -> float | None:
        """How far the receiver's time is ahead of the listening clock; None: nobody knows."""
        return median(ahead) if (ahead := self._ahead_s()) else None

    @property
    def clock_uneven_s(self) -> float:
        """By how much that changes while we listen."""
        return max(ahead) - min(ahead) if (ahead := self._ahead_s()) else 0.0

    def _ahead_s(self) -> list[float]:
        if not self.began:
            return []
        dated = [report.time - self.began - report.at_s for report in self.fixes if report.time is not None]
        undated = [at_day(fix.of_day - self.began - fix.at_s) for fix in self.fixes if fix.of_day is not None]
        return dated or undated


def at_day(seconds: float) -> float:
    """A difference of two times of day: at most twelve hours, either way."""
    return (seconds + DAY_S / 2) % DAY_S - DAY_S / 2


def median(values: list[float]) -> float:
    """The middle one, of an even number the upper of the two."""
    return sorted(values)[len(values) // 2]


def lines(transcript: Transcript) -> Iterator[tuple[float, bytes]]:
    r"""Give whole lines without their end (`\n`, `\r\n`), each with the time at which it came; a cut one is not."""
    pieces: list[bytes] = []
    for at_s, data in transcript.chunks:
        first, *others = data.split(b"\n")
        pieces.append(first)
        for other in others:
            yield at_s, b"".join(pieces).rstrip(b"\r")
            pieces = [other]
