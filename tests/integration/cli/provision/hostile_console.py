"""A RouterOS console whose every word is hostile."""

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import paramiko
from impostor import HOSTILE
from paramiko.common import AUTH_SUCCESSFUL, OPEN_SUCCEEDED


class _Guard(paramiko.ServerInterface):
    """Lets everybody in, with a banner."""

    def check_auth_none(self, username: str) -> int:  # noqa: ARG002
        return AUTH_SUCCESSFUL

    def check_auth_password(self, username: str, password: str) -> int:  # noqa: ARG002
        return AUTH_SUCCESSFUL

    def get_allowed_auths(self, username: str) -> str:  # noqa: ARG002
        return "none,password"

    def get_banner(self) -> tuple[str, str]:
        return HOSTILE, "en"

    def check_channel_request(self, kind: str, chanid: int) -> int:  # noqa: ARG002
        return OPEN_SUCCEEDED

    def check_channel_pty_request(self, *_terminal: object) -> bool:
        return True

    def check_channel_shell_request(self, channel: paramiko.Channel) -> bool:
        threading.Thread(target=_type_back, args=(channel,), daemon=True).start()
        return True

    def check_channel_exec_request(self, channel: paramiko.Channel, command: bytes) -> bool:  # noqa: ARG002
        threading.Thread(target=_type_back, args=(channel,), daemon=True).start()
        return True


_PROMPT = "\r\n[admin@MikroTik] > "
_GREETING = f"{HOSTILE}\r\n  MikroTik RouterOS 7.18.2 (c) 1999-2025\r\n{_PROMPT}".encode()


def _answer(typed: bytes) -> bytes:
    """Echo, and answer in words of its own."""
    shown = typed.decode(errors="replace").replace("\r", "\r\n")
    return f"{shown}failure: {HOSTILE}\r\nboard-name: {HOSTILE}{_PROMPT}".encode()


def _type_back(channel: paramiko.Channel) -> None:
    """Greet, answer once, and end: whoever waits for another prompt has nothing to wait for."""
    with suppress(OSError, EOFError):
        channel.sendall(_GREETING)
        channel.sendall(_answer(channel.recv(4096)))
        channel.close()


@contextmanager
def hostile_console() -> Iterator[int]:
    """Serve it over SSH; give the port."""
    key = paramiko.ECDSAKey.generate()
    with socket.create_server(("127.0.0.1", 0)) as server:
        transports: list[paramiko.Transport] = []

        def accept() -> None:
            with suppress(OSError):
                while True:
                    raw, _ = server.accept()
                    with suppress(paramiko.SSHException, EOFError, OSError):
                        transport = paramiko.Transport(raw)
                        transports.append(transport)
                        transport.add_server_key(key)
                        transport.start_server(server=_Guard(), event=threading.Event())

        thread = threading.Thread(target=accept, daemon=True)
        thread.start()
        try:
            yield server.getsockname()[1]
        finally:
            server.shutdown(socket.SHUT_RDWR)
            thread.join()
            for transport in transports:
                transport.close()
