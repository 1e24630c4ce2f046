"""The console over SSH: netmiko opens the session, our own dialogue uses it.

After connecting, netmiko would log everything it types, secrets included. Therefore its channel is taken over as soon
as it is open.
"""

from __future__ import annotations

import base64
import contextlib
import errno
import hashlib
import logging
import socket
import threading
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import paramiko
from netmiko import NetmikoAuthenticationException, NetmikoTimeoutException
from netmiko.mikrotik.mikrotik_ssh import MikrotikRouterOsSSH

from atlantis_netcfg.core.errors import TRUST, NetcfgError
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.routeros.console import types
from atlantis_netcfg.routeros.console.terminal import Terminal

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path
    from types import TracebackType

    from _typeshed import ReadableBuffer


def fingerprint(key: paramiko.PKey) -> str:
    """Return the key's fingerprint as printed by `ssh-keygen -l`: `SHA256:` and unpadded base64."""
    digest = base64.b64encode(hashlib.sha256(key.asbytes()).digest()).decode()
    return f"SHA256:{digest.rstrip('=')}"


class PinnedKey(paramiko.MissingHostKeyPolicy):
    """Lets one key through; paramiko asks it after the key exchange and before any authentication."""

    def __init__(self, pin: str | None) -> None:
        self._pin = pin
        self.seen: str | None = None

    def missing_host_key(self, client: paramiko.SSHClient, hostname: str, key: paramiko.PKey) -> None:  # noqa: ARG002
        """Raise UnknownHostKey without a pin, HostKeyMismatch if the keys differ."""
        self.seen = fingerprint(key)
        if self._pin is None:
            raise types.UnknownHostKey(
                msg(
                    f"{arg(hostname)}: unknown SSH host key; no password was sent; the device presented "
                    f"{arg(self.seen)}"
                ),
                fingerprint=self.seen,
                hint=TRUST,
            )
        if self._pin != self.seen:
            raise types.HostKeyMismatch(
                msg(
                    f"{arg(hostname)}: the SSH host key is not the one of this device; pinned {arg(self._pin)}, "
                    f"presented {arg(self.seen)}"
                ),
                pinned_key=self._pin,
                actual_key=self.seen,
                hint=(
                    "another device has this address, the device was reset, or somebody intercepts the connection: "
                    "nothing was sent"
                ),
            )


# Without a handler Python prints paramiko's tracebacks on the technician's screen; what failed is said by our errors.
logging.getLogger("paramiko").addHandler(logging.NullHandler())

_CHUNK = 65536
_MOST = 64 * 1024 * 1024
"""Maximum bytes of one connection; nothing that is read from a device comes near."""
_CONNECTION_ERRORS = (OSError, EOFError, paramiko.SSHException)


class _ConsoleConnection(MikrotikRouterOsSSH):  # type: ignore[misc,unused-ignore] # netmiko's types differ by version
    """netmiko's session up to the open shell."""

    def special_login_handler(self, delay_factor: float = 1.0) -> None:
        """Do nothing: the dialogue handles the prompts of the first login."""

    def _try_session_preparation(self, force_data: bool = True) -> None:  # noqa: FBT001, FBT002 - netmiko's signature
        """Send nothing: an Enter would confirm the first of those prompts."""


class TcpSocket(socket.socket):
    """A TCP connection that counts its bytes and stops a peer that sends endlessly.

    paramiko keeps all received data, also before the login: a packet may announce any size.
    """

    tally: types.Tally | None = None
    received_bytes = 0

    @classmethod
    def connect_to(cls, address: str, port: int, timeout_s: float, tally: types.Tally | None = None) -> TcpSocket:
        """Connect. Raises OSError."""
        connection = cls(fileno=socket.create_connection((address, port), timeout_s).detach())
        connection.settimeout(timeout_s)
        connection.tally = tally
        if tally is not None:
            tally.connect()
        return connection

    def hang_up(self) -> None:
        """End the connection for all threads that wait on it."""
        with contextlib.suppress(OSError):
            self.shutdown(socket.SHUT_RDWR)

    def send(self, data: ReadableBuffer, flags: int = 0, /) -> int:
        """Send like a socket, and count the bytes."""
        size = super().send(data, flags)
        if self.tally is not None:
            self.tally.send(size)
        return size

    def recv(self, size: int, flags: int = 0, /) -> bytes:
        """Receive like a socket, and count the bytes."""
        data = super().recv(size, flags)
        self.received_bytes += len(data)
        if self.received_bytes > _MOST:
            raise OSError(errno.EMSGSIZE, msg(f"more than {arg(_MOST)} bytes received"))
        if data and self.tally is not None:
            self.tally.receive(len(data))
        return data


