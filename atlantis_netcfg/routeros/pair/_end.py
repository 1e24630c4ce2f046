"""One end of the pair during its transaction: what was read, planned and sent.

Also here: the input for the two ends of a radio bridge.
"""

from __future__ import annotations

import asyncio
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from atlantis_netcfg import runs
from atlantis_netcfg.core import errors
from atlantis_netcfg.core.events import Event, Stage
from atlantis_netcfg.core.messages import arg, conjunction, join, msg
from atlantis_netcfg.core.versions import Version
from atlantis_netcfg.routeros import apply, guard, planner
from atlantis_netcfg.routeros.apply import _state, _work
from atlantis_netcfg.routeros.apply._change import find_missing_requirements
from atlantis_netcfg.routeros.apply._contact import Contact, choose_variant
from atlantis_netcfg.routeros.apply._job import Unfit
from atlantis_netcfg.routeros.commands import Examination
from atlantis_netcfg.routeros.estimate import estimate
from atlantis_netcfg.routeros.observe import MenuMissing, observe
from atlantis_netcfg.routeros.pair import _radio

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.routeros import _types


_LIST_LIMIT = 3
_SAFE_MODE = Version(7, 18)
"""First version with safe mode over the API."""
_STAGES = {
    apply.Status.UNCHANGED: Stage.DONE,
    apply.Status.CHANGED: Stage.CONFIRMED,
    apply.Status.ROLLED_BACK: Stage.UNROLLED,
}


class StateMismatch(errors.DeviceError):
    """The state read back is not the desired one: the change must be rolled back."""


