"""A console, or a computer at the other end of SSH, that sends without an end or never ends a command."""

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

import paramiko
import pytest
from paramiko.common import AUTH_SUCCESSFUL, OPEN_SUCCEEDED

from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.routeros.console import ssh
from atlantis_netcfg.routeros.console.ssh import fingerprint, host_key_of, open_commands
from atlantis_netcfg.routeros.console.terminal import MOST, TerminalScreen
from atlantis_netcfg.routeros.console.types import ConsoleLost, ConsoleUnreachable

KEY = paramiko.ECDSAKey.generate()


@pytest.mark.parametrize(
    "sent",
    [b"\x1b[999999999999GX", b"\x1b[" + b"9" * 5_000 + b"GX", b"\x1b[1;2DX", b"\x1b[?9CX", b"\x1b[" + b"9" * 100],
)
def test_screen_width_is_bounded(sent: bytes) -> None:
    screen = TerminalScreen()
    for byte in sent:
        screen.feed(bytes([byte]))
    assert max(map(len, screen.lines)) <= max(511, len(sent))
    assert len(screen._rest) < 64


def test_screen_size_is_counted_since_the_last_clear() -> None:
    screen = TerminalScreen()
    screen.feed(b"x\n" * MOST)
    assert screen.size > MOST
    screen.clear()
    assert screen.size == 0


class Server(paramiko.ServerInterface):
    def check_auth_password(self, username: str, password: str) -> int:  # noqa: ARG002
        return AUTH_SUCCESSFUL

    def get_allowed_auths(self, username: str) -> str:  # noqa: ARG002
        return "password"

    def check_channel_request(self, kind: str, chanid: int) -> int:  # noqa: ARG002
        return OPEN_SUCCEEDED

    def check_channel_exec_request(self, channel: paramiko.Channel, command: bytes) -> bool:  # noqa: ARG002
        return True


@contextmanager
def serving(behave: Callable[[paramiko.Channel], None]) -> Iterator[int]:
    def meet() -> None:
        with suppress(OSError, EOFError, paramiko.SSHException):
            line, _ = server.accept()
            transport = paramiko.Transport(line)
            transport.add_server_key(KEY)
            transport.start_server(server=Server())
            channel = transport.accept(20)
            if channel is not None:
                with suppress(OSError, EOFError):
                    behave(channel)
            transport.close()

    with socket.create_server(("127.0.0.1", 0)) as server:
        thread = threading.Thread(target=meet, daemon=True)
        thread.start()
        yield server.getsockname()[1]
        thread.join()


def flood(channel: paramiko.Channel) -> None:
    while True:
        channel.sendall(b"x" * 65536)


def drip(channel: paramiko.Channel) -> None:
    while True:
        channel.sendall(b"x")
        threading.Event().wait(0.05)


def no_end(channel: paramiko.Channel) -> None:
    """Everything is said, but how it ended."""
    channel.shutdown_write()
    channel.recv(1)
    threading.Event().wait(0.05)
    while channel.active and not channel.closed:
        threading.Event().wait(0.05)


@pytest.mark.parametrize("behave", [flood, drip, no_end])
def test_endless_command_output_is_aborted(
    behave: Callable[[paramiko.Channel], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ssh, "_MOST", 4_000_000)
    with (
        serving(behave) as port,
        open_commands("127.0.0.1", port, "root", Secret("x"), pin=fingerprint(KEY), timeout_s=20) as commands,
        pytest.raises(ConsoleLost, match="the SSH session was lost"),
    ):
        commands.run("uci show", timeout_s=60 if behave is flood else 1)


def test_endless_greeting_is_aborted() -> None:
    """Before SSH has begun, a line that never ends."""

    def greet() -> None:
        with suppress(OSError):
            line, _ = server.accept()
            with line:
                while True:
                    line.sendall(b"x")
                    threading.Event().wait(0.05)

    with socket.create_server(("127.0.0.1", 0)) as server:
        thread = threading.Thread(target=greet, daemon=True)
        thread.start()
        with pytest.raises(ConsoleUnreachable, match="cannot open an SSH session"):
            host_key_of("127.0.0.1", server.getsockname()[1], 0.5)
        thread.join()
