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

from atlantis_netcfg.errors import DeviceFailed
from atlantis_netcfg.routeros.api import Command

if TYPE_CHECKING:
    from atlantis_netcfg.routeros._types import Facts
    from atlantis_netcfg.routeros.apply import Channel

__all__ = ["NAME", "Armed", "arm", "disarm", "script", "why_not"]

NAME = "atlantis-pair"
_PATH = "/system/scheduler"
_LOOK = Command(f"{_PATH}/print", queries=(f"?name={NAME}",))
_FALSE, _TRUE = ("false", "no"), ("true", "yes")


class Armed(DeviceFailed):
    """Such a job is there already: somebody else's run is under way, or one has died."""


def why_not(facts: Facts) -> str:
    """Return why the device would not run a job; empty: it would."""
    mode = facts.device_mode
    if mode.get("scheduler") in _FALSE:
        return f"device-mode {mode.get('mode', '')} forbids the scheduler"
    return "the device is flagged" if mode.get("flagged") in _TRUE else ""


def script(menu: str, peer: str, way_back: str) -> str:
    """Write the job: `peer` is the MAC address that has to be registered with the radios of `menu`."""
    look = f'{menu}/registration-table/get [find mac-address="{peer}"] uptime'
    return f':do {{\n{look}\n}} on-error={{\n{way_back}}}\n{_PATH}/remove [find name="{NAME}"]\n'


async def arm(session: Channel, text: str, after_s: float) -> None:
    """Make the job and see that the device will run it. Raises Armed, and DeviceFailed if it will not run it."""
    if (await session.command(_LOOK)).checked().rows:
        raise Armed(
            "another run changes this bridge, or has died in the middle of it",
            hint="wait until it has ended; if it has died:  provision resume",
        )
    start = await _moment(session, after_s)
    arguments = {
        "name": NAME,
        "start-date": start.strftime("%Y-%m-%d"),
        "start-time": start.strftime("%H:%M:%S"),
        "interval": f"{max(1, round(after_s))}s",
        "on-event": text,
    }
    (await session.command(Command(f"{_PATH}/add", tuple(arguments.items())))).checked()
    rows = (await session.command(_LOOK)).checked().rows
    if not rows or rows[0].get(".about") or rows[0].get("disabled") in _TRUE:
        await disarm(session)
        raise DeviceFailed(
            f"the device does not run jobs: {rows[0].get('.about', 'it is disabled') if rows else 'gone'}"
        )


async def _moment(session: Channel, after_s: float) -> datetime:
    """Return the device's own time `after_s` from now."""
    rows = (await session.command(Command("/system/clock/print"))).checked().rows
    row = rows[0] if rows else {}
    try:
        now = datetime.strptime(f"{row['date']} {row['time']}", "%Y-%m-%d %H:%M:%S")  # noqa: DTZ007 - its own zone
    except (KeyError, ValueError):
        raise DeviceFailed(f"its clock says {row.get('date')} {row.get('time')}, which is no time") from None
    return now + timedelta(seconds=after_s)


async def disarm(session: Channel) -> None:
    """Take the job away, and see that it is away. Raises Refused, SessionLost."""
    rows = (await session.command(_LOOK)).checked().rows
    if rows:
        ids = ",".join(row[".id"] for row in rows)
        await session.command(Command(f"{_PATH}/remove", ((".id", ids),)))
        left = (await session.command(_LOOK)).checked().rows
        if left:
            raise DeviceFailed(f"the job {NAME} could not be taken away")
