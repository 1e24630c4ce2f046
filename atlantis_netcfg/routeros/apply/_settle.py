"""After a failure: read the device, and make sure that it is in the old or in the desired state.

Only what is read back counts. Safe mode of a dead session is never released: we wait until the device has undone it.
"""

from __future__ import annotations

import asyncio
from dataclasses import replace
from typing import TYPE_CHECKING

from atlantis_netcfg import runs
from atlantis_netcfg.core.errors import DeviceError, NetcfgError
from atlantis_netcfg.core.events import Stage
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.routeros import api, scheduler_jobs
from atlantis_netcfg.routeros._types import Observation, Verb
from atlantis_netcfg.routeros.apply import _protection
from atlantis_netcfg.routeros.apply._change import VerificationError, change
from atlantis_netcfg.routeros.apply._job import DeviceResult, Status
from atlantis_netcfg.routeros.apply._state import differing_menus, find_invalid_rows, restore_target
from atlantis_netcfg.routeros.apply._work import RunContext, split_plan
from atlantis_netcfg.routeros.apply._writer import ActionError
from atlantis_netcfg.routeros.observe import observe
from atlantis_netcfg.routeros.planner import CannotPlan, plan
from atlantis_netcfg.routeros.safe_mode import Holder, ProtectionLost

if TYPE_CHECKING:
    from atlantis_netcfg.routeros.api._values import Channel

_LIST_LIMIT = 5


async def settle(work: RunContext, reason: NetcfgError) -> DeviceResult:
    """Determine and report the result of a run that failed for `reason`."""
    work.say(Stage.FAILED, work.clean(str(reason)))
    if not work.has_sent_changes:
        free = await undo_safe_mode(work) and await _disarm_unused(work)
        hint = reason.hint if free else _resume_hint(work)
        result = work.result(Status.LEFT_AS_FOUND, msg(f"nothing was changed: {arg(reason)}"), hint=hint)
        return replace(result, left_open=not free, was_reached=not isinstance(reason, api.Unreachable))
    try:
        return await _read_back(work, reason)
    except NetcfgError as lost:
        return _unknown_result(work, msg(f"{arg(reason)}; then: {arg(lost)}"))
    except Exception as fault:  # noqa: BLE001 - a fault of ours in here must not hide that the device was changed
        unknown = _unknown_result(
            work, msg(f"{arg(reason)}; then provision failed with an internal error ({arg(type(fault).__name__)})")
        )
        return replace(unknown, fault=fault)


async def undo_safe_mode(work: RunContext) -> bool:
    """Undo what is in our safe mode; return False if safe mode may still be held.

    If nothing was written, it is released instead: another user may have changed something meanwhile.
    """
    session = work.session
    if not work.holding:
        return True
    if session is None:
        await work.safe_mode.drop()
        return False
    try:
        if work.has_sent_changes:
            await work.safe_mode.unroll(session)
        elif (await work.safe_mode.look(session)).ours:
            await work.safe_mode.release(session, ())
    except (api.SessionLost, api.CommandError, ProtectionLost):
        # The device undoes it by itself as soon as it knows that the session is over.
        work.session = None
        await work.safe_mode.drop()
        await work.contact.leave(session)
        return False
    work.holding = False
    return True


async def _disarm_unused(work: RunContext) -> bool:
    """Remove the dead-man job if nothing was written; return False if it may still run, which has no effect."""
    if work.dead_man is None:
        return True
    for session in (work.session, None):
        try:
            work.session = session or await work.contact.reach(work.job.patience.reach_s, "after a lost connection")
            await _disarm_ours(work, work.dead_man.id)
        except api.SessionLost:
            continue
        except NetcfgError:
            return False
        work.dead_man = None
        return True
    return False


async def _disarm_ours(work: RunContext, job: str) -> None:
    """Remove our dead-man job; without its id, search for it, since it may not exist."""
    armed_jobs = (
        scheduler_jobs.jobs_of((await work.channel.command(scheduler_jobs.READ_JOBS)).check().rows) if not job else ()
    )
    ours = [each.id for each in armed_jobs if each.name == scheduler_jobs.DEAD_MAN and each.owner == work.signer.text]
    for each in [job] if job else ours:
        await scheduler_jobs.disarm(work.channel, each)


