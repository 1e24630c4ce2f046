"""SSH to an emulated router: asyncssh on the same pipe that carries the API.

Link, faults, firewall and counters act on the encrypted bytes. The host key is Ed25519, generated at first use and
stored on the flash; a real device has an RSA key unless `/ip/ssh host-key-type` is set otherwise.
"""

from __future__ import annotations

import asyncio
import base64
import hashlib
import logging
import socket
from typing import TYPE_CHECKING, Any, cast

import asyncssh
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    PublicFormat,
    load_ssh_private_key,
)

from atlantis_netcfg.core.paths import write_private
from atlantis_netcfg.emulator.routeros.answers import Caller, Trap
from atlantis_netcfg.emulator.routeros.shell._work import ConnectionLost, WorkItem
from atlantis_netcfg.emulator.routeros.shell.keys import Screen, split_login
from atlantis_netcfg.emulator.routeros.shell.session import ConsoleSession
from atlantis_netcfg.emulator.routeros.shell.sftp import Sftp
from atlantis_netcfg.emulator.routeros.wire import link
from atlantis_netcfg.emulator.routeros.wire.host import Pipe, RouterHost

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine
    from pathlib import Path

    from atlantis_netcfg.emulator.routeros.device import ConsoleReply, Device


_VERSION = "ROSSSH"
"""Name of the SSH server of RouterOS."""


