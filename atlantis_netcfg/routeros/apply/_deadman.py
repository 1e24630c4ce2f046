"""The dead-man job: the device's scheduler runs the way back, unless we take the job away in time.

Armed before safe mode is taken, for within it it would be undone too. It is set off by `interval` alone: without a
battery the clock jumps as soon as NTP answers, and a wall-clock time is then missed or hit too early (inferred). Its
script first removes the job, so that it runs once. In a device-mode without scheduler such a row can be added and never
runs (manual, Device-mode): it is read back.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.errors import DeviceFailed
from atlantis_netcfg.routeros.api import Command

if TYPE_CHECKING:
    from collections.abc import Sequence

    from atlantis_netcfg.routeros._types import Row
    from atlantis_netcfg.routeros.api import Reply
    from atlantis_netcfg.routeros.apply._job import Channel

__all__ = ["FOUND", "DeadMan", "WillNotRun", "arm", "disarm", "found"]

_NAME = "atlantis-dead-man"
_MENU = "/system/scheduler"
_PROPERTIES = ".id,name,comment,interval,disabled,invalid,.about"
FOUND = Command(f"{_MENU}/print", ((".proplist", _PROPERTIES),), (f"?name={_NAME}",))
_PREFIX = (
    f"/system scheduler remove [find name={_NAME}]\n"
    '/log warning message="atlantis: a change was not confirmed in time and is taken back"\n'
)
_MARGIN_S = 60.0


class WillNotRun(DeviceFailed):
    """The device has taken the job and will not run it, or has not taken it at all."""


@dataclass(frozen=True, slots=True)
class DeadMan:
    """An armed job."""

    id: str
    armed: float
    """On the loop's clock, before the job was sent."""
    after_s: float

    def is_near(self, now: float) -> bool:
        """Whether it may run before anything more is finished."""
        return now > self.armed + self.after_s - _MARGIN_S

    @property
    def over(self) -> float:
        """When it has run for certain, on the loop's clock."""
        return self.armed + self.after_s + _MARGIN_S


def found(reply: Reply) -> str | None:
    """Return whose job is armed, or None."""
    return (reply.rows[0].get("comment") or "a run") if reply.trap is None and reply.rows else None


async def arm(session: Channel, script: str, ours: str, after_s: float, now: float) -> DeadMan:
    """Arm the job and read it back. Raises WillNotRun, SessionLost."""
    values = (("name", _NAME), ("interval", f"{after_s:.0f}s"), ("comment", ours), ("on-event", _PREFIX + script))
    reply = await session.command(Command(f"{_MENU}/add", values))
    rows = (await session.command(FOUND)).rows
    if reply.trap is not None:
        who = rows[0].get("comment", "a run") if rows else ""
        raise WillNotRun(f"{who} has armed one already" if who else f"the device says: {reply.trap.message}")
    why = _idle(rows)
    if why is not None:
        await session.command(Command(f"{_MENU}/remove", ((".id", reply.ret or ""),)))
        raise WillNotRun(f"the job would not run: {why}")
    return DeadMan(reply.ret or rows[0][".id"], now, after_s)


def _idle(rows: Sequence[Row]) -> str | None:
    if not rows:
        return "it is not there"
    about = rows[0].get(".about", "")
    if about.startswith("inactiv"):
        return about
    return "it is disabled" if "true" in (rows[0].get("disabled"), rows[0].get("invalid")) else None


async def disarm(session: Channel, job: DeadMan, witness: Sequence[Command] = ()) -> tuple[bool, list[Reply]]:
    """Take the job away and see that it is gone; False if it had gone by itself, for then it has run.

    All in one round trip; also answers to `witness`. Raises WillNotRun if it is still there, SessionLost.
    """
    removed, seen, *witnessed = await session.flight([Command(f"{_MENU}/remove", ((".id", job.id),)), FOUND, *witness])
    if seen.rows:
        seen = await session.command(FOUND)
    if seen.rows:
        raise WillNotRun("the dead-man job cannot be taken away")
    return removed.trap is None, witnessed
