"""What a radio sees of the other end, for whoever asks the router."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from atlantis_netcfg.emulator.routeros.radio._settings import Settings

__all__ = ["Peer", "RadioState"]


@dataclass(frozen=True, slots=True)
class Peer:
    """The other end of a link that is up."""

    settings: Settings
    signal_dbm: float
    """What we hear of it."""
    theirs_dbm: float
    """What it hears of us."""
    channel_mhz: int
    since: float
    """On the clock of the twin."""
    distance_km: int


@dataclass(frozen=True, slots=True)
class RadioState:
    """One radio; `status` is a word of `/interface/wireless/monitor` (Manual, Wireless Interface)."""

    status: str
    peer: Peer | None = None
