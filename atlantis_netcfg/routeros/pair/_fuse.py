"""A job of the far end's scheduler that brings the radio back when the link is not there in time.

Safe mode notices a dead link only after the device's own TCP time-out, about nine minutes (Manual, Configuration
Management). The job looks once, at the declared moment: if the other end is registered the change has come off and the
job only goes away; if not, it writes the old values. It has a start in the future on the device's own clock and an
interval, so that a clock that jumps delays it by one interval at most; it is made outside safe mode, which would take
it back. Where device-mode forbids the scheduler a job can be made, but never runs (Manual, Device-mode).
"""

from __future__ import annotations

from datetime import datetime, timedelta
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import DeviceFailed
from atlantis_netcfg.routeros import scheduler_jobs
from atlantis_netcfg.routeros.api import Command
from atlantis_netcfg.routeros.scheduler_jobs import MENU, PAIR

if TYPE_CHECKING:
    from atlantis_netcfg.routeros._types import Facts
    from atlantis_netcfg.routeros.apply import Channel

__all__ = ["arm", "script", "why_not"]

_FALSE, _TRUE = ("false", "no"), ("true", "yes")


def why_not(facts: Facts) -> str:
    """Return why the device would not run a job; empty: it would."""
    mode = facts.device_mode
    if mode.get("scheduler") in _FALSE:
        return f"device-mode {mode.get('mode', '')} forbids the scheduler"
    return "the device is flagged" if mode.get("flagged") in _TRUE else ""


def script(menu: str, peer: str, way_back: str) -> str:
    """Write the job: `peer` is the MAC address that has to be registered with the radios of `menu`."""
    look = f'{menu}/registration-table/get [find mac-address="{peer}"] uptime'
    return f':do {{\n{look}\n}} on-error={{\n{way_back}}}\n{MENU}/remove [find name="{PAIR}"]\n'


async def arm(session: Channel, owner: str, text: str, after_s: float) -> str:
    """Make the job, see that the device will run it, and return its `.id`. Raises AlreadyArmed, WillNotRun."""
    start = await _moment(session, after_s)
    values = {
        "start-date": start.strftime("%Y-%m-%d"),
        "start-time": start.strftime("%H:%M:%S"),
        "interval": f"{max(1, round(after_s))}s",
        "on-event": text,
    }
    return await scheduler_jobs.arm(session, PAIR, owner, values)


async def _moment(session: Channel, after_s: float) -> datetime:
    """Return the device's own time `after_s` from now."""
    rows = (await session.command(Command("/system/clock/print"))).checked().rows
    row = rows[0] if rows else {}
    try:
        now = datetime.strptime(f"{row['date']} {row['time']}", "%Y-%m-%d %H:%M:%S")  # noqa: DTZ007 - its own zone
    except (KeyError, ValueError):
        raise DeviceFailed(f"its clock says {row.get('date')} {row.get('time')}, which is no time") from None
    return now + timedelta(seconds=after_s)