class SshWire:
    """A paramiko channel as console wire."""

    def __init__(self, connection: _ConsoleConnection) -> None:
        self._connection = connection
        channel = connection.remote_conn
        assert isinstance(channel, paramiko.Channel)  # noqa: S101 - netmiko holds telnet and serial lines there too
        self._channel = channel

    def read(self, timeout_s: float) -> bytes:
        """Return the data received until the timeout; may be empty."""
        self._channel.settimeout(max(timeout_s, 0.001))
        try:
            data = self._channel.recv(_CHUNK)
        except TimeoutError:
            return b""
        except _CONNECTION_ERRORS as error:
            raise types.WireLost from error
        if not data:
            raise types.WireLost
        return data

    def write(self, data: bytes) -> None:
        """Send the data. Raises WireLost."""
        self._channel.settimeout(types.CONNECT_S)
        try:
            self._channel.sendall(data)
        except _CONNECTION_ERRORS as error:
            raise types.WireLost from error

    def close(self) -> None:
        """Drop the connection."""
        with contextlib.suppress(*_CONNECTION_ERRORS):
            self._connection.paramiko_cleanup()

    def hang_up(self) -> None:
        """Drop the connection, which makes the device undo safe mode."""
        self.close()


@contextlib.contextmanager
def translate_errors(address: str, port: int) -> Iterator[None]:
    """Convert connection errors to our exceptions with a message for the user."""
    where = msg(f"{arg(address)} port {arg(port)}")
    try:
        yield
    except NetcfgError:
        raise
    except (NetmikoAuthenticationException, paramiko.AuthenticationException) as error:
        raise types.ConsoleLoginError(
            f"{arg(where)}: the device did not accept the user name and password",
            hint="the factory's password is on the sticker of newer devices, and empty on older ones",
        ) from error
    except (NetmikoTimeoutException, OSError, EOFError, paramiko.SSHException) as error:
        raise types.ConsoleUnreachable(
            f"{arg(where)}: cannot open an SSH session ({arg(type(error).__name__)})",
            hint="check that the laptop is plugged into the right port and has an address of that network",
        ) from error


@contextlib.contextmanager
def ended_after(close: Callable[[], object], seconds: float) -> Iterator[None]:
    """Close a connection still in use after `seconds`: paramiko's timeouts restart with each byte."""
    clock = threading.Timer(seconds, close)
    clock.daemon = True
    clock.start()
    try:
        yield
    finally:
        clock.cancel()


def open_ssh(  # noqa: PLR0913 - all of it is one address
    address: str,
    port: int,
    user: str,
    password: Secret,
    *,
    pin: str | None,
    timeout_s: float = types.CONNECT_S,
    tally: types.Tally | None = None,
) -> types.Console:
    """Log in over SSH. `pin`: `SHA256:...` of the host key; `tally`: counts the bytes on the wire.

    Raises ConsoleUnreachable, UnknownHostKey (without a pin) and HostKeyMismatch before the password is sent,
    ConsoleLoginError, ConsoleLost.
    """
    policy = PinnedKey(pin)
    with translate_errors(address, port):
        sock = TcpSocket.connect_to(address, port, timeout_s, tally)
        connection = _ConsoleConnection(
            sock=sock,
            host=address,
            port=port,
            username=user,
            password=password.reveal(),
            conn_timeout=timeout_s,
            auth_timeout=timeout_s,
            banner_timeout=timeout_s,
            blocking_timeout=timeout_s,
            ssh_strict=True,
            auto_connect=False,
        )
        connection.key_policy = policy
        try:
            with ended_after(sock.hang_up, 2 * timeout_s):
                connection._open()  # noqa: SLF001 - the step that `auto_connect` leaves out
        except BaseException:
            connection.paramiko_cleanup()
            sock.close()
            raise
    terminal = Terminal(SshWire(connection), user=user, name=f"{address} port {port}", host_key=policy.seen)
    terminal.settle(timeout_s)
    return terminal


@dataclass(frozen=True, slots=True)
class CommandEnd:
    """Result of a command: exit status and output."""

    code: int
    """Exit status; -1 if the device did not return one."""
    out: str
    error: str


