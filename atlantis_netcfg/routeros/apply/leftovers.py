"""What is still armed or open on a device: safe mode, jobs of its scheduler, the marker of a run.

Every reading asks for it in its one flight, also where nothing is to be changed. A plan and drift tell it. A run takes
away what a run has left that is over, once it has read that the device is as declared; what may be in use it leaves
alone. Only a run that sees both ends of a bridge takes the job `atlantis-pair` away.

That a run is over is known of the runs of this computer: one at a time may change a site, and that one is ours.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import DeviceFailed
from atlantis_netcfg.routeros.apply._claim import CLAIMS, Sign, seen, withdrawing
from atlantis_netcfg.routeros.drift import Difference, DriftKind, Owner
from atlantis_netcfg.routeros.scheduler_jobs import DEAD_MAN, PAIR, ArmedJob, disarm, jobs_of

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.routeros._types import Observed
    from atlantis_netcfg.routeros.apply._job import Channel

IsOver = Callable[[str], bool]

_WORDS = {
    DEAD_MAN: "takes back what that run has changed",
    PAIR: "takes this end of the bridge back if the link is lost",
}


@dataclass(frozen=True, slots=True)
class Leftovers:
    """What was read of one device; false if nothing is armed and nothing is open."""

    safe_mode: str | None = None
    """Who holds it."""
    markers: tuple[Sign, ...] = ()
    jobs: tuple[ArmedJob, ...] = ()

    def __bool__(self) -> bool:
        return self.safe_mode is not None or bool(self.markers or self.jobs)

    def words(self) -> tuple[str, ...]:
        """Return one sentence for each."""
        return tuple(difference.row for difference in self.differences())

    def differences(self) -> tuple[Difference, ...]:
        """Return one difference for each, as drift tells it."""
        return tuple(self._differences())

    def _differences(self) -> Iterator[Difference]:
        if self.safe_mode is not None:
            words = f"{self.safe_mode} holds safe mode, and there is only one"
            yield _open("/safe-mode", "safe mode", Owner.SESSION, words)
        for sign in self.markers:
            words = f"{sign.text} is under way on this device, or has died there"
            yield _open("/ip firewall address-list", "atlantis-run", Owner.RUN, words)
        for job in self.jobs:
            yield _open("/system scheduler", job.name, Owner.RUN, _armed(job))

    def alive(self, is_over: IsOver, *, bridge: bool = True) -> str | None:
        """Say which job may belong to a run that is alive, and for a device alone, which belongs to a bridge."""
        alive = (job for job in self.jobs if not is_over(job.owner) or (job.name == PAIR and not bridge))
        return next(map(_armed, alive), None)

    def armed(self, name: str) -> ArmedJob | None:
        """Return the job of this name."""
        return next((job for job in self.jobs if job.name == name), None)

    async def remove(self, session: Channel) -> tuple[str, ...]:
        """Take jobs and markers away, see that they are gone, and say what was removed.

        The caller has read that nobody uses them, and reads the device anew afterwards: a job may have run meanwhile.
        Raises DeviceFailed.
        """
        for job in self.jobs:
            await disarm(session, job.id)
        if self.markers:
            removed = [sign.id for sign in self.markers]
            *_, left = await session.flight([*map(withdrawing, removed), CLAIMS])
            left = left if not left.rows else await session.command(CLAIMS)
            if any(row.get(".id") in removed for row in left.rows):
                raise DeviceFailed("the marker of a run that is over cannot be taken away")
        jobs = (f"the job {job.name} of {job.owner}" for job in self.jobs)
        return (*jobs, *(f"the marker of {sign.text}" for sign in self.markers))


def look(observed: Observed) -> Leftovers:
    """Return what was armed or open when the device was read."""
    return Leftovers(observed.facts.safe_mode_owner, seen(observed), jobs_of(observed.jobs))


def _armed(job: ArmedJob) -> str:
    return f"the job {job.name} of {job.owner} is armed, and {_WORDS[job.name]}"


def _open(menu: str, subject: str, owner: Owner, words: str) -> Difference:
    return Difference(menu, subject, DriftKind.OPEN, owner, row=words, why_unknown="the device does not say")
