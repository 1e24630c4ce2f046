"""The run on one device from first contact to result: observe, plan, check, change, and always report.

A drift report is read like a plan, with the history of the device and the journal added.
"""

from __future__ import annotations

import asyncio
from contextlib import suppress
from dataclasses import replace
from itertools import islice
from typing import TYPE_CHECKING

from atlantis_netcfg.core import errors
from atlantis_netcfg.core.events import Stage
from atlantis_netcfg.core.messages import arg, conjunction, join, msg
from atlantis_netcfg.routeros import guard, link_use, planner, safe_mode, scheduler_jobs
from atlantis_netcfg.routeros._types import Verb, is_bare
from atlantis_netcfg.routeros.api import Unreachable
from atlantis_netcfg.routeros.apply import _contact, _job, _protection, _state, _work
from atlantis_netcfg.routeros.apply._change import (
    BEFORE,
    change,
    find_missing_requirements,
    needs_run_marker,
    safe_mode_first,
)
from atlantis_netcfg.routeros.apply._inverse import CannotInvert, inverse
from atlantis_netcfg.routeros.apply._settle import settle, undo_safe_mode
from atlantis_netcfg.routeros.drift import HISTORY, Comparison, DriftHistory, DriftKind, Past, compare
from atlantis_netcfg.routeros.estimate import estimate
from atlantis_netcfg.routeros.observe import (
    BRIEF,
    CERTIFICATES,
    LATER,
    MenuMissing,
    complete_observation,
    observe,
    read_bare,
    samples,
    with_rows,
)
from atlantis_netcfg.runs import DeviceObservation, PlanRecord

if TYPE_CHECKING:
    from collections.abc import Sequence

    from atlantis_netcfg.routeros.api import Command


_NO_HISTORY = DriftHistory()


async def drift(work: _work.RunContext) -> _job.DeviceResult:
    """Report the differences; the device's history costs one round trip, and is read only if there is drift."""
    comparison = work.comparison = build_comparison(work)
    if comparison.drift:
        reply = await work.channel.command(HISTORY)
        if reply.trap is None:
            comparison = work.comparison = build_comparison(work, DriftHistory(reply.rows))
        result = work.result(_job.Status.DRIFTED, _summary(comparison))
    else:
        result = work.result(_job.Status.UNCHANGED, _as_declared_text(comparison))
    # Of the plan's notes only what holds for a look, too: the others are for whoever carries it out.
    return replace(result, notes=(*planner.newer_than_known(work.observation.facts.version), *work.notes))


def build_comparison(work: _work.RunContext, history: DriftHistory = _NO_HISTORY) -> Comparison:
    """Compare with the desired state, and with the last confirmed state as far as it can be read."""
    comparison = compare(work.job.desired_state, work.observation, work.aim, _past(work), history)
    leftovers = work.leftovers.differences()
    menus = dict.fromkeys((*comparison.menus, *(difference.menu for difference in leftovers)))
    return replace(comparison, menus=tuple(menus), differences=(*comparison.differences, *leftovers))


def _has_differences(work: _work.RunContext) -> bool:
    return bool(work.aim.actions or work.aim.drift)


def _past(work: _work.RunContext) -> Past | None:
    saved_state = work.job.confirmed_state
    if saved_state is None:
        return None
    if not _has_differences(work):
        return Past(saved_state.run, saved_state.at, {})
    try:
        return Past.read(saved_state.run, saved_state.at, saved_state.text())
    except errors.NetcfgError as error:
        if str(error) not in work.notes:
            work.notes.append(str(error))
        return None


def _as_declared_text(comparison: Comparison) -> str:
    beside = [item for item in comparison.differences if item.kind is DriftKind.FOREIGN]
    hidden_secrets = [difference for difference in comparison.differences if difference.kind is DriftKind.HIDDEN]
    words = ["as in the inventory"]
    if beside:
        words.append(msg(f"{arg(len(beside))} foreign row{'' if len(beside) == 1 else 's'} left unchanged"))
    if hidden_secrets:
        words.append(
            msg(f"{arg(len(hidden_secrets))} secret{'' if len(hidden_secrets) == 1 else 's'} could not be compared")
        )
    return join("; ", words)


