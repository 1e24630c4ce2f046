"""Commands over SSH without a terminal, on a Linux device; the host key is compared before the password is sent."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

import paramiko

from atlantis_netcfg.console._errors import ConsoleLost
from atlantis_netcfg.console._keys import PinnedKey
from atlantis_netcfg.console._ssh import connected
from atlantis_netcfg.console._types import COMMAND_S, CONNECT_S

if TYPE_CHECKING:
    from types import TracebackType
    from typing import Self

    from atlantis_netcfg.secret import Secret

__all__ = ["CommandEnd", "Commands", "open_commands"]


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

    def run(self, command: str, *, given: str = "", timeout_s: float = COMMAND_S) -> CommandEnd:
        """Run one command. What is secret goes into `given`, its standard input: a command line stands in `ps`.

        Raises ConsoleLost if the connection broke; then nobody knows how far the command came.
        """
        self.count += 1
        try:
            stdin, stdout, stderr = self._client.exec_command(command, timeout=timeout_s)
            if given:
                stdin.write(given)
            stdin.channel.shutdown_write()
            out, error = stdout.read().decode("utf-8", "replace"), stderr.read().decode("utf-8", "replace")
            return CommandEnd(stdout.channel.recv_exit_status(), out, error)
        except (OSError, EOFError, paramiko.SSHException) as lost:
            with suppress(OSError, EOFError, paramiko.SSHException):
                self._client.close()
            raise ConsoleLost(
                f"{self._name}: the SSH session broke off ({type(lost).__name__})",
                in_flight=True,
                hint="run the same command again: it begins by reading what the device has",
            ) from lost


def open_commands(  # noqa: PLR0913 - all of it is one address
    address: str, port: int, user: str, password: Secret, *, pin: str | None, timeout_s: float = CONNECT_S
) -> Commands:
    """Log in. `pin`: `SHA256:...` of the host key.

    Raises ConsoleUnreachable, UnknownHostKey (without a pin) and HostKeyChanged before the password is sent,
    LoginFailed.
    """
    client = paramiko.SSHClient()
    client.set_missing_host_key_policy(PinnedKey(pin))
    try:
        with connected(address, port):
            client.connect(
                address,
                port,
                user,
                password.reveal(),
                timeout=timeout_s,
                banner_timeout=timeout_s,
                auth_timeout=timeout_s,
                allow_agent=False,
                look_for_keys=False,
            )
    except BaseException:
        client.close()
        raise
    return Commands(client, f"{address} port {port}")
