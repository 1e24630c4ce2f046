"""The serial line of an emulated router: a pty with a console that waits for a login.

Network faults do not affect it, but a reboot does. Not emulated: baud rates, parity, line noise and flow control; boot
messages are only outlined.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import tty
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.answers import Caller, Trap
from atlantis_netcfg.emulator.routeros.shell._work import ConnectionLost
from atlantis_netcfg.emulator.routeros.shell.keys import Key, Keyboard, Screen, split_login
from atlantis_netcfg.emulator.routeros.shell.session import ConsoleSession, DirectTalk

if TYPE_CHECKING:
    from atlantis_netcfg.emulator.routeros.device import ConsoleReply, Device
    from atlantis_netcfg.emulator.routeros.wire.host import RouterHost

_MOST = 65536
_BUFFER_SIZE = 262144
"""Size of the output buffer in bytes without a reader; older output is lost, as on an unconnected line."""
_LOGIN_FAILED = "Login failed, incorrect username or password"
_GOING_DOWN = "\r\nRebooting...\r\n"
_STARTING = "\r\nRouterBOOT booter {version}\r\n\r\n{board}\r\n\r\nloading kernel... OK\r\nStarting services...\r\n"


class SerialLine:
    """A connected serial line; clients open `path`."""

    def __init__(self, host: RouterHost, device: Device) -> None:
        self._host = host
        self._device = device
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.path = os.ttyname(self._slave)
        self._typed: asyncio.Queue[bytes] = asyncio.Queue()
        self._unsaid = bytearray()
        self._caller: Caller | None = None
        self._screen = Screen()
        self._session: ConsoleSession | None = None
        self._tasks: list[asyncio.Task[None]] = []

    def start(self) -> None:
        """Start listening."""
        asyncio.get_running_loop().add_reader(self._master, self._receive)
        self._begin()

    def close(self) -> None:
        """Disconnect the line."""
        loop = asyncio.get_running_loop()
        loop.remove_reader(self._master)
        loop.remove_writer(self._master)
        self._end()
        os.close(self._master)
        os.close(self._slave)

    def down(self, *, clean: bool) -> None:
        """Handle the shutdown of the router."""
        self._caller = self._session = None
        self._end()
        if clean:
            self._write(_GOING_DOWN.encode())

    def up(self) -> None:
        """Handle the start of the router."""
        spec = self._device.spec
        self._write(_STARTING.format(version=spec.version, board=spec.board).encode())
        self._begin()

    def check(self) -> None:
        """Log out if this session was removed from `/user/active`."""
        if self._caller is not None and self._caller.number in self._device.closed_sessions:
            self._log_out()
            self._end()
            self._begin()

    def say_pending(self) -> None:
        """Show pending messages of the router."""
        if self._session is not None:
            self._session.tell()

    def speaks(self, caller: Caller) -> bool:
        """Return whether this session is logged in here."""
        return self._caller is caller

    # --- bytes -----------------------------------------------------------------------------------------------------

    def _receive(self) -> None:
        with contextlib.suppress(BlockingIOError, OSError):
            self._typed.put_nowait(os.read(self._master, _MOST))

    def _write(self, data: bytes) -> None:
        self._unsaid += data
        del self._unsaid[:-_BUFFER_SIZE]
        self._flush()

    def _flush(self) -> None:
        with contextlib.suppress(BlockingIOError):
            while self._unsaid:
                del self._unsaid[: os.write(self._master, self._unsaid)]
        loop = asyncio.get_running_loop()
        if self._unsaid:
            loop.add_writer(self._master, self._flush)
        else:
            loop.remove_writer(self._master)

    # --- the dialogue ----------------------------------------------------------------------------------------------

    def _begin(self) -> None:
        task = asyncio.create_task(self._serve())
        self._tasks.append(task)
        self._host.watch(task)

    def _end(self) -> None:
        for task in self._tasks:
            if task is not asyncio.current_task():
                task.cancel()
        self._tasks.clear()

    async def _serve(self) -> None:
        """Serve one login after another."""
        while not self._typed.empty():
            self._typed.get_nowait()
        while True:
            self._write(f"\r\n\r\nMikroTik {self._device.spec.version} (stable)\r\n".encode())
            await self._log_in()
            try:
                await self._run_session()
            except ConnectionLost:
                return
            self._log_out()

    async def _log_in(self) -> None:
        while self._caller is None:
            self._write(b"Login: ")
            name = await self._line(has_echo=True)
            if not name:
                continue
            self._write(b"Password: ")
            password = await self._line(has_echo=False)
            try:
                self._caller = self._device.login(split_login(name)[0], password, via="console", address="")
            except Trap:
                self._write(f"{_LOGIN_FAILED}\r\n\r\n".encode())
            else:
                self._screen = split_login(name)[1]

    async def _line(self, *, has_echo: bool) -> str:
        """Read a line typed without the console's editor."""
        text, keys = "", Keyboard()
        while True:
            data = await self._typed.get()
            for place, byte in enumerate(data):
                for key in keys.feed(bytes([byte])):
                    if key is Key.ENTER:
                        self._write(b"\r\n")
                        self._unread(data[place + 1 :])
                        return text
                    if key is Key.BACKSPACE and text:
                        text = text[:-1]
                        self._write(b"\b \b" if has_echo else b"")
                    elif isinstance(key, str):
                        text += key
                        self._write(key.encode(errors="surrogateescape") if has_echo else b"")

    def _unread(self, data: bytes) -> None:
        """Put back input that was typed ahead, without the line feed of a CR LF."""
        rest = [data.removeprefix(b"\n")]
        while not self._typed.empty():
            rest.append(self._typed.get_nowait())
        if any(rest):
            self._typed.put_nowait(b"".join(rest))

    async def _run_session(self) -> None:
        if self._caller is None:
            return
        talk = _SettledTalk(self, self._host, self._device, self._caller)
        self._session = session = ConsoleSession(talk, self._screen, self._write, has_size=False)
        await session.start()
        while not session.over:
            patience = None if session.begun else self._host.knobs.probe_s
            try:
                async with asyncio.timeout(patience):
                    data = await self._typed.get()
            except TimeoutError:
                await session.give_up()
            else:
                await session.feed(data)
        if session.quitted:
            self._device.keep(self._caller)

    def _log_out(self) -> None:
        if self._caller is not None:
            self._device.logout(self._caller, clean=True)
            self._host.tell()
        self._caller = self._session = None


class _SettledTalk(DirectTalk):
    """Console access that also applies changes to the router's network."""

    def __init__(self, line: SerialLine, host: RouterHost, device: Device, caller: Caller) -> None:
        super().__init__(device, caller)
        self._line = line
        self._host = host

    async def _settle(self, reply: ConsoleReply) -> ConsoleReply:
        await self._host.settle()
        self._host.tell()
        if not self._line.speaks(self.caller):
            raise ConnectionLost  # the router went down, or somebody has logged this session out
        return reply

    async def type(self, line: str, width: int | None) -> ConsoleReply:
        return await self._settle(await super().type(line, width))

    async def safe_key(self, choice: str) -> ConsoleReply:
        """Press Ctrl+X, or answer its question."""
        return await self._settle(await super().safe_key(choice))

    async def confirm(self, line: str) -> ConsoleReply:
        """Run a line whose question was answered with yes."""
        return await self._settle(await super().confirm(line))
