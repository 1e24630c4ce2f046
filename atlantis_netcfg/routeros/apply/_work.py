"""The state of a run on one device: observations, stages of the plan, leftovers, and reports."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING

from atlantis_netcfg import runs
from atlantis_netcfg.core.errors import DeviceError, fill_hint
from atlantis_netcfg.core.events import Event, Stage
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.core.secret import MASK
from atlantis_netcfg.routeros import _types, drift, scheduler_jobs, snapshot
from atlantis_netcfg.routeros.apply import _job
from atlantis_netcfg.routeros.apply._protection import Protection, ProtectionChoice
from atlantis_netcfg.routeros.apply._state import CLAIMS, RunMarker, RunSigner, find_markers, plan_hash, withdrawing
from atlantis_netcfg.routeros.commands import Examination
from atlantis_netcfg.routeros.safe_mode import BUDGET, NoSafeMode, SafeMode

if TYPE_CHECKING:
    from atlantis_netcfg.routeros.api import Command, Reply
    from atlantis_netcfg.routeros.api._values import Channel
    from atlantis_netcfg.routeros.apply._contact import Contact
    from atlantis_netcfg.routeros.apply._writer import Writer
    from atlantis_netcfg.routeros.estimate import Estimate


_FOUNDATION, _NAMING = True, False


@dataclass(frozen=True, slots=True)
class Stages:
    """The actions of a plan by stage; within each stage in the order of the plan."""

    prepare: tuple[_types.Action, ...] = ()
    pieces: tuple[tuple[_types.Action, ...], ...] = ()
    """Parts of the plan, each within the budget of one safe mode."""
    finish: tuple[_types.Action, ...] = ()


def split_plan(plan: _types.Plan, protection: Protection, budget: int = BUDGET) -> Stages:
    """Split a plan so that it costs the fewest round trips; without safe mode it is not split.

    A plan within the budget is one part. Otherwise harmless additions may go outside safe mode: those that other rows
    refer to (address lists, pools) before it, those that refer to others (leases) after it. The rest is split into
    parts with a checkpoint between them, so that safe mode never has to record more than it can.
    """
    if not protection.holds:
        return Stages(prepare=plan.actions)
    ways = [_cut(plan, budget, outside) for outside in ((), (_FOUNDATION,), (_NAMING,), (_FOUNDATION, _NAMING))]
    return min(ways, key=_cost)


def _cut(plan: _types.Plan, budget: int, outside: Sequence[bool]) -> Stages:
    """Split; harmless additions that others refer to (True), or that refer to others (False), go outside."""
    out = [
        action
        for action in plan.actions
        if _is_harmless(action) and (action.layer is _types.Layer.FOUNDATION) in outside
    ]
    rest = [action for action in plan.actions if action not in out]
    return Stages(
        prepare=tuple(action for action in out if action.layer is _types.Layer.FOUNDATION),
        pieces=tuple(_split_into_batches(rest, budget)),
        finish=tuple(action for action in out if action.layer is not _types.Layer.FOUNDATION),
    )


def _cost(stages: Stages) -> int:
    """Return the extra round trips; after a preparation, safe mode cannot be taken together with the last read."""
    checkpoints = max(0, len(stages.pieces) - 1)
    return 2 * bool(stages.prepare) + bool(stages.finish) + 7 * checkpoints


def _is_harmless(action: _types.Action) -> bool:
    return action.inert and action.verb is _types.Verb.ADD


def _split_into_batches(actions: Sequence[_types.Action], budget: int) -> Iterator[tuple[_types.Action, ...]]:
    piece: list[_types.Action] = []
    remaining_budget = budget
    for action in (part for whole in actions for part in _parts(whole, budget)):
        if action.weight > remaining_budget:
            yield tuple(piece)
            piece, remaining_budget = [], budget
        piece.append(action)
        remaining_budget -= action.weight
    if piece:
        yield tuple(piece)


def _parts(action: _types.Action, budget: int) -> Iterator[_types.Action]:
    """Split an action on many rows; the parts keep its number, and it is done when the last part is."""
    for start in range(0, max(1, len(action.ids)), budget):
        yield replace(action, ids=action.ids[start : start + budget])


AGREE_APART = (
    "`--plan --remove-foreign` shows all of them; to remove them, run the same command with "
    "`--remove-foreign` (plain Ansible: with `-e atlantis_remove_foreign=true`); `--yes` is not enough"
)


def find_missing_consent(job: _job.DeviceJob, plan: _types.Plan) -> str:
    """Return why the plan needs a separate consent that was not given; empty if it may continue."""
    return msg(
        ""
        if job.remove_foreign or not plan.foreign_words
        else f"nobody has confirmed that it {arg(plan.foreign_words)}"
    )


def number_of(plan: _types.Plan) -> str:
    """Return the size of a plan as text: actions, and rows if an action covers several."""
    number, rows = len(plan.actions), plan.weight
    words = msg(f"{arg(number)} action{'s' if number != 1 else ''}")
    return words if rows == number else msg(f"{arg(words)} on {arg(rows)} rows")


def build_journal_action(action: _types.Action) -> runs.PlannedAction:
    """Convert an action to its journal entry, secrets masked."""
    return runs.PlannedAction(
        number=action.number,
        layer=action.layer.name.lower(),
        menu=action.menu,
        verb=action.verb.value,
        subject=action.subject,
        ids=action.ids,
        values=action.get_masked_values(),
    )


def mask_secrets(text: str, actions: Iterable[_types.Action]) -> str:
    """Mask the plan's secrets in a text from the device, in case it repeats one."""
    for action in actions:
        for name, value in action.values:
            if name in action.secrets and value:
                text = text.replace(value, MASK)
    return text