def _summary(comparison: Comparison) -> str:
    kinds = [difference.kind for difference in comparison.drift]
    parts = join(", ", (msg(f"{arg(kinds.count(noun))} {noun}") for noun in DriftKind if noun in kinds))
    return msg(f"{arg(len(kinds))} difference{'' if len(kinds) == 1 else 's'} from the inventory: {arg(parts)}")


_READING = (_job.JobMode.PLAN, _job.JobMode.DRIFT)
"""Modes that change nothing."""
_LET_THEM = "let them finish, then run the same command again"
_STAND_BY = (
    "pin its SSH host key with `provision device adopt site=… device=…`, upgrade it to RouterOS 7.18, or "
    "add --without-protection with somebody next to the device"
)


class Busy(errors.DeviceError):
    """Another user's changes are still open on the device, so even `no changes needed` would be uncertain."""


class UserInterrupt(errors.DeviceError):
    """The user has interrupted the run."""


async def converge(job: _job.DeviceJob, *, mode: _job.JobMode = _job.JobMode.APPLY) -> _job.DeviceResult:
    """Bring one device to its desired state, or report why not. Raises only if cancelled a second time."""
    contact = _contact.Contact(job)
    ssh = job.ssh and replace(job.ssh, opening=contact.opening)
    work = _work.RunContext(replace(job, ssh=ssh), contact, asyncio.get_running_loop().time())
    try:
        result = await _run_guarded(work, mode)
    except BaseException:
        await _close(work)
        raise
    result, is_stopped = await _contact.completed_despite_stop(_end(work, result))
    return replace(result, is_stopped=True) if is_stopped else result


async def _end(work: _work.RunContext, result: _job.DeviceResult) -> _job.DeviceResult:
    try:
        await _remove_run_marker(work, result)
        return work.finish(result)
    finally:
        await _close(work)


async def _close(work: _work.RunContext) -> None:
    await work.safe_mode.drop()
    await work.contact.close(wait=work.holding)


async def _remove_run_marker(work: _work.RunContext, result: _job.DeviceResult) -> None:
    """Release unused safe mode, and remove the run marker of a failed run.

    If that is not possible, both disappear without us.
    """
    if work.holding and not work.has_sent_changes:
        await undo_safe_mode(work)
    if work.session is not None and result.status is not _job.Status.UNKNOWN:
        with suppress(errors.NetcfgError):
            if farewell := work.marker_removal():
                await work.session.flight(farewell)


async def _run_guarded(work: _work.RunContext, mode: _job.JobMode) -> _job.DeviceResult:
    """Run, and convert any failure to a result."""
    try:
        return await (_backup(work) if mode is _job.JobMode.BACKUP else _run(work, mode))
    except (planner.CannotPlan, MenuMissing, _job.Unfit) as refusal:
        return work.result(_job.Status.REFUSED, str(refusal), hint=refusal.hint)
    except errors.NetcfgError as failure:
        if mode in _READING:
            result = work.result(
                _job.Status.LEFT_AS_FOUND, msg(f"could not be read: {arg(failure)}"), hint=failure.hint
            )
            return replace(result, was_reached=not isinstance(failure, Unreachable))
        return await settle(work, failure)
    except asyncio.CancelledError:
        if (task := asyncio.current_task()) is not None:
            task.uncancel()
        return replace(await settle(work, UserInterrupt("stopped by the user")), is_stopped=True)
    except Exception as fault:  # noqa: BLE001 - whatever we did wrong, the device must not stay between two states
        result = await settle(
            work, errors.DeviceError(f"provision failed with an internal error ({arg(type(fault).__name__)})")
        )
        exit_ = errors.ExitCode.UNKNOWN if result.status is _job.Status.UNKNOWN else errors.ExitCode.OUR_FAULT
        return replace(result, exit=exit_, fault=fault)


