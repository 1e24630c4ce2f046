"""What takes a change back when we cannot: the device's own safe mode, or nothing (before RouterOS 7.18).

Manual, Configuration Management, Safe Mode. Over the API from RouterOS 7.18; one session holds it; when that session
ends the device undoes what was not released: at once after a clean close, after about nine minutes when the link died.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

from atlantis_netcfg.errors import DeviceFailed
from atlantis_netcfg.routeros.api import Command

if TYPE_CHECKING:
    from collections.abc import Sequence

    from atlantis_netcfg.routeros.api import Reply
    from atlantis_netcfg.routeros.apply._job import Channel

__all__ = ["BUDGET", "HOLD", "TAKE", "Hold", "Protection", "ProtectionLost", "release", "take_failed", "unroll"]

BUDGET = 80
"""Entries of history that one safe mode may take. The device keeps 100 (manual, Configuration Management); beyond them
it leaves safe mode without a word. Whether a script counts once or once a row is not documented: counted per row."""

HOLD = Command("/safe-mode/print")
TAKE = Command("/safe-mode/take")
_RELEASE = Command("/safe-mode/release")
_UNROLL = Command("/safe-mode/unroll")
_TRUE = ("true", "yes")


class Protection(StrEnum):
    """Who takes an unfinished change back."""

    SAFE_MODE = "safe-mode"
    NONE = "none"
    """Nobody: only for changes that can do no harm by themselves, and we put the old state back ourselves."""


class ProtectionLost(DeviceFailed):
    """Safe mode is not ours any more while changes depend on it: nothing more may be sent."""


@dataclass(frozen=True, slots=True)
class Hold:
    """Who holds safe mode, as one session sees it."""

    taken: bool
    ours: bool = False
    """This session holds it."""
    who: str = ""

    @classmethod
    def of(cls, reply: Reply) -> Hold:
        """Read the answer to HOLD; a device without safe mode has nobody who holds it."""
        row = reply.rows[0] if reply.trap is None and reply.rows else {}
        if row.get("enabled") not in _TRUE:
            return cls(taken=False)
        return cls(True, row.get("current") in _TRUE, row.get("owner") or row.get("user") or "somebody")


def take_failed(take: Reply, hold: Hold) -> DeviceFailed:
    """Say why safe mode could not be taken."""
    if hold.taken and not hold.ours:
        return DeviceFailed(
            f"{hold.who} holds safe mode, and there is only one",
            hint="let them release or unroll it, then run the same command again",
        )
    words = take.trap.message if take.trap is not None else "it says it is not taken"
    return DeviceFailed(f"safe mode could not be taken: {words}")


async def release(session: Channel, witness: Sequence[Command] = ()) -> list[Reply]:
    """Make everything permanent and see that we do not hold safe mode any more. Raises ProtectionLost.

    All answers come in one round trip, those to `witness` are returned. If who holds it was looked up before it was
    released it still says `ours`, which proves nothing, and is asked again.
    """
    reply, seen, *witnessed = await session.flight([_RELEASE, HOLD, *witness])
    hold = Hold.of(seen)
    if hold.ours:
        hold = Hold.of(await session.command(HOLD))
    if reply.trap is not None or hold.ours:
        words = reply.trap.message if reply.trap is not None else "it is still taken"
        raise ProtectionLost(f"safe mode could not be released: {words}")
    return witnessed


async def unroll(session: Channel) -> None:
    """Let the device take everything back. Raises Refused if this session does not hold safe mode."""
    (await session.command(_UNROLL)).checked()
