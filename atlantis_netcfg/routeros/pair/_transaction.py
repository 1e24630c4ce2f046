"""Both ends changed as one: far end first, each under its own rollback, kept only after both were verified.

The order of keeping makes sure that a crash between any two steps leaves both ends old or both new. The far end is
released, its scheduler job still armed (it would check the link). The near end is released. The job is removed.
Limitations: without the job (device-mode) a crash between the two releases leaves only the far end new. With the job,
this happens only if the laptop loses power at that moment, since the near end notices after nine minutes and the job
has checked before. `resume` then changes the near end as well.
"""

from __future__ import annotations

import asyncio
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from atlantis_netcfg import runs
from atlantis_netcfg.core.errors import DeviceError, NetcfgError
from atlantis_netcfg.core.events import Stage
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.routeros import safe_mode, scheduler_jobs
from atlantis_netcfg.routeros.apply import _state
from atlantis_netcfg.routeros.apply._inverse import CannotInvert, inverse
from atlantis_netcfg.routeros.apply._protection import InterferenceError
from atlantis_netcfg.routeros.apply._scripts import output, scripts
from atlantis_netcfg.routeros.commands import script_command
from atlantis_netcfg.routeros.pair import _end
from atlantis_netcfg.routeros.pair._radio import level_dbm, registrations

if TYPE_CHECKING:
    from collections.abc import Sequence

    from atlantis_netcfg.routeros._types import Action
    from atlantis_netcfg.routeros.api import Reply
    from atlantis_netcfg.routeros.apply import Channel, DeviceResult

SAFE_MODE = safe_mode.ApiSafeMode(silence_s=20.0)
"""For replies at the end: the link has just worked, and the far end's job will soon check it."""


class LinkGone(DeviceError):
    """The link did not come back in time, or not with the required properties."""


class Refusal(DeviceError):
    """The device refused an action."""


