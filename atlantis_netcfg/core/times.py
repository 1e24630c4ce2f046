"""Times as a person reads them: in the pilot's zone, with UTC beside it. Data, journals and signed texts keep UTC."""

from __future__ import annotations

from datetime import UTC, datetime, tzinfo
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

_DATE, _MINUTE = "%Y-%m-%d", "%H:%M"


def time_text(at: datetime, zone: str = "") -> str:
    """`2026-11-25 15:37 WET (15:37 UTC)`; the date of UTC stands there only where it is another day.

    `zone`: IANA name, as `time_zone` of the pilot has it. Where it is empty, or not known on this computer, it is UTC
    alone. A time of which nobody knows the zone says so.
    """
    if at.tzinfo is None:
        return f"{at:{_DATE} {_MINUTE}} (time zone unknown)"
    utc = at.astimezone(UTC)
    local = at.astimezone(_zone(zone))
    name = local.tzname() or zone
    if name == "UTC":
        return f"{utc:{_DATE} {_MINUTE}} UTC"
    beside = f"{utc:{_MINUTE}}" if utc.date() == local.date() else f"{utc:{_DATE} {_MINUTE}}"
    return f"{local:{_DATE} {_MINUTE}} {name} ({beside} UTC)"


def _zone(name: str) -> tzinfo:
    try:
        return ZoneInfo(name) if name else UTC
    except (ZoneInfoNotFoundError, ValueError, OSError):
        return UTC