async def _run(work: _work.RunContext, mode: _job.JobMode) -> _job.DeviceResult:
    work.brief = _may_be_brief(work.job, mode)
    await _observe(work, mode)
    if mode in _READING:
        return await _report_only(work, mode)
    refusal = await _refuse_if_busy(work, mode)
    if refusal is not None:
        return refusal
    await _plan(work, mode)
    if _has_to_run(work):
        await _wait_for_dead_man(work, mode)
    return _refusal(work, mode) or await _clear_and_change(work, mode)


async def _report_only(work: _work.RunContext, mode: _job.JobMode) -> _job.DeviceResult:
    """Report what a run would do, or the drift, and any armed jobs or open changes."""
    await _plan(work, mode)
    work.busy = join("; ", work.leftovers.words())
    work.notes += [
        msg(f"{arg(words)}: changes made since then may still be rolled back") for words in work.leftovers.words()
    ]
    if mode is _job.JobMode.DRIFT:
        _cost_policy(work, mode)
        return await drift(work)
    refusal = _refusal(work, mode)
    work.comparison = build_comparison(work)
    return _build_plan_result(work) if refusal is None else replace(refusal, comparison=work.comparison)


def _refusal(work: _work.RunContext, mode: _job.JobMode) -> _job.DeviceResult | None:
    """Return the refusal of the plan; None if it may be applied."""
    refusal = _cost_policy(work, mode)
    if refusal is None and work.aim.actions:
        refusal = _judge(work, mode)
    return refusal


async def _clear_and_change(work: _work.RunContext, mode: _job.JobMode) -> _job.DeviceResult:
    """Remove what finished runs have left on the device, then apply the plan."""
    removed_items = await _clear(work, mode)
    if work.aim.actions:
        return await _change(work)
    if removed_items:
        work.after = work.observation
        return work.result(_job.Status.CHANGED, msg(f"as in the inventory; removed {arg(conjunction(removed_items))}"))
    return work.result(_job.Status.UNCHANGED, "no changes needed")


def _build_plan_result(work: _work.RunContext) -> _job.DeviceResult:
    """Report what a run would do; if somebody is working on the device, it would do nothing."""
    words = join("; ", work.leftovers.words())
    if work.aim.actions:
        return work.result(_job.Status.PLANNED, msg(f"{arg(_action_count_text(work))} planned"))
    if work.leftovers.safe_mode is not None:
        return work.result(_job.Status.LEFT_AS_FOUND, msg(f"nothing to change, but {arg(words)}"), hint=_LET_THEM)
    if words:
        return work.result(
            _job.Status.PLANNED, msg(f"nothing to change except what an earlier run has left: {arg(words)}")
        )
    return work.result(_job.Status.UNCHANGED, "no changes needed")


async def _observe(work: _work.RunContext, mode: _job.JobMode) -> None:
    work.say(Stage.CONNECTING, msg(f"to {arg(work.job.endpoint)}"), work.job.endpoint.connect_timeout_s)
    work.session = await work.contact.open()
    if mode is _job.JobMode.RESUME:
        await _wait_for_undo(work)
    await _read_fitting(work)


async def _read_fitting(work: _work.RunContext) -> None:
    """Read what the fitting desired state needs. Raises Unfit, MenuMissing, SessionLost.

    If there is only one variant, it is read as if it fitted; this saves the round trip that asks for the device's
    radios.
    """
    fitting = work.job.fitting
    if fitting is None or len(fitting.states) > 1:
        work.job = await _contact.choose_variant(work.channel, work.job)
        await _read(work)
        return
    (menu,) = fitting.states
    try:
        await _read(work)
    except MenuMissing:
        await _contact.choose_variant(work.channel, work.job)  # says so if it is that of the radio
        raise
    if menu not in work.job.desired_state.menus or any(row.get("default-name") for row in work.observation.rows[menu]):
        work.job = replace(work.job, fitting=None)
    else:
        work.job = await _contact.choose_variant(work.channel, work.job)


