"""What every source of positions is reduced to, whatever it speaks."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import StrEnum

__all__ = ["DAY_S", "Nature", "Reception", "Report", "at_day", "median"]

DAY_S = 86_400.0


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
    device: str = ""
    version: str = ""
    satellites: int | None = None
    hdop: float | None = None
    single: bool = False
    """The source tells its latest position and no stream of them."""
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
        return sum(one.fixed and not then.fixed for one, then in zip(self.reports, self.reports[1:], strict=False))

    @property
    def clock_ahead_s(self) -> float | None:
        """How far the receiver's time is ahead of the listening clock; None: nobody knows."""
        if not self.began:
            return None
        dated = [one.time - self.began - one.at_s for one in self.fixes if one.time is not None]
        if dated:
            return median(dated)
        undated = [at_day(one.of_day - self.began - one.at_s) for one in self.fixes if one.of_day is not None]
        return median(undated) if undated else None


def at_day(seconds: float) -> float:
    """A difference of two times of day: at most twelve hours, either way."""
    return (seconds + DAY_S / 2) % DAY_S - DAY_S / 2


def median(values: list[float]) -> float:
    """The middle one, of an even number the upper of the two."""
    return sorted(values)[len(values) // 2]
