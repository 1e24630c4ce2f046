"""Safe mode: whatever is not released, the device undoes. One implementation for a device alone and for a bridge.

Manual, Configuration Management, Safe Mode: one session holds it, any session may release it, and when the holder has
gone the device undoes the changes of all sessions: at once after a clean close, after about nine minutes when the link
died. Of a dead session's safe mode nothing is ever released by us: it is waited for until the device has undone it.
From RouterOS 7.18 the session that writes holds it (`ApiSafeMode`), before that a console beside it (`_console`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from atlantis_netcfg.core.errors import DeviceError
from atlantis_netcfg.routeros.api import Command, Reply

if TYPE_CHECKING:
    from collections.abc import Sequence

    from atlantis_netcfg.routeros.api._values import Channel

BUDGET = 82
"""Entries of history that one safe mode may take. The device keeps 100 (manual, Configuration Management); beyond them
it leaves safe mode without a word. Counted per row.

Assumption: safe-mode-counts-rows
Assumption: safe-mode-undoes-scripts
Assumption: safe-mode-second-taker
Assumption: safe-mode-current
Assumption: safe-mode-idle
"""
DEAD_SESSION_S = 600.0
"""Until safe mode of a dead session is undone: about nine minutes (manual, Configuration Management), and some."""

READ = Command("/safe-mode/print")
TAKE, RELEASE, UNROLL = (Command(f"/safe-mode/{word}") for word in ("take", "release", "unroll"))
_TRUE = ("true", "yes")


class SafeModeUnavailable(DeviceError):
    """Safe mode is not ours: somebody else holds it, or it could not be taken."""

    reason = "somebody else holds it"


class ProtectionLost(DeviceError):
    """The protection is not ours any more while changes depend on it: nothing more may be sent."""


@dataclass(frozen=True, slots=True)
class Holder:
    """Who holds safe mode, as one session sees it."""

    is_taken: bool
    ours: bool = False
    """This session holds it."""
    who: str = ""

    @classmethod
    def of(cls, reply: Reply) -> Holder:
        """Read the answer to READ; a device without safe mode has nobody who holds it."""
        row = reply.rows[0] if reply.trap is None and reply.rows else {}
        if row.get("enabled") not in _TRUE:
            return cls(is_taken=False)
        return cls(True, row.get("current") in _TRUE, row.get("owner") or row.get("user") or "somebody")


def held_by(who: str) -> SafeModeUnavailable:
    """Say who was faster."""
    return SafeModeUnavailable(
        f"{who} holds safe mode, and there is only one",
        hint="let them release or unroll it, then run the same command again",
    )


def _take_failed(take: Reply, holder: Holder) -> SafeModeUnavailable:
    """Say why safe mode could not be taken."""
    if holder.is_taken and not holder.ours:
        return held_by(holder.who)
    words = take.trap.message if take.trap is not None else "it says it is not taken"
    failure = SafeModeUnavailable(f"safe mode could not be taken: {words}")
    failure.reason = words
    return failure


class SafeMode(Protocol):
    """What the executor asks of whoever takes a change back."""

    beside: tuple[Command, ...]
    """Asked in the same round trip as every turn of writing; `read_holder` reads the answers."""

    def read_holder(self, answers: Sequence[Reply]) -> Holder | None:
        """Who holds safe mode as the answers to `beside` say; None if they say nothing."""

    async def take(self, session: Channel) -> Holder:
        """Take it. Raises DeviceFailed if it is not ours then."""

    taking: tuple[Command, ...]
    """What takes it, to be sent beside other things; `confirm_take` reads the answers."""

    async def confirm_take(self, session: Channel, answers: Sequence[Reply]) -> Holder:
        """Read the answers to `taking`. Raises SafeModeUnavailable if it is not ours then, SessionLost."""

    async def look(self, session: Channel) -> Holder:
        """Ask who holds it. Raises SessionLost."""

    async def release(self, session: Channel, witness: Sequence[Command]) -> list[Reply]:
        """Make everything permanent and see that we do not hold it any more; answers to `witness`.

        Raises ProtectionLost.
        """

    async def unroll(self, session: Channel) -> None:
        """Let the device take everything back. Raises Refused, SessionLost."""

    async def free(self, session: Channel) -> Holder:
        """Ask who holds it after a loss; ours if this session does. Raises SessionLost."""

    async def drop(self) -> None:
        """End what is held open beside the session; what was not released the device undoes. Never raises."""


class NoSafeMode:
    """For changes without safe mode."""

    beside: tuple[Command, ...] = ()
    taking: tuple[Command, ...] = ()

    def read_holder(self, answers: Sequence[Reply]) -> Holder | None:  # noqa: ARG002 - the seam's
        """Nobody can take away what is not there."""
        return None

    async def take(self, session: Channel) -> Holder:  # noqa: ARG002
        """Nothing to take."""
        return Holder(is_taken=False)

    async def confirm_take(self, session: Channel, answers: Sequence[Reply]) -> Holder:  # noqa: ARG002
        """Nothing was taken."""
        return Holder(is_taken=False)

    async def look(self, session: Channel) -> Holder:  # noqa: ARG002
        """Nobody."""
        return Holder(is_taken=False)

    async def release(self, session: Channel, witness: Sequence[Command]) -> list[Reply]:
        """Everything is permanent as soon as it is written."""
        return await session.flight(witness) if witness else []

    async def unroll(self, session: Channel) -> None:
        """Nobody takes anything back."""

    async def free(self, session: Channel) -> Holder:  # noqa: ARG002
        """Nobody."""
        return Holder(is_taken=False)

    async def drop(self) -> None:
        """Nothing is open."""


class ApiSafeMode(NoSafeMode):
    """Safe mode of the session that writes, from RouterOS 7.18. `silence_s`: for its answers, where not the usual."""

    beside: tuple[Command, ...] = (READ,)
    taking: tuple[Command, ...] = (TAKE, READ)

    def __init__(self, silence_s: float | None = None) -> None:
        self.silence_s = silence_s

    def read_holder(self, answers: Sequence[Reply]) -> Holder | None:
        """As `current` says."""
        return Holder.of(answers[0])

    async def take(self, session: Channel) -> Holder:
        """One round trip, or two."""
        return await self.confirm_take(session, await session.flight(self.taking, silence_s=self.silence_s))

    async def confirm_take(self, session: Channel, answers: Sequence[Reply]) -> Holder:
        """That the question was answered before it was taken proves nothing: then ask again."""
        take, holder_reply = answers
        holder = Holder.of(holder_reply)
        if take.trap is None and not holder.ours:
            holder = await self.look(session)
        if not holder.ours:
            raise _take_failed(take, holder)
        return holder

    async def look(self, session: Channel) -> Holder:
        """One round trip."""
        return Holder.of(await session.command(READ, silence_s=self.silence_s))

    async def release(self, session: Channel, witness: Sequence[Command], owner: str = "") -> list[Reply]:
        """One round trip. If the look came before the release it still says that it is held, and is repeated.

        `owner`: what the device calls the session that holds it, where that is another one of ours.
        """

        def is_held(holder: Holder) -> bool:
            return holder.is_taken and holder.who == owner if owner else holder.ours

        reply, holder_reply, *witness_replies = await session.flight(
            [RELEASE, READ, *witness], silence_s=self.silence_s
        )
        holder = Holder.of(holder_reply)
        if is_held(holder):
            holder = await self.look(session)
        if reply.trap is not None or is_held(holder):
            words = reply.trap.message if reply.trap is not None else "it is still taken"
            raise ProtectionLost(f"safe mode could not be released: {words}")
        return witness_replies

    async def release_of(self, session: Channel, owner: str) -> None:
        """Release what `owner` holds, from whatever session of ours, once it is seen that it still does.

        Raises ProtectionLost, SessionLost.
        """
        holder = await self.look(session)
        if not holder.is_taken or holder.who != owner:
            cause = f"taken by {holder.who}" if holder.is_taken else "given up"
            raise ProtectionLost(f"safe mode was {cause} before the end")
        await self.release(session, (), owner)

    async def unroll(self, session: Channel) -> None:
        """By command; the session lives on."""
        if (await self.look(session)).ours:
            (await session.command(UNROLL, silence_s=self.silence_s)).check()

    async def free(self, session: Channel) -> Holder:
        """One round trip."""
        return await self.look(session)