@dataclass(slots=True)
class End:
    """A device and the progress of its part of the transaction."""

    job: apply.DeviceJob
    contact: Contact
    radio_name: str
    start_time: float
    session: apply.Channel | None = None
    """The first session, which holds safe mode; None once it is known to be lost."""
    before: _types.Observation | None = None
    plan: _types.Plan | None = None
    examination: Examination = field(default_factory=Examination)
    """Result of the device's own parser for the plan."""
    after: _types.Observation | None = None
    """The state of the device as read back, without remaining actions."""
    owner: str = ""
    """Name of our session on the device while we hold its safe mode; empty: we do not hold it."""
    job_id: str = ""
    """`.id` of the scheduler job that restores its radio; empty: no job."""
    arms: bool = False
    """A rollback job was sent, and may be armed."""
    leftovers: _work.Leftovers = field(default_factory=_work.Leftovers)
    """Armed jobs and open safe mode found when the device was read."""
    removed_items: tuple[str, ...] = ()
    """Leftovers of a finished run that this run has removed."""
    confirmed_count: int = 0
    """Actions that were read back and are permanent."""
    has_sent_changes: bool = False
    is_released: bool = False
    """The change is permanent, or may be."""
    is_kept: bool = False
    """The change is permanent, as confirmed by the device."""
    protection: str = "none"
    notes: list[str] = field(default_factory=list)

    @property
    def name(self) -> str:
        """The device's name."""
        return self.job.name

    @property
    def observation(self) -> _types.Observation:
        """The device before the transaction. Raises RuntimeError if it was not read."""
        if self.before is None:
            raise RuntimeError(f"{self.name} has not been read")
        return self.before

    @property
    def aim(self) -> _types.Plan:
        """The plan. Raises RuntimeError if there is none."""
        if self.plan is None:
            raise RuntimeError(f"{self.name} has not been planned")
        return self.plan

    @property
    def actions(self) -> tuple[_types.Action, ...]:
        """The planned actions; empty without a plan."""
        return self.plan.actions if self.plan is not None else ()

    @property
    def channel(self) -> apply.Channel:
        """The first session. Raises DeviceError once it is closed."""
        if self.session is None:
            raise errors.DeviceError(f"the session with {arg(self.name)} was lost")
        return self.session

    @property
    def safe_actions(self) -> tuple[_types.Action, ...]:
        """The actions before the first that may interrupt the link."""
        number = next((at for at, action in enumerate(self.actions) if _radio.drops_link(action)), len(self.actions))
        return self.actions[:number]

    @property
    def disruptive_actions(self) -> tuple[_types.Action, ...]:
        """The remaining actions, from the first one that may interrupt the link."""
        return self.actions[len(self.safe_actions) :]

    @property
    def changes_radio(self) -> bool:
        """True if the plan may interrupt the link."""
        return _radio.touches_radio(self.actions)

    def radio(self, *, after: bool) -> _radio.PairRadio | None:
        """Return the bridge's radio as it is, or as after the plan."""
        rows = (
            planner.simulate(self.observation.rows, self.plan)
            if after and self.plan is not None
            else self.observation.rows
        )
        return _radio.radio_of(rows, self.radio_name)

    @property
    def signer(self) -> _state.RunSigner:
        """The identity of this run: for the job it arms, and for the leftovers it may remove."""
        return _state.RunSigner(self.job, self.observation.facts.session_address)

    # --- reading ---------------------------------------------------------------------------------------------------

    async def read(self) -> None:
        """Open the first session, read everything and plan. Raises CannotPlan, MenuMissing, Unfit, DeviceError."""
        self.say(Stage.CONNECTING, msg(f"to {arg(self.job.endpoint)}"), self.job.endpoint.connect_timeout_s)
        self.session = await self.contact.open()
        self.job = await choose_variant(self.session, self.job)
        self.before = await observe(
            self.session, self.job.endpoint, self.job.desired_state.menus, (*guard.MENUS, *_radio.MENUS)
        )
        self.leftovers = _work.find_leftovers(self.before)
        facts = self.before.facts
        self.record(
            runs.DeviceObservation(
                device=self.name, version=str(facts.version), identity=facts.identity, state=_state.digest(self.before)
            )
        )
        self.plan = planner.plan(self.name, self.job.desired_state, self.before)
        while commands := self.examination.questions(self.actions, self.before.rows):
            self.examination.read_answers(await self.session.flight(commands))
        if (doubt := self.examination.doubt(self.actions)) and doubt not in self.notes:
            self.notes.append(doubt)
        self.say(Stage.PLANNED, msg(f"{arg(len(self.actions))} actions" if self.actions else "nothing to change"))

    async def problem(self, mode: apply.JobMode = apply.JobMode.APPLY) -> apply.DeviceResult | None:
        """Read in a new first session, which replaces the old one; return the result if that fails."""
        session, self.session = self.session, None
        if session is not None:
            await self.contact.leave(session)
        try:
            await self.read()
        except (planner.CannotPlan, MenuMissing, Unfit) as refusal:
            return self.result(apply.Status.REFUSED, str(refusal), hint=refusal.hint)
        except errors.NetcfgError as failure:
            what = "could not be read" if mode is apply.JobMode.PLAN else "nothing was changed"
            return self.result(apply.Status.LEFT_AS_FOUND, msg(f"{arg(what)}: {arg(failure)}"), hint=failure.hint)
        return None

    def refusals(self) -> Iterator[str]:
        """Yield the reasons why this end's plan must not be applied."""
        facts, path = self.observation.facts, self._path()
        if self.plan is None or not self.actions:
            return
        yield from guard.objections(self.plan, self.observation, path)
        yield from find_missing_requirements(self.plan, self.observation)
        yield from self.examination.objections(self.actions, self.job.desired_state.source)
        if not facts.has_safe_mode:
            yield msg(
                f"RouterOS {arg(facts.version)} has no safe mode over the API; {arg(_SAFE_MODE)} and later have it"
            )
        if facts.safe_mode_owner is not None:
            yield msg(f"{arg(facts.safe_mode_owner)} holds safe mode, which only one session can hold")
        yield from self._too_dear(self.plan)
        if apart := _work.find_missing_consent(self.job, self.plan):
            yield apart
        if self.job.agreed_hash is not None and self.job.agreed_hash != _state.plan_hash(self.plan):
            yield "the device has changed since the plan was shown; check the new plan and confirm it"

    def hint(self) -> str | None:
        """Return the remedy for a refusal, if there is a single one."""
        facts = self.observation.facts
        if not facts.has_safe_mode and self.actions:
            return facts.upgrade(_SAFE_MODE)
        return _work.AGREE_APART if self.plan is not None and _work.find_missing_consent(self.job, self.plan) else None

    def _too_dear(self, current_plan: _types.Plan) -> Iterator[str]:
        """Yield the cost refusal, estimated for this end alone; waiting for each other costs a few round trips more."""
        job = self.job
        if job.cost_policy is None or job.link is None:
            return
        cost = estimate(current_plan, job.link, self.observation)
        refusal = job.cost_policy.judge(self.observation, cost, spends=True, is_plan=False).refusal
        if refusal is not None:
            yield refusal

    def _path(self) -> guard.ManagementPath:
        job, facts = self.job, self.observation.facts
        return guard.ManagementPath(facts.session_address, job.address or job.endpoint.host, user=job.endpoint.user)

    async def reread(self, session: apply.Channel) -> _types.Observation:
        """Read the same menus as before the transaction, in another session. Raises SessionLost."""
        return await observe(session, self.job.endpoint, self.job.desired_state.menus, tuple(self.observation.rows))

    def compare(self, now: _types.Observation) -> None:
        """Check that nothing remains to be done. Raises StateMismatch."""
        try:
            remaining_actions = planner.plan(self.name, self.job.desired_state, now).actions
        except planner.CannotPlan as problem:
            raise StateMismatch(
                f"no plan can be made for the new state of {arg(self.name)}: {arg(problem)}"
            ) from problem
        if remaining_actions:
            names = join("; ", (f"{action.verb} {action.subject}" for action in remaining_actions[:_LIST_LIMIT]))
            raise StateMismatch(f"{arg(self.name)} did not keep everything; still to do: {arg(names)}")
        unused_rows = [
            row for row in _state.find_invalid_rows(now) if row not in _state.find_invalid_rows(self.observation)
        ]
        if unused_rows:
            raise StateMismatch(
                f"{arg(self.name)} accepted these rows but does not use them: "
                f"{arg(join('; ', unused_rows[:_LIST_LIMIT]))}"
            )
        self.after = now

    def same(self, now: _types.Observation) -> tuple[str, ...]:
        """Return the menus in which the device differs from before."""
        return _state.differing_menus(self.observation, now)

    # --- telling ---------------------------------------------------------------------------------------------------

    def say(self, stage: Stage, message: str, limit_s: float = 0.0) -> None:
        """Send a progress event to the subscriber."""
        event = Event(self.name, stage, message, self.confirmed_count, len(self.actions), limit_s=limit_s)
        self.job.events(event)

    def record(self, record: runs.Record) -> None:
        """Write a record to disk. Raises JournalError."""
        self.job.journal.write(record)

    def note(self, record: runs.Record) -> None:
        """Write a record to disk if possible; the reported event has happened in any case."""
        with suppress(runs.JournalError):
            self.job.journal.write(record)

    def announce(self) -> None:
        """Record the plan in the journal."""
        if self.plan is not None:
            actions = tuple(map(_work.build_journal_action, self.actions))
            self.record(runs.PlanRecord(device=self.name, plan=_state.plan_hash(self.plan), actions=actions))

    def confirm(self, message: str) -> apply.DeviceResult:
        """Record and return that the desired state is permanent."""
        numbers = tuple(action.number for action in self.actions)
        self.note(runs.ActionConfirmation(device=self.name, actions=numbers))
        self.confirmed_count = len(numbers)
        return self.result(apply.Status.CHANGED, message)

    def rolled_back(self, why: str) -> apply.DeviceResult:
        """Record and return that the device was rolled back."""
        self.note(runs.RollbackRecord(device=self.name, reason=self.clean(why)))
        return self.result(apply.Status.ROLLED_BACK, msg(f"rolled back, the device is as before: {arg(why)}"))

    def report_unchanged(self) -> apply.DeviceResult:
        """Return the result of an end without changes, with the leftovers of earlier runs that were removed."""
        if not self.removed_items:
            return self.result(apply.Status.UNCHANGED, "no changes needed")
        self.after = self.observation
        return self.result(
            apply.Status.CHANGED, msg(f"as in the inventory; removed {arg(conjunction(self.removed_items))}")
        )

    def result(self, status: apply.Status, message: str, *, hint: str | None = None) -> apply.DeviceResult:
        """Build the result of this end."""
        traffic, now = self.contact.traffic, asyncio.get_running_loop().time()
        return apply.DeviceResult(
            name=self.name,
            status=status,
            exit=status.exit,
            message=errors.fill_hint(self.clean(message), site=self.job.site, device=self.name),
            hint=hint and errors.fill_hint(hint, site=self.job.site, device=self.name),
            planned_count=len(self.actions),
            rows=self.plan.weight if self.plan is not None else 0,
            foreign_words=self.plan.foreign_words if self.plan is not None else "",
            confirmed_count=self.confirmed_count,
            diff=self.plan.diff if self.plan is not None else "",
            drift=self.plan.drift if self.plan is not None else (),
            notes=(*(self.plan.notes if self.plan is not None else ()), *self.notes, *self.contact.notes),
            plan_hash=_state.plan_hash(self.plan) if self.plan is not None else "",
            protection=self.protection,
            round_trips=traffic.round_trips,
            sent_bytes=traffic.sent_bytes,
            received_bytes=traffic.received_bytes,
            seconds=now - self.start_time,
            facts=self.before.facts if self.before is not None else None,
            sessions=traffic.connections,
        )

    def clean(self, text: str) -> str:
        """Mask the plan's secrets in a text from the device, in case it repeats one."""
        return _work.mask_secrets(text, self.actions)

    def finish(self, result: apply.DeviceResult) -> apply.DeviceResult:
        """Record and report the result; if the journal cannot be written, the result says so."""
        read = {apply.Status.UNCHANGED: self.before, apply.Status.CHANGED: self.after}.get(result.status)
        result = _work.record_outcome(self.job, result, read if self.plan is not None else None)
        self.say(_STAGES.get(result.status, Stage.FAILED), result.message)
        return result