async def _read_back(work: RunContext, reason: NetcfgError) -> DeviceResult:
    await undo_safe_mode(work)
    while True:
        result = await _decide(work, reason)
        if work.dead_man is None or result.status is Status.UNKNOWN or await _disarm_dead_man(work):
            return result


async def _disarm_dead_man(work: RunContext) -> bool:
    """Remove the dead-man job; return False if it had already run, as the device must then be read again."""
    job = work.dead_man
    if job is None:
        return True
    session, _, _ = (work.session, None, None) if work.session is not None else await _state(work)
    if session is None:
        raise DeviceError("no session is left to remove the dead-man job")
    in_time, _ = await scheduler_jobs.disarm(session, job.id)
    work.dead_man = None
    return in_time


async def _decide(work: RunContext, reason: NetcfgError) -> DeviceResult:
    session, holder, now = await _state(work)
    changed_menus = differing_menus(work.observation, now)
    if not changed_menus:
        return _rolled_back_result(work, reason)
    if holder.is_taken:
        return _unknown_result(
            work,
            msg(
                f"{arg(reason)}; {arg(holder.who)} still holds safe mode, and the device differs in "
                f"{arg(_list_menus(changed_menus))}"
            ),
        )
    if _is_declared(work, reason, now) and await _is_reachable(work):
        work.after = now
        return _finish_as_desired(work, reason)
    if isinstance(reason, _protection.InterferenceError) or _is_foreign(work, now):
        return _unknown_result(
            work,
            msg(
                f"{arg(reason)}; somebody else has changed {arg(_list_menus(changed_menus))}, which was left unchanged"
            ),
        )
    if work.restores:
        return _unknown_result(work, msg(f"{arg(reason)}; the device differs in {arg(_list_menus(changed_menus))}"))
    return await _restore_state(work, reason, session, now)


def _is_foreign(work: RunContext, now: Observation) -> bool:
    """Return True if more remains to be changed than was planned: then somebody else has changed the device.

    Moves are ignored: a half-written first-match menu may also need them.
    """
    try:
        remaining_actions = plan(work.job.name, work.job.desired_state, now).actions
    except CannotPlan:
        return False
    planned_subjects = {(action.menu, action.subject) for action in work.aim.actions}
    return any(
        (action.menu, action.subject) not in planned_subjects
        for action in remaining_actions
        if action.verb is not Verb.MOVE
    )


async def _state(work: RunContext) -> tuple[Channel, Holder, Observation]:
    """Read the device once safe mode is free, with as many sessions as necessary."""
    patience, clock = work.job.patience, asyncio.get_running_loop().time
    until = clock() + patience.reach_s + patience.undo_s
    while True:
        try:
            session = work.session or await work.contact.reach(patience.reach_s, "after a lost connection")
            work.session = session
            holder = await work.contact.until_free(work.safe_mode, session, patience.undo_s)
            now = await observe(session, work.job.endpoint, work.job.desired_state.menus, tuple(work.observation.rows))
        except api.SessionLost:
            work.session = None
            if clock() >= until:
                raise
            await asyncio.sleep(patience.first_poll_s)
        else:
            return session, holder, now


def _is_declared(work: RunContext, reason: NetcfgError, now: Observation) -> bool:
    """Return True if the device is in the desired state and the change may stay."""
    if isinstance(reason, (VerificationError, ActionError)):
        return False
    try:
        remaining_actions = plan(work.job.name, work.job.desired_state, now).actions
    except CannotPlan:
        return False
    return not remaining_actions and not set(find_invalid_rows(now)) - set(find_invalid_rows(work.observation))


async def _is_reachable(work: RunContext) -> bool:
    """Verify in a new session that the device is reachable: access must not depend on the writing session."""
    try:
        session = await work.contact.reach(work.job.patience.verify_s, "testing access in a new session", insist=False)
    except DeviceError:
        return False
    await work.contact.leave(session, wait=False)
    return True


