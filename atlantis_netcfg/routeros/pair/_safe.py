"""Safe mode as the pair needs it: by session, by owner, and without an answer where the link goes.

Manual, Configuration Management, Safe Mode: one session holds it, any session may release it, and when the holder has
gone the device undoes everything: at once after a clean close, after about nine minutes when the link died.
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import DeviceFailed
from atlantis_netcfg.routeros.api import Command

if TYPE_CHECKING:
    from atlantis_netcfg.routeros.api import Reply
    from atlantis_netcfg.routeros.apply import Channel

__all__ = ["HOLD", "Held", "HoldLost", "release", "take", "unroll", "until_free"]

HOLD = Command("/safe-mode/print")
_TAKE, _RELEASE, _UNROLL = (Command(f"/safe-mode/{word}") for word in ("take", "release", "unroll"))
_TRUE = ("true", "yes")
_SOON_S = 20.0
"""For answers at the end: the link was there a moment ago, and the far end's job will soon look."""


class HoldLost(DeviceFailed):
    """Safe mode is not ours, or not any more."""


@dataclass(frozen=True, slots=True)
class Held:
    """Who holds safe mode, as one session sees it."""

    taken: bool
    ours: bool
    who: str

    @classmethod
    def of(cls, reply: Reply) -> Held:
        """Read the answer to HOLD."""
        row = reply.rows[0] if reply.trap is None and reply.rows else {}
        who = row.get("owner") or row.get("user") or "somebody"
        return cls(row.get("enabled") in _TRUE, row.get("current") in _TRUE, who)


async def take(session: Channel, name: str) -> str:
    """Take safe mode and return what the device calls us. Raises HoldLost."""
    reply = await session.command(_TAKE)
    current = Held.of(await session.command(HOLD))
    if current.ours:
        return current.who
    words = (
        f"{current.who} holds it"
        if current.taken
        else reply.trap.message
        if reply.trap is not None
        else "no reason given"
    )
    raise HoldLost(f"{name}: safe mode could not be taken: {words}")


async def release(session: Channel, owner: str, name: str) -> None:
    """Release what `owner` holds, from whatever session, and see that it is released. Raises HoldLost, SessionLost."""
    current = Held.of(await session.command(HOLD, silence_s=_SOON_S))
    if not current.taken or current.who != owner:
        raise HoldLost(
            f"{name}: safe mode was {'taken by ' + current.who if current.taken else 'given up'} before the end"
        )
    reply = await session.command(_RELEASE, silence_s=_SOON_S)
    if reply.trap is not None or Held.of(await session.command(HOLD, silence_s=_SOON_S)).taken:
        words = reply.trap.message if reply.trap is not None else "it is still taken"
        raise HoldLost(f"{name}: safe mode could not be released: {words}")


async def unroll(session: Channel, silence_s: float) -> None:
    """Let the device take everything back, if this session holds safe mode. Raises SessionLost."""
    if Held.of(await session.command(HOLD, silence_s=silence_s)).ours:
        await session.command(_UNROLL, silence_s=silence_s)


async def until_free(session: Channel, patience_s: float, poll_s: float) -> Held:
    """Wait until nobody holds safe mode: the device may still have to undo what a dead session left open."""
    clock = asyncio.get_running_loop().time
    until = clock() + patience_s
    while True:
        current = Held.of(await session.command(HOLD))
        if not current.taken or clock() >= until:
            return current
        await asyncio.sleep(poll_s)