@dataclass(slots=True)
class Transaction:
    """The forward part of a transaction; `_back` is the rollback."""

    pair: _end.Pair
    near: _end.End
    far: _end.End
    is_linked: bool = False
    """The far end was reached after its change."""
    deadline: float = 0.0
    """Loop time at which the near end is rolled back, even if steps are missing."""
    fires: float = 0.0
    """Loop time by which the far end has rolled back by itself, if it is never reached again."""
    unseen: DeviceResult | None = None
    """Result for the far end that could not be read, because the bridge does not exist yet; else None."""
    _answer: asyncio.Task[list[Reply]] | None = None
    _anew: dict[str, Channel] = field(default_factory=dict)

    @property
    def ends(self) -> tuple[_end.End, _end.End]:
        """Both ends, far end first."""
        return self.far, self.near

    async def forward(self) -> None:
        """Run the whole transaction; on return, both ends are read back and permanent. Raises NetcfgError."""
        for end in self.ends:
            end.announce()
            await self._save(end)
        await self._protect()
        await self._change_far()
        await self.change_near()
        await self._prove()
        await self._keep()

    # --- before ----------------------------------------------------------------------------------------------------

    async def _save(self, end: _end.End) -> None:
        saved_export = _state.parse_export(*await end.channel.flight(_state.SAVING))
        text = saved_export.text if saved_export.text is not None else await _state.fetch(end.channel)
        end.job.journal.save(end.name, text)

    async def _protect(self) -> None:
        now = asyncio.get_running_loop().time()
        self.deadline = now + self.pair.link_timeout_s - self.pair.reserve_s
        self.fires = now + safe_mode.DEAD_SESSION_S
        if self.far.actions:
            await self._arm()
        for end in self.ends:
            if end.actions:
                await self._take_safe_mode(end)
        await self._see_job()

    async def protect_near(self) -> None:
        """Save the near end and take its safe mode, for a change of that end alone."""
        self.near.announce()
        await self._save(self.near)
        await self._take_safe_mode(self.near)

    async def _take_safe_mode(self, end: _end.End) -> None:
        try:
            end.owner = (await safe_mode.ApiSafeMode().take(end.channel)).who
        except safe_mode.SafeModeUnavailable as unavailable:
            raise safe_mode.SafeModeUnavailable(f"{arg(end.name)}: {arg(unavailable)}", hint=unavailable.hint) from None
        end.protection = "safe-mode and a job of the scheduler" if end.job_id else "safe-mode"
        self._record_protection(end)

    async def _see_job(self) -> None:
        """Check that the far end's job still exists: another run that assumed this one dead would have removed it."""
        far = self.far
        if far.job_id and not any(
            row.get(".id") == far.job_id for row in (await far.channel.command(scheduler_jobs.READ_JOBS)).rows
        ):
            far.job_id = ""
            raise InterferenceError(f"{arg(far.name)}: the scheduler job has run, or another run has removed it")

    async def _arm(self) -> None:
        """Arm the far end's scheduler job that restores its radio; if impossible, report the consequence."""
        far, near = self.far, self.near.radio(after=False)
        radio, why = far.radio(after=False), scheduler_jobs.forbidden(far.observation.facts) or ""
        try:
            rollback = inverse(far.observation, far.aim, with_secrets=True)
        except CannotInvert as reason:
            why = why or msg(f"there is no rollback script ({arg(reason)})")
        if not why and radio is not None and near is not None:
            try:
                text = scheduler_jobs.pair_script(radio.menu, near.mac, rollback)
                far.record(runs.SignRecord(device=far.name, sign=far.signer.text))
                far.arms = True
                far.job_id = await scheduler_jobs.arm_pair(far.channel, text, far.signer.text, self.pair.link_timeout_s)
            except scheduler_jobs.JobConflict:
                raise
            except DeviceError as failed:
                why = str(failed)
            else:
                self.fires = asyncio.get_running_loop().time() + self.pair.link_timeout_s
                return
        far.notes.append(
            msg(
                f"if its link fails, {arg(far.name)} needs about nine minutes to roll back by itself: no scheduler job "
                f"can do it sooner, {arg(why or 'it has no radio')}"
            )
        )

    def _record_protection(self, end: _end.End) -> None:
        job = msg(f", and a scheduler job after {arg(self.pair.link_timeout_s):.0f} s" if end.job_id else "")
        end.record(runs.ProtectionRecord(device=end.name, how=end.protection))
        end.say(Stage.PROTECTED, msg(f"this end rolls back by itself: safe mode{arg(job)}"))

    # --- changing --------------------------------------------------------------------------------------------------

    async def _change_far(self) -> None:
        """Write the far end; its last script may cut the link before the reply."""
        far = self.far
        if not far.actions:
            return
        await self._write(far, far.safe_actions)
        if not far.disruptive_actions:
            return
        self._announce(far, far.disruptive_actions)
        patience_s = self.pair.link_timeout_s + safe_mode.DEAD_SESSION_S
        commands = [script_command(_script(far.disruptive_actions)), safe_mode.READ]
        self._answer = asyncio.create_task(far.channel.flight(commands, silence_s=patience_s))
        finished_tasks, _ = await asyncio.wait({self._answer}, timeout=self.pair.grace_s)
        if finished_tasks:
            self._read_far_replies(await self._answer)
        else:
            far.say(Stage.WAITING, "its radio was changed, the link is down", patience_s)

    async def change_near(self) -> None:
        """Write the near end, whose replies come over the cable."""
        await self._write(self.near, self.near.actions)

    async def _write(self, end: _end.End, actions: Sequence[Action]) -> None:
        for text, inside in scripts(actions):
            self._announce(end, inside)
            reply, holder = await end.channel.flight([script_command(text), safe_mode.READ])
            self._record_acknowledgement(end, inside, reply, holder)

    def _announce(self, end: _end.End, actions: Sequence[Action]) -> None:
        layers = " ".join(dict.fromkeys(action.layer.name.lower() for action in actions))
        end.record(runs.LayerSent(device=end.name, layer=layers, actions=tuple(action.number for action in actions)))
        end.has_sent_changes = True

    def _read_far_replies(self, replies: Sequence[Reply]) -> None:
        self._record_acknowledgement(self.far, self.far.disruptive_actions, *replies)

    def _record_acknowledgement(self, end: _end.End, actions: Sequence[Action], reply: Reply, holder: Reply) -> None:
        result = output(reply.ret or "")
        end.note(runs.ActionAcknowledgement(device=end.name, actions=result.acknowledged_numbers))
        if reply.trap is not None or list(result.acknowledged_numbers) != [action.number for action in actions]:
            words = reply.trap.message if reply.trap is not None else result.words
            raise Refusal(f"{arg(end.name)} refused an action: {arg(words or 'it stopped without a message')}")
        if not safe_mode.Holder.of(holder).ours:
            raise safe_mode.ProtectionLost(f"{arg(end.name)}: safe mode was lost in the middle of the change")
        end.say(Stage.APPLYING, msg(f"{arg(len(result.acknowledged_numbers))} actions sent"))

    # --- proving ---------------------------------------------------------------------------------------------------

    async def _prove(self) -> None:
        """Read both ends in new sessions, far end first, before the deadline. Raises LinkGone, StateMismatch."""
        try:
            async with asyncio.timeout_at(self.deadline):
                await self._prove_end(self.far)
                self.is_linked = True
                if self._answer is not None:
                    self._read_far_replies(await self._answer)
                await self._prove_end(self.near)
                await self._prove_radio()
        except TimeoutError:
            timeout_s = self.pair.link_timeout_s - self.pair.reserve_s
            raise LinkGone(f"the link was not back and verified within {arg(timeout_s):.0f} s") from None

    async def _prove_end(self, end: _end.End) -> None:
        end.say(Stage.VERIFYING, "verifying in a new session")
        left_s = max(0.0, self.deadline - asyncio.get_running_loop().time())
        while True:
            session = await end.contact.reach(left_s, "verifying", insist=False)
            try:
                now = await end.reread(session)
            except DeviceError:
                await end.contact.leave(session)
                await asyncio.sleep(end.job.patience.first_poll_s)
                continue
            break
        end.compare(now)
        self._anew[end.name] = session
        end.record(runs.VerificationRecord(device=end.name, state=_state.digest(now)))

    async def _prove_radio(self) -> None:
        """Check that each end is in the other's registration table, with a level within the limits."""
        for end, other in ((self.far, self.near), (self.near, self.far)):
            radio, peer = end.radio(after=True), other.radio(after=True)
            if radio is None or peer is None:
                raise _end.StateMismatch(f"{arg(end.name)} no longer has a radio")
            rows = (await self._anew[end.name].command(registrations(radio.menu))).check().rows
            row = next((row for row in rows if row.get("mac-address", "").upper() == peer.mac.upper()), None)
            if row is None:
                raise LinkGone(f"{arg(other.name)} is not registered with the radio of {arg(end.name)}")
            _judge_level(end, level_dbm(row), self.pair.signal)

    # --- keeping ---------------------------------------------------------------------------------------------------

    async def _keep(self) -> None:
        """Release far end, then near end, then remove the far end's job (see above)."""
        if asyncio.get_running_loop().time() > self.deadline:
            raise LinkGone("time ran out before the change could be kept")
        await self._see_job()
        for end in self.ends:
            if end.actions:
                await self.release(end, end.channel)
        await self.defuse(self._anew[self.far.name])

    async def release(self, end: _end.End, session: Channel) -> None:
        """Make one end permanent. Raises ProtectionLost, SessionLost: then it is unknown whether it is."""
        end.record(runs.Releasing(device=end.name))
        end.is_released = True
        try:
            await SAFE_MODE.release_of(session, end.owner)
        except safe_mode.ProtectionLost as lost:
            raise safe_mode.ProtectionLost(f"{arg(end.name)}: {arg(lost)}") from lost
        end.is_kept = True
        end.owner = ""
        end.record(runs.ReleaseRecord(device=end.name))

    async def defuse(self, session: Channel) -> None:
        """Remove the far end's job if this run may have armed one; the reply to the arming may have been lost."""
        far = self.far
        if not far.arms:
            return
        for job in scheduler_jobs.jobs_of((await session.command(scheduler_jobs.READ_JOBS)).check().rows):
            if job.name == scheduler_jobs.PAIR and job.owner == far.signer.text:
                await scheduler_jobs.disarm(session, job.id)
        far.job_id, far.arms = "", False

    async def forget_answer(self) -> None:
        """Stop waiting for the far end's reply; this ends its first session."""
        answer, self._answer = self._answer, None
        if answer is None:
            return
        answer.cancel()
        with suppress(asyncio.CancelledError, NetcfgError):
            await answer

    def can_use_first_session(self) -> bool:
        """Return True if the far end's first session is still usable."""
        return self._answer is None or (
            self._answer.done() and not self._answer.cancelled() and self._answer.exception() is None
        )


def _script(actions: Sequence[Action]) -> str:
    """Return the actions as one script. Raises DeviceError if that is not possible."""
    parts = list(scripts(actions))
    if len(parts) > 1:
        raise DeviceError("the change is too long for one script, and a radio must be changed in one step")
    return parts[0][0]


def _judge_level(end: _end.End, level: float | None, bounds: _end.Signal | None) -> None:
    if level is None or bounds is None:
        return
    if not bounds.weakest_dbm <= level <= bounds.strongest_dbm:
        raise LinkGone(
            f"{arg(end.name)} receives the other end at {arg(level):.0f} dBm, not between "
            f"{arg(bounds.weakest_dbm):.0f} and {arg(bounds.strongest_dbm):.0f}"
        )
