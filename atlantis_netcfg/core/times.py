"""Times for people: in the pilot's time zone, with UTC; data, journals and signed texts keep UTC."""

from __future__ import annotations

from datetime import UTC, datetime, tzinfo
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

from atlantis_netcfg.core.messages import arg, msg

_DATE, _MINUTE = "%Y-%m-%d", "%H:%M"


def time_text(at: datetime, zone: str = "") -> str:
    """Format a time as `2026-11-25 15:37 WET (15:37 UTC)`; UTC has a date only if it is another day.

    `zone`: IANA name, as in `time_zone` of the pilot. If it is empty or unknown on this computer, only UTC is shown. A
    time without time zone is marked as such.
    """
    if at.tzinfo is None:
        return msg(f"{arg(at):{_DATE} {_MINUTE}} (time zone unknown)")
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
