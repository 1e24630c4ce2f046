"""Where a run on one device stands: what was read, what was sent, what is known of it; and who is told."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import complete
from atlantis_netcfg.core.events import Event, Stage
from atlantis_netcfg.journal import JournalFailed
from atlantis_netcfg.routeros.apply._claim import Signer, withdrawing
from atlantis_netcfg.routeros.apply._job import DeviceResult, Status
from atlantis_netcfg.routeros.apply._protection import Choice, Protection
from atlantis_netcfg.routeros.apply._stages import Stages
from atlantis_netcfg.routeros.apply._state import plan_hash
from atlantis_netcfg.routeros.apply._telling import cleaned, ended
from atlantis_netcfg.routeros.apply.leftovers import Leftovers
from atlantis_netcfg.routeros.parsing import Examination
from atlantis_netcfg.routeros.safe_mode import NoSafeMode

if TYPE_CHECKING:
    from collections.abc import Sequence

    from atlantis_netcfg.journal import Record
    from atlantis_netcfg.routeros._types import Observed, Plan, PortCounts
    from atlantis_netcfg.routeros.api import Command
    from atlantis_netcfg.routeros.apply._contact import Contact
    from atlantis_netcfg.routeros.apply._job import Channel, DeviceJob
    from atlantis_netcfg.routeros.apply._writer import Writer
    from atlantis_netcfg.routeros.drift import Comparison
    from atlantis_netcfg.routeros.estimate import Estimate
    from atlantis_netcfg.routeros.safe_mode import SafeMode
    from atlantis_netcfg.routeros.scheduler_jobs import DeadMan

_STAGES = {
    Status.UNCHANGED: Stage.DONE,
    Status.CHANGED: Stage.CONFIRMED,
    Status.PLANNED: Stage.DONE,
    Status.DRIFTED: Stage.DONE,
    Status.ROLLED_BACK: Stage.UNROLLED,
}


@dataclass(slots=True)
class RunContext:
    """A run on one device; the steps read it and write down here what has become true."""

    job: DeviceJob
    contact: Contact
    started: float
    restores: bool = False
    """This run puts an old state back after another one failed: it is not guarded, and not put back itself."""
    session: Channel | None = None
    """The session that changes the device; None before the first contact and after a loss."""
    before: Observed | None = None
    after: Observed | None = None
    """What the verifying session read."""
    brief: bool = False
    """Rows of others by the thousand are read bare: nothing that this run does needs more of them."""
    left: Leftovers = field(default_factory=Leftovers)
    """What was armed or open when the device was read."""
    plan: Plan | None = None
    examination: Examination = field(default_factory=Examination)
    """What the device's own parser has said of the plan."""
    comparison: Comparison | None = None
    estimate: Estimate | None = None
    stages: Stages = field(default_factory=Stages)
    writer: Writer | None = None
    choice: Choice = field(default_factory=lambda: Choice(Protection.NONE))
    safe_mode: SafeMode = field(default_factory=NoSafeMode)
    script: str | None = None
    """The way back, for a dead-man job."""
    dead_man: DeadMan | None = None
    """The job that is armed."""
    sign: str | None = None
    """`.id` of the sign that a run is under way, ours or that of a dead run that we have taken over."""
    busy: str = ""
    """Who is at work on the device, or what is left of them."""
    last_look: PortCounts | None = None
    """At the ports' counters, beside the release: after it nothing of weight is sent."""
    holding: bool = False
    """Safe mode was asked for and may be ours."""
    owner: str = ""
    """What the device calls us while we hold safe mode."""
    touched: bool = False
    """A change was sent: the device may have executed it."""
    acknowledged: set[int] = field(default_factory=set)
    confirmed: int = 0
    notes: list[str] = field(default_factory=list)

    @property
    def protection(self) -> Protection:
        """Who takes an unfinished change back."""
        return self.choice.protection

    @property
    def signer(self) -> Signer:
        """Whose sign this run puts on the device."""
        return Signer(self.job, self.before.facts.session_address if self.before is not None else "")

    @property
    def counts(self) -> tuple[PortCounts, ...]:
        """The first and the last look at the ports' counters."""
        looks = [look for seen in (self.before, self.after) if seen is not None for look in seen.counts]
        looks += [self.last_look] if self.last_look is not None else []
        return (looks[0], looks[-1]) if looks else ()

    @property
    def channel(self) -> Channel:
        """The session, where there has to be one."""
        if self.session is None:
            raise RuntimeError("no session is open")
        return self.session

    @property
    def seen(self) -> Observed:
        """The device as it was before the run, where it has been read."""
        if self.before is None:
            raise RuntimeError("the device has not been read")
        return self.before

    @property
    def aim(self) -> Plan:
        """The plan, where there has to be one."""
        if self.plan is None:
            raise RuntimeError("nothing is planned")
        return self.plan

    @property
    def complete(self) -> bool:
        """Every action was sent, and the device says that it executed it."""
        return self.acknowledged >= {action.number for action in self.aim.actions}

    def say(self, stage: Stage, message: str) -> None:
        """Tell the subscriber."""
        total = len(self.plan.actions) if self.plan is not None else 0
        data = {"acknowledged": len(self.acknowledged)}
        self.job.events(Event(self.job.name, stage, message, self.confirmed, total, data))

    def record(self, record: Record) -> None:
        """Put a record on disk. Raises JournalFailed."""
        self.job.journal.write(record)

    def note(self, record: Record) -> None:
        """Put a record on disk if that is possible: what it reports has happened in any case."""
        with suppress(JournalFailed):
            self.job.journal.write(record)

    def clean(self, text: str) -> str:
        """Mask secrets of the plan in a text of the device, should it ever repeat one."""
        return cleaned(text, self.plan.actions if self.plan is not None else ())

    def result(self, status: Status, message: str, *, hint: str | None = None) -> DeviceResult:
        """Say how it ended."""
        traffic, plan = self.contact.traffic, self.plan
        return DeviceResult(
            name=self.job.name,
            status=status,
            exit=status.exit,
            message=complete(self.clean(message), site=self.job.site, device=self.job.name),
            hint=hint and complete(hint, site=self.job.site, device=self.job.name),
            planned=len(plan.actions) if plan is not None else 0,
            rows=plan.weight if plan is not None else 0,
            foreign_words=plan.foreign_words if plan is not None else "",
            confirmed=self.confirmed,
            diff=plan.diff if plan is not None else "",
            drift=plan.drift if plan is not None else (),
            comparison=self.comparison,
            notes=(*(plan.notes if plan is not None else ()), *self.notes, *self.contact.notes),
            estimate=self.estimate,
            plan_hash=plan_hash(plan) if plan is not None else "",
            protection=self.protection.value,
            protection_words=self.choice.words,
            round_trips=traffic.round_trips,
            sent=traffic.sent,
            received=traffic.received,
            seconds=asyncio.get_running_loop().time() - self.started,
            facts=self.before.facts if self.before is not None else None,
            sessions=traffic.connections,
            counts=self.counts,
            busy=self.busy,
        )

    def farewell(self) -> tuple[Command, ...]:
        """What takes the sign down, beside the last thing that is sent; `signed_off` once it is answered."""
        return () if self.sign is None else (withdrawing(self.sign),)

    def signed_off(self, farewell: Sequence[Command]) -> None:
        """The sign is down, if that was asked."""
        if farewell:
            self.sign = None

    def ended(self, result: DeviceResult) -> DeviceResult:
        """Record and tell the end; a journal that cannot be written is said in the result."""
        read = {Status.UNCHANGED: self.before, Status.CHANGED: self.after}.get(result.status)
        result = ended(self.job, result, read if self.plan is not None else None)
        self.say(_STAGES.get(result.status, Stage.FAILED), result.message)
        return result