def _finish_as_desired(work: RunContext, reason: NetcfgError) -> DeviceResult:
    work.confirmed_count = len(work.aim.actions)
    work.note(
        runs.ActionConfirmation(device=work.job.name, actions=tuple(action.number for action in work.aim.actions))
    )
    return work.result(
        Status.CHANGED,
        msg(f"as in the inventory: {arg(_count(work))} read back, although: {arg(reason)}"),
        hint=reason.hint,
    )


def _rolled_back_result(work: RunContext, reason: NetcfgError, how: str = "rolled back") -> DeviceResult:
    work.note(runs.RollbackRecord(device=work.job.name, reason=work.clean(str(reason))))
    return work.result(Status.ROLLED_BACK, msg(f"{arg(how)}, the device is as before: {arg(reason)}"), hint=reason.hint)


def _unknown_result(work: RunContext, message: str) -> DeviceResult:
    return work.result(Status.UNKNOWN, msg(f"outcome unknown: {arg(message)}"), hint=_resume_hint(work))


def _resume_hint(work: RunContext) -> str:
    if work.dead_man is not None:
        what = msg(
            f"the dead-man job rolls everything back within {arg(work.dead_man.after_s / 60):.0f} minutes after it was "
            "armed"
        )
    else:
        what = "the device undoes changes in safe mode by itself, within ten minutes if the link is lost"
    run = f" run={work.job.run}" if work.job.run else ""
    return msg(f"{arg(what)}; then:  provision recover resume site={arg(work.job.site)}{arg(run)}")


async def _restore_state(work: RunContext, reason: NetcfgError, session: Channel, now: Observation) -> DeviceResult:
    """Restore the state observed at the start, with the same protection as any other change."""
    work.say(Stage.APPLYING, "restoring the state before the run")
    job = replace(work.job, desired_state=restore_target(work.observation), journal=runs.NoJournal(), agreed_hash=None)
    inner = RunContext(job, work.contact, work.start_time, restores=True, session=session, before=now)
    inner.choice = work.choice if work.protection.holds else _protection.ProtectionChoice(_protection.Protection.NONE)
    inner.safe_mode = _protection.safe_mode_of(inner.choice, job)
    try:
        inner.plan = plan(job.name, job.desired_state, now)
        inner.stages = split_plan(inner.plan, inner.protection)
        await change(inner)
    except NetcfgError as failed:
        outcome = await settle(inner, failed)
        if outcome.status is not Status.CHANGED:
            return await _await_dead_man(work, reason, outcome.message)
    different_menus = differing_menus(work.observation, inner.after or now)
    if different_menus:
        return _unknown_result(
            work,
            msg(f"{arg(reason)}; the old state was restored, but {arg(_list_menus(different_menus))} still differ"),
        )
    return _rolled_back_result(work, reason, "restored by us")


async def _await_dead_man(work: RunContext, reason: NetcfgError, failure_message: str) -> DeviceResult:
    """Wait until an armed dead-man job has run, since our own restore failed."""
    job = work.dead_man
    if job is not None:
        left_s = max(0.0, job.over - asyncio.get_running_loop().time())
        work.say(Stage.WAITING, "waiting until the dead-man job has rolled everything back", left_s)
        await asyncio.sleep(left_s)
        _, _, now = await _state(work)
        if not differing_menus(work.observation, now):
            return _rolled_back_result(work, reason, "rolled back by the dead-man job")
    return _unknown_result(work, msg(f"{arg(reason)}; restoring the old state failed: {arg(failure_message)}"))


def _list_menus(menus: tuple[str, ...]) -> str:
    more = msg(f" and {arg(len(menus) - _LIST_LIMIT)} more menus" if len(menus) > _LIST_LIMIT else "")
    return join(", ", menus[:_LIST_LIMIT]) + more


def _count(work: RunContext) -> str:
    number = len(work.aim.actions)
    return msg(f"{arg(number)} action{'s' if number != 1 else ''}")
