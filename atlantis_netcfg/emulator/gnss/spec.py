"""One emulated receiver: healthy by default, each field a way to be otherwise."""

from __future__ import annotations

from enum import StrEnum

from pydantic import BaseModel, ConfigDict, Field

__all__ = ["Access", "GnssSpec", "Speech"]


class Speech(StrEnum):
    """What comes out of it."""

    POSITIONS = "positions"
    NOTHING = "nothing"
    """No data: the port is open, and the receiver is silent."""
    GARBAGE = "garbage"
    """A wrong baud rate, or another program."""


class Access(StrEnum):
    """How its server treats clients."""

    SERVED = "served"
    REFUSED = "refused"
    """Nothing listens at the port."""
    IN_USE = "in use"
    """It serves one client, and has it: the next one is hung up at once."""
    MUTE = "mute"
    """It takes the connection and never says a word, not even a greeting."""


class GnssSpec(BaseModel):
    """A receiver, and the program or port that passes its data on."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    latitude: float = 41.68642
    """The report's point in the port of Viana do Castelo."""
    longitude: float = -8.83883
    mode: int = Field(default=3, ge=1, le=3)
    """1 no fix, 2 or 3 dimensions."""
    every_s: float = Field(default=0.2, gt=0)
    """Between two reports. A receiver takes a second; rehearsals are in a hurry."""
    time_offset_s: float = 0.0
    """Of the receiver's time to this computer's."""
    timed: bool = True
    """False: positions without a time (gpsd), or GGA without RMC, which has no date (NMEA)."""
    stale: bool = False
    """The same position with the same time again and again."""
    silent_after: int | None = None
    """So many reports, then none."""
    lost_after: int | None = None
    """So many fixes, then none: reports go on without a fix."""
    swapped: bool = False
    """Latitude and longitude exchanged."""
    jumping_m: float = 0.0
    """Every other report is so far north."""
    null: bool = False
    """A fix at 0, 0."""
    status: int | None = None
    """In gpsd's words: 2 DGPS, 3 and 4 RTK, 5 dead reckoning, 7 surveyed, 8 simulated; None: a plain fix."""
    eph_m: float = 17.1
    hdop: float = 0.9
    satellites: int = Field(default=9, ge=0, le=99)
    speech: Speech = Speech.POSITIONS
    access: Access = Access.SERVED
    device: bool = True
    """False: gpsd runs without a receiver."""
    damaged: int = 0
    """Of so many reports the last is damaged (checksum, JSON); 0: none."""
    piecewise: bool = False
    """Every byte by itself."""
