"""Scheduler jobs on a device that roll a change back without us: armed before the change, removed after it.

`atlantis-dead-man` runs the rollback script of one device (`apply`), `atlantis-pair` that of the far end of a bridge
(`pair`). Both are armed outside safe mode, which would undo them too. `atlantis-use` ends the use of a link
(`link_use`); it is a row like others, and is added and removed with the routes. If device-mode has no scheduler, such a
row can be added but never runs (manual, Device-mode), so it is read back. Every observation of a device also sends
`READ_JOBS`.

The dead-man job is triggered by `interval` only: without a battery the clock jumps as soon as NTP answers, and a
wall-clock time would be missed or reached too early. Its script first removes the job, so that it runs once. The job of
a bridge checks once, at the configured time: if the other end is registered the change has succeeded, and the job only
removes itself; if not, it writes the old values. It has a start time in the future of the device's own clock and an
interval, so that a clock jump delays it by one interval at most. Safe mode notices a dead link only after the device's
own TCP timeout, about nine minutes (manual, Configuration Management).

Assumption: scheduler-forbidden
Assumption: scheduler-interval
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import DeviceError
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.routeros.api import Command, Reply

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from atlantis_netcfg.routeros._types import Facts, Row
    from atlantis_netcfg.routeros.api._values import Channel

DEAD_MAN, PAIR, USE = "atlantis-dead-man", "atlantis-pair", "atlantis-use"
MENU = "/system/scheduler"
_PRINT = f"{MENU}/print"
_EITHER = (f"?name={DEAD_MAN}", f"?name={PAIR}", "?#|", f"?name={USE}", "?#|")
READ_JOBS = Command(_PRINT, ((".proplist", ".id,name,comment"),), _EITHER)
"""Reads our jobs; a device without jobs replies with a few bytes."""
_READ_BACK = ((".proplist", ".id,name,comment,disabled,invalid,.about"),)
_FALSE, _TRUE = ("false", "no"), ("true", "yes")
_DEAD_MAN_PREFIX = (
    f"/system scheduler remove [find name={DEAD_MAN}]\n"
    '/log warning message="atlantis: a change was not confirmed in time and is taken back"\n'
)
_MARGIN_S = 60.0


class WillNotRun(DeviceError):
    """The device has accepted the job but will not run it, or has not accepted it."""


class JobConflict(WillNotRun):
    """Such a job already exists: another run is active, or has died."""


@dataclass(frozen=True, slots=True)
class ArmedJob:
    """One of our jobs on the device."""

    id: str
    name: str
    owner: str
    """Owner of the run that armed it, from the job's comment."""


def jobs_of(rows: Iterable[Row]) -> tuple[ArmedJob, ...]:
    """Return the jobs of runs in a reply to `READ_JOBS`; without `atlantis-use`, which a user has requested."""
    return tuple(
        ArmedJob(row.get(".id", ""), row.get("name", ""), row.get("comment") or "a run")
        for row in rows
        if row.get("name") != USE
    )


@dataclass(frozen=True, slots=True)
class DeadMan:
    """An armed dead-man job."""

    id: str
    """`.id` of the job; empty: sent, but not read back."""
    armed_at: float
    """Loop time before the job was sent."""
    after_s: float

    def is_near(self, now: float) -> bool:
        """Return True if the job may run before the next step is finished."""
        return now > self.armed_at + self.after_s - _MARGIN_S

    @property
    def over(self) -> float:
        """Time on the loop's clock at which the job has certainly run."""
        return self.armed_at + self.after_s + _MARGIN_S


def forbidden(facts: Facts) -> str | None:
    """Return why the scheduler would not run a job, or None. No restrictions exist before 7.17 (Device-mode)."""
    mode = facts.device_mode
    if mode.get("flagged") in _TRUE:
        return "the device is flagged and refuses new jobs"
    return (
        msg(f"device-mode {arg(mode.get('mode', ''))} forbids the scheduler")
        if mode.get("scheduler") in _FALSE
        else None
    )