def _may_be_brief(job: _job.DeviceJob, mode: _job.JobMode) -> bool:
    """Return True if foreign rows may be counted only: no run can remove them, and the user did not request all."""
    return mode in (_job.JobMode.PLAN, _job.JobMode.APPLY) and not job.remove_foreign


async def _read(work: _work.RunContext) -> None:
    """Read everything that a plan needs, and any armed jobs or open changes."""
    job = work.job
    watched_menus = (
        [*guard.WAY_BACK, _state.SIGNS]
        if link_use.is_order(job.desired_state)
        else [path for path in guard.MENUS if path not in LATER]
    )
    brief = [path for path in BRIEF if work.brief and path in job.desired_state.entire]
    work.before = await observe(
        work.channel, job.endpoint, job.desired_state.menus, watched_menus, job.counted_ports, brief=brief
    )
    work.leftovers = _work.find_leftovers(work.before)
    work.job = replace(job, desired_state=link_use.allow_link_use(job.desired_state, work.before))
    use = link_use.in_use(work.before.jobs)
    if use is not None and not any(note.startswith(f"{use.link} is in use") for note in work.notes):
        work.notes.append(use.words(work.before.uptime_s))
    facts = work.before.facts
    work.record(
        DeviceObservation(
            device=job.name, version=str(facts.version), identity=facts.identity, state=_state.digest(work.before)
        )
    )
    work.say(Stage.OBSERVED, msg(f"{arg(facts.board)}, RouterOS {arg(facts.version)}"))


async def _plan(work: _work.RunContext, mode: _job.JobMode) -> None:
    """Plan from what was read; if there are changes, read what they require and plan again."""
    job = work.job
    work.plan = planner.plan(job.name, job.desired_state, work.observation)
    if work.plan.actions:
        await _complete(work, mode)
        work.plan = planner.plan(job.name, job.desired_state, work.observation)
        if not _is_read_enough(work):
            work.early = ()
            work.before = await read_bare(work.channel, work.observation)
            work.plan = planner.plan(job.name, job.desired_state, work.observation)
        await _examine(work, mode)
    if job.link is not None:
        work.estimate = estimate(work.plan, job.link, work.observation)
    _protect(work)
    unused_notes = [msg(f"the device does not use {arg(row)}") for row in _state.find_invalid_rows(work.observation)]
    work.notes += [note for note in unused_notes if note not in work.notes]
    work.say(Stage.PLANNED, f"{_action_count_text(work)}" if work.plan.actions else "nothing to change")


def _is_read_enough(work: _work.RunContext) -> bool:
    """Return True if reading the bare rows in full would change neither the plan nor its checks.

    Limitation: their content is neither shown nor compared with the last confirmed state, except for a few samples.
    """
    bare = {path for path, rows in work.observation.rows.items() if any(map(is_bare, rows))}
    if not bare:
        return True
    removed_alone = all(action.verb is Verb.REMOVE for action in work.aim.actions if action.menu in bare)
    return (
        removed_alone
        and work.observation.facts.has_safe_mode
        and not guard.objections(work.aim, work.observation, _path(work))
    )


async def _complete(work: _work.RunContext, mode: _job.JobMode) -> None:
    """Read what is needed before a change; if the change needs safe mode, take it in the same round trip.

    If the change is then refused, nothing was written under safe mode, and it is released. If somebody else holds it,
    that is reported where it matters. Leftovers of an earlier run are removed first, outside safe mode, which would
    restore them. If nothing rules out the plan yet, the state to be saved and the run markers of others are read
    together with it.
    """
    _protect(work)
    takes = mode not in _READING and not work.leftovers and not work.holding and safe_mode_first(work)
    takes = takes and not _work.find_missing_consent(work.job, work.aim)
    work.holding = work.holding or takes
    commands, sample_commands = _parser_requests(work, mode), samples(work.observation)
    first = BEFORE if takes and not needs_run_marker(work) and _is_plan_acceptable(work, mode) else ()
    parts = (work.safe_mode.taking if takes else (), commands, tuple(sample_commands.values()), first)
    beside = [each for part in parts for each in part]
    work.before, answers = await complete_observation(
        work.channel, work.job.endpoint, work.observation, beside, _late_menus(work)
    )
    remaining = iter(answers)
    taking, examination_replies, sampling, work.early = (tuple(islice(remaining, len(part))) for part in parts)
    work.before = with_rows(work.before, sample_commands, sampling)
    work.examination.read_answers(examination_replies)
    if takes:
        try:
            round_trips = work.channel.traffic.round_trips
            work.owner = (await work.safe_mode.confirm_take(work.channel, taking)).who
            work.early = work.early if work.channel.traffic.round_trips == round_trips else ()
        except safe_mode.SafeModeUnavailable:
            work.holding = False


