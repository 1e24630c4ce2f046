"""What one radio is set to, in words that both driver families share."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

__all__ = ["NEWEST", "Driver", "Settings", "ghz_of", "standards_of"]


class Driver(Enum):
    """The package that drives a radio."""

    WIRELESS = "wireless"
    WIFI = "wifi"


NEWEST = ("a", "n", "ac", "ax", "be")
"""Standards of 5 GHz, each of which knows those before it."""


@dataclass(frozen=True, slots=True)
class Settings:
    """A radio as it is configured; whatever of this changes makes the radio start anew."""

    driver: Driver
    mac: str
    radio_name: str
    enabled: bool
    mode: str
    """The device's own word: `bridge`, `ap-bridge`, `ap`, `station-bridge` ..."""
    bridges_stations: bool
    """An access point takes `station-bridge` (`bridge-mode=enabled`)."""
    protocol: str
    """Its word for `wireless-protocol`; `802.11` with the newer driver."""
    ssid: str
    band: str
    width: str
    frequency: int | None
    """What an access point uses; None: it chooses."""
    scans: tuple[tuple[int, int], ...] | None
    """Where a station looks for its access point; None: wherever its country allows."""
    country: str
    outdoor: bool
    lawless: bool
    """`frequency-mode=superchannel`: every channel of the card."""
    authentication: frozenset[str]
    passphrase: str
    nv2_key: str | None
    """None: `nv2-security=disabled`."""
    reach_km: float | None
    """The greatest distance for which it is set, where there is a limit."""
    power_dbm: float
    gain_dbi: float
    refuses: frozenset[str]
    """MAC addresses that its access list or connect list turns away; `*` is everybody whom it does not name."""
    admits: frozenset[str]
    rest: frozenset[tuple[str, str]] = frozenset()
    """Everything else that its row says: no matter of the other end, but a change makes the radio start anew."""

    @property
    def is_ap(self) -> bool:
        """It opens the network."""
        return self.mode in ("ap", "ap-bridge", "bridge")

    @property
    def speaks(self) -> str:
        """What an access point sends: the table of `wireless-protocol` (Manual, Wireless Interface)."""
        if self.protocol.startswith("nv2"):
            return "nv2"
        return "802.11" if self.protocol in ("any", "unspecified") else self.protocol

    @property
    def understands(self) -> frozenset[str]:
        """What a station connects to."""
        if self.protocol == "any":
            return frozenset(("802.11", "nstreme", "nv2"))
        if self.protocol == "unspecified":
            return frozenset(("802.11", "nstreme"))
        return frozenset(
            ("nv2", "nstreme", "802.11") if self.protocol == "nv2-nstreme-802.11" else _both(self.protocol)
        )

    @property
    def channel_mhz(self) -> int:
        """The channel of an access point; one that may choose takes the lowest that outdoor links use."""
        if self.frequency is not None:
            return self.frequency
        return 2412 if ghz_of(self.band) == 2 else 5500  # noqa: PLR2004 (GHz)


def _both(protocol: str) -> tuple[str, ...]:
    return tuple(protocol.split("-")) if protocol.startswith("nv2-") else (protocol,)


def ghz_of(band: str) -> int:
    """Return 2 or 5; a radio without a word about it is one of 5 GHz."""
    return 2 if band.startswith("2ghz") else 5


def standards_of(band: str, driver: Driver) -> frozenset[str]:
    """Return the standards that a band allows: lists and `only` with the older driver, an upper end with the newer."""
    name = band.partition("ghz-")[2]
    if not name:
        return frozenset((*NEWEST, "b", "g"))
    if driver is Driver.WIRELESS:
        return frozenset(name.removeprefix("only").split("/"))
    older = ("g", *NEWEST[1:]) if ghz_of(band) == 2 else NEWEST  # noqa: PLR2004 (GHz)
    return frozenset(older[: older.index(name) + 1])
