"""What runs that are over have left on the two ends of a bridge: taken away, or waited for, by what makes both alike.

A job `atlantis-pair` takes its end back if the link is lost. It goes once both ends are as declared and nobody holds
their safe mode: from then on both stay. While only its own end has the new radio it has to run, for the other one has
returned. In every other case the run that follows plans from what it reads, and arms a job of its own.
"""

from __future__ import annotations

import asyncio
from contextlib import suppress
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import DeviceFailed
from atlantis_netcfg.routeros.apply import Mode, Status
from atlantis_netcfg.routeros.safe_mode import DEAD_SESSION_S, ApiSafeMode
from atlantis_netcfg.routeros.scheduler_jobs import ARMED, DEAD_MAN

if TYPE_CHECKING:
    from atlantis_netcfg.routeros.apply import DeviceResult
    from atlantis_netcfg.routeros.pair._end import End
    from atlantis_netcfg.routeros.pair._transaction import Transaction

__all__ = ["clear", "read_again", "returned"]

Results = tuple["DeviceResult", "DeviceResult"]


async def clear(work: Transaction, mode: Mode) -> Results | None:
    """Leave nothing armed or open on either end, both read anew; else how the run ends."""
    stopped = _in_use(work, mode)
    if stopped:
        return _stopped(work, stopped)
    if any(_has_to_run(work, end) for end in work.ends):
        await _until_run(work)
        ended = await read_again(work) or _stopped_if(work, _in_use(work, mode))
        if ended is not None:
            return ended
    try:
        for end in work.ends:
            current = await ApiSafeMode().look(end.channel)
            if current.taken:
                return _stopped(work, f"{end.name}: {current.who} holds safe mode, and there is only one")
        for end in work.ends:
            if end.left:
                end.removed = await end.left.remove(end.channel)
                end.notes.append(f"removed {' and '.join(end.removed)}")
    except DeviceFailed as failure:
        return _stopped(work, str(failure))
    return await read_again(work) or _stopped_if(work, _in_use(work, mode))


async def returned(work: Transaction) -> None:
    """After a run that was killed: give both ends the time that they need to return by themselves."""
    for end in work.ends:
        try:
            session = await end.contact.reach(DEAD_SESSION_S + work.pair.link_timeout_s, "returning by itself")
            await end.contact.until_free(ApiSafeMode(), session, end.job.patience.undo_s)
            await end.contact.leave(session)
        except DeviceFailed:
            continue


def _in_use(work: Transaction, mode: Mode) -> str:
    """Say what may belong to a run that is alive; empty: nothing does.

    Of a bridge that is as declared, a job alone is none: who is at work there holds safe mode, or has changed nothing
    yet and sees that its job is gone.
    """
    settled = not any(end.actions for end in work.ends)
    for end in work.ends:
        other = end.signer.other(end.left.markers)
        if end.left.safe_mode is not None:
            return f"{end.name}: {end.left.safe_mode} holds safe mode, and there is only one"
        if other is not None:
            return f"{end.name}: {other.text} is under way on this device, or has died there"
        alive = end.left.alive(end.signer.is_over)
        if alive is not None and mode is not Mode.RESUME and not settled:
            return f"{end.name}: {alive}"
    return ""


def _has_to_run(work: Transaction, end: End) -> bool:
    """Tell whether the job of an end has to run: only this end has what is declared, or it is the way back of one."""
    if not end.left.jobs or not any(each.actions for each in work.ends):
        return False
    other = work.near if end is work.far else work.far
    return end.left.armed(DEAD_MAN) is not None or (other.changes_radio and not end.changes_radio)


async def _until_run(work: Transaction) -> None:
    """Wait until no job is armed any more; the link may come and go with that."""
    for end in work.ends:
        patience = end.job.patience
        with suppress(DeviceFailed):
            if end.left.jobs:
                longest_s = max(2 * work.pair.link_timeout_s, patience.undo_s + 2 * patience.dead_man_s)
                await end.contact.until_fired(end.channel, ARMED, longest_s)
    await returned(work)


async def read_again(work: Transaction) -> Results | None:
    """Read both ends in new sessions; how the run ends if that fails."""
    near, far = await asyncio.gather(work.near.problem(), work.far.problem())
    if near is None and far is None:
        return None
    site = work.near.job.site
    return (
        near or _left(work.near, site, f"{work.far.name} is away"),
        far or _left(work.far, site, f"{work.near.name} is away"),
    )


def _stopped_if(work: Transaction, why: str) -> Results | None:
    return _stopped(work, why) if why else None


def _stopped(work: Transaction, why: str) -> Results:
    return _left(work.near, work.near.job.site, why), _left(work.far, work.near.job.site, why)


def _left(end: End, site: str, why: str) -> DeviceResult:
    """`site`: the one that was asked for; from there both ends are reached."""
    hint = (
        "let them finish, then run the same command again; if a run of ours has died there:"
        f"  `provision resume site={site}`"
    )
    return end.result(Status.LEFT_AS_FOUND, f"nothing was changed: {why}", hint=hint)