class Commands:
    """An SSH connection on which commands run one after another; a context manager."""

    def __init__(self, client: paramiko.SSHClient, name: str) -> None:
        self._client = client
        self._name = name
        self.count = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._client.close()

    @property
    def _is_open(self) -> bool:
        transport = self._client.get_transport()
        return transport is not None and transport.is_active()

    def run(self, command: str, *, input_text: str = "", timeout_s: float = types.COMMAND_S) -> CommandEnd:
        """Run one command. Secrets go into `input_text` (standard input), since a command line is visible in `ps`.

        Raises ConsoleLost if the connection broke; then it is unknown how far the command ran.
        """
        self.count += 1
        try:
            with ended_after(self._client.close, timeout_s):
                stdin, stdout, stderr = self._client.exec_command(command, timeout=timeout_s)
                if input_text:
                    stdin.write(input_text)
                stdin.channel.shutdown_write()
                out, error = (stream.read().decode("utf-8", "replace") for stream in (stdout, stderr))
                end = CommandEnd(stdout.channel.recv_exit_status(), out, error)
        except (OSError, EOFError, paramiko.SSHException) as lost:
            with suppress(OSError, EOFError, paramiko.SSHException):
                self._client.close()
            raise self._broken(type(lost).__name__) from lost
        if end.code < 0 and not self._is_open:
            raise self._broken("closed by the device, or by us after a timeout")
        return end

    def _broken(self, why: str) -> types.ConsoleLost:
        return types.ConsoleLost(
            msg(f"{arg(self._name)}: the SSH session was lost ({arg(why)})"),
            in_flight=True,
            hint="run the same command again: it first reads the state of the device",
        )


def open_commands(  # noqa: PLR0913 - all of it is one address
    address: str, port: int, user: str, password: Secret, *, pin: str | None, timeout_s: float = types.CONNECT_S
) -> Commands:
    """Log in. `pin`: `SHA256:...` of the host key.

    Raises ConsoleUnreachable, UnknownHostKey (without a pin) and HostKeyMismatch before the password is sent,
    ConsoleLoginError.
    """
    return Commands(
        _connect_client(address, port, user, password, pin, timeout_s), msg(f"{arg(address)} port {arg(port)}")
    )


def _connect_client(  # noqa: PLR0913, PLR0917 - as above
    address: str, port: int, user: str, password: Secret, pin: str | None, timeout_s: float
) -> paramiko.SSHClient:
    client = paramiko.SSHClient()
    client.set_missing_host_key_policy(PinnedKey(pin))
    sock: TcpSocket | None = None
    try:
        with translate_errors(address, port), ended_after(client.close, 2 * timeout_s):
            sock = TcpSocket.connect_to(address, port, timeout_s)
            client.connect(
                address,
                port,
                user,
                password.reveal(),
                sock=sock,
                timeout=timeout_s,
                banner_timeout=timeout_s,
                auth_timeout=timeout_s,
                allow_agent=False,
                look_for_keys=False,
            )
    except BaseException:
        client.close()
        if sock is not None:
            sock.close()
        raise
    return client


def host_key_of(address: str, port: int, timeout_s: float = types.CONNECT_S) -> str:
    """Return the fingerprint of the host key without a login. Raises ConsoleUnreachable."""
    try:
        with open_commands(address, port, "nobody", Secret(""), pin=None, timeout_s=timeout_s):
            raise AssertionError("without a pin nobody logs in")
    except types.UnknownHostKey as unknown:
        return unknown.fingerprint


_SLOWEST_S, _SLOWEST_BYTES = 600.0, 2_000
"""Timeout of a copy: ten minutes plus the time at 16 kbit/s."""


def upload(  # noqa: PLR0913 - all of it is one address and one file
    address: str,
    port: int,
    user: str,
    password: Secret,
    *,
    pin: str | None,
    source: Path,
    name: str,
    progress: Callable[[int, int], None] | None = None,
    timeout_s: float = types.CONNECT_S,
) -> None:
    """Copy `source` to the file `name` of the device. `progress(sent, total)` is called often, with bytes.

    Raises like `open_ssh`; ConsoleLost if the copy broke off or has another length: then the file on the device is
    incomplete.
    """
    size = source.stat().st_size
    client = _connect_client(address, port, user, password, pin, timeout_s)
    try:
        with (
            ended_after(client.close, _SLOWEST_S + size / _SLOWEST_BYTES),
            client.open_sftp() as sftp,
            source.open("rb") as file,
        ):
            channel = sftp.get_channel()
            if channel is not None:
                channel.settimeout(timeout_s)
            sftp.putfo(file, name, size, progress, confirm=True)
    except (OSError, EOFError, paramiko.SSHException) as error:
        raise types.ConsoleLost(
            msg(
                f"{arg(address)} port {arg(port)}: {arg(name)} was not copied completely ({arg(type(error).__name__)})"
            ),
            in_flight=True,
            hint=(
                "check for free space on the device, then run the same command again: the copy starts from the "
                "beginning"
            ),
        ) from error
    finally:
        client.close()
