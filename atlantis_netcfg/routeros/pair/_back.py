"""After a failure: the near end is rolled back at once, the far end on its own; then wait and read both.

Only what was read from both counts. If the near end turns out to be permanent (its release was executed, only the reply
was lost), the far end must keep its change, too. In every other case both must be as before.
"""

from __future__ import annotations

import asyncio
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import DeviceError, NetcfgError
from atlantis_netcfg.core.events import Stage
from atlantis_netcfg.core.messages import arg, conjunction, msg
from atlantis_netcfg.routeros import apply, scheduler_jobs
from atlantis_netcfg.routeros.api import Unreachable
from atlantis_netcfg.routeros.apply._state import restore_target
from atlantis_netcfg.routeros.pair._end import End, StateMismatch
from atlantis_netcfg.routeros.safe_mode import DEAD_SESSION_S, ApiSafeMode
from atlantis_netcfg.runs import NoJournal, ReleaseRecord

if TYPE_CHECKING:
    from atlantis_netcfg.routeros.pair._transaction import Transaction


_QUICK_S = 10.0
"""Timeout for an optional reply."""


async def roll_back(work: Transaction, reason: NetcfgError) -> tuple[apply.DeviceResult, apply.DeviceResult]:
    """End a transaction that failed for `reason`; return the results of near and far end."""
    for end in work.ends:
        end.say(Stage.FAILED, end.clean(str(reason)))
    return await _WayBack(work, reason).go()


