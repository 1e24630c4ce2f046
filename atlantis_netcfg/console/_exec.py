"""Commands over SSH without a terminal, on a Linux device; the host key is compared before the password is sent."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

import paramiko

from atlantis_netcfg.console._errors import ConsoleLost, UnknownHostKey
from atlantis_netcfg.console._keys import PinnedKey
from atlantis_netcfg.console._ssh import TcpSocket, connected, ended_after
from atlantis_netcfg.console._types import COMMAND_S, CONNECT_S
from atlantis_netcfg.core.secret import Secret

if TYPE_CHECKING:
    from types import TracebackType
    from typing import Self

__all__ = ["CommandEnd", "Commands", "host_key_of", "open_commands"]


@dataclass(frozen=True, slots=True)
class CommandEnd:
    """How a command ended, and what it printed."""

    code: int
    """Exit status; -1 if the device did not give one."""
    out: str
    error: str


class Commands:
    """An SSH connection on which commands run one after another; `with` closes it."""

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

    def run(self, command: str, *, given: str = "", timeout_s: float = COMMAND_S) -> CommandEnd:
        """Run one command. What is secret goes into `given`, its standard input: a command line stands in `ps`.

        Raises ConsoleLost if the connection broke; then nobody knows how far the command came.
        """
        self.count += 1
        try:
            with ended_after(self._client.close, timeout_s):
                stdin, stdout, stderr = self._client.exec_command(command, timeout=timeout_s)
                if given:
                    stdin.write(given)
                stdin.channel.shutdown_write()
                out, error = (said.read().decode("utf-8", "replace") for said in (stdout, stderr))
                end = CommandEnd(stdout.channel.recv_exit_status(), out, error)
        except (OSError, EOFError, paramiko.SSHException) as lost:
            with suppress(OSError, EOFError, paramiko.SSHException):
                self._client.close()
            raise self._broken(type(lost).__name__) from lost
        if end.code < 0 and not self._is_open:
            raise self._broken("cut by the device, or by us after too long")
        return end

    def _broken(self, why: str) -> ConsoleLost:
        return ConsoleLost(
            f"{self._name}: the SSH session broke off ({why})",
            in_flight=True,
            hint="run the same command again: it begins by reading what the device has",
        )


def open_commands(  # noqa: PLR0913 - all of it is one address
    address: str, port: int, user: str, password: Secret, *, pin: str | None, timeout_s: float = CONNECT_S
) -> Commands:
    """Log in. `pin`: `SHA256:...` of the host key.

    Raises ConsoleUnreachable, UnknownHostKey (without a pin) and HostKeyChanged before the password is sent,
    LoginFailed.
    """
    client = paramiko.SSHClient()
    client.set_missing_host_key_policy(PinnedKey(pin))
    sock: TcpSocket | None = None
    try:
        with connected(address, port), ended_after(client.close, 2 * timeout_s):
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
    return Commands(client, f"{address} port {port}")


def host_key_of(address: str, port: int, timeout_s: float = CONNECT_S) -> str:
    """The fingerprint of the host key that is shown; nobody logs in. Raises ConsoleUnreachable."""
    try:
        with open_commands(address, port, "nobody", Secret(""), pin=None, timeout_s=timeout_s):
            raise AssertionError("without a pin nobody logs in")
    except UnknownHostKey as unknown:
        return unknown.fingerprint