def _late_menus(work: _work.RunContext) -> Sequence[str]:
    """Return the menus that turned out to be needed to check the plan."""
    if link_use.is_order(work.job.desired_state) and guard.moves_answers(work.aim, work.observation, _path(work)):
        return guard.MENUS
    value_names = {name for action in work.aim.actions for name, _ in action.values}
    return [path for path in LATER if path != CERTIFICATES or "certificate" in value_names]


def _parser_requests(work: _work.RunContext, mode: _job.JobMode) -> tuple[Command, ...]:
    """Return the commands that let the device's parser check the plan; none if no plan is sent or it costs too much."""
    if mode is _job.JobMode.DRIFT or _is_too_dear(work, mode):
        return ()
    return work.examination.questions(work.aim.actions, work.observation.rows)


def _is_too_dear(work: _work.RunContext, mode: _job.JobMode) -> bool:
    if work.job.cost_policy is None or work.job.link is None:
        return False
    cost = estimate(work.aim, work.job.link, work.observation)
    is_plan = mode is _job.JobMode.PLAN
    return work.job.cost_policy.judge(work.observation, cost, spends=True, is_plan=is_plan).refusal is not None


def _is_plan_acceptable(work: _work.RunContext, mode: _job.JobMode) -> bool:
    """Return True if nothing read so far rules out the plan."""
    has_consent = work.job.agreed_hash in (None, _state.plan_hash(work.aim))
    return (
        has_consent and not _is_too_dear(work, mode) and not guard.objections(work.aim, work.observation, _path(work))
    )


async def _examine(work: _work.RunContext, mode: _job.JobMode) -> None:
    """Send the remaining parser requests: for actions planned meanwhile, and for complete lists of values."""
    while commands := _parser_requests(work, mode):
        work.early = ()
        work.examination.read_answers(await work.channel.flight(commands))
    doubt = work.examination.doubt(work.aim.actions)
    if doubt and doubt not in work.notes and mode is not _job.JobMode.DRIFT:
        work.notes.append(doubt)


def _cost_policy(work: _work.RunContext, mode: _job.JobMode) -> _job.DeviceResult | None:
    """Check whether the cost of the run is allowed; if nothing more is sent, only report it."""
    if work.job.cost_policy is None:
        return None
    spends = bool(work.aim.actions) and mode is not _job.JobMode.DRIFT
    verdict = work.job.cost_policy.judge(
        work.observation, work.estimate, spends=spends, is_plan=mode is _job.JobMode.PLAN
    )
    for note in verdict.notes:
        work.notes.append(note)
        work.say(Stage.PLANNED, note)
    if verdict.refusal is None:
        return None
    return work.result(
        _job.Status.REFUSED, msg(f"refused, nothing was changed: {arg(verdict.refusal)}"), hint=verdict.hint
    )