@dataclass(slots=True)
class _WayBack:
    work: Transaction
    reason: NetcfgError

    async def go(self) -> tuple[apply.DeviceResult, apply.DeviceResult]:
        near, far = self.work.near, self.work.far
        if not (near.has_sent_changes or far.has_sent_changes):
            await self._let_go(near)
            await self._let_go(far)
            await self._no_job()
            return self._untouched_result(near), self._untouched_result(far)
        if self.work.is_linked and not far.is_released:
            await self._let_go(far)
        is_near_kept = await self._near()
        if is_near_kept is None:
            return self._unknown_result(near), self._unknown_result(far)
        if is_near_kept:
            return await self._forward()
        result = await self._far()
        if far.is_released and result.status is apply.Status.UNKNOWN:
            return await self._after_all()
        return self._near_result(), result

    # --- the near end ----------------------------------------------------------------------------------------------

    async def _near(self) -> bool | None:
        """Roll the near end back. True: its change is already permanent; None: unknown."""
        near = self.work.near
        if self.work.far.is_kept and await self._follow(near):
            return True
        await self._let_go(near)
        if not near.has_sent_changes:
            return False if near.actions or not self.work.far.is_released else None
        outcome = await self._wait_until_settled(near, near.job.patience.reach_s)
        if outcome is None:
            return None
        session, different_menus = outcome
        if different_menus and near.is_released and await self._is_declared(near, session):
            return True
        return False if not different_menus else await self._put_back(near)

    async def _follow(self, near: End) -> bool:
        """Release the near end, too, in a new session, if still possible, as the far end is kept."""
        try:
            session = await near.contact.reach(self.work.pair.reserve_s, "keeping the change")
            if near.owner:
                await self.work.release(near, session)
            return await self._is_declared(near, session)
        except NetcfgError:
            return False

    def _near_result(self) -> apply.DeviceResult:
        near = self.work.near
        return near.rolled_back(str(self.reason)) if near.has_sent_changes else self._untouched_result(near)

    # --- the far end -----------------------------------------------------------------------------------------------

    async def _far(self) -> apply.DeviceResult:
        """Wait until the far end has rolled back on its own, and report its state."""
        far, work = self.work.far, self.work
        await self._let_go(far)
        if not far.has_sent_changes:
            await self._no_job()
            return self._untouched_result(far)
        clock = asyncio.get_running_loop().time
        patience_s = max(0.0, work.fires - clock()) + far.job.patience.reach_s
        far.say(
            Stage.WAITING,
            msg(f"it rolls back by itself within {arg(max(0.0, work.fires - clock())):.0f} s"),
            patience_s,
        )
        outcome = await self._wait_until_settled(far, patience_s, returning=True)
        if outcome is None:
            return self._unknown_result(far)
        _, different_menus = outcome
        if different_menus and not await self._put_back(far):
            return self._unknown_result(far)
        await self._no_job()
        return far.rolled_back(str(self.reason))

    async def _forward(self) -> tuple[apply.DeviceResult, apply.DeviceResult]:
        """Make sure that the far end keeps its change, as the near end's change is permanent."""
        near, far = self.work.near, self.work.far
        words = msg(f"as in the inventory: {arg(len(near.actions))} actions read back, although: {arg(self.reason)}")
        outcome = await self._wait_until_settled(far, self.work.pair.link_timeout_s + far.job.patience.reach_s)
        if outcome is not None and await self._is_declared(far, outcome[0]):
            if not await self._defuse_far(outcome[0]):
                return near.confirm(words), self._unknown_result(far)
            return near.confirm(words), far.confirm(words) if far.actions else self._untouched_result(far)
        if await self._put_back(near):
            result = await self._far()
            return near.rolled_back(str(self.reason)), result
        return self._unknown_result(near), self._unknown_result(far)

    async def _after_all(self) -> tuple[apply.DeviceResult, apply.DeviceResult]:
        """Apply the change to the near end again, as the far end has kept its change."""
        near, far = self.work.near, self.work.far
        result = await apply.converge(
            replace(near.job, agreed_hash=None, journal=NoJournal()), mode=apply.JobMode.RESUME
        )
        if result.status is not apply.Status.CHANGED:
            return self._unknown_result(near), self._unknown_result(far)
        return await self._forward()

    # --- both ------------------------------------------------------------------------------------------------------

    async def _let_go(self, end: End) -> None:
        """Undo safe mode over the first session if it still responds; else close it, so that the device notices."""
        session, end.session = end.session, None
        silent = end is self.work.far and not self.work.can_use_first_session()
        if silent:
            await self.work.forget_answer()
        if session is None:
            return
        if end.owner and not silent:
            with suppress(NetcfgError, TimeoutError):
                async with asyncio.timeout(_QUICK_S):
                    await ApiSafeMode(_QUICK_S).unroll(session)
        await end.contact.leave(session)

    async def _wait_until_settled(
        self, end: End, patience_s: float, *, returning: bool = False
    ) -> tuple[apply.Channel, tuple[str, ...]] | None:
        """Wait until nobody holds an end's safe mode; return a session and the menus that differ from before.

        `returning`: its own rollback may still be about to happen, so repeat until that is over.
        """
        clock = asyncio.get_running_loop().time
        until = clock() + patience_s
        final = until + end.job.patience.undo_s
        while clock() < final:
            try:
                session = await end.contact.reach(max(0.0, until - clock()), "after a failure")
                current = await end.contact.until_free(ApiSafeMode(), session, end.job.patience.undo_s)
                different_menus = end.same(await end.reread(session))
            except DeviceError:
                if clock() >= until:
                    return None
                await asyncio.sleep(end.job.patience.first_poll_s)
                continue
            if current.is_taken:
                return None
            if not different_menus or not returning or not end.job_id or clock() > self.work.fires + _QUICK_S:
                return session, different_menus
            await end.contact.leave(session)
            await asyncio.sleep(end.job.patience.last_poll_s)
        return None

    async def _is_declared(self, end: End, session: apply.Channel) -> bool:
        try:
            end.compare(await end.reread(session))
        except (StateMismatch, DeviceError):
            return False
        end.note(ReleaseRecord(device=end.name))
        return True

    async def _put_back(self, end: End) -> bool:
        """Restore the state observed before, like any other change; return True on success."""
        end.say(Stage.APPLYING, "restoring the state before the run")
        job = replace(end.job, desired_state=restore_target(end.observation), journal=NoJournal(), agreed_hash=None)
        await apply.converge(job, mode=apply.JobMode.RESUME)
        outcome = await self._wait_until_settled(end, end.job.patience.reach_s)
        return outcome is not None and not outcome[1]

    async def _defuse_far(self, session: apply.Channel) -> bool:
        """Remove the far end's job, with as many sessions as necessary; return True if it is still as desired."""
        far, clock = self.work.far, asyncio.get_running_loop().time
        until = clock() + far.job.patience.reach_s
        while True:
            try:
                await self.work.defuse(session)
                return await self._is_declared(far, session)
            except DeviceError:
                if clock() >= until:
                    return False
                await asyncio.sleep(far.job.patience.first_poll_s)
            with suppress(DeviceError):
                session = await far.contact.reach(max(0.0, until - clock()), "removing its job")

    async def _no_job(self) -> None:
        """Remove the far end's job; on failure, it removes itself after its check."""
        far = self.work.far
        if not far.arms:
            return
        try:
            session = await far.contact.reach(_QUICK_S, "removing its job")
            await self.work.defuse(session)
        except DeviceError:
            far.notes.append(
                msg(f"its scheduler job {arg(scheduler_jobs.PAIR)} is still there, and disappears after it has run")
            )

    def _untouched_result(self, end: End) -> apply.DeviceResult:
        if not end.actions:
            return end.report_unchanged()
        hint = getattr(self.reason, "hint", None)
        result = end.result(apply.Status.LEFT_AS_FOUND, msg(f"nothing was changed: {arg(self.reason)}"), hint=hint)
        return replace(result, was_reached=not isinstance(self.reason, Unreachable))

    def _unknown_result(self, end: End) -> apply.DeviceResult:
        site = self.work.near.job.site  # the one that was asked for; from there both ends are reached
        return end.result(
            apply.Status.UNKNOWN,
            msg(f"the outcome is unknown: {arg(self.reason)}"),
            hint=msg(
                "each end rolls back by itself what was not kept, within ten minutes if its link is lost; then:  "
                f"`provision recover resume site={arg(site)}`"
            ),
        )