def record_outcome(
    job: _job.DeviceJob, result: _job.DeviceResult, read: _types.Observation | None
) -> _job.DeviceResult:
    """Record the outcome, and save the state `read` back, for the dating of drift and for a replacement device.

    If the journal cannot be written, the result says so and is not successful.
    """
    outcome = runs.Outcome(
        device=result.name,
        status=result.status,
        exit=int(result.exit),
        message=result.message,
        open=result.left_open,
    )
    if read is not None:
        try:
            job.journal.confirm(job.name, partial(_state, job, read))
        except runs.JournalError as failure:
            # The state is missing for drift and for a replacement; the outcome itself may still be recorded.
            if str(failure) not in result.message:
                result = replace(result, notes=(*result.notes, str(failure)))
    return runs.mark_unrecorded(result, runs.conclude(job.journal, outcome))


def _state(job: _job.DeviceJob, read: _types.Observation) -> str:
    """Return the state as text; a bug in here must not hide that the device itself succeeded."""
    try:
        return snapshot.write(job.name, job.desired_state, read)
    except Exception as fault:
        why = msg(f"provision failed with an internal error ({arg(type(fault).__name__)})")
        raise runs.JournalError(f"the confirmed state cannot be written: {arg(why)}") from fault


IsOver = Callable[[str], bool]

_WORDS = {
    scheduler_jobs.DEAD_MAN: "rolls back what that run changed",
    scheduler_jobs.PAIR: "rolls this end of the bridge back if the link is lost",
}


@dataclass(frozen=True, slots=True)
class Leftovers:
    """Armed jobs, run markers and safe mode found on one device; false if there are none.

    Every observation reads them in its single batch, also if nothing is to be changed. A plan and drift report them. A
    run removes leftovers of finished runs after it has read that the device is in the desired state; what may be in use
    is left alone. Only a run that sees both ends of a bridge removes the job `atlantis-pair`. Only runs of this
    computer are known to be finished: one run at a time may change a site, and that one is ours.
    """

    safe_mode: str | None = None
    """Session that holds safe mode; None: nobody."""
    markers: tuple[RunMarker, ...] = ()
    jobs: tuple[scheduler_jobs.ArmedJob, ...] = ()

    def __bool__(self) -> bool:
        return self.safe_mode is not None or bool(self.markers or self.jobs)

    def words(self) -> tuple[str, ...]:
        """Return one sentence per leftover."""
        return tuple(difference.row for difference in self.differences())

    def differences(self) -> tuple[drift.Difference, ...]:
        """Return one difference per leftover, in the form of the drift report."""
        return tuple(self._differences())

    def _differences(self) -> Iterator[drift.Difference]:
        if self.safe_mode is not None:
            words = msg(f"{arg(self.safe_mode)} holds safe mode, which only one session can hold")
            yield _open_difference("/safe-mode", "safe mode", drift.Owner.SESSION, words)
        for sign in self.markers:
            words = msg(f"{arg(sign.text)} is active on this device, or was interrupted there")
            yield _open_difference("/ip firewall address-list", "atlantis-run", drift.Owner.RUN, words)
        for job in self.jobs:
            yield _open_difference("/system scheduler", job.name, drift.Owner.RUN, _describe_job(job))

    def alive(self, is_over: IsOver, *, bridge: bool = True) -> str | None:
        """Describe a job that may belong to an active run; for a single device, also one that belongs to a bridge."""
        alive = (job for job in self.jobs if not is_over(job.owner) or (job.name == scheduler_jobs.PAIR and not bridge))
        return next(map(_describe_job, alive), None)

    def find_job(self, name: str) -> scheduler_jobs.ArmedJob | None:
        """Return the job of this name; None if there is none."""
        return next((job for job in self.jobs if job.name == name), None)

    async def remove(self, session: Channel) -> tuple[str, ...]:
        """Remove jobs and markers, check that they are gone, and return what was removed.

        The caller has read that nobody uses them, and reads the device again afterwards: a job may have run meanwhile.
        Raises DeviceError.
        """
        for job in self.jobs:
            await scheduler_jobs.disarm(session, job.id)
        if self.markers:
            removed_ids = [sign.id for sign in self.markers]
            *_, reply = await session.flight([*map(withdrawing, removed_ids), CLAIMS])
            reply = reply if not reply.rows else await session.command(CLAIMS)
            if any(row.get(".id") in removed_ids for row in reply.rows):
                raise DeviceError("the marker of a finished run cannot be removed")
        jobs = (msg(f"the job {arg(job.name)} of {arg(job.owner)}") for job in self.jobs)
        return (*jobs, *(msg(f"the marker of {arg(sign.text)}") for sign in self.markers))


