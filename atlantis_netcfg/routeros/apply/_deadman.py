"""The dead-man job: the device's scheduler runs the way back, unless we take the job away in time.

Armed before safe mode is taken, for within it it would be undone too. It is set off by `interval` alone: without a
battery the clock jumps as soon as NTP answers, and a wall-clock time is then missed or hit too early. Its script first
removes the job, so that it runs once.

Assumption: scheduler-interval
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.routeros import scheduler_jobs
from atlantis_netcfg.routeros.scheduler_jobs import DEAD_MAN

if TYPE_CHECKING:
    from atlantis_netcfg.routeros.apply._job import Channel

__all__ = ["DeadMan", "arm"]

_PREFIX = (
    f"/system scheduler remove [find name={DEAD_MAN}]\n"
    '/log warning message="atlantis: a change was not confirmed in time and is taken back"\n'
)
_MARGIN_S = 60.0


@dataclass(frozen=True, slots=True)
class DeadMan:
    """An armed job."""

    id: str
    """Empty: it was sent, and not read back."""
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


async def arm(session: Channel, script: str, ours: str, after_s: float, now: float) -> DeadMan:
    """Arm the job and read it back. Raises WillNotRun, SessionLost."""
    values = {"interval": f"{after_s:.0f}s", "on-event": _PREFIX + script}
    return DeadMan(await scheduler_jobs.arm(session, DEAD_MAN, ours, values), now, after_s)