@dataclass(frozen=True, slots=True)
class Signal:
    """Limits of a healthy signal level, in dBm; too strong a signal also disturbs a receiver."""

    weakest_dbm: float = -75.0
    strongest_dbm: float = -20.0


@dataclass(frozen=True, slots=True)
class Pair:
    """The ends of one bridge, seen from the technician: `far` is reached through `near`'s radio."""

    near: apply.DeviceJob
    far: apply.DeviceJob
    near_radio: str = ""
    """Factory name (`wlan1`); empty: the first radio of the device."""
    far_radio: str = ""
    link_timeout_s: float = 300.0
    """Declared timeout for the verified return of the link after the first change; then both ends roll back.

        It must cover the wait for radar (60 s on DFS channels, 10 min at 5600 to 5650 MHz), association and
        reading back.
    """
    reserve_s: float = 30.0
    """Part of that time for verifying and releasing: the near end rolls back this much earlier than the far end."""
    grace_s: float = 5.0
    """Timeout for the far end's reply to its radio change: the link may be lost before the reply."""
    signal: Signal | None = None
    """Checked at both ends before release; None: registration is sufficient."""

    @property
    def name(self) -> str:
        """Both names, near end first."""
        return msg(f"{arg(self.near.name)} and {arg(self.far.name)}")
