"""The router's end of one SSH connection: asyncssh behind the same pipe that carries the API.

Link, faults, firewall and counters act on the bytes between; what is encrypted in them is counted as it passes, and
round trips of the key exchange count like all others.
"""

from __future__ import annotations

import asyncio
import logging
import socket
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.emulator.routeros.answers import Caller, Trap
from atlantis_netcfg.emulator.routeros.shell.flags import Screen, split_login
from atlantis_netcfg.emulator.routeros.shell.labour import WorkItem
from atlantis_netcfg.emulator.routeros.wire.link import Chunk, End
from atlantis_netcfg.emulator.routeros.wire.pipe import Pipe
from atlantis_netcfg.emulator.routeros.wire.tally import TrafficCounters

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

    import asyncssh

    from atlantis_netcfg.emulator.routeros.device import Device
    from atlantis_netcfg.emulator.routeros.shell.channel import Shell
    from atlantis_netcfg.emulator.routeros.wire.host import Host

_VERSION = "ROSSSH"
"""What RouterOS calls its SSH server."""


class SshConnection:
    """One connection: who has logged in on it, and its channels."""

    def __init__(self, host: Host, device: Device, *, address: str, key: Callable[[], bytes]) -> None:
        self.host = host
        self.device = device
        self.tally = TrafficCounters("ssh")
        self.pipe = Pipe(host, "ssh")
        self.pipe.end = self
        self.labour = WorkItem(host, self)
        self.screen = Screen()
        self._address = address
        self._key = key
        self._caller: Caller | None = None
        self._callers: list[Caller] = []
        self._unused = True
        self._shells: list[Shell] = []
        self._tasks: set[asyncio.Task[None]] = set()
        self._accepted = asyncio.Event()
        self._near: asyncio.Transport | None = None
        self._waiting: list[bytes] = []
        self._ssh: asyncssh.SSHServerConnection | None = None
        self._sent, self._listened = 0, -1
        self._closed = False

    @property
    def over(self) -> bool:
        """Nothing is answered here any more."""
        return self._closed or self.pipe.ended or self.pipe.lost

    @property
    def logged_in(self) -> bool:
        """Somebody has proved who he is."""
        return self._caller is not None

    # --- what the pipe reports -------------------------------------------------------------------------------------

    def accepted(self) -> None:
        """The connection is there."""
        self._accepted.set()

    def arrived(self, chunk: Chunk) -> None:
        """The client is heard."""
        if chunk.end is End.FIN and self._near is not None and not self._near.is_closing():
            self._near.write_eof()
        elif chunk.end is not None:
            self.hang_up()
        else:
            self.tally.counters.wire_in += len(chunk.data)
            if chunk.heard > self._listened:
                self.tally.counters.turns += 1
                self._listened = chunk.heard
            self._forward(chunk.data)

    def gone(self) -> None:
        """The router has learnt that the client is gone."""
        self._abort()
        self.host.tell()

    async def work(self) -> None:
        """Speak SSH for ever."""
        import asyncssh  # noqa: PLC0415 (slow to load, and most twins are never asked for SSH)

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

        from atlantis_netcfg.emulator.routeros.shell.channel import Shell  # noqa: PLC0415
        from atlantis_netcfg.emulator.routeros.shell.sftp import Sftp  # noqa: PLC0415

        def start(
            stdin: asyncssh.SSHReader[bytes], stdout: asyncssh.SSHWriter[bytes], _: asyncssh.SSHWriter[bytes]
        ) -> None:
            Shell(self, stdin, stdout).start()

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
        """The router sends."""
        if not self.over:
            self._sent += 1
            self.tally.counters.wire_out += len(data)
            self.pipe.depart(Chunk(data, heard=self._sent))

    def hang_up(self) -> None:
        """The router closes in good order, and knows that it is closed."""
        if not self._closed:
            self.pipe.depart(Chunk(end=End.FIN))
            self._closed = True
            self.gone()

    def _abort(self) -> None:
        if self._ssh is not None:
            self._ssh.abort()
        if self._near is not None:
            self._near.abort()

    # --- faults, and what happens to the router --------------------------------------------------------------------

    def drop(self) -> None:
        """Reset under both ends at once."""
        self.pipe.stop(reset=True)

    def vanish(self) -> None:
        """Silence for good, and neither end is told."""
        self.pipe.vanish()

    def rebooted(self, *, clean: bool) -> None:
        """The router has lost its memory."""
        self._callers.clear()
        for task in self._tasks - {asyncio.current_task()}:
            task.cancel()
        if self.pipe.established and clean:
            self.pipe.farewell()
        elif self.pipe.established:
            self.pipe.forget()

    def say_pending(self) -> None:
        """Show what the router has to say unasked."""
        for shell in self._shells:
            shell.tell()

    def check(self) -> None:
        """Close if somebody has removed this session from `/user/active`."""
        if any(caller.number in self.device.ended for caller in self._callers):
            self.hang_up()

    # --- what asyncssh asks ----------------------------------------------------------------------------------------

    def met(self, ssh: asyncssh.SSHServerConnection) -> None:
        """The key exchange begins."""
        self._ssh = ssh

    def admit(self, name: str, proof: str | bytes) -> bool:
        """Log in by password or public key; flags behind the name describe the terminal."""
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
        """A session of its own for each channel."""
        if self._caller is None:
            raise RuntimeError("a channel before the login")
        if self._unused:
            self._unused = False
            return self._caller
        another = self.device.again(self._caller)
        self._callers.append(another)
        return another

    def left(self, caller: Caller) -> None:
        """A channel has ended."""
        if caller in self._callers:
            self._callers.remove(caller)
            self.device.logout(caller, clean=True)
            self.host.tell()

    def opened(self, shell: Shell) -> None:
        """A channel with a console."""
        self._shells.append(shell)

    def shut(self, shell: Shell) -> None:
        """That channel is closed."""
        if shell in self._shells:
            self._shells.remove(shell)

    def go(self, work: Coroutine[Any, Any, None]) -> None:
        """Do something beside; it ends with the router, not with the connection."""
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        self.host.watch(task)


class _Near(asyncio.Protocol):
    """Our end of the socket pair whose other end is asyncssh's."""

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

    class Server(asyncssh.SSHServer):
        """Logins and console channels; nothing is forwarded."""

        def __init__(self) -> None:
            self.connection = connection
            self._name = ""
            self._key = b""

        def connection_made(self, conn: asyncssh.SSHServerConnection) -> None:
            connection.met(conn)

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

    return Server()