def _judge(work: _work.RunContext, mode: _job.JobMode) -> _job.DeviceResult | None:
    """Return the refusal of a plan that must not be applied; None if it may."""
    current_plan = work.aim
    lacking = find_missing_requirements(
        current_plan, work.observation, console=work.protection is _protection.Protection.CONSOLE
    )
    reasons, hint = [*guard.objections(current_plan, work.observation, _path(work)), *lacking], None
    reasons += work.examination.objections(current_plan.actions, work.job.desired_state.source)
    if work.protection is _protection.Protection.NONE and not all(action.inert for action in current_plan.actions):
        if work.job.allows_unprotected:
            work.notes.append("nothing protects this change: if it fails, a person has to repair it")
        else:
            reasons.append(_describe_no_protection(work))
            hint = _STAND_BY
    if reasons:
        return work.result(
            _job.Status.REFUSED, msg("refused, nothing was changed: " + str(arg(join("; ", reasons)))), hint=hint
        )
    if mode is _job.JobMode.PLAN:
        return None
    if apart := _work.find_missing_consent(work.job, current_plan):
        return work.result(
            _job.Status.REFUSED, msg(f"refused, nothing was changed: {arg(apart)}"), hint=_work.AGREE_APART
        )
    if work.job.agreed_hash is not None and work.job.agreed_hash != _state.plan_hash(current_plan):
        return work.result(
            _job.Status.REFUSED,
            "the device has changed since the plan was shown: nothing was changed",
            hint="check the new plan and confirm it",
        )
    return None


def _describe_no_protection(work: _work.RunContext) -> str:
    local = " and touches the management path" if guard.touches(work.aim, work.observation, _path(work)) else ""
    return msg(
        f"nothing would roll this change back if it failed: {arg(work.choice.why)}; it moves traffic{arg(local)}"
    )


def _protect(work: _work.RunContext) -> None:
    """Choose how the change is rolled back, and split the plan accordingly."""
    facts, job, current_plan = work.observation.facts, work.job, work.aim
    why = None
    if current_plan.actions and not facts.has_safe_mode:
        try:
            work.script = inverse(work.observation, current_plan)
        except CannotInvert as problem:
            why = str(problem)
    seconds = work.estimate.seconds if work.estimate is not None else 0.0
    work.choice = _protection.choose(current_plan, facts, job, invertible=why, seconds=seconds)
    work.stages = _work.split_plan(current_plan, work.protection)
    if work.protection.holds and not work.stages.pieces:
        work.choice = _protection.ProtectionChoice(_protection.Protection.NONE, why="nothing in it can do harm")
        work.stages = _work.split_plan(current_plan, _protection.Protection.NONE)
    if not work.holding:
        work.safe_mode = _protection.safe_mode_of(work.choice, job)


async def _refuse_if_busy(work: _work.RunContext, mode: _job.JobMode) -> _job.DeviceResult | None:
    """Return the refusal if somebody else's changes are still open on the device.

    Changes of a dead run of this computer are waited for, and its run marker becomes ours.
    """
    resumes = mode is _job.JobMode.RESUME
    busy = await _busy(work, resumes=resumes)
    if busy is not None and not resumes and work.job.history.has_unfinished_run():
        work.say(Stage.WAITING, msg(f"{arg(busy)}: a run of this computer was interrupted here; this run continues it"))
        await _wait_for_undo(work)
        await _read(work)
        busy = await _busy(work, resumes=True)
    work.busy = str(busy) if busy is not None else ""
    if busy is not None:
        return work.result(_job.Status.LEFT_AS_FOUND, msg(f"{arg(busy)}: nothing was changed"), hint=busy.hint)
    work.sign = next((sign.id for sign in work.leftovers.markers), None)
    return None


async def _busy(work: _work.RunContext, *, resumes: bool) -> Busy | None:
    """Return who may be working on the device; None if nobody, whatever a finished run has left there."""
    leftovers, resume = work.leftovers, f"provision recover resume site={work.job.site}"
    owner = leftovers.safe_mode
    other = work.signer.other(leftovers.markers)
    alive = leftovers.alive(work.signer.is_over, bridge=False)
    if owner is None and other is None and leftovers and not work.observation.facts.has_safe_mode:
        holder = await _protection.console_safe_mode(work.job).free(work.channel)
        owner = holder.who if holder.is_taken else None
    if owner is not None:
        return Busy(
            f"{arg(owner)} holds safe mode, which only one session can hold",
            hint=(
                "let them finish, then run the same command again; the device undoes an interrupted run by itself, "
                f"and this command waits for that:  {arg(resume)}"
            ),
        )
    if other is not None:
        conflict = _state.claim_conflict(other, work.job.site)
        return Busy(str(conflict), hint=conflict.hint)
    if alive is not None and not resumes:
        return Busy(
            alive, hint=f"let it run, then run the same command again; this command waits for it:  {arg(resume)}"
        )
    return None


