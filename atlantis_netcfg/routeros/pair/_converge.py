"""A pair from first contact to result: observe, plan, check and change both ends as one.

Also here: the near end alone, after a run that died when only the far end was kept, so that the near end has to follow.
Only `resume` does so, and only if the far end is not reachable. The near end is changed under its own safe mode, and
kept if the far end then responds over the new link; if not, it is rolled back.
"""

from __future__ import annotations

import asyncio
from dataclasses import replace

from atlantis_netcfg.core import errors
from atlantis_netcfg.core.events import Stage
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.routeros import apply
from atlantis_netcfg.routeros.api import Traffic
from atlantis_netcfg.routeros.apply._contact import Contact, completed_despite_stop
from atlantis_netcfg.routeros.pair._back import clear, read_again, roll_back, wait_for_return
from atlantis_netcfg.routeros.pair._end import End, Pair
from atlantis_netcfg.routeros.pair._radio import disagreements
from atlantis_netcfg.routeros.pair._transaction import SAFE_MODE, Transaction
from atlantis_netcfg.routeros.safe_mode import BUDGET, DEAD_SESSION_S


async def follow(work: Transaction) -> apply.DeviceResult | None:
    """Change the near end to match the far end; return None if kept, else the result."""
    near, far = work.near, work.far
    near.say(
        Stage.WAITING,
        msg(f"{arg(far.name)} cannot be reached: {arg(near.name)} is changed to match the inventory, too"),
    )
    try:
        await work.protect_near()
        await work.change_near()
        far.session = await far.contact.reach(work.pair.link_timeout_s, "after changing the near end")
        await work.release(near, near.channel)
    except errors.NetcfgError as failure:
        return await _back(
            work, msg(f"{arg(far.name)} did not respond after {arg(near.name)} was changed to match it: {arg(failure)}")
        )
    return None


async def _back(work: Transaction, why: str) -> apply.DeviceResult:
    """Roll the near end back, and report the state read afterwards."""
    near = work.near
    try:
        session = near.channel
        await SAFE_MODE.unroll(session)
        different_menus = near.same(await near.reread(session))
    except errors.NetcfgError as lost:
        return near.result(apply.Status.UNKNOWN, msg(f"outcome unknown: {arg(why)}; then: {arg(lost)}"))
    if different_menus:
        return near.result(
            apply.Status.UNKNOWN, msg(f"outcome unknown: {arg(why)}; differences in {arg(join(', ', different_menus))}")
        )
    return near.rolled_back(why)


Results = tuple["apply.DeviceResult", "apply.DeviceResult"]

_CONNECT_S = 15.0
"""Timeout of one attempt: the link comes and goes during the wait, so attempts are frequent."""


async def converge_pair(pair: Pair, *, mode: apply.JobMode = apply.JobMode.APPLY) -> Results:
    """Bring both ends to their desired states, or report why not: results of near and far end.

    If no radio is changed, both are ordinary runs, far end first. The near end's run is also ordinary while its radio
    is off and the far end is not reachable: a new bridge is set up end by end, each over its own cable. A result
    includes all sessions with its end, whoever opened them.
    """
    near_sessions: list[Traffic] = []
    far_sessions: list[Traffic] = []
    pair = replace(pair, near=_count_sessions(pair.near, near_sessions), far=_count_sessions(pair.far, far_sessions))
    near, far = await _converge_both(pair, mode)
    return _with_cost(near, near_sessions), _with_cost(far, far_sessions)


def _count_sessions(job: apply.DeviceJob, sessions: list[Traffic]) -> apply.DeviceJob:
    return replace(job, endpoint=replace(job.endpoint, opening=sessions.append))


def _with_cost(result: apply.DeviceResult, sessions: list[Traffic]) -> apply.DeviceResult:
    cost = Traffic.total(sessions)
    return replace(
        result,
        round_trips=cost.round_trips,
        sent_bytes=cost.sent_bytes,
        received_bytes=cost.received_bytes,
        sessions=cost.connections,
    )


async def _converge_both(pair: Pair, mode: apply.JobMode) -> Results:
    if mode not in (apply.JobMode.PLAN, apply.JobMode.APPLY, apply.JobMode.RESUME, apply.JobMode.ROLLBACK):
        return await _one_by_one(pair, mode)
    start_time = asyncio.get_running_loop().time()
    near, far = (
        End(job, Contact(job), radio, start_time)
        for job, radio in (
            (_limit_connect_timeout(pair.near), pair.near_radio),
            (_limit_connect_timeout(pair.far), pair.far_radio),
        )
    )
    work = Transaction(pair, near, far)
    try:
        results = await _stoppable(work, mode)
    except BaseException:
        await _close(work)
        raise
    results, is_stopped = await completed_despite_stop(_end(work, results))
    if results is not None:
        return results
    if is_stopped:
        return apply.stopped_before_turn(near.name), apply.stopped_before_turn(far.name)
    return await _one_by_one(pair, mode, work)


