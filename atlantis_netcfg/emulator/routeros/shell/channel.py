"""One session channel of an SSH connection: an interactive console, or one command."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, cast

import asyncssh

from atlantis_netcfg.emulator.routeros.shell.labour import Gone
from atlantis_netcfg.emulator.routeros.shell.session import Session

if TYPE_CHECKING:
    from collections.abc import Callable

    from atlantis_netcfg.emulator.routeros.answers import Caller
    from atlantis_netcfg.emulator.routeros.device import Device, Printed
    from atlantis_netcfg.emulator.routeros.shell.flags import Screen
    from atlantis_netcfg.emulator.routeros.shell.ssh import SshConnection

_MOST = 65536
_INTERRUPT = b"\x03"


class Shell:
    """What serves the channel; keys that come while a command runs wait their turn in asyncssh's buffer."""

    def __init__(
        self, connection: SshConnection, stdin: asyncssh.SSHReader[bytes], stdout: asyncssh.SSHWriter[bytes]
    ) -> None:
        self._connection = connection
        self._stdin = stdin
        self._channel = cast("asyncssh.SSHServerChannel[bytes]", stdout.channel)
        self._session: Session | None = None

    def start(self) -> None:
        """Begin, beside asyncssh: what was typed is done even if nobody waits for it any more."""
        self._connection.opened(self)
        self._connection.go(self._work())

    def tell(self) -> None:
        """Show what the router has to say unasked."""
        if self._session is not None:
            self._session.tell()

    async def _work(self) -> None:
        caller = self._connection.caller()
        command = self._channel.get_command()
        try:
            if command is None:
                await self._converse(caller)
            else:
                await self._obey(caller, command)
        except Gone:
            pass
        finally:
            self._connection.shut(self)
            self._connection.left(caller)

    async def _obey(self, caller: Caller, command: str) -> None:
        printed = await WireTalk(self._connection, caller).type(command, None)
        lines = printed.text.split("\n") if printed.text else []
        self._say("".join(f"{line}\r\n" for line in lines).encode(errors="surrogateescape"))
        if not self._channel.is_closing():
            self._channel.exit(1 if printed.failed else 0)

    async def _converse(self, caller: Caller) -> None:
        """Feed the session until it or the terminal has had enough."""
        kind = self._channel.get_terminal_type()
        session = Session(WireTalk(self._connection, caller), self._screen(kind), self._say, sized=kind is not None)
        self._session = session
        await session.start()
        patience: float | None = self._connection.host.knobs.probe_s
        while not session.over:
            try:
                async with asyncio.timeout(None if session.begun else patience):
                    data = await self._stdin.read(_MOST)
            except TimeoutError:
                await session.give_up()
            except asyncssh.TerminalSizeChanged as size:
                session.resize(size.width, size.height)
            except (asyncssh.BreakReceived, asyncssh.SignalReceived):
                await session.feed(_INTERRUPT)
            except (OSError, asyncssh.Error):
                break
            else:
                if not data:
                    break
                self._connection.tally.counters.bytes_in += len(data)
                await session.feed(data)
        if session.quitted:
            self._connection.device.keep(caller)
        if not self._channel.is_closing():
            self._channel.exit(0)

    def _screen(self, kind: str | None) -> Screen:
        """The terminal's own size, unless the login's flags say another; without a terminal none of its tricks."""
        screen = self._connection.screen
        if kind is None:
            return screen.plain()
        width, height, *_ = self._channel.get_terminal_size()
        screen = screen.sized(*(ours or theirs for ours, theirs in zip(screen.asked, (width, height), strict=True)))
        return screen.plain() if kind == "dumb" else screen

    def _say(self, data: bytes) -> None:
        if not self._channel.is_closing():
            self._connection.tally.counters.bytes_out += len(data)
            self._channel.write(data)


class WireTalk:
    """A console's talk with its device, through the faults of its connection."""

    def __init__(self, connection: SshConnection, caller: Caller) -> None:
        self.caller = caller
        self.device: Device = connection.device
        self._labour = connection.labour

    async def type(self, line: str, width: int | None) -> Printed:
        """Run a line."""
        return await self._labour.run(line, lambda: self.device.type(self.caller, line, width=width))

    async def safe_key(self, choice: str) -> Printed:
        """Press Ctrl+X, or answer its question."""
        return await self._labour.run("ctrl+x", lambda: self.device.safe_key(self.caller, choice))

    async def confirm(self, line: str) -> Printed:
        """Run a line whose question was answered with yes."""
        return await self._labour.run("y", lambda: self.device.type(self.caller, line, confirmed=True))

    async def set_password(self, password: str) -> str:
        """Give the caller a new password; the refusal, or nothing."""
        return await self._quiet("new password", lambda: self.device.set_password(self.caller, password))

    async def remove_defaults(self) -> None:
        """Take the default configuration away."""
        await self._quiet("remove defaults", self._remove_defaults)

    def _remove_defaults(self) -> str:
        self.device.remove_defaults(self.caller)
        return ""

    async def _quiet(self, name: str, action: Callable[[], str]) -> str:
        faults = await self._labour.begin(name)
        text = action()
        await self._labour.end(faults)
        return text
