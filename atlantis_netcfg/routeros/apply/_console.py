"""Safe mode of an SSH session kept open while the API session writes: the only kind before RouterOS 7.18.

Ctrl+X takes and releases it (manual, Configuration Management). Imported only if needed, since the SSH client is heavy.
"""

from __future__ import annotations

import asyncio
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeVar

from atlantis_netcfg.core.errors import DeviceError
from atlantis_netcfg.core.messages import alternatives, arg
from atlantis_netcfg.routeros import api, safe_mode
from atlantis_netcfg.routeros.console import types

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from atlantis_netcfg.routeros.api._values import Channel
    from atlantis_netcfg.routeros.apply._job import OpenConsole, SshEndpoint

T = TypeVar("T")


_ACTIVE = api.Command("/user/active/print", ((".proplist", "name,address,via"),))


_CONSOLES = ("ssh", "console", "telnet", "winbox", "mac-telnet", "local", "web")


_LOOK = ':put "atlantis"'


_US = "our SSH session"


@dataclass(slots=True)
class ConsoleSafeMode(safe_mode.NoSafeMode):
    """Safe mode of an SSH session (Ctrl+X) that is kept open while the API session writes.

    Before 7.18 the API does not show who holds it. Our own prompt contains `<SAFE>`. A second user who tries to take it
    gets a prompt, to which we always reply `d` (don't take it).
    """

    opener: OpenConsole
    endpoint: SshEndpoint
    patience_s: float
    """Timeout in seconds for a console that has become silent."""
    beside: tuple[api.Command, ...] = field(default=(), init=False)
    _console: types.Console | None = field(default=None, init=False)

    async def take(self, session: Channel) -> safe_mode.Holder:
        """Open the console and take safe mode in it."""
        if self._console is None:
            self._console = await in_thread(lambda: self.opener(self.endpoint), undone=lambda console: console.close())
        try:
            await in_thread(self._console.take_safe_mode)
        except types.SafeModeHeld:
            await self.drop()
            raise safe_mode.holder_error(await _somebody(session)) from None
        except DeviceError:
            await self.drop()
            raise
        return safe_mode.Holder(is_taken=True, ours=True, who=_US)

    async def look(self, session: Channel) -> safe_mode.Holder:  # noqa: ARG002 - the console answers
        """Request a new prompt and read the state of safe mode from it."""
        console = self._console
        if console is None:
            return safe_mode.Holder(is_taken=False)
        try:
            await in_thread(lambda: console.run(_LOOK, timeout_s=self.patience_s))
        except DeviceError:
            await self.drop()
            return safe_mode.Holder(is_taken=False)
        return safe_mode.Holder(is_taken=console.safe, ours=console.safe, who=_US)

    async def release(self, session: Channel, witness: Sequence[api.Command]) -> list[api.Reply]:
        """Release with Ctrl+X, then read the changed menu, which shows if it was undone instead."""
        console = self._console
        if console is None or not console.safe:
            raise safe_mode.ProtectionLost("safe mode could not be released: its SSH session has ended")
        try:
            await in_thread(console.release_safe_mode)
        except DeviceError as failed:
            await self.drop()
            raise safe_mode.ProtectionLost(f"safe mode could not be released: {arg(failed)}") from failed
        return await session.flight(witness) if witness else []

    async def unroll(self, session: Channel) -> None:  # noqa: ARG002
        """Close the console without releasing; `free` reports when the device has undone the change."""
        await self.drop()

    async def free(self, session: Channel) -> safe_mode.Holder:
        """Check that nobody holds safe mode: take it with a new console and release it at once."""
        await self.drop()
        try:
            console = await in_thread(
                lambda: self.opener(self.endpoint), undone=lambda new_console: new_console.close()
            )
        except types.ConsoleUnreachable:
            return safe_mode.Holder(is_taken=True, who="an SSH session that cannot be identified")
        try:
            await in_thread(console.take_safe_mode)
            await in_thread(console.release_safe_mode)
        except types.SafeModeHeld:
            return safe_mode.Holder(is_taken=True, who=await _somebody(session))
        except DeviceError:
            return safe_mode.Holder(is_taken=True, who="an SSH session that was lost")
        finally:
            await in_thread(console.close)
        return safe_mode.Holder(is_taken=False)

    async def drop(self) -> None:
        """Close the console; if safe mode is held, drop the connection, which undoes the change."""
        console, self._console = self._console, None
        if console is not None:
            with suppress(DeviceError, OSError):
                await in_thread(console.close)


async def in_thread(work: Callable[[], T], undone: Callable[[T], object] | None = None) -> T:
    """Run a blocking call in a thread; on cancellation wait for its end, then call `undone` with its result."""
    running = asyncio.ensure_future(asyncio.to_thread(work))
    try:
        return await asyncio.shield(running)
    except asyncio.CancelledError:
        with suppress(Exception):
            brought = await running
            if undone is not None:
                await asyncio.to_thread(undone, brought)
        raise


async def _somebody(session: Channel) -> str:
    """Name the users on a console: before 7.18 the device does not say which of them holds safe mode."""
    try:
        reply = await session.command(_ACTIVE)
    except (api.SessionLost, api.CommandError):
        return "somebody"
    rows = [row for row in reply.rows if row.get("via", "").startswith(_CONSOLES)]
    names = dict.fromkeys(f"{row.get('via')}:{row.get('name')}@{row.get('address') or 'console'}" for row in rows)
    return alternatives(names) or "somebody"