async def _end(work: Transaction, results: Results | None) -> Results | None:
    try:
        return None if results is None else (work.near.finish(results[0]), work.far.finish(results[1]))
    finally:
        await _close(work)


async def _close(work: Transaction) -> None:
    await work.forget_answer()
    for end in (work.near, work.far):
        await end.contact.close()


async def _stoppable(work: Transaction, mode: apply.JobMode) -> Results | None:
    """Run the pair as one; if interrupted before both ends were read, nothing was changed."""
    try:
        return await _run(work, mode)
    except asyncio.CancelledError:
        if (task := asyncio.current_task()) is not None:
            task.uncancel()
        if all(end.before is not None for end in work.ends):
            return await roll_back(work, errors.DeviceError("stopped by the user"))
        near, far = (
            end.result(apply.Status.LEFT_AS_FOUND, "nothing was changed: stopped by the user")
            for end in (work.near, work.far)
        )
        return near, far


def _limit_connect_timeout(job: apply.DeviceJob) -> apply.DeviceJob:
    endpoint = replace(job.endpoint, connect_timeout_s=min(job.endpoint.connect_timeout_s, _CONNECT_S))
    return replace(job, endpoint=endpoint)


async def _one_by_one(pair: Pair, mode: apply.JobMode, work: Transaction | None = None) -> Results:
    """Run ordinary runs, far end first, so that a failure there does not affect the near end."""
    if work is not None and work.unseen is not None:
        near = await apply.converge(pair.near, mode=mode)
        return replace(near, notes=(*near.notes, _single_end_notice(pair))), work.far.finish(work.unseen)
    far = await apply.converge(pair.far, mode=mode)
    near = apply.stopped_before_turn(pair.near.name) if far.is_stopped else await apply.converge(pair.near, mode=mode)
    if work is not None:
        near, far = (_add_notes(work, end, each) for end, each in ((work.near, near), (work.far, far)))
    return near, far


def _add_notes(work: Transaction, end: End, result: apply.DeviceResult) -> apply.DeviceResult:
    """Add the pair's notes to the result of an end that was run alone."""
    notes = [_pair_notice(work.pair)] if any(each.changes_radio for each in work.ends) else []
    notes += [msg(f"removed {arg(what)}") for what in end.removed_items]
    return replace(result, notes=(*result.notes, *notes))


def _single_end_notice(pair: Pair) -> str:
    return msg(
        f"the radio of {arg(pair.near.name)} was off and {arg(pair.far.name)} cannot be reached: only "
        f"{arg(pair.near.name)} is changed. After {arg(pair.far.name)} has been set up over its own cable, run this "
        "again: only then is the bridge verified"
    )


def _pair_notice(pair: Pair) -> str:
    return msg(
        f"{arg(pair.name)} change together, far end first; if the link is not back within "
        f"{arg(pair.link_timeout_s):.0f} s both roll back by themselves (where the far end's scheduler may not run, "
        f"within {arg(DEAD_SESSION_S / 60):.0f} min)"
    )


async def _run(work: Transaction, mode: apply.JobMode) -> Results | None:
    """Run the pair as one; return None if two ordinary runs are sufficient."""
    results = await _read(work, mode)
    if results is not None or work.unseen is not None:
        return results
    has_leftovers = any(end.leftovers for end in work.ends)
    if has_leftovers and mode is not apply.JobMode.PLAN:
        results = await clear(work, mode)
        if results is not None:
            return results
    if not any(end.actions for end in work.ends) and not (has_leftovers and mode is apply.JobMode.PLAN):
        return work.near.report_unchanged(), work.far.report_unchanged()
    if not any(end.changes_radio for end in work.ends):
        return None
    refusal = _refusal(work, mode)
    if refusal:
        text = msg(f"refused, nothing was changed: {arg(refusal)}")
        near, far = (end.result(apply.Status.REFUSED, text, hint=end.hint()) for end in (work.near, work.far))
        return near, far
    return None if mode is apply.JobMode.PLAN else await _run_forward(work)


