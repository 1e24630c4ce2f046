"""The status of a link of any kind, and the requests that read it from a RouterOS device.

Readers are pure: they can only cause these requests to be sent; a test checks every query against RouterOS' own
command trees.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.core.events import Verdict, worst

if TYPE_CHECKING:
    from collections.abc import Mapping


class LinkState(StrEnum):
    """Whether the link carries traffic."""

    UP = "up"
    """It was observed to carry traffic, or its own device reports a connection."""
    DOWN = "down"
    """It was observed to carry no traffic."""
    SEARCHING = "searching"
    """Its device is in transition: searching for a network, waiting for radar, registering."""
    UNKNOWN = "unknown"
    """It cannot be determined from here: deliberately not probed, or its device does not respond."""


@dataclass(frozen=True, slots=True)
class LinkFinding:
    """A finding about a link."""

    verdict: Verdict
    code: str
    """Stable identifier for programs: `roaming-not-allowed`."""
    message: str
    hint: str | None = None
    """What a technician can do about it."""

    def as_dict(self) -> dict[str, str | None]:
        """Return JSON-able data."""
        return {"verdict": self.verdict.value, "code": self.code, "message": self.message, "hint": self.hint}


Quality = dict[str, str | int | float | None]
"""Normalised readings by name, with the unit in the name (`signal_dbm`, `rsrp_dbm`, `rtt_ms`); None: not readable."""


@dataclass(frozen=True, slots=True)
class LinkStatus:
    """The current state of a link; a value that could not be read is None, never zero."""

    name: str
    kind: str
    """Link kind in the inventory: wifi_ptp, lte, satellite, ethernet."""
    state: LinkState
    active: bool | None
    """Whether it carries the site's traffic now."""
    is_metered: bool
    quality: Quality
    month_bytes: int | None
    """Bytes counted this month in both directions, as far as the counters were read."""
    findings: tuple[LinkFinding, ...] = ()

    @property
    def verdict(self) -> Verdict:
        """The worst verdict of the findings; without any, PASS if the link is up, else INCONCLUSIVE."""
        if self.findings:
            return worst(finding.verdict for finding in self.findings)
        return Verdict.PASS if self.state is LinkState.UP else Verdict.INCONCLUSIVE

    def as_dict(self) -> Mapping[str, Any]:
        """Return JSON-able data in the format of `provision links --json`."""
        return {
            "kind": self.kind,
            "state": self.state.value,
            "active": self.active,
            "metered": self.is_metered,
            "quality": self.quality,
            "month_bytes": self.month_bytes,
            "findings": [finding.as_dict() for finding in self.findings],
        }


@dataclass(frozen=True, slots=True)
class Query:
    """A read-only command of the API."""

    menu: str
    """Menu in the API's notation: `/interface/wireless`."""
    command: str
    """`print`, `monitor`, `show-capabilities`."""
    arguments: tuple[tuple[str, str], ...] = ()
    proplist: tuple[str, ...] = ()
    """Requested properties; empty: all. Excludes what must not leave the device (IMEI, IMSI, ICCID)."""

    @property
    def path(self) -> str:
        """The command word: `/interface/lte/monitor`."""
        return f"{self.menu}/{self.command}"

    @property
    def words(self) -> tuple[tuple[str, str], ...]:
        """The arguments of the API sentence, including the list of properties."""
        proplist = ((".proplist", ",".join(self.proplist)),) if self.proplist else ()
        return (*self.arguments, *proplist)


_LEVEL = re.compile(r"([+-]?\d+(?:\.\d+)?)\s*(dBm|dB)?(?:@.*)?", re.IGNORECASE)
_RATE = re.compile(r"(\d+(?:\.\d+)?)\s*([kMG]?)bps(?:[-/ ].*)?", re.IGNORECASE)
_PER_MEGABIT = {"": 1e-6, "k": 1e-3, "m": 1.0, "g": 1e3}
_PERCENT = re.compile(r"(\d+(?:\.\d+)?)\s*%?")
_UNIT = re.compile(r"(\d+(?:\.\d+)?)(ms|w|d|h|m|s)")
_SPAN = re.compile(r"(?:\d+(?:\.\d+)?(?:ms|w|d|h|m|s))+")
_CLOCK = re.compile(r"(?:(\d+)w)?(?:(\d+)d)?(\d+):(\d\d):(\d\d)(?:\.\d+)?")
_SECONDS = {"w": 604_800.0, "d": 86_400.0, "h": 3600.0, "m": 60.0, "s": 1.0, "ms": 1e-3}
_BARE_BITS = 1_000_000
"""A number without unit from this value on is a rate in bit/s; a smaller one is ambiguous."""


def decibels(text: str | None, low: float, high: float, unit: str = "dBm") -> float | None:
    """Parse a level like `-97dBm`, `-48dBm@6Mbps`, `-9dB`, `-72`; None outside the range from `low` to `high`."""
    match = _LEVEL.fullmatch((text or "").strip())
    if match is None or (match[2] is not None and match[2].lower() != unit.lower()):
        return None
    value = float(match[1])
    return value if low <= value <= high else None


def megabits(text: str | None) -> float | None:
    """Parse a rate to Mbit/s: `54.0Mbps-20MHz/1S`, `144.4Mbps`, `1.2Gbps`, `286800000`; None for 0 (no frame yet)."""
    word = (text or "").strip()
    if word.isdecimal():
        return int(word) / _BARE_BITS if int(word) >= _BARE_BITS else None
    match = _RATE.fullmatch(word)
    value = float(match[1]) * _PER_MEGABIT[match[2].lower()] if match is not None else 0.0
    return round(value, 3) or None


def percent(text: str | None) -> float | None:
    """Parse a percentage: `90` or `90%`."""
    match = _PERCENT.fullmatch((text or "").strip())
    value = float(match[1]) if match is not None else None
    return value if value is not None and value <= 100 else None  # noqa: PLR2004 - per cent


def seconds(text: str | None) -> float | None:
    """Parse an interval to seconds: `6h24m21s`, `1w2d`, `0ms`, `00:15:54`."""
    word = (text or "").strip()
    if clock := _CLOCK.fullmatch(word):
        weeks, days, hours, minutes, rest = (int(part or 0) for part in clock.groups())
        return float((((weeks * 7 + days) * 24 + hours) * 60 + minutes) * 60 + rest)
    if not _SPAN.fullmatch(word):
        return None
    return sum(float(count) * _SECONDS[unit] for count, unit in _UNIT.findall(word))


def whole(text: str | None) -> int | None:
    """Parse a non-negative whole number; None if the text is none."""
    word = (text or "").strip()
    return int(word) if word.isascii() and word.isdecimal() else None


def yes(text: str | None) -> bool | None:
    """Parse `yes`/`true` and `no`/`false`; None for anything else."""
    return {"yes": True, "true": True, "no": False, "false": False}.get((text or "").strip().lower())
