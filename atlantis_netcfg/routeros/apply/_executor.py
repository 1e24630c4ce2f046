"""One device from first contact to last word: observe, plan, judge, change, and an honest end whatever happens."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

from atlantis_netcfg.errors import DeviceFailed, ExitCode, NetcfgError
from atlantis_netcfg.events import Stage
from atlantis_netcfg.journal import DeviceObserved, Planned
from atlantis_netcfg.routeros.apply._change import change
from atlantis_netcfg.routeros.apply._claim import other
from atlantis_netcfg.routeros.apply._contact import Contact
from atlantis_netcfg.routeros.apply._deadman import FOUND, found
from atlantis_netcfg.routeros.apply._drift import compared, drift
from atlantis_netcfg.routeros.apply._fitting import Unfit, fitted
from atlantis_netcfg.routeros.apply._inverse import CannotInvert, inverse
from atlantis_netcfg.routeros.apply._job import Mode, Status
from atlantis_netcfg.routeros.apply._prerequisites import missing
from atlantis_netcfg.routeros.apply._protection import Choice, Protection, choose
from atlantis_netcfg.routeros.apply._saving import SAVING, fetch, saved
from atlantis_netcfg.routeros.apply._settle import settle
from atlantis_netcfg.routeros.apply._shield import HOLD, ApiShield
from atlantis_netcfg.routeros.apply._shields import console_of, shield_of
from atlantis_netcfg.routeros.apply._stages import cut
from atlantis_netcfg.routeros.apply._state import digest, invalid, plan_hash
from atlantis_netcfg.routeros.apply._telling import planned
from atlantis_netcfg.routeros.apply._work import Work
from atlantis_netcfg.routeros.estimate import estimate
from atlantis_netcfg.routeros.guard import MENUS as GUARDED
from atlantis_netcfg.routeros.guard import ManagementPath, objections, touches
from atlantis_netcfg.routeros.observe import LATER, MenuMissing, completed, observe
from atlantis_netcfg.routeros.planner import CannotPlan, plan

if TYPE_CHECKING:
    from atlantis_netcfg.routeros.apply._job import DeviceJob, DeviceResult

__all__ = ["converge"]

_READING = (Mode.PLAN, Mode.DRIFT)
"""Ways that change nothing."""


class Interrupted(DeviceFailed):
    """The person who started the run has stopped it."""


async def converge(job: DeviceJob, *, mode: Mode = Mode.APPLY) -> DeviceResult:
    """Bring one device to its declared state, or say why not. Never raises but when it is cancelled a second time."""
    work = Work(job, Contact(job), asyncio.get_running_loop().time())
    try:
        result = await _honestly(work, mode)
        await _lay_down(work, result)
        return work.ended(result)
    finally:
        await work.shield.drop()
        await work.contact.close()


async def _lay_down(work: Work, result: DeviceResult) -> None:
    """Take the sign of a run down that has failed; where that cannot be done it goes by itself."""
    if work.session is not None and result.status is not Status.UNKNOWN:
        with suppress(NetcfgError):
            if farewell := work.farewell():
                await work.session.flight(farewell)


async def _honestly(work: Work, mode: Mode) -> DeviceResult:
    """Run, and turn whatever went wrong into a result."""
    try:
        return await (_backup(work) if mode is Mode.BACKUP else _run(work, mode))
    except (CannotPlan, MenuMissing, Unfit) as refusal:
        return work.result(Status.REFUSED, str(refusal), hint=refusal.hint)
    except NetcfgError as failure:
        if mode is Mode.DRIFT:
            return work.result(Status.LEFT_AS_FOUND, f"could not be read: {failure}", hint=failure.hint)
        return await settle(work, failure)
    except asyncio.CancelledError:
        if (task := asyncio.current_task()) is not None:
            task.uncancel()
        return await settle(work, Interrupted("stopped by hand"))
    except Exception as fault:  # noqa: BLE001 - whatever we did wrong, the device must not stay between two states
        result = await settle(work, DeviceFailed(f"provision itself failed ({type(fault).__name__})"))
        exit_ = ExitCode.UNKNOWN if result.status is Status.UNKNOWN else ExitCode.OUR_FAULT
        return replace(result, exit=exit_, fault=fault)


async def _run(work: Work, mode: Mode) -> DeviceResult:
    await _observe(work, mode)
    busy = await _busy(work)
    if busy is not None and mode not in _READING:
        return _held(work, busy)
    await _plan(work)
    if busy is not None:
        work.notes.append(f"{busy}: what was changed meanwhile may yet be taken back")
    refusal = _toll(work, mode)
    if mode is Mode.DRIFT:
        return await drift(work)
    if mode is Mode.PLAN:
        work.comparison = compared(work)
    if refusal is None and work.aim.actions:
        refusal = _judge(work, mode)
    if refusal is not None:
        return refusal
    if not work.aim.actions:
        return work.result(Status.UNCHANGED, "already so: nothing to change")
    if mode is Mode.PLAN:
        return work.result(Status.PLANNED, f"{_actions(work)} planned")
    return await _change(work)


async def _observe(work: Work, mode: Mode) -> None:
    work.say(Stage.CONNECTING, f"to {work.job.endpoint}")
    work.session = await work.contact.open()
    if mode is Mode.RESUME:
        await _until_undone(work)
    job = work.job = await fitted(work.session, work.job)
    watched = [path for path in GUARDED if path not in LATER]
    work.before = await observe(work.session, job.endpoint, job.desired.menus, watched, job.counted)
    facts = work.before.facts
    work.record(
        DeviceObserved(device=job.name, version=str(facts.version), identity=facts.identity, state=digest(work.before))
    )
    work.say(Stage.OBSERVED, f"{facts.board}, RouterOS {facts.version}")


async def _plan(work: Work) -> None:
    """Plan from what was read; where something is to change, from what has to be known then, too."""
    job = work.job
    work.plan = plan(job.name, job.desired, work.seen)
    if work.plan.actions:
        work.before = await completed(work.channel, job.endpoint, work.seen)
        work.plan = plan(job.name, job.desired, work.seen)
    if job.bearer is not None:
        work.estimate = estimate(work.plan, job.bearer, work.seen)
    _protect(work)
    work.notes += [f"the device does not use {row}" for row in invalid(work.seen)]
    work.say(Stage.PLANNED, f"{_actions(work)}" if work.plan.actions else "nothing to change")


def _toll(work: Work, mode: Mode) -> DeviceResult | None:
    """Ask whether the run may cost what it would, from what was read; where nothing more is sent, that is only told."""
    if work.job.toll is None:
        return None
    spends = bool(work.aim.actions) and mode is not Mode.DRIFT
    verdict = work.job.toll.judge(work.seen, work.estimate, spends=spends, planned=mode is Mode.PLAN)
    for note in verdict.notes:
        work.notes.append(note)
        work.say(Stage.PLANNED, note)
    if verdict.refusal is None:
        return None
    return work.result(Status.REFUSED, f"refused, nothing was changed: {verdict.refusal}", hint=verdict.hint)


def _judge(work: Work, mode: Mode) -> DeviceResult | None:
    """Return the refusal of a plan that may not be carried out."""
    found = work.aim
    reasons = [*objections(found, work.seen, _path(work)), *missing(found, work.seen)]
    if work.protection is Protection.NONE and not all(action.inert for action in found.actions):
        if work.job.unprotected:
            work.notes.append("nothing protects this change: what goes wrong has to be repaired by a person")
        else:
            reasons.append(_unprotected(work))
    if reasons:
        return work.result(Status.REFUSED, "refused, nothing was changed: " + "; ".join(reasons))
    if mode is Mode.PLAN:
        return None
    if work.job.agreed is not None and work.job.agreed != plan_hash(found):
        return work.result(
            Status.REFUSED,
            "the device has changed since the plan was shown: nothing was changed",
            hint="look at the new plan and agree to it",
        )
    return None


def _unprotected(work: Work) -> str:
    own = " and touches the way by which the device is managed" if touches(work.aim, work.seen, _path(work)) else ""
    return (
        f"nothing would take this change back if it went wrong: {work.choice.why}; it moves traffic{own}."
        " Pin its SSH host key with `provision adopt`, upgrade it to RouterOS 7.18,"
        " or say --without-protection with somebody standing beside it"
    )


def _protect(work: Work) -> None:
    """Choose what takes the change back, and cut the plan for it."""
    facts, job, found = work.seen.facts, work.job, work.aim
    why = None
    if found.actions and not facts.has_safe_mode:
        try:
            work.script = inverse(work.seen, found)
        except CannotInvert as problem:
            why = str(problem)
    seconds = work.estimate.seconds if work.estimate is not None else 0.0
    work.choice = choose(found, facts, job, invertible=why, seconds=seconds)
    work.stages = cut(found, work.protection)
    if work.protection.holds and not work.stages.protected:
        work.choice = Choice(Protection.NONE, why="nothing in it can do harm by itself")
        work.stages = cut(found, Protection.NONE)
    work.shield = shield_of(work.choice, job)


async def _busy(work: Work) -> str | None:
    """Say who is at work on the device, or what is left of them; None if nobody is."""
    facts = work.seen.facts
    if facts.safe_mode_owner is not None:
        return f"{facts.safe_mode_owner} holds safe mode, and there is only one"
    who = other(work.seen, work.ours)
    if who is not None:
        return f"{who} is under way on this device"
    if not facts.has_safe_mode:
        who = found(await work.channel.command(FOUND))
        if who is not None:
            return f"the dead-man job of {who} is armed, and takes back what that run has left"
    return None


async def _until_undone(work: Work) -> None:
    """Wait until the device has taken back what a dead run left open: by safe mode, then by its dead-man job."""
    job, session = work.job, work.channel
    reply = await session.command(HOLD)
    work.shield = ApiShield() if reply.trap is None else console_of(job)
    await work.contact.until_free(work.shield, session, job.patience.undo_s)
    if reply.trap is not None:
        await work.contact.until_fired(session, FOUND, job.patience.undo_s + 2 * job.patience.dead_man_s)


def _held(work: Work, busy: str) -> DeviceResult:
    """Leave a device alone on which somebody's changes are still open: not even `already so` would be certain."""
    return work.result(
        Status.LEFT_AS_FOUND,
        f"{busy}: nothing was changed",
        hint="let them finish, then run the same command again; if a run of ours has died there:"
        f"  provision resume site={work.job.site}",
    )


def _path(work: Work) -> ManagementPath:
    job, facts = work.job, work.seen.facts
    return ManagementPath(facts.session_address, job.address or job.endpoint.host, user=job.endpoint.user)


async def _change(work: Work) -> DeviceResult:
    actions = work.aim.actions
    work.record(Planned(device=work.job.name, plan=plan_hash(work.aim), actions=tuple(map(planned, actions))))
    await change(work)
    return work.result(Status.CHANGED, f"{_actions(work)} read back and kept")


async def _backup(work: Work) -> DeviceResult:
    """Save the device's own text of its state, and change nothing."""
    work.say(Stage.CONNECTING, f"to {work.job.endpoint}")
    work.session = await work.contact.open()
    found = saved(*await work.session.flight(SAVING))
    text = found.text if found.text is not None else await fetch(work.session)
    work.job.journal.save(work.job.name, text)
    lines = text.count("\n")
    return work.result(Status.UNCHANGED, f"{lines} lines saved; secrets and users are not in them")


def _actions(work: Work) -> str:
    number = len(work.aim.actions)
    return f"{number} action{'s' if number != 1 else ''}"
