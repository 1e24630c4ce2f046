"""Distances on the earth, and where a position lies in relation to a geofence."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from atlantis_netcfg.declaration.model import Geofence

__all__ = ["distance_m", "from_middle_m", "meters", "place"]

RADIUS_M = 6_371_008.8
"""Mean radius of WGS 84."""


def distance_m(latitude: float, longitude: float, other_latitude: float, other_longitude: float) -> float:
    """Along the great circle, by the haversine formula: within 0.5 % of the ellipsoid."""
    north, east = math.radians(other_latitude - latitude), math.radians(other_longitude - longitude)
    both = math.cos(math.radians(latitude)) * math.cos(math.radians(other_latitude))
    half = math.sin(north / 2) ** 2 + both * math.sin(east / 2) ** 2
    return 2 * RADIUS_M * math.asin(min(1.0, math.sqrt(half)))


def from_middle_m(fence: Geofence, latitude: float, longitude: float) -> float:
    """How far a position is from the middle of a geofence."""
    return distance_m(fence.latitude, fence.longitude, latitude, longitude)


def place(latitude: float | None, longitude: float | None) -> str:
    """A position to five decimals: about a metre."""
    return "nowhere" if latitude is None or longitude is None else f"{latitude:.5f}, {longitude:.5f}"


def meters(value: float) -> str:
    """A distance for people."""
    return f"{value:.0f} m" if value < 10_000 else f"{value / 1000:.0f} km"  # noqa: PLR2004 - from 10 km on in km