def find_leftovers(observation: _types.Observation) -> Leftovers:
    """Return the leftovers in an observation."""
    return Leftovers(
        observation.facts.safe_mode_owner, find_markers(observation), scheduler_jobs.jobs_of(observation.jobs)
    )


def _describe_job(job: scheduler_jobs.ArmedJob) -> str:
    return msg(f"the job {arg(job.name)} of {arg(job.owner)} is armed, and {arg(_WORDS[job.name])}")


def _open_difference(menu: str, subject: str, owner: drift.Owner, words: str) -> drift.Difference:
    return drift.Difference(
        menu, subject, drift.DriftKind.OPEN, owner, row=words, why_unknown="the device gives no reason"
    )


_STAGES = {
    _job.Status.UNCHANGED: Stage.DONE,
    _job.Status.CHANGED: Stage.CONFIRMED,
    _job.Status.PLANNED: Stage.DONE,
    _job.Status.DRIFTED: Stage.DONE,
    _job.Status.ROLLED_BACK: Stage.UNROLLED,
}


@dataclass(slots=True)
class RunContext:
    """State of a run on one device; each step reads it and records its results here."""

    job: _job.DeviceJob
    contact: Contact
    start_time: float
    restores: bool = False
    """This run restores an old state after another run failed: it is not protected, and not rolled back itself."""
    session: Channel | None = None
    """The session that changes the device; None before the first contact and after a loss."""
    before: _types.Observation | None = None
    after: _types.Observation | None = None
    """State read by the verifying session."""
    brief: bool = False
    """Thousands of foreign rows are read in short form: this run needs no more of them."""
    leftovers: Leftovers = field(default_factory=Leftovers)
    """Armed jobs and open safe mode found when the device was read."""
    plan: _types.Plan | None = None
    examination: Examination = field(default_factory=Examination)
    """Result of the device's own parser for the plan."""
    comparison: drift.Comparison | None = None
    estimate: Estimate | None = None
    stages: Stages = field(default_factory=Stages)
    writer: Writer | None = None
    choice: ProtectionChoice = field(default_factory=lambda: ProtectionChoice(Protection.NONE))
    safe_mode: SafeMode = field(default_factory=NoSafeMode)
    script: str | None = None
    """Rollback script for a dead-man job."""
    dead_man: scheduler_jobs.DeadMan | None = None
    early: tuple[Reply, ...] = ()
    """Replies to the requests before the first change, if they came with safe mode; nothing was sent since."""
    sign: str | None = None
    """`.id` of the run marker: ours, or that of a dead run that we have taken over."""
    busy: str = ""
    """Other users or runs active on the device, or their leftovers."""
    last_look: _types.PortCounts | None = None
    """Port counters read together with the release; after it only small requests follow."""
    holding: bool = False
    """Safe mode was requested and may be ours."""
    owner: str = ""
    """Name of our session on the device while we hold safe mode."""
    has_sent_changes: bool = False
    """A change was sent: the device may have executed it."""
    acknowledged_numbers: set[int] = field(default_factory=set)
    confirmed_count: int = 0
    notes: list[str] = field(default_factory=list)

    @property
    def protection(self) -> Protection:
        """Mechanism that undoes an unfinished change."""
        return self.choice.protection

    @property
    def signer(self) -> RunSigner:
        """The run marker that this run places on the device."""
        return RunSigner(self.job, self.before.facts.session_address if self.before is not None else "")

    @property
    def counts(self) -> tuple[_types.PortCounts, ...]:
        """First and last reading of the port counters."""
        looks = [
            look for observation in (self.before, self.after) if observation is not None for look in observation.counts
        ]
        looks += [self.last_look] if self.last_look is not None else []
        return (looks[0], looks[-1]) if looks else ()

    @property
    def channel(self) -> Channel:
        """The open session. Raises RuntimeError if there is none."""
        if self.session is None:
            raise RuntimeError("no session is open")
        return self.session

    @property
    def observation(self) -> _types.Observation:
        """The device before the run. Raises RuntimeError if it was not read."""
        if self.before is None:
            raise RuntimeError("the device has not been read")
        return self.before

    @property
    def aim(self) -> _types.Plan:
        """The plan. Raises RuntimeError if there is none."""
        if self.plan is None:
            raise RuntimeError("nothing is planned")
        return self.plan

    @property
    def complete(self) -> bool:
        """True if every action was sent and acknowledged by the device."""
        return self.acknowledged_numbers >= {action.number for action in self.aim.actions}

    def say(self, stage: Stage, message: str, limit_s: float = 0.0) -> None:
        """Send a progress event to the subscriber."""
        total = len(self.plan.actions) if self.plan is not None else 0
        data = {"acknowledged": len(self.acknowledged_numbers)}
        self.job.events(Event(self.job.name, stage, message, self.confirmed_count, total, data, limit_s))

    def record(self, record: runs.Record) -> None:
        """Write a record to disk. Raises JournalError."""
        self.job.journal.write(record)

    def note(self, record: runs.Record) -> None:
        """Write a record to disk if possible; the reported event has happened in any case."""
        with suppress(runs.JournalError):
            self.job.journal.write(record)

    def clean(self, text: str) -> str:
        """Mask the plan's secrets in a text from the device, in case it repeats one."""
        return mask_secrets(text, self.plan.actions if self.plan is not None else ())

    def result(self, status: _job.Status, message: str, *, hint: str | None = None) -> _job.DeviceResult:
        """Build the result of the run."""
        traffic, plan = self.contact.traffic, self.plan
        return _job.DeviceResult(
            name=self.job.name,
            status=status,
            exit=status.exit,
            message=fill_hint(self.clean(message), site=self.job.site, device=self.job.name),
            hint=hint and fill_hint(hint, site=self.job.site, device=self.job.name),
            planned_count=len(plan.actions) if plan is not None else 0,
            rows=plan.weight if plan is not None else 0,
            foreign_words=plan.foreign_words if plan is not None else "",
            confirmed_count=self.confirmed_count,
            diff=plan.diff if plan is not None else "",
            drift=plan.drift if plan is not None else (),
            comparison=self.comparison,
            notes=(*(plan.notes if plan is not None else ()), *self.notes, *self.contact.notes),
            estimate=self.estimate,
            plan_hash=plan_hash(plan) if plan is not None else "",
            protection=self.protection.value,
            protection_words=self.choice.words,
            round_trips=traffic.round_trips,
            sent_bytes=traffic.sent_bytes,
            received_bytes=traffic.received_bytes,
            seconds=asyncio.get_running_loop().time() - self.start_time,
            facts=self.before.facts if self.before is not None else None,
            sessions=traffic.connections,
            counts=self.counts,
            busy=self.busy,
        )

    def marker_removal(self) -> tuple[Command, ...]:
        """Return the command that removes the marker, sent with the last request; then call `note_marker_removed`."""
        return () if self.sign is None else (withdrawing(self.sign),)

    def note_marker_removed(self, farewell: Sequence[Command]) -> None:
        """Record that the marker was removed, if that was requested."""
        if farewell:
            self.sign = None

    def finish(self, result: _job.DeviceResult) -> _job.DeviceResult:
        """Record and report the result; if the journal cannot be written, the result says so."""
        read = {_job.Status.UNCHANGED: self.before, _job.Status.CHANGED: self.after}.get(result.status)
        whole = self.plan is not None and not self.job.desired_state.partial
        result = record_outcome(self.job, result, read if whole else None)
        self.say(_STAGES.get(result.status, Stage.FAILED), result.message)
        return result
