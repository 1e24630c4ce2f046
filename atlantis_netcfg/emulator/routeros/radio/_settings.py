"""Settings of a radio, independent of the driver family, and its radio path."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Self

from pydantic import BaseModel, ConfigDict, Field, model_validator


class Driver(Enum):
    """Driver package of a radio."""

    WIRELESS = "wireless"
    WIFI = "wifi"


NEWEST = ("a", "n", "ac", "ax", "be")
"""Standards of 5 GHz, each of which includes the earlier ones."""


@dataclass(frozen=True, slots=True)
class RadioSettings:
    """Configuration of a radio; any change restarts it."""

    driver: Driver
    mac: str
    radio_name: str
    is_enabled: bool
    mode: str
    """Mode as the device names it: `bridge`, `ap-bridge`, `ap`, `station-bridge` ..."""
    bridges_stations: bool
    """The access point accepts `station-bridge` (`bridge-mode=enabled`)."""
    protocol: str
    """Value of `wireless-protocol`; `802.11` with the newer driver."""
    ssid: str
    band: str
    width: str
    frequency: int | None
    """Frequency of an access point in MHz; None: it chooses one."""
    scans: tuple[tuple[int, int], ...] | None
    """Frequency ranges that a station scans; None: all that its country allows."""
    country: str
    outdoor: bool
    lawless: bool
    """`frequency-mode=superchannel`: every channel of the card is allowed."""
    authentication: frozenset[str]
    passphrase: str
    nv2_key: str | None
    """None: `nv2-security=disabled`."""
    reach_km: float | None
    """Maximum configured distance in km; None: no limit."""
    power_dbm: float
    gain_dbi: float
    refuses: frozenset[str]
    """MAC addresses rejected by its access list or connect list; `*` stands for all that it does not name."""
    admits: frozenset[str]
    rest: frozenset[tuple[str, str]] = frozenset()
    """All other properties of the row: irrelevant to the other end, but a change restarts the radio."""

    @property
    def is_ap(self) -> bool:
        """Whether the radio is an access point."""
        return self.mode in ("ap", "ap-bridge", "bridge")

    @property
    def speaks(self) -> str:
        """Protocol that an access point uses: table of `wireless-protocol` (Manual, Wireless Interface)."""
        if self.protocol.startswith("nv2"):
            return "nv2"
        return "802.11" if self.protocol in ("any", "unspecified") else self.protocol

    @property
    def understands(self) -> frozenset[str]:
        """Protocols that a station connects to."""
        if self.protocol == "any":
            return frozenset(("802.11", "nstreme", "nv2"))
        if self.protocol == "unspecified":
            return frozenset(("802.11", "nstreme"))
        return frozenset(
            ("nv2", "nstreme", "802.11") if self.protocol == "nv2-nstreme-802.11" else _split_protocols(self.protocol)
        )

    @property
    def channel_mhz(self) -> int:
        """Channel of an access point; an automatic choice takes the lowest outdoor channel."""
        if self.frequency is not None:
            return self.frequency
        return 2412 if ghz_of(self.band) == 2 else 5500  # noqa: PLR2004 (GHz)


def _split_protocols(protocol: str) -> tuple[str, ...]:
    return tuple(protocol.split("-")) if protocol.startswith("nv2-") else (protocol,)


def ghz_of(band: str) -> int:
    """Return the band, 2 or 5 GHz; default 5."""
    return 2 if band.startswith("2ghz") else 5


def standards_of(band: str, driver: Driver) -> frozenset[str]:
    """Return a band's standards: lists and `only` (older driver), or an upper limit (newer driver)."""
    name = band.partition("ghz-")[2]
    if not name:
        return frozenset((*NEWEST, "b", "g"))
    if driver is Driver.WIRELESS:
        return frozenset(name.removeprefix("only").split("/"))
    older = ("g", *NEWEST[1:]) if ghz_of(band) == 2 else NEWEST  # noqa: PLR2004 (GHz)
    return frozenset(older[: older.index(name) + 1])


@dataclass(frozen=True, slots=True)
class Peer:
    """The other end of an active link."""

    settings: RadioSettings
    signal_dbm: float
    """Level at which this end receives the peer."""
    theirs_dbm: float
    """Level at which the peer receives this end."""
    channel_mhz: int
    since: float
    """Start of the link on the emulator's clock."""
    distance_km: int


@dataclass(frozen=True, slots=True)
class RadioState:
    """State of a radio; `status` is a value of `/interface/wireless/monitor` (Manual, Wireless Interface)."""

    status: str
    peer: Peer | None = None


class Air(BaseModel):
    """Radio path between two radios, and association delays; times in seconds."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    distance_m: float = Field(default=150.0, gt=0)
    loss_db: float = Field(default=0.0, ge=0)
    """Loss besides free space, for example a mast in the path or a misaligned antenna."""
    sensitivity_dbm: float = -85.0
    """Reception limit: between the data sheets' figures for 6 and 24 Mbit/s. Assumption: radio-restart"""
    association_s: float = Field(default=3.0, ge=0)
    """Seconds from first reception of the access point until the station is registered."""
    dfs_wait_s: float = Field(default=60.0, ge=0)
    """Seconds for which an access point checks a DFS channel for radar before transmitting (ETSI EN 301 893)."""
    weather_wait_s: float = Field(default=600.0, ge=0)
    """The same on weather radar channels, 5600 to 5650 MHz."""
    radar_mhz: tuple[int, ...] = ()
    """Channels on which radar is always detected, so that an access point never transmits there."""
    lowest_mhz: int = 2300
    highest_mhz: int = 6100
    """Upper frequency limit of the antennas."""


class RadioPair(BaseModel):
    """Two routers of a site with a radio link; the technician reaches `far` through `near`."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    near: str
    far: str
    near_radio: str = "wlan1"
    """Factory name of the radio."""
    far_radio: str = "wlan1"
    air: Air = Air()

    @model_validator(mode="after")
    def _check_two_ends(self) -> Self:
        if self.near == self.far:
            raise ValueError(f"{self.near} cannot be both ends of a radio link")
        return self


NOISE_DBM = -110
"""Value of `noise-floor` on a quiet 20 MHz channel (sample of the manual, Wireless Interface)."""
