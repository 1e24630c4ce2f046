"""One record of a radio for both families of menus; what a family does not have, or did not say, is None."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

__all__ = ["Condition", "Family", "WifiPeer", "WifiReading"]


class Family(StrEnum):
    """RouterOS' two families of radio menus; the value is the menu under `/interface`."""

    WIRELESS = "wireless"
    """Package `wireless`: nv2, nstreme, 802.11; has CCQ."""
    WIFI = "wifi"
    """Packages `wifi-qcom` and `wifi-qcom-ac`; no CCQ, no noise floor."""


class Condition(StrEnum):
    """What the radio does; a word that nobody knows is `unknown`, never a failure."""

    RUNNING = "running"
    """An access point on the air, whether or not anybody is registered."""
    CONNECTED = "connected"
    """A station in the cell of an access point."""
    SEARCHING = "searching"
    RADAR = "radar"
    """It listens for radar before it may send."""
    DISABLED = "disabled"
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True, kw_only=True)
class WifiPeer:
    """Who is registered, and how the two hear each other: a row of the registration table."""

    mac: str | None = None
    """Upper case."""
    radio_name: str | None = None
    """The family `wireless` only."""
    signal_dbm: float | None = None
    """How this end hears the other."""
    tx_signal_dbm: float | None = None
    """How the other end says that it hears this one."""
    chains_dbm: tuple[float | None, ...] = ()
    """`signal_dbm` of each chain of the receiver, the first one first."""
    snr_db: float | None = None
    tx_rate_mbps: float | None = None
    """Of the latest frame: on an idle link that may be a frame of management at the lowest rate."""
    rx_rate_mbps: float | None = None
    tx_ccq_percent: float | None = None
    rx_ccq_percent: float | None = None
    uptime_s: float | None = None
    authorised: bool | None = None
    """Whether the key was right; None: not said."""

    @property
    def imbalance_db(self) -> float | None:
        """Between the best and the worst chain; None with fewer than two."""
        levels = [level for level in self.chains_dbm if level is not None]
        return max(levels) - min(levels) if len(levels) > 1 else None


@dataclass(frozen=True, slots=True, kw_only=True)
class WifiReading:
    """What a radio said at one moment."""

    family: Family
    condition: Condition = Condition.UNKNOWN
    status: str | None = None
    """The device's own word."""
    channel: str | None = None
    """As the device writes it: `5500/20/an`."""
    channel_mhz: int | None = None
    wait_left_s: float | None = None
    """Until the radar wait ends, where the device says so."""
    overall_ccq_percent: float | None = None
    """Of an access point in the family `wireless`: of all its clients together."""
    peers: tuple[WifiPeer, ...] = ()
    associated: bool | None = None
    """Whether somebody is registered; None: it cannot be told."""
