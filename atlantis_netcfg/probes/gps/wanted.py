"""What is expected of a source of positions, and how it is called in sentences."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from atlantis_netcfg.site.model import Geofence, GpsDriver

__all__ = ["Wanted"]


@dataclass(frozen=True, slots=True)
class Wanted:
    """Of one endpoint."""

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
