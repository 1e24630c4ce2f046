"""The console over SSH: netmiko opens the session, our dialogue does the talking.

What netmiko would type after connecting, it types with its own log of every write, secrets included; therefore its
channel is taken over as soon as it is open.
"""

from __future__ import annotations

import contextlib
import errno
import logging
import socket
import threading
from typing import TYPE_CHECKING

import paramiko
from netmiko import NetmikoAuthenticationException, NetmikoTimeoutException
from netmiko.mikrotik.mikrotik_ssh import MikrotikRouterOsSSH

from atlantis_netcfg.console._errors import ConsoleUnreachable, LoginFailed
from atlantis_netcfg.console._keys import PinnedKey
from atlantis_netcfg.console._terminal import Terminal
from atlantis_netcfg.console._types import CONNECT_S
from atlantis_netcfg.console._wire import WireLost
from atlantis_netcfg.core.errors import NetcfgError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from _typeshed import ReadableBuffer

    from atlantis_netcfg.console._types import Console, Tally
    from atlantis_netcfg.core.secret import Secret

__all__ = ["TcpSocket", "connected", "ended_after", "open_ssh"]

# Without a handler Python prints paramiko's tracebacks on the technician's screen; what failed is said by our errors.
logging.getLogger("paramiko").addHandler(logging.NullHandler())

_CHUNK = 65536
_MOST = 64 * 1024 * 1024
"""Bytes of one connection: nothing that is read of a device comes near."""
_GONE = (OSError, EOFError, paramiko.SSHException)


class _Connection(MikrotikRouterOsSSH):  # type: ignore[misc,unused-ignore] # netmiko's types differ by version
    """netmiko's session up to the open shell."""

    def special_login_handler(self, delay_factor: float = 1.0) -> None:
        """Leave the questions of the first login to the dialogue."""

    def _try_session_preparation(self, force_data: bool = True) -> None:  # noqa: FBT001, FBT002 - netmiko's signature
        """Type nothing: an Enter would answer the first of those questions."""


class TcpSocket(socket.socket):
    """A TCP connection that tells what it carries, and ends one that sends without an end.

    paramiko keeps whatever comes, before the login as well: a packet may name any size.
    """

    tally: Tally | None = None
    received = 0

    @classmethod
    def connect_to(cls, address: str, port: int, timeout_s: float, tally: Tally | None = None) -> TcpSocket:
        """Connect. Raises OSError."""
        made = cls(fileno=socket.create_connection((address, port), timeout_s).detach())
        made.settimeout(timeout_s)
        made.tally = tally
        if tally is not None:
            tally.connect()
        return made

    def hang_up(self) -> None:
        """End it for whoever waits on it, in any thread."""
        with contextlib.suppress(OSError):
            self.shutdown(socket.SHUT_RDWR)

    def send(self, data: ReadableBuffer, flags: int = 0, /) -> int:
        size = super().send(data, flags)
        if self.tally is not None:
            self.tally.send(size)
        return size

    def recv(self, size: int, flags: int = 0, /) -> bytes:
        data = super().recv(size, flags)
        self.received += len(data)
        if self.received > _MOST:
            raise OSError(errno.EMSGSIZE, f"more than {_MOST} bytes came")
        if data and self.tally is not None:
            self.tally.receive(len(data))
        return data


class SshWire:
    """A paramiko channel."""

    def __init__(self, connection: _Connection) -> None:
        self._connection = connection
        channel = connection.remote_conn
        assert isinstance(channel, paramiko.Channel)  # noqa: S101 - netmiko holds telnet and serial lines there too
        self._channel = channel

    def read(self, timeout_s: float) -> bytes:
        """Whatever came."""
        self._channel.settimeout(max(timeout_s, 0.001))
        try:
            data = self._channel.recv(_CHUNK)
        except TimeoutError:
            return b""
        except _GONE as error:
            raise WireLost from error
        if not data:
            raise WireLost
        return data

    def write(self, data: bytes) -> None:
        """Send."""
        self._channel.settimeout(CONNECT_S)
        try:
            self._channel.sendall(data)
        except _GONE as error:
            raise WireLost from error

    def close(self) -> None:
        """Drop the connection."""
        with contextlib.suppress(*_GONE):
            self._connection.paramiko_cleanup()

    def hang_up(self) -> None:
        """A dropped connection is the signal."""
        self.close()


@contextlib.contextmanager
def connected(address: str, port: int) -> Iterator[None]:
    """Say in our words why no session came about."""
    where = f"{address} port {port}"
    try:
        yield
    except NetcfgError:
        raise
    except (NetmikoAuthenticationException, paramiko.AuthenticationException) as error:
        raise LoginFailed(
            f"{where}: the device did not accept the user name and password",
            hint="the factory's password is on the sticker of newer devices, and empty on older ones",
        ) from error
    except (NetmikoTimeoutException, OSError, EOFError, paramiko.SSHException) as error:
        raise ConsoleUnreachable(
            f"{where}: no SSH session came about ({type(error).__name__})",
            hint="is the laptop plugged into the right port, and has it an address of that network?",
        ) from error


@contextlib.contextmanager
def ended_after(close: Callable[[], object], seconds: float) -> Iterator[None]:
    """Close a connection on which we still wait then: time-outs of paramiko begin anew with each byte."""
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
    timeout_s: float = CONNECT_S,
    tally: Tally | None = None,
) -> Console:
    """Log in over SSH. `pin`: `SHA256:...` of the host key; `tally`: told what the wire carries.

    Raises ConsoleUnreachable, UnknownHostKey (without a pin) and HostKeyChanged before the password is sent,
    LoginFailed, ConsoleLost.
    """
    policy = PinnedKey(pin)
    with connected(address, port):
        sock = TcpSocket.connect_to(address, port, timeout_s, tally)
        connection = _Connection(
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
