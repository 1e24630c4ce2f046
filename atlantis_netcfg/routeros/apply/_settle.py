"""After a failure: find out what the device is now, and see that it is as before or as declared, never between.

Only what is read back counts. Safe mode of a dead session is never released: we wait until the device has undone it.
"""

from __future__ import annotations

import asyncio
from dataclasses import replace
from typing import TYPE_CHECKING

from atlantis_netcfg.errors import DeviceFailed, NetcfgError
from atlantis_netcfg.events import Stage
from atlantis_netcfg.journal import ActionsConfirmed, NoJournal, Unrolled
from atlantis_netcfg.routeros.api import Refused, SessionLost
from atlantis_netcfg.routeros.apply._change import VerificationFailed, change
from atlantis_netcfg.routeros.apply._job import Status
from atlantis_netcfg.routeros.apply._protection import HOLD, Hold, Protection, unroll
from atlantis_netcfg.routeros.apply._stages import cut
from atlantis_netcfg.routeros.apply._state import differing, invalid, restoring
from atlantis_netcfg.routeros.apply._work import Work
from atlantis_netcfg.routeros.apply._writer import ActionRefused
from atlantis_netcfg.routeros.observe import observe
from atlantis_netcfg.routeros.planner import CannotPlan, plan

if TYPE_CHECKING:
    from atlantis_netcfg.routeros._types import Observed
    from atlantis_netcfg.routeros.apply._job import Channel, DeviceResult

__all__ = ["settle"]

_SHOWN = 5


async def settle(work: Work, reason: NetcfgError) -> DeviceResult:
    """End a run that failed for `reason`, as honestly as the device lets us."""
    work.say(Stage.FAILED, work.clean(str(reason)))
    if not work.touched:
        free = await _let_go(work)
        return work.result(
            Status.LEFT_AS_FOUND, f"nothing was changed: {reason}", hint=reason.hint if free else _stale(work)
        )
    try:
        return await _read_back(work, reason)
    except NetcfgError as lost:
        return _unknown(work, f"{reason}; then: {lost}")
    except Exception as fault:  # noqa: BLE001 - a fault of ours in here must not hide that the device was changed
        unknown = _unknown(work, f"{reason}; then provision itself failed ({type(fault).__name__})")
        return replace(unknown, fault=fault)


async def _let_go(work: Work) -> bool:
    """Take back what is in safe mode, if it is ours; False if it may still be held."""
    session = work.session
    if not work.holding:
        return True
    if session is None:
        return False
    try:
        if Hold.of(await session.command(HOLD)).ours:
            await unroll(session)
    except (SessionLost, Refused):
        # The device undoes it by itself as soon as it knows that the session is over.
        work.session = None
        await work.contact.leave(session)
        return False
    work.holding = False
    return True


async def _read_back(work: Work, reason: NetcfgError) -> DeviceResult:
    await _let_go(work)
    session, hold, now = await _state(work)
    changed = differing(work.seen, now)
    if not changed:
        return _rolled_back(work, reason)
    if hold.taken:
        return _unknown(
            work, f"{reason}; {hold.who} still holds safe mode, and the device differs in {_names(changed)}"
        )
    if _is_declared(work, reason, now) and await _is_reachable(work):
        work.after = now
        return _declared(work, reason)
    if work.restores:
        return _unknown(work, f"{reason}; the device differs in {_names(changed)}")
    return await _put_back(work, reason, session, now)


async def _state(work: Work) -> tuple[Channel, Hold, Observed]:
    """Read the device once nobody holds safe mode any more, over as many sessions as that takes."""
    patience, clock = work.job.patience, asyncio.get_running_loop().time
    until = clock() + patience.reach_s + patience.undo_s
    while True:
        try:
            session = work.session or await work.contact.reach(patience.reach_s, "after a loss")
            work.session = session
            hold = await work.contact.until_free(session, patience.undo_s)
            now = await observe(session, work.job.endpoint, work.job.desired.menus, tuple(work.seen.rows))
        except SessionLost:
            work.session = None
            if clock() >= until:
                raise
            await asyncio.sleep(patience.first_poll_s)
        else:
            return session, hold, now


def _is_declared(work: Work, reason: NetcfgError, now: Observed) -> bool:
    """Tell whether everything is there and may stay."""
    if not work.complete or isinstance(reason, (VerificationFailed, ActionRefused)):
        return False
    try:
        left = plan(work.job.name, work.job.desired, now).actions
    except CannotPlan:
        return False
    return not left and not set(invalid(now)) - set(invalid(work.seen))


async def _is_reachable(work: Work) -> bool:
    """Prove by a new session that the way in is open: what stays must not depend on the session that wrote it."""
    try:
        session = await work.contact.reach(work.job.patience.verify_s, "proving the way in", insist=False)
    except DeviceFailed:
        return False
    await work.contact.leave(session)
    return True


def _declared(work: Work, reason: NetcfgError) -> DeviceResult:
    work.confirmed = len(work.aim.actions)
    work.note(ActionsConfirmed(device=work.job.name, actions=tuple(action.number for action in work.aim.actions)))
    return work.result(Status.CHANGED, f"as declared: {_count(work)} read back, although: {reason}", hint=reason.hint)


def _rolled_back(work: Work, reason: NetcfgError, how: str = "taken back") -> DeviceResult:
    work.note(Unrolled(device=work.job.name, reason=work.clean(str(reason))))
    return work.result(Status.ROLLED_BACK, f"{how}, the device is as before: {reason}", hint=reason.hint)


def _unknown(work: Work, message: str) -> DeviceResult:
    return work.result(Status.UNKNOWN, f"the outcome is not known: {message}", hint=_stale(work))


def _stale(work: Work) -> str:
    return (
        "what is in safe mode the device takes back by itself, within ten minutes if the link has died; then:"
        f"  provision resume site={work.job.site}"
    )


async def _put_back(work: Work, reason: NetcfgError, session: Channel, now: Observed) -> DeviceResult:
    """Write the state that was observed at the start, guarded by safe mode like any other change."""
    work.say(Stage.APPLYING, "putting the state before the run back")
    job = replace(work.job, desired=restoring(work.seen), journal=NoJournal(), agreed=None)
    inner = Work(job, work.contact, work.started, restores=True, session=session, before=now)
    inner.protection = Protection.SAFE_MODE if now.facts.has_safe_mode else Protection.NONE
    try:
        inner.plan = plan(job.name, job.desired, now)
        inner.stages = cut(inner.plan, inner.protection)
        await change(inner)
    except NetcfgError as failed:
        outcome = await settle(inner, failed)
        if outcome.status is not Status.CHANGED:
            return _unknown(work, f"{reason}; putting the old state back failed: {outcome.message}")
    left = differing(work.seen, inner.after or now)
    if left:
        return _unknown(work, f"{reason}; the old state was put back, but {_names(left)} still differ")
    return _rolled_back(work, reason, "put back by us")


def _names(menus: tuple[str, ...]) -> str:
    more = f" and {len(menus) - _SHOWN} more menus" if len(menus) > _SHOWN else ""
    return ", ".join(menus[:_SHOWN]) + more


def _count(work: Work) -> str:
    number = len(work.aim.actions)
    return f"{number} action{'s' if number != 1 else ''}"
