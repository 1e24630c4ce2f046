"""A pair of radios that point at each other, and the air between them: plain JSON."""

from __future__ import annotations

from typing import Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

__all__ = ["Air", "RadioPair"]


class Air(BaseModel):
    """What lies between two radios, and how long they take; times in seconds."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    distance_m: float = Field(default=150.0, gt=0)
    loss_db: float = Field(default=0.0, ge=0)
    """Lost besides free space: a mast in the way, an antenna that points elsewhere."""
    sensitivity_dbm: float = -85.0
    """Below, a radio hears nothing: between the data sheets' figures for 6 and 24 Mbit/s. Assumption: radio-restart"""
    association_s: float = Field(default=3.0, ge=0)
    """From the moment at which the access point can be heard until the station is registered."""
    dfs_wait_s: float = Field(default=60.0, ge=0)
    """An access point listens for radar before it speaks on a DFS channel (ETSI EN 301 893)."""
    weather_wait_s: float = Field(default=600.0, ge=0)
    """The same where weather radars are, 5600 to 5650 MHz."""
    radar_mhz: tuple[int, ...] = ()
    """Channels on which a radar is always heard: an access point never speaks there."""
    lowest_mhz: int = 2300
    highest_mhz: int = 6100
    """What the antennas are made for."""


class RadioPair(BaseModel):
    """Two twins of a site; the way from the technician to `far` leads through `near`."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    near: str
    far: str
    near_radio: str = "wlan1"
    """Factory name."""
    far_radio: str = "wlan1"
    air: Air = Air()

    @model_validator(mode="after")
    def _two(self) -> Self:
        if self.near == self.far:
            raise ValueError(f"{self.near} cannot be both ends of a radio link")
        return self