async def _wait_for_undo(work: _work.RunContext) -> None:
    """Wait until safe mode of a dead run has ended and the device has undone its changes."""
    job, session = work.job, work.channel
    reply = await session.command(safe_mode.READ)
    work.safe_mode = safe_mode.ApiSafeMode() if reply.trap is None else _protection.console_safe_mode(job)
    await work.contact.until_free(work.safe_mode, session, job.patience.undo_s)


def _has_to_run(work: _work.RunContext) -> bool:
    """Return True if an armed dead-man job must not be removed, since the current state is not the desired one."""
    job = work.leftovers.find_job(scheduler_jobs.DEAD_MAN)
    return job is not None and (bool(work.aim.actions) or not work.signer.is_over(job.owner))


async def _wait_for_dead_man(work: _work.RunContext, mode: _job.JobMode) -> None:
    """Wait until the dead-man job of a dead run has fired, since that run's state is not the desired one."""
    patience = work.job.patience
    await work.contact.until_fired(work.channel, scheduler_jobs.READ_JOBS, patience.undo_s + 2 * patience.dead_man_s)
    await _read(work)
    await _plan(work, mode)


async def _clear(work: _work.RunContext, mode: _job.JobMode) -> tuple[str, ...]:
    """Remove the leftovers of finished runs, and read the device again, as a job may have run meanwhile.

    A bridge's job is kept: only a run that sees both ends knows whether it is still needed.
    """
    leftovers = replace(
        work.leftovers, jobs=tuple(job for job in work.leftovers.jobs if job.name != scheduler_jobs.PAIR)
    )
    if not leftovers:
        return ()
    planned_before = _state.plan_hash(work.aim)
    removed_items = await leftovers.remove(work.channel)
    work.sign = None
    work.notes.append(msg(f"removed {arg(conjunction(removed_items))}"))
    await _read(work)
    await _plan(work, mode)
    if _state.plan_hash(work.aim) != planned_before:
        raise _protection.InterferenceError(
            f"the device changed while {arg(conjunction(removed_items))} was being removed",
            hint="run the same command again: it computes a new plan from the current state",
        )
    return removed_items


def _path(work: _work.RunContext) -> guard.ManagementPath:
    job, facts = work.job, work.observation.facts
    return guard.ManagementPath(facts.session_address, job.address or job.endpoint.host, user=job.endpoint.user)


async def _change(work: _work.RunContext) -> _job.DeviceResult:
    actions = work.aim.actions
    work.record(
        PlanRecord(
            device=work.job.name,
            plan=_state.plan_hash(work.aim),
            actions=tuple(map(_work.build_journal_action, actions)),
        )
    )
    await change(work)
    return work.result(_job.Status.CHANGED, msg(f"{arg(_action_count_text(work))} applied and verified"))


async def _backup(work: _work.RunContext) -> _job.DeviceResult:
    """Save the device's own export; change nothing."""
    work.say(Stage.CONNECTING, msg(f"to {arg(work.job.endpoint)}"), work.job.endpoint.connect_timeout_s)
    work.session = await work.contact.open()
    saved_export = _state.parse_export(*await work.session.flight(_state.SAVING))
    text = saved_export.text if saved_export.text is not None else await _state.fetch(work.session)
    work.job.journal.save(work.job.name, text)
    lines = text.count("\n")
    return work.result(_job.Status.UNCHANGED, msg(f"{arg(lines)} lines saved, without secrets and users"))


def _action_count_text(work: _work.RunContext) -> str:
    return _work.number_of(work.aim)