async def _read(work: Transaction, mode: apply.JobMode) -> Results | None:
    """Read and plan both ends; return results if one end cannot be read or planned."""
    if mode is apply.JobMode.RESUME:
        await wait_for_return(work)
    problems = await asyncio.gather(*(end.problem(mode) for end in (work.near, work.far)))
    if not any(problems):
        return None
    near, far = problems
    if (
        near is None
        and far is not None
        and mode in (apply.JobMode.PLAN, apply.JobMode.APPLY)
        and _is_new(work.near, far)
    ):
        work.unseen = far
        return None
    if mode is apply.JobMode.RESUME and near is None and far is not None and work.near.changes_radio:
        return await _handle_unreachable_far(work, far)
    return (
        near or _unchanged_result(work.near, msg(f"cannot read its other end {arg(work.far.name)}")),
        far or _unchanged_result(work.far, msg(f"cannot read its other end {arg(work.near.name)}")),
    )


def _is_new(near: End, far: apply.DeviceResult) -> bool:
    """Return True if there is no bridge yet that could be lost."""
    radio = near.radio(after=False)
    return far.status is apply.Status.LEFT_AS_FOUND and radio is not None and radio.get("disabled") in ("yes", "true")


async def _handle_unreachable_far(work: Transaction, far_result: apply.DeviceResult) -> Results:
    """Handle an unreachable far end, which may have been kept alone: follow it, then continue with both."""
    near = work.near
    refusal = join("; ", near.refusals())
    if refusal:
        return near.result(
            apply.Status.REFUSED, msg(f"refused, nothing was changed: {arg(refusal)}"), hint=near.hint()
        ), far_result
    failure = await follow(work)
    if failure is not None:
        return failure, far_result
    near_result = _success_result(near)
    stop_results = await read_again(work) or (
        await clear(work, apply.JobMode.RESUME) if any(end.leftovers for end in work.ends) else None
    )
    return near_result, stop_results[1] if stop_results is not None else _unchanged_result(
        work.far, "run the same command again"
    )


def _unchanged_result(end: End, why: str) -> apply.DeviceResult:
    if end.leftovers:
        why = join("; ", (why, *end.leftovers.words()))
    elif not end.actions:
        return end.report_unchanged()
    return end.result(apply.Status.LEFT_AS_FOUND, msg(f"nothing was changed: {arg(why)}"))


def _refusal(work: Transaction, mode: apply.JobMode) -> str:
    names = (work.near.name, work.far.name)
    conflicts = disagreements(work.near.radio(after=True), work.far.radio(after=True), names)
    reasons = [msg(f"the two ends would not connect: {arg(join('; ', conflicts))}")] if conflicts else []
    if mode is not apply.JobMode.PLAN:
        reasons += [msg(f"{arg(end.name)}: {arg(why)}") for end in work.ends for why in end.refusals()]
    reasons += [
        msg(
            f"{arg(end.name)}: {arg(end.plan.weight)} rows change, but safe mode can undo only {arg(BUDGET)}: make the "
            "change in two steps"
        )
        for end in work.ends
        if end.plan is not None and end.plan.weight > BUDGET
    ]
    return join("; ", reasons)


async def _run_forward(work: Transaction) -> Results:
    """Apply the change; convert any failure to a result."""
    try:
        await work.forward()
    except errors.NetcfgError as failure:
        return await roll_back(work, failure)
    except asyncio.CancelledError:
        if (task := asyncio.current_task()) is not None:
            task.uncancel()
        return await roll_back(work, errors.DeviceError("stopped by the user"))
    except Exception as fault:  # noqa: BLE001 - whatever we did wrong, no end must stay between two states
        near, far = await roll_back(
            work, errors.DeviceError(f"provision failed with an internal error ({arg(type(fault).__name__)})")
        )
        return _mark_as_our_fault(near, fault), _mark_as_our_fault(far, fault)
    return _success_result(work.near), _success_result(work.far)


def _success_result(end: End) -> apply.DeviceResult:
    number = len(end.actions)
    return (
        end.confirm(msg(f"{arg(number)} action{'s' if number != 1 else ''} applied and verified"))
        if number
        else end.report_unchanged()
    )


def _mark_as_our_fault(result: apply.DeviceResult, fault: Exception) -> apply.DeviceResult:
    exit_ = errors.ExitCode.UNKNOWN if result.status is apply.Status.UNKNOWN else errors.ExitCode.OUR_FAULT
    return replace(result, exit=exit_, fault=fault)
