"""Safe mode: the device undoes whatever is not released. One implementation for a single device and for a bridge.

Manual, Configuration Management, Safe Mode: one session holds it, any session may release it, and when the holder is
gone the device undoes the changes of all sessions: at once after a clean close, after about nine minutes if the link
died. Safe mode of a dead session is never released by us: we wait until the device has undone it.

From RouterOS 7.18 on the writing session holds it (`ApiSafeMode`), before that a separate console (`_console`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from atlantis_netcfg.core.errors import DeviceError
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.routeros.api import Command, Reply

if TYPE_CHECKING:
    from collections.abc import Sequence

    from atlantis_netcfg.routeros.api._values import Channel

BUDGET = 82
"""History entries that one safe mode may use. The device keeps 100 (manual, Configuration Management); beyond

them it silently leaves safe mode. Counted per row.

Assumption: safe-mode-counts-rows
Assumption: safe-mode-undoes-scripts
Assumption: safe-mode-second-taker
Assumption: safe-mode-current
Assumption: safe-mode-idle
"""
DEAD_SESSION_S = 600.0
"""Undo time for safe mode of a dead session: about nine minutes (manual, Configuration Management) and a margin."""

READ = Command("/safe-mode/print")
TAKE, RELEASE, UNROLL = (Command(f"/safe-mode/{word}") for word in ("take", "release", "unroll"))
_TRUE = ("true", "yes")


class SafeModeUnavailable(DeviceError):
    """Safe mode is not ours: somebody else holds it, or it could not be taken."""

    reason = "somebody else holds it"


class ProtectionLost(DeviceError):
    """We no longer hold the protection that the changes depend on: nothing more may be sent."""


@dataclass(frozen=True, slots=True)
class Holder:
    """The holder of safe mode, as seen by one session."""

    is_taken: bool
    ours: bool = False
    """This session holds safe mode."""
    who: str = ""

    @classmethod
    def of(cls, reply: Reply) -> Holder:
        """Parse the reply to READ; on a device without safe mode, nobody holds it."""
        row = reply.rows[0] if reply.trap is None and reply.rows else {}
        if row.get("enabled") not in _TRUE:
            return cls(is_taken=False)
        return cls(True, row.get("current") in _TRUE, row.get("owner") or row.get("user") or "somebody")


def holder_error(who: str) -> SafeModeUnavailable:
    """Return the error that somebody else already holds safe mode."""
    return SafeModeUnavailable(
        f"{arg(who)} holds safe mode, which only one session can hold",
        hint="let them release or undo it, then run the same command again",
    )


def _take_failed(take: Reply, holder: Holder) -> SafeModeUnavailable:
    """Return the error with the reason why safe mode could not be taken."""
    if holder.is_taken and not holder.ours:
        return holder_error(holder.who)
    words = take.trap.message if take.trap is not None else "the device reports that it is not taken"
    failure = SafeModeUnavailable(f"safe mode could not be taken: {arg(words)}")
    failure.reason = words
    return failure


class SafeMode(Protocol):
    """Interface of the executor to the mechanism that undoes a change."""

    beside: tuple[Command, ...]
    """Commands sent in the same round trip as every write turn; `read_holder` reads the replies."""

    def read_holder(self, answers: Sequence[Reply]) -> Holder | None:
        """Return the holder according to the replies to `beside`; None if they do not show it."""

    async def take(self, session: Channel) -> Holder:
        """Take safe mode. Raises DeviceError if it is not ours afterwards."""

    taking: tuple[Command, ...]
    """Commands that take safe mode, to be sent with others; `confirm_take` reads the replies."""

    async def confirm_take(self, session: Channel, answers: Sequence[Reply]) -> Holder:
        """Read the replies to `taking`. Raises SafeModeUnavailable if it is not ours, SessionLost."""

    async def look(self, session: Channel) -> Holder:
        """Request the holder of safe mode. Raises SessionLost."""

    async def release(self, session: Channel, witness: Sequence[Command]) -> list[Reply]:
        """Make everything permanent, check that we no longer hold safe mode, and return replies to `witness`.

        Raises ProtectionLost.
        """

    async def unroll(self, session: Channel) -> None:
        """Let the device undo everything. Raises CommandError, SessionLost."""

    async def free(self, session: Channel) -> Holder:
        """Request the holder after a loss; `ours` if this session holds it. Raises SessionLost."""

    async def drop(self) -> None:
        """Close what is open beside the session; the device undoes what was not released. Never raises."""


class NoSafeMode:
    """Implementation for changes without safe mode."""

    beside: tuple[Command, ...] = ()
    taking: tuple[Command, ...] = ()

    def read_holder(self, answers: Sequence[Reply]) -> Holder | None:  # noqa: ARG002 - the seam's
        """Return None: there is no holder."""
        return None

    async def take(self, session: Channel) -> Holder:  # noqa: ARG002
        """Do nothing; nobody holds safe mode."""
        return Holder(is_taken=False)

    async def confirm_take(self, session: Channel, answers: Sequence[Reply]) -> Holder:  # noqa: ARG002
        """Do nothing; nobody holds safe mode."""
        return Holder(is_taken=False)

    async def look(self, session: Channel) -> Holder:  # noqa: ARG002
        """Return that nobody holds safe mode."""
        return Holder(is_taken=False)

    async def release(self, session: Channel, witness: Sequence[Command]) -> list[Reply]:
        """Return the replies to `witness`; every write is permanent at once."""
        return await session.flight(witness) if witness else []

    async def unroll(self, session: Channel) -> None:
        """Do nothing: nothing is undone."""

    async def free(self, session: Channel) -> Holder:  # noqa: ARG002
        """Return that nobody holds safe mode."""
        return Holder(is_taken=False)

    async def drop(self) -> None:
        """Do nothing: nothing is open."""


class ApiSafeMode(NoSafeMode):
    """Safe mode of the writing session, from RouterOS 7.18 on. `silence_s`: timeout of its replies, if special."""

    beside: tuple[Command, ...] = (READ,)
    taking: tuple[Command, ...] = (TAKE, READ)

    def __init__(self, silence_s: float | None = None) -> None:
        self.silence_s = silence_s

    def read_holder(self, answers: Sequence[Reply]) -> Holder | None:
        """Return the holder from the reply to READ."""
        return Holder.of(answers[0])

    async def take(self, session: Channel) -> Holder:
        """Take safe mode in one or two round trips. Raises SafeModeUnavailable."""
        return await self.confirm_take(session, await session.flight(self.taking, silence_s=self.silence_s))

    async def confirm_take(self, session: Channel, answers: Sequence[Reply]) -> Holder:
        """Read the replies; if READ was answered before TAKE took effect, request the holder again."""
        take, holder_reply = answers
        holder = Holder.of(holder_reply)
        if take.trap is None and not holder.ours:
            holder = await self.look(session)
        if not holder.ours:
            raise _take_failed(take, holder)
        return holder

    async def look(self, session: Channel) -> Holder:
        """Request the holder; one round trip."""
        return Holder.of(await session.command(READ, silence_s=self.silence_s))

    async def release(self, session: Channel, witness: Sequence[Command], owner: str = "") -> list[Reply]:
        """Release in one round trip; if the state was read before the release, read it again.

        `owner`: the device's name of the holding session, if it is another session of ours.
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
            raise ProtectionLost(f"safe mode could not be released: {arg(words)}")
        return witness_replies

    async def release_of(self, session: Channel, owner: str) -> None:
        """Release what `owner` holds, from any of our sessions, after checking that it still does.

        Raises ProtectionLost, SessionLost.
        """
        holder = await self.look(session)
        if not holder.is_taken or holder.who != owner:
            cause = msg(f"taken by {arg(holder.who)}" if holder.is_taken else "given up")
            raise ProtectionLost(f"safe mode was {arg(cause)} before the end")
        await self.release(session, (), owner)

    async def unroll(self, session: Channel) -> None:
        """Undo by command; the session remains open."""
        if (await self.look(session)).ours:
            (await session.command(UNROLL, silence_s=self.silence_s)).check()

    async def free(self, session: Channel) -> Holder:
        """Request the holder; one round trip."""
        return await self.look(session)
