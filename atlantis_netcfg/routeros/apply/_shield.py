"""Safe mode, held by the session that writes (here) or by a console beside it (`_console`): one seam for both.

Of a dead session's safe mode nothing is ever released by us: it is waited for until the device has undone it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from atlantis_netcfg.core.errors import DeviceFailed
from atlantis_netcfg.routeros.api import Command
from atlantis_netcfg.routeros.apply._protection import ProtectionLost

if TYPE_CHECKING:
    from collections.abc import Sequence

    from atlantis_netcfg.routeros.api import Reply
    from atlantis_netcfg.routeros.apply._job import Channel

__all__ = ["HOLD", "ApiShield", "Held", "Hold", "NoShield", "Shield", "held_by"]

HOLD = Command("/safe-mode/print")
_TAKE = Command("/safe-mode/take")
_RELEASE = Command("/safe-mode/release")
_UNROLL = Command("/safe-mode/unroll")
_TRUE = ("true", "yes")


class Held(DeviceFailed):
    """Safe mode is not ours: somebody else holds it, or it could not be taken."""


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


def _take_failed(take: Reply, hold: Hold) -> Held:
    """Say why safe mode could not be taken."""
    if hold.taken and not hold.ours:
        return held_by(hold.who)
    words = take.trap.message if take.trap is not None else "it says it is not taken"
    return Held(f"safe mode could not be taken: {words}")


def held_by(who: str) -> Held:
    """Say who was faster."""
    return Held(
        f"{who} holds safe mode, and there is only one",
        hint="let them release or unroll it, then run the same command again",
    )


class Shield(Protocol):
    """What the executor asks of whoever takes a change back."""

    beside: tuple[Command, ...]
    """Asked in the same round trip as every turn of writing; `seen` reads the answers."""

    def seen(self, answers: Sequence[Reply]) -> Hold | None:
        """Who holds safe mode as the answers to `beside` say; None if they say nothing."""

    async def take(self, session: Channel) -> Hold:
        """Take it. Raises DeviceFailed if it is not ours then."""

    taking: tuple[Command, ...]
    """What takes it, to be sent beside other things; `taken` reads the answers."""

    async def taken(self, session: Channel, answers: Sequence[Reply]) -> Hold:
        """Read the answers to `taking`. Raises Held if it is not ours then, SessionLost."""

    async def look(self, session: Channel) -> Hold:
        """Ask who holds it. Raises SessionLost."""

    async def release(self, session: Channel, witness: Sequence[Command]) -> list[Reply]:
        """Make everything permanent and see that we do not hold it any more; answers to `witness`.

        Raises ProtectionLost.
        """

    async def unroll(self, session: Channel) -> None:
        """Let the device take everything back. Raises Refused, SessionLost."""

    async def free(self, session: Channel) -> Hold:
        """Ask who holds it after a loss; ours if this session does. Raises SessionLost."""

    async def drop(self) -> None:
        """End what is held open beside the session; what was not released the device undoes. Never raises."""


class NoShield:
    """For changes without safe mode."""

    beside: tuple[Command, ...] = ()
    taking: tuple[Command, ...] = ()

    def seen(self, answers: Sequence[Reply]) -> Hold | None:  # noqa: ARG002 - the seam's
        """Nobody can take away what is not there."""
        return None

    async def take(self, session: Channel) -> Hold:  # noqa: ARG002
        """Nothing to take."""
        return Hold(taken=False)

    async def taken(self, session: Channel, answers: Sequence[Reply]) -> Hold:  # noqa: ARG002
        """Nothing was taken."""
        return Hold(taken=False)

    async def look(self, session: Channel) -> Hold:  # noqa: ARG002
        """Nobody."""
        return Hold(taken=False)

    async def release(self, session: Channel, witness: Sequence[Command]) -> list[Reply]:
        """Everything is permanent as soon as it is written."""
        return await session.flight(witness) if witness else []

    async def unroll(self, session: Channel) -> None:
        """Nobody takes anything back."""

    async def free(self, session: Channel) -> Hold:  # noqa: ARG002
        """Nobody."""
        return Hold(taken=False)

    async def drop(self) -> None:
        """Nothing is open."""


class ApiShield(NoShield):
    """Safe mode of the session that writes, from RouterOS 7.18."""

    beside: tuple[Command, ...] = (HOLD,)
    taking: tuple[Command, ...] = (_TAKE, HOLD)

    def seen(self, answers: Sequence[Reply]) -> Hold | None:
        """As `current` says."""
        return Hold.of(answers[0])

    async def take(self, session: Channel) -> Hold:
        """One round trip, or two."""
        return await self.taken(session, await session.flight(self.taking))

    async def taken(self, session: Channel, answers: Sequence[Reply]) -> Hold:
        """That the question was answered before it was taken proves nothing: then ask again."""
        take, seen = answers
        hold = Hold.of(seen)
        if take.trap is None and not hold.ours:
            hold = await self.look(session)
        if not hold.ours:
            raise _take_failed(take, hold)
        return hold

    async def look(self, session: Channel) -> Hold:
        """One round trip."""
        return Hold.of(await session.command(HOLD))

    async def release(self, session: Channel, witness: Sequence[Command]) -> list[Reply]:
        """One round trip. If the look came before the release it still says `ours`, and is repeated."""
        reply, seen, *witnessed = await session.flight([_RELEASE, HOLD, *witness])
        hold = Hold.of(seen)
        if hold.ours:
            hold = await self.look(session)
        if reply.trap is not None or hold.ours:
            words = reply.trap.message if reply.trap is not None else "it is still taken"
            raise ProtectionLost(f"safe mode could not be released: {words}")
        return witnessed

    async def unroll(self, session: Channel) -> None:
        """By command; the session lives on."""
        if (await self.look(session)).ours:
            (await session.command(_UNROLL)).checked()

    async def free(self, session: Channel) -> Hold:
        """One round trip."""
        return await self.look(session)
