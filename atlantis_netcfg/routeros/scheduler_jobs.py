"""Jobs of a device's scheduler that take a change back by themselves: armed before it, taken away after it.

`atlantis-dead-man` runs the way back of one device (`apply`), `atlantis-pair` that of the far end of a bridge (`pair`).
Both are armed outside safe mode, which would undo them too. In a device-mode without scheduler such a row can be added
and never runs (manual, Device-mode): it is read back. Every reading of a device asks for `ARMED` as well.

Assumption: scheduler-forbidden
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import DeviceFailed
from atlantis_netcfg.routeros.api import Command

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from atlantis_netcfg.routeros._types import Row
    from atlantis_netcfg.routeros.api import Reply
    from atlantis_netcfg.routeros.apply._job import Channel

__all__ = ["ARMED", "DEAD_MAN", "MENU", "PAIR", "AlreadyArmed", "ArmedJob", "WillNotRun", "arm", "disarm", "jobs_of"]

DEAD_MAN, PAIR = "atlantis-dead-man", "atlantis-pair"
MENU = "/system/scheduler"
_PRINT = f"{MENU}/print"
_EITHER = (f"?name={DEAD_MAN}", f"?name={PAIR}", "?#|")
ARMED = Command(_PRINT, ((".proplist", ".id,name,comment"),), _EITHER)
"""Reads the jobs of ours; a device without any answers with a few bytes."""
_READ_BACK = ((".proplist", ".id,name,comment,disabled,invalid,.about"),)
_TRUE = ("true", "yes")


class WillNotRun(DeviceFailed):
    """The device has taken the job and will not run it, or has not taken it at all."""


class AlreadyArmed(WillNotRun):
    """Such a job is there already: somebody else's run is under way, or one has died."""


@dataclass(frozen=True, slots=True)
class ArmedJob:
    """A job of ours on the device."""

    id: str
    name: str
    owner: str
    """Whose run has armed it, as its comment says."""


def jobs_of(rows: Iterable[Row]) -> tuple[ArmedJob, ...]:
    """Return the jobs among the answers to `ARMED`."""
    return tuple(ArmedJob(row.get(".id", ""), row.get("name", ""), row.get("comment") or "a run") for row in rows)


async def arm(session: Channel, name: str, owner: str, values: Mapping[str, str]) -> str:
    """Arm a job, read it back, and return its `.id`. Raises WillNotRun, AlreadyArmed, SessionLost."""
    reply = await session.command(Command(f"{MENU}/add", (("name", name), ("comment", owner), *values.items())))
    rows = (await session.command(Command(_PRINT, _READ_BACK, (f"?name={name}",)))).rows
    if reply.trap is not None:
        if rows:
            raise AlreadyArmed(
                f"{jobs_of(rows)[0].owner} has armed one already",
                hint="wait until it has ended, then run the same command again",
            )
        raise WillNotRun(f"the device says: {reply.trap.message}")
    why = _idle(rows)
    if why is not None:
        await session.command(_removing(reply.ret or ""))
        raise WillNotRun(f"the job would not run: {why}")
    return reply.ret or rows[0][".id"]


def _idle(rows: Sequence[Row]) -> str | None:
    """Return why the device will not run the job that was read back, or None."""
    if not rows:
        return "it is not there"
    about = rows[0].get(".about", "")
    if about.startswith("inactiv"):
        return about
    return "it is disabled" if rows[0].get("disabled") in _TRUE or rows[0].get("invalid") in _TRUE else None


async def disarm(session: Channel, job: str, witness: Sequence[Command] = ()) -> tuple[bool, list[Reply]]:
    """Take a job away by its `.id` and see that it is gone; False if it had gone by itself, for then it has run.

    All in one round trip; also answers to `witness`. Raises WillNotRun if it is still there, SessionLost.
    """
    removed, seen, *witnessed = await session.flight([_removing(job), ARMED, *witness])
    if _is_there(job, seen):
        seen = await session.command(ARMED)
    if _is_there(job, seen):
        raise WillNotRun("the job of its scheduler cannot be taken away")
    return removed.trap is None, witnessed


def _is_there(job: str, seen: Reply) -> bool:
    return any(row.get(".id") == job for row in seen.rows)


def _removing(job: str) -> Command:
    return Command(f"{MENU}/remove", ((".id", job),))