async def arm_dead_man(session: Channel, script: str, owner: str, after_s: float, now: float) -> DeadMan:
    """Arm the dead-man job and read it back. Raises WillNotRun, SessionLost."""
    values = {"interval": f"{after_s:.0f}s", "on-event": _DEAD_MAN_PREFIX + script}
    return DeadMan(await _arm(session, DEAD_MAN, owner, values), now, after_s)


async def arm_pair(session: Channel, script: str, owner: str, after_s: float) -> str:
    """Arm the far end's job, check that the device will run it; return its `.id`. Raises JobConflict, WillNotRun."""
    start = await _moment(session, after_s)
    values = {
        "start-date": start.strftime("%Y-%m-%d"),
        "start-time": start.strftime("%H:%M:%S"),
        "interval": f"{max(1, round(after_s))}s",
        "on-event": script,
    }
    return await _arm(session, PAIR, owner, values)


def pair_script(menu: str, peer: str, rollback: str) -> str:
    """Return the script of the far end's job; `peer` is the MAC address expected as a peer of `menu`'s radios."""
    look = f'{menu}/registration-table/get [find mac-address="{peer}"] uptime'
    return f':do {{\n{look}\n}} on-error={{\n{rollback}}}\n{MENU}/remove [find name="{PAIR}"]\n'


async def _moment(session: Channel, after_s: float) -> datetime:
    """Return the device's own time in `after_s` seconds."""
    rows = (await session.command(Command("/system/clock/print"))).check().rows
    row = rows[0] if rows else {}
    try:
        now = datetime.strptime(f"{row['date']} {row['time']}", "%Y-%m-%d %H:%M:%S")  # noqa: DTZ007 - its own zone
    except (KeyError, ValueError):
        raise DeviceError(
            f"its clock shows {arg(row.get('date'))} {arg(row.get('time'))}, which is not a valid time"
        ) from None
    return now + timedelta(seconds=after_s)


async def _arm(session: Channel, name: str, owner: str, values: Mapping[str, str]) -> str:
    """Arm a job, read it back, and return its `.id`. Raises WillNotRun, JobConflict, SessionLost."""
    reply = await session.command(Command(f"{MENU}/add", (("name", name), ("comment", owner), *values.items())))
    rows = (await session.command(Command(_PRINT, _READ_BACK, (f"?name={name}",)))).rows
    if reply.trap is not None:
        if rows:
            raise JobConflict(
                f"{arg(jobs_of(rows)[0].owner)} has already armed one",
                hint="wait until it has ended, then run the same command again",
            )
        raise WillNotRun(f"the device says: {arg(reply.trap.message)}")
    why = _idle(rows)
    if why is not None:
        await session.command(_removal_command(reply.ret or ""))
        raise WillNotRun(f"the job would not run: {arg(why)}")
    return reply.ret or rows[0][".id"]


def _idle(rows: Sequence[Row]) -> str | None:
    """Return why the device will not run the job that was read back; None if it will."""
    if not rows:
        return "it does not exist"
    about = rows[0].get(".about", "")
    if about.startswith("inactiv"):
        return about
    return "it is disabled" if rows[0].get("disabled") in _TRUE or rows[0].get("invalid") in _TRUE else None


async def disarm(session: Channel, job: str, witness: Sequence[Command] = ()) -> tuple[bool, list[Reply]]:
    """Remove a job by its `.id` and check that it is gone; False if it was already gone, which means it has run.

    All in one round trip, with the replies to `witness`. Raises WillNotRun if the job still exists, SessionLost.
    """
    removal, jobs_reply, *witness_replies = await session.flight([_removal_command(job), READ_JOBS, *witness])
    if _is_there(job, jobs_reply):
        jobs_reply = await session.command(READ_JOBS)
    if _is_there(job, jobs_reply):
        raise WillNotRun("the scheduler job cannot be removed")
    return removal.trap is None, witness_replies


def _is_there(job: str, jobs_reply: Reply) -> bool:
    return any(row.get(".id") == job for row in jobs_reply.rows)


def _removal_command(job: str) -> Command:
    return Command(f"{MENU}/remove", ((".id", job),))