class SshConnection:
    """One SSH connection: its login and its channels."""

    def __init__(self, host: RouterHost, device: Device, *, address: str, key: Callable[[], bytes]) -> None:
        self.host = host
        self.device = device
        self.tally = link.TrafficCounters("ssh")
        self.pipe = Pipe(host, "ssh")
        self.pipe.end = self
        self.labour = WorkItem(host, self)
        self.screen = Screen()
        self._address = address
        self._key = key
        self._caller: Caller | None = None
        self._callers: list[Caller] = []
        self._unused = True
        self._shells: list[SshShell] = []
        self._tasks: set[asyncio.Task[None]] = set()
        self._accepted = asyncio.Event()
        self._near: asyncio.Transport | None = None
        self._waiting: list[bytes] = []
        self._ssh: asyncssh.SSHServerConnection | None = None
        self._sent, self._listened = 0, -1
        self._closed = False

    @property
    def over(self) -> bool:
        """Whether the connection no longer responds."""
        return self._closed or self.pipe.ended or self.pipe.lost

    @property
    def logged_in(self) -> bool:
        """Whether a user is authenticated."""
        return self._caller is not None

    # --- what the pipe reports -------------------------------------------------------------------------------------

    def handle_accept(self) -> None:
        """Handle the accepted connection."""
        self._accepted.set()

    def handle_chunk(self, chunk: link.Chunk) -> None:
        """Handle data from the client."""
        if chunk.end is link.LineEnd.FIN and self._near is not None and not self._near.is_closing():
            self._near.write_eof()
        elif chunk.end is not None:
            self.hang_up()
        else:
            self.tally.counters.wire_in += len(chunk.data)
            if chunk.heard_count > self._listened:
                self.tally.counters.turns += 1
                self._listened = chunk.heard_count
            self._forward(chunk.data)

    def handle_loss(self) -> None:
        """Handle the loss of the client, once the router detects it."""
        self._abort()
        self.host.tell()

    async def work(self) -> None:
        """Serve SSH until the connection ends."""
        import asyncssh  # noqa: PLC0415 (slow to load, and most emulators get no SSH connection)

        logging.getLogger("asyncssh").setLevel(logging.CRITICAL)
        await self._accepted.wait()
        near, far = socket.socketpair()
        transport, _ = await asyncio.get_running_loop().create_connection(lambda: _Near(self), sock=near)
        self._near = transport
        for data in self._waiting:
            self._forward(data)
        try:
            await asyncssh.run_server(far, server_factory=lambda: _server(self), **self._options())
            await asyncio.Event().wait()
        except (OSError, asyncssh.Error, TimeoutError):
            self.hang_up()
        finally:
            if self._ssh is None:
                far.close()
            self._abort()

    def _options(self) -> dict[str, Any]:
        import asyncssh  # noqa: PLC0415

        def start(
            stdin: asyncssh.SSHReader[bytes], stdout: asyncssh.SSHWriter[bytes], _: asyncssh.SSHWriter[bytes]
        ) -> None:
            SshShell(self, stdin, stdout).start()

        return {
            "server_host_keys": [asyncssh.import_private_key(self._key())],
            "server_version": _VERSION,
            "session_factory": start,
            "sftp_factory": lambda channel: Sftp(channel, self),
            "allow_scp": True,
            "encoding": None,
            "line_editor": False,
            "kbdint_auth": False,
            "host_based_auth": False,
            "gss_host": None,
            "agent_forwarding": False,
        }

    # --- between the pipe and asyncssh -----------------------------------------------------------------------------

    def _forward(self, data: bytes) -> None:
        if self._near is None:
            self._waiting.append(data)
        elif not self._near.is_closing():
            self._near.write(data)

    def speak(self, data: bytes) -> None:
        """Send data to the client."""
        if not self.over:
            self._sent += 1
            self.tally.counters.wire_out += len(data)
            self.pipe.depart(link.Chunk(data, heard_count=self._sent))

    def hang_up(self) -> None:
        """Close the connection in the regular way."""
        if not self._closed:
            self.pipe.depart(link.Chunk(end=link.LineEnd.FIN))
            self._closed = True
            self.handle_loss()

    def _abort(self) -> None:
        if self._ssh is not None:
            self._ssh.abort()
        if self._near is not None:
            self._near.abort()

    # --- faults, and what happens to the router --------------------------------------------------------------------

    def drop(self) -> None:
        """Reset the connection at both ends."""
        self.pipe.stop(reset=True)

    def vanish(self) -> None:
        """Silence the connection permanently, without notice to either end."""
        self.pipe.vanish()

    def handle_reboot(self, *, clean: bool) -> None:
        """Handle a reboot: the router forgets its sessions."""
        self._callers.clear()
        for task in self._tasks - {asyncio.current_task()}:
            task.cancel()
        if self.pipe.established and clean:
            self.pipe.farewell()
        elif self.pipe.established:
            self.pipe.forget()

    def say_pending(self) -> None:
        """Show pending messages of the router."""
        for shell in self._shells:
            shell.tell()

    def check(self) -> None:
        """Close the connection if this session was removed from `/user/active`."""
        if any(caller.number in self.device.closed_sessions for caller in self._callers):
            self.hang_up()

    # --- what asyncssh asks ----------------------------------------------------------------------------------------

    def start_key_exchange(self, ssh: asyncssh.SSHServerConnection) -> None:
        """Handle the start of the key exchange."""
        self._ssh = ssh

    def admit(self, name: str, proof: str | bytes) -> bool:
        """Log in by password or public key; flags after the name describe the terminal."""
        user, self.screen = split_login(name)
        try:
            if isinstance(proof, bytes):
                self._caller = self.device.login_by_key(user, proof, via="ssh", address=self._address)
            else:
                self._caller = self.device.login(user, proof, via="ssh", address=self._address)
        except Trap:
            return False
        self._callers.append(self._caller)
        self.tally.counters.logins += 1
        return True

    def caller(self) -> Caller:
        """Return a separate session for each channel."""
        if self._caller is None:
            raise RuntimeError("a channel before the login")
        if self._unused:
            self._unused = False
            return self._caller
        another = self.device.again(self._caller)
        self._callers.append(another)
        return another

    def end_channel(self, caller: Caller) -> None:
        """Handle the end of a channel."""
        if caller in self._callers:
            self._callers.remove(caller)
            self.device.logout(caller, clean=True)
            self.host.tell()

    def add_shell(self, shell: SshShell) -> None:
        """Register a channel with a console."""
        self._shells.append(shell)

    def remove_shell(self, shell: SshShell) -> None:
        """Unregister a closed channel."""
        if shell in self._shells:
            self._shells.remove(shell)

    def start_task(self, work: Coroutine[Any, Any, None]) -> None:
        """Start a background task; it ends with the router, not with the connection."""
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        self.host.watch(task)


class _Near(asyncio.Protocol):
    """Our end of the socket pair; asyncssh has the other one."""

    def __init__(self, connection: SshConnection) -> None:
        self._connection = connection

    def data_received(self, data: bytes) -> None:
        self._connection.speak(data)

    def eof_received(self) -> None:
        self._connection.hang_up()

    def connection_lost(self, exc: Exception | None) -> None:
        del exc
        self._connection.hang_up()


def _server(connection: SshConnection) -> asyncssh.SSHServer:
    import asyncssh  # noqa: PLC0415

    class SshServer(asyncssh.SSHServer):
        """SSH server with logins and console channels, without forwarding."""

        def __init__(self) -> None:
            self.connection = connection
            self._name = ""
            self._key = b""

        def connection_made(self, conn: asyncssh.SSHServerConnection) -> None:
            connection.start_key_exchange(conn)

        def begin_auth(self, username: str) -> bool:
            self._name = username
            return True

        def password_auth_supported(self) -> bool:
            return connection.device.takes_password(split_login(self._name)[0])

        def validate_password(self, username: str, password: str) -> bool:
            return connection.admit(username, password)

        def public_key_auth_supported(self) -> bool:
            return True

        def validate_public_key(self, username: str, key: asyncssh.SSHKey) -> bool:
            self._key = key.public_data
            return connection.device.has_key(split_login(username)[0], self._key)

        def auth_completed(self) -> None:
            if not connection.logged_in:
                connection.admit(self._name, self._key)

    return SshServer()