BackResults = tuple["apply.DeviceResult", "apply.DeviceResult"]


async def clear(work: Transaction, mode: apply.JobMode) -> BackResults | None:
    """Remove what is armed or open on both ends, and read both again; return results if the run must end.

    A job `atlantis-pair` rolls its end back if the link is lost. It is removed once both ends are in the desired state
    and nobody holds their safe mode; from then on both stay. If only its own end has the new radio settings it has to
    run, since the other one has rolled back. In every other case the following run plans from what it reads, and arms
    its own job.
    """
    reason = _in_use(work, mode)
    if reason:
        return _build_stop_results(work, reason)
    if any(_has_to_run(work, end) for end in work.ends):
        await _until_run(work)
        results = await read_again(work) or _stopped_if(work, _in_use(work, mode))
        if results is not None:
            return results
    try:
        for end in work.ends:
            current = await ApiSafeMode().look(end.channel)
            if current.is_taken:
                return _build_stop_results(
                    work, msg(f"{arg(end.name)}: {arg(current.who)} holds safe mode, which only one session can hold")
                )
        for end in work.ends:
            if end.leftovers:
                end.removed_items = await end.leftovers.remove(end.channel)
                end.notes.append(msg(f"removed {arg(conjunction(end.removed_items))}"))
    except DeviceError as failure:
        return _build_stop_results(work, str(failure))
    return await read_again(work) or _stopped_if(work, _in_use(work, mode))


async def wait_for_return(work: Transaction) -> None:
    """After a killed run, wait until both ends have rolled back on their own."""
    for end in work.ends:
        try:
            session = await end.contact.reach(DEAD_SESSION_S + work.pair.link_timeout_s, "rolling back by itself")
            await end.contact.until_free(ApiSafeMode(), session, end.job.patience.undo_s)
            await end.contact.leave(session)
        except DeviceError:
            continue


def _in_use(work: Transaction, mode: apply.JobMode) -> str:
    """Return what may belong to an active run; empty if nothing does.

    If the bridge is in the desired state, a job alone does not count. A run that is active there holds safe mode, or
    has changed nothing yet and notices that its job is gone.
    """
    is_as_desired = not any(end.actions for end in work.ends)
    for end in work.ends:
        other = end.signer.other(end.leftovers.markers)
        if end.leftovers.safe_mode is not None:
            return msg(
                f"{arg(end.name)}: {arg(end.leftovers.safe_mode)} holds safe mode, which only one session can hold"
            )
        if other is not None:
            return msg(f"{arg(end.name)}: {arg(other.text)} is active on this device, or was interrupted there")
        alive = end.leftovers.alive(end.signer.is_over)
        if alive is not None and mode is not apply.JobMode.RESUME and not is_as_desired:
            return msg(f"{arg(end.name)}: {arg(alive)}")
    return ""


def _has_to_run(work: Transaction, end: End) -> bool:
    """Return True if an end's job has to run: only this end was changed, or it is one device's dead-man job."""
    if not end.leftovers.jobs or not any(each.actions for each in work.ends):
        return False
    other = work.near if end is work.far else work.far
    return end.leftovers.find_job(scheduler_jobs.DEAD_MAN) is not None or (
        other.changes_radio and not end.changes_radio
    )


async def _until_run(work: Transaction) -> None:
    """Wait until no job is armed; the link may go down and up meanwhile."""
    for end in work.ends:
        patience = end.job.patience
        with suppress(DeviceError):
            if end.leftovers.jobs:
                longest_s = max(2 * work.pair.link_timeout_s, patience.undo_s + 2 * patience.dead_man_s)
                await end.contact.until_fired(end.channel, scheduler_jobs.READ_JOBS, longest_s)
    await wait_for_return(work)


async def read_again(work: Transaction) -> BackResults | None:
    """Read both ends in new sessions; return results if that fails."""
    near, far = await asyncio.gather(work.near.problem(), work.far.problem())
    if near is None and far is None:
        return None
    site = work.near.job.site
    return (
        near or _left_between(work.near, site, msg(f"{arg(work.far.name)} is not ready")),
        far or _left_between(work.far, site, msg(f"{arg(work.near.name)} is not ready")),
    )


def _stopped_if(work: Transaction, why: str) -> BackResults | None:
    return _build_stop_results(work, why) if why else None


def _build_stop_results(work: Transaction, why: str) -> BackResults:
    return _left_between(work.near, work.near.job.site, why), _left_between(work.far, work.near.job.site, why)


def _left_between(end: End, site: str, why: str) -> apply.DeviceResult:
    """Return a result without changes; `site` is the requested site, from which both ends are reachable."""
    hint = msg(
        "let them finish, then run the same command again; if a run of ours was interrupted there:  `provision "
        f"recover resume site={arg(site)}`"
    )
    return end.result(apply.Status.LEFT_AS_FOUND, msg(f"nothing was changed: {arg(why)}"), hint=hint)
