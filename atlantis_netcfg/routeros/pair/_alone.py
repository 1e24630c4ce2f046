"""The near end alone, after a run that has died when only the far end was kept: it has to follow it.

Only `resume` does so, and only where the far end is not to be seen. The near end is changed under its own safe mode,
and kept if the far end then answers over the new link; if not, it is as before.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import NetcfgError
from atlantis_netcfg.core.events import Stage
from atlantis_netcfg.routeros.apply import Status
from atlantis_netcfg.routeros.pair._transaction import SAFE_MODE

if TYPE_CHECKING:
    from atlantis_netcfg.routeros.apply import DeviceResult
    from atlantis_netcfg.routeros.pair._transaction import Transaction

__all__ = ["follow"]


async def follow(work: Transaction) -> DeviceResult | None:
    """Let the near end, which has been read, go where the far end is; None: it is kept, else how it ended."""
    near, far = work.near, work.far
    near.say(Stage.WAITING, f"{far.name} is not to be seen: {near.name} follows it to what is declared")
    try:
        await work.protect_near()
        await work.change_near()
        far.session = await far.contact.reach(work.pair.link_timeout_s, "following it")
        await work.release(near, near.channel)
    except NetcfgError as failure:
        return await _back(work, f"{far.name} did not answer after {near.name} had followed it: {failure}")
    return None


async def _back(work: Transaction, why: str) -> DeviceResult:
    """Take the near end back, and say what was read of it then."""
    near = work.near
    try:
        session = near.channel
        await SAFE_MODE.unroll(session)
        left = near.same(await near.reread(session))
    except NetcfgError as lost:
        return near.result(Status.UNKNOWN, f"the outcome is not known: {why}; then: {lost}")
    if left:
        return near.result(Status.UNKNOWN, f"the outcome is not known: {why}; it differs in {', '.join(left)}")
    return near.rolled_back(why)
