"""Emulated mobile coverage that depends on the position; it represents no real network.

Two masts on land; the level falls with the distance (log-distance model, exponent 3.5), the stronger one serves, and
quality, rate and delay follow from the level. Out of range there is no service. Not modelled: fading, waves, cell load,
hysteresis of cell changes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

_METRES: Final = 111_195.0
"""Metres for each degree of latitude."""
_REACH_DBM: Final = -120
_GOOD_DBM, _POOR_DBM = -85.0, -115.0
"""Between these levels the rate falls from 100 % to 5 %."""


@dataclass(frozen=True, slots=True)
class Mast:
    """Position of a cell's antenna; `level_dbm`: RSRP at a distance of 100 m."""

    cell_id: int
    latitude: float
    longitude: float
    level_dbm: float = -60.0


@dataclass(frozen=True, slots=True)
class PlaceTruth:
    """Radio conditions at a position, in whole numbers as units report; `rate_share`, `delay_factor`: of the best."""

    cell_id: int
    rsrp_dbm: int
    rsrq_db: int
    sinr_db: int
    rate_share: float
    delay_factor: float

    @property
    def has_service(self) -> bool:
        """Whether a unit has service."""
        return self.rsrp_dbm > _REACH_DBM


@dataclass(frozen=True, slots=True)
class Coverage:
    """An invented network."""

    masts: tuple[Mast, ...]

    def at(self, latitude: float, longitude: float) -> PlaceTruth:
        """Return the radio conditions at a position."""
        levels = sorted(
            ((_signal_level(mast, latitude, longitude), mast) for mast in self.masts), key=lambda pair: -pair[0]
        )
        best, serving = levels[0]
        other = levels[1][0] if len(levels) > 1 else -140.0
        rsrp = round(max(-139.0, min(-50.0, best)))
        sinr = round(max(-8.0, min(25.0, best - other, (best + 118.0) * 0.8)))
        share = max(0.05, min(1.0, (rsrp - _POOR_DBM) / (_GOOD_DBM - _POOR_DBM)))
        return PlaceTruth(serving.cell_id, rsrp, round(max(-18.0, min(-6.0, -14 + sinr / 3))), sinr, share, 2 - share)


def _signal_level(mast: Mast, latitude: float, longitude: float) -> float:
    north = (latitude - mast.latitude) * _METRES
    east = (longitude - mast.longitude) * _METRES * math.cos(math.radians(mast.latitude))
    return mast.level_dbm - 35.0 * math.log10(max(100.0, math.hypot(north, east)) / 100.0)


def two_masts(latitude: float, longitude: float) -> Coverage:
    """Return a network around a position: one mast 1 km east, and one 3 km north."""
    degree = 1000.0 / _METRES
    east = degree / math.cos(math.radians(latitude))
    return Coverage((Mast(3103242, latitude, longitude + east), Mast(3103499, latitude + 3 * degree, longitude)))


@dataclass(frozen=True, slots=True)
class Track:
    """A voyage at constant speed along positions, back and forth."""

    places: tuple[tuple[float, float], ...]
    """Latitude and longitude of each position."""
    speed_m_s: float = 3.0

    def at(self, seconds: float) -> tuple[float, float]:
        """Return the vessel's position after some seconds."""
        legs = list(zip(self.places, self.places[1:], strict=False))
        way = seconds * self.speed_m_s
        for begin, end in (*legs, *((end, begin) for begin, end in reversed(legs))):
            length = _distance_m(begin, end)
            if way <= length:
                share = way / length if length else 0.0
                return tuple(a + (b - a) * share for a, b in zip(begin, end, strict=True))  # type: ignore[return-value]
            way -= length
        return self.at(way / self.speed_m_s) if any(_distance_m(*leg) for leg in legs) else self.places[0]


def _distance_m(begin: tuple[float, float], end: tuple[float, float]) -> float:
    north = (end[0] - begin[0]) * _METRES
    return math.hypot(north, (end[1] - begin[1]) * _METRES * math.cos(math.radians(begin[0])))


def out_and_back(latitude: float, longitude: float) -> Track:
    """Return a voyage: 4.5 km west, 5 km north, and back."""
    degree = 1000.0 / _METRES
    west = longitude - 4.5 * degree / math.cos(math.radians(latitude))
    return Track(((latitude, longitude), (latitude, west), (latitude + 5 * degree, west)))