_MOST = 65536
_INTERRUPT = b"\x03"


class SshShell:
    """Serves a console channel; keys typed while a command runs wait in asyncssh's buffer."""

    def __init__(
        self, connection: SshConnection, stdin: asyncssh.SSHReader[bytes], stdout: asyncssh.SSHWriter[bytes]
    ) -> None:
        self._connection = connection
        self._stdin = stdin
        self._channel = cast("asyncssh.SSHServerChannel[bytes]", stdout.channel)
        self._session: ConsoleSession | None = None

    def start(self) -> None:
        """Start in the background: typed commands are completed even if the client has gone."""
        self._connection.add_shell(self)
        self._connection.start_task(self._run_session())

    def tell(self) -> None:
        """Show pending messages of the router."""
        if self._session is not None:
            self._session.tell()

    async def _run_session(self) -> None:
        caller = self._connection.caller()
        command = self._channel.get_command()
        try:
            if command is None:
                await self._converse(caller)
            else:
                await self._run_command(caller, command)
        except ConnectionLost:
            pass
        finally:
            self._connection.remove_shell(self)
            self._connection.end_channel(caller)

    async def _run_command(self, caller: Caller, command: str) -> None:
        reply = await WireTalk(self._connection, caller).type(command, None)
        lines = reply.text.split("\n") if reply.text else []
        self._write("".join(f"{line}\r\n" for line in lines).encode(errors="surrogateescape"))
        if not self._channel.is_closing():
            self._channel.exit(1 if reply.has_failed else 0)

    async def _converse(self, caller: Caller) -> None:
        """Feed the session until it or the terminal ends."""
        kind = self._channel.get_terminal_type()
        session = ConsoleSession(
            WireTalk(self._connection, caller), self._screen(kind), self._write, has_size=kind is not None
        )
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
        """Return the terminal's size, unless login flags override it; without a terminal a plain screen."""
        screen = self._connection.screen
        if kind is None:
            return screen.plain()
        width, height, *_ = self._channel.get_terminal_size()
        screen = screen.resize(
            *(ours or theirs for ours, theirs in zip(screen.requested_size, (width, height), strict=True))
        )
        return screen.plain() if kind == "dumb" else screen

    def _write(self, data: bytes) -> None:
        if not self._channel.is_closing():
            self._connection.tally.counters.bytes_out += len(data)
            self._channel.write(data)


class WireTalk:
    """Console access through the faults of its connection."""

    def __init__(self, connection: SshConnection, caller: Caller) -> None:
        self.caller = caller
        self.device: Device = connection.device
        self._labour = connection.labour

    async def type(self, line: str, width: int | None) -> ConsoleReply:
        """Run a line."""
        return await self._labour.run(line, lambda: self.device.type(self.caller, line, width=width))

    async def safe_key(self, choice: str) -> ConsoleReply:
        """Press Ctrl+X, or answer its question."""
        return await self._labour.run("ctrl+x", lambda: self.device.safe_key(self.caller, choice))

    async def confirm(self, line: str) -> ConsoleReply:
        """Run a line whose question was answered with yes."""
        return await self._labour.run("y", lambda: self.device.type(self.caller, line, is_confirmed=True))

    async def set_password(self, password: str) -> str:
        """Set the caller's password; return the error text, or an empty string."""
        return await self._run_with_faults("new password", lambda: self.device.set_password(self.caller, password))

    async def remove_defaults(self) -> None:
        """Remove the default configuration."""
        await self._run_with_faults("remove defaults", self._remove_defaults)

    def _remove_defaults(self) -> str:
        self.device.remove_defaults(self.caller)
        return ""

    async def _run_with_faults(self, name: str, action: Callable[[], str]) -> str:
        faults = await self._labour.begin(name)
        text = action()
        await self._labour.end(faults)
        return text


def host_key(path: Path) -> bytes:
    """Return the private key in OpenSSH's format, generating it if needed."""
    if not path.exists():
        key = Ed25519PrivateKey.generate()
        write_private(path, key.private_bytes(Encoding.PEM, PrivateFormat.OpenSSH, NoEncryption()))
    return path.read_bytes()


def fingerprint(path: Path) -> str:
    """Return the fingerprint `SHA256:...`, as `ssh-keygen -l` prints it."""
    key = load_ssh_private_key(host_key(path), None).public_key()
    blob = base64.b64decode(key.public_bytes(Encoding.OpenSSH, PublicFormat.OpenSSH).split()[1])
    return "SHA256:" + base64.b64encode(hashlib.sha256(blob).digest()).decode().rstrip("=")
