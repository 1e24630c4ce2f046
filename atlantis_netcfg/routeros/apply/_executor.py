"""One device from first contact to last word: observe, plan, judge, change, and an honest end whatever happens."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from typing import TYPE_CHECKING

from atlantis_netcfg.errors import DeviceFailed, ExitCode, NetcfgError
from atlantis_netcfg.events import Stage
from atlantis_netcfg.journal import DeviceObserved, Planned, PlannedAction
from atlantis_netcfg.routeros.apply._change import change
from atlantis_netcfg.routeros.apply._contact import Contact
from atlantis_netcfg.routeros.apply._drift import compared, drift
from atlantis_netcfg.routeros.apply._job import Mode, Status
from atlantis_netcfg.routeros.apply._prerequisites import missing
from atlantis_netcfg.routeros.apply._protection import Protection
from atlantis_netcfg.routeros.apply._saving import SAVING, fetch, saved
from atlantis_netcfg.routeros.apply._settle import settle
from atlantis_netcfg.routeros.apply._stages import cut
from atlantis_netcfg.routeros.apply._state import digest, invalid, plan_hash
from atlantis_netcfg.routeros.apply._work import Work
from atlantis_netcfg.routeros.estimate import estimate
from atlantis_netcfg.routeros.guard import MENUS as GUARDED
from atlantis_netcfg.routeros.guard import ManagementPath, objections
from atlantis_netcfg.routeros.observe import MenuMissing, observe
from atlantis_netcfg.routeros.planner import CannotPlan, plan

if TYPE_CHECKING:
    from atlantis_netcfg.routeros._types import Action
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
        return work.ended(await _honestly(work, mode))
    finally:
        await work.contact.close()


async def _honestly(work: Work, mode: Mode) -> DeviceResult:
    """Run, and turn whatever went wrong into a result."""
    try:
        return await (_backup(work) if mode is Mode.BACKUP else _run(work, mode))
    except (CannotPlan, MenuMissing) as refusal:
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
    holder = work.seen.facts.safe_mode_owner
    if holder is not None and mode not in _READING:
        return _held(work, holder)
    _plan(work)
    if holder is not None:
        work.notes.append(f"{holder} holds safe mode: what was changed in it may yet be taken back")
    if mode is Mode.DRIFT:
        return await drift(work)
    if mode is Mode.PLAN:
        work.comparison = compared(work)
    refusal = None if not work.aim.actions else _judge(work, mode)
    if refusal is not None:
        return refusal
    if not work.aim.actions:
        return work.result(Status.UNCHANGED, "already so: nothing to change")
    if mode is Mode.PLAN:
        return work.result(Status.PLANNED, f"{_actions(work)} planned")
    return await _change(work)


async def _observe(work: Work, mode: Mode) -> None:
    job = work.job
    work.say(Stage.CONNECTING, f"to {job.endpoint}")
    work.session = await work.contact.open()
    if mode is Mode.RESUME:
        await work.contact.until_free(work.session, job.patience.undo_s)
    work.before = await observe(work.session, job.endpoint, job.desired.menus, GUARDED)
    facts = work.before.facts
    work.record(
        DeviceObserved(device=job.name, version=str(facts.version), identity=facts.identity, state=digest(work.before))
    )
    work.say(Stage.OBSERVED, f"{facts.board}, RouterOS {facts.version}")


def _plan(work: Work) -> None:
    job = work.job
    work.plan = plan(job.name, job.desired, work.seen)
    if job.bearer is not None:
        work.estimate = estimate(work.plan, job.bearer, work.seen)
    work.protection = Protection.SAFE_MODE if work.seen.facts.has_safe_mode else Protection.NONE
    work.stages = cut(work.plan, work.protection)
    if not work.stages.protected:
        work.protection = Protection.NONE
    work.notes += [f"the device does not use {row}" for row in invalid(work.seen)]
    work.say(Stage.PLANNED, f"{_actions(work)}" if work.plan.actions else "nothing to change")


def _judge(work: Work, mode: Mode) -> DeviceResult | None:
    """Return the refusal of a plan that may not be carried out."""
    facts, found = work.seen.facts, work.aim
    reasons = [*objections(found, work.seen, _path(work)), *missing(found, work.seen)]
    if not facts.has_safe_mode and not all(action.inert for action in found.actions):
        reasons.append(
            f"RouterOS {facts.version} has no safe mode over the API (7.18 and later have): a change that goes wrong"
            " could not be taken back; upgrade it first"
        )
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


def _held(work: Work, holder: str) -> DeviceResult:
    """Leave a device alone on which somebody's changes are still open: not even `already so` would be certain."""
    return work.result(
        Status.LEFT_AS_FOUND,
        f"{holder} holds safe mode, and there is only one: nothing was changed",
        hint=f"let them release or unroll it; if a run of ours has died there:  provision resume site={work.job.site}",
    )


def _path(work: Work) -> ManagementPath:
    job, facts = work.job, work.seen.facts
    return ManagementPath(facts.session_address, job.address or job.endpoint.host, user=job.endpoint.user)


async def _change(work: Work) -> DeviceResult:
    actions = work.aim.actions
    work.record(Planned(device=work.job.name, plan=plan_hash(work.aim), actions=tuple(map(_planned, actions))))
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


def _planned(action: Action) -> PlannedAction:
    return PlannedAction(
        number=action.number,
        layer=action.layer.name.lower(),
        menu=action.menu,
        verb=action.verb.value,
        subject=action.subject,
        ids=action.ids,
        values=action.shown(),
    )


def _actions(work: Work) -> str:
    number = len(work.aim.actions)
    return f"{number} action{'s' if number != 1 else ''}"
