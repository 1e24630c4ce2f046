"""`/system/gps/monitor once` of a RouterOS device: its latest position, and none before it.

Names of fields: Manual, GPS (package `gps`). `data-age` exists from 7.1 on. Coordinates come in the form of
`coordinate-format`: decimal degrees, or a letter with degrees, minutes and seconds; `none` is no position. The manual
does not say in which time zone `date-and-time` is: UTC and that of the device's clock are taken.
"""

from __future__ import annotations

import math
import re
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from atlantis_netcfg.bearers.query import Query
from atlantis_netcfg.checklist.probes.gps.record import Nature, Reception, Report

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.checklist.probes.results import Rows

__all__ = ["CLOCK", "MONITOR", "SETTINGS", "enabled", "read"]

MONITOR = Query("/system/gps", "monitor", (("once", ""),))
SETTINGS = Query("/system/gps", "print")
CLOCK = Query("/system/clock", "print")
_YES = {"yes": True, "true": True, "no": False, "false": False}
_QUALITY = {"6": Nature.DEAD_RECKONING, "7": Nature.MANUAL, "8": Nature.SIMULATED}
_TIMES = ("%Y-%m-%d %H:%M:%S", "%b/%d/%Y %H:%M:%S")
_SECONDS = {"w": 604_800.0, "d": 86_400.0, "h": 3600.0, "m": 60.0, "s": 1.0, "ms": 0.001}
_PART = r"(\d+(?:\.\d+)?)(ms|[wdhms])"


def enabled(settings: Rows) -> bool | None:
    """Whether the receiver is switched on; None: nobody says."""
    return _YES.get(settings.rows[0].get("enabled", "")) if settings.rows else None


def read(monitored: Rows, clock: Rows | None = None) -> Reception:
    """Understand the one row; `clock`: the device's own, for its time zone. Raises nothing."""
    row = monitored.rows[0] if monitored.rows else {}
    age_s = _age(row.get("data-age", ""))
    count = re.fullmatch(r"\d{1,3}", row.get("satellites", ""))
    hdop = re.fullmatch(r"\d{1,3}(\.\d+)?", row.get("horizontal-dilution", ""))
    return Reception(
        reports=(_report(row),) if row else (),
        understood=bool(row),
        good=len(row),
        satellites=int(count[0]) if count else None,
        hdop=float(hdop[0]) if hdop else None,
        single=True,
        zone_s=_zone_s(clock),
        began=monitored.heard - age_s if monitored.heard else 0.0,
        ended_s=age_s,
    )


def _report(row: Mapping[str, str]) -> Report:
    valid = _YES.get(row.get("valid", ""))
    altitude = re.match(r"-?\d", row.get("altitude", ""))
    return Report(
        at_s=0.0,
        mode=None if valid is None else 1 if not valid or row.get("fix-quality") == "0" else 3 if altitude else 2,
        latitude=_degrees(row.get("latitude", "")),
        longitude=_degrees(row.get("longitude", "")),
        time=_time(row.get("date-and-time", "")),
        nature=_QUALITY.get(row.get("fix-quality", ""), Nature.MEASURED),
    )


def _degrees(text: str) -> float | None:
    parts = re.findall(r"\d{1,3}(?:\.\d{1,12})?", text)
    if not re.fullmatch(r"[NSEW]?\s*-?[\d.\s'\"°]+[NSEW]?", text) or not 1 <= len(parts) <= 3:  # noqa: PLR2004 - d, m, s
        return None
    value = math.fsum(float(part) / 60**place for place, part in enumerate(parts))
    return -value if "-" in text or "S" in text or "W" in text else value


def _time(text: str) -> float | None:
    for form in _TIMES:
        try:
            return (
                datetime.strptime(text.strip().title() if "%b" in form else text.strip(), form)
                .replace(tzinfo=UTC)
                .timestamp()
            )
        except (ValueError, OverflowError):
            continue
    return None


def _age(text: str) -> float:
    """Of `2s`, `1m4s`, or bare seconds; what is not told counts as now, for older versions do not tell it."""
    if re.fullmatch(r"\d{1,9}(\.\d+)?", text):
        return float(text)
    if not re.fullmatch(f"(?:{_PART})+", text):
        return 0.0
    return sum(float(count) * _SECONDS[unit] for count, unit in re.findall(_PART, text))


def _zone_s(clock: Rows | None) -> float:
    """How far the device's clock is ahead of UTC: `gmt-offset` is `+01:00`."""
    text = clock.rows[0].get("gmt-offset", "") if clock is not None and clock.rows else ""
    found = re.fullmatch(r"([+-])(\d\d):(\d\d)", text)
    return 0.0 if found is None else (-1 if found[1] == "-" else 1) * (int(found[2]) * 3600.0 + int(found[3]) * 60.0)
