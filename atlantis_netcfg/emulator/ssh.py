"""Stubs of ssh, sshd and systemctl for rehearsals without root: real transfers, but no encryption.

The program's first argument selects the stub; it needs only Python. `ssh` connects by its `ProxyCommand` to
`CommandServer`; without one it runs the command in the folder of the variable `ROBOT`. `systemctl` starts, shows and
stops one unit: the command in `UNIT`.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import shlex
import signal
import socketserver
import struct
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import IO, TYPE_CHECKING

if TYPE_CHECKING:
    import socket
    from collections.abc import Mapping, Sequence

ROBOT, UNIT, LOCK = "ATLANTIS_REHEARSED_ROBOT", "ATLANTIS_REHEARSED_UNIT", "ATLANTIS_REHEARSED_LOCK"
_FRAME = struct.Struct("!cI")
_OUT, _ERROR, _END, _ALIVE = b"o", b"e", b"x", b"a"
_ALIVE_S = 0.5
_VALUES = frozenset({"-F", "-i", "-l", "-o", "-p"})
"""Options of ssh that are followed by a value."""
_PIECE = 65536
_LOST_CODE = 255


class CommandServer:
    """Server on the loopback for the ssh stub; it runs a fixed command, whatever the client requests."""

    def __init__(self, command: Sequence[str], environment: Mapping[str, str]) -> None:
        class Handler(socketserver.BaseRequestHandler):
            def handle(self) -> None:
                _serve(self.request, command, environment)

        class CommandTcpServer(socketserver.ThreadingTCPServer):
            daemon_threads = True

        self._server = CommandTcpServer(("127.0.0.1", 0), Handler)
        self.address = ("127.0.0.1", int(self._server.server_address[1]))
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    def close(self) -> None:
        """Stop accepting connections."""
        self._server.shutdown()
        self._server.server_close()


def _serve(connection: socket.socket, command: Sequence[str], environment: Mapping[str, str]) -> None:
    stream = connection.makefile("rb", buffering=_PIECE)
    command_line = json.loads(stream.readline() or b"null")
    if command_line is None:
        return
    lock, end_event = threading.Lock(), threading.Event()

    def send_frame(kind: bytes, number: int, data: bytes = b"") -> None:
        with lock, contextlib.suppress(OSError):
            connection.sendall(_FRAME.pack(kind, number) + data)

    def send_keepalives() -> None:
        while not end_event.wait(_ALIVE_S):
            send_frame(_ALIVE, 0)

    def frames(source: IO[bytes], kind: bytes) -> None:
        while data := os.read(source.fileno(), _PIECE):
            send_frame(kind, len(data), data)

    with subprocess.Popen(  # noqa: S603 - a program of ours
        command,
        env={**environment, "SSH_ORIGINAL_COMMAND": command_line},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
    ) as process:
        assert process.stdin is not None  # noqa: S101 - they are pipes
        assert process.stdout is not None  # noqa: S101
        assert process.stderr is not None  # noqa: S101
        threading.Thread(target=_copy, args=(stream, process.stdin), daemon=True).start()
        errors = threading.Thread(target=frames, args=(process.stderr, _ERROR), daemon=True)
        errors.start()
        threading.Thread(target=send_keepalives, daemon=True).start()
        frames(process.stdout, _OUT)
        errors.join()
        end_event.set()
        send_frame(_END, process.wait() & 0xFF)


def _copy(source: IO[bytes], target: IO[bytes]) -> None:
    """Copy until the source ends, then close the target."""
    with contextlib.suppress(OSError, ValueError):
        while data := source.read1(_PIECE):  # type: ignore[attr-defined]
            target.write(data)
            target.flush()
    with contextlib.suppress(OSError):
        target.close()


def _emulate_ssh(words: Sequence[str]) -> int:
    options, rest = {}, list(words)
    while rest and rest[0].startswith("-"):
        name, _, value = (rest.pop(1) if rest[0] in _VALUES else "").partition("=")
        options[name] = value
        del rest[0]
    command = " ".join(rest[1:])
    if "ProxyCommand" not in options:
        os.chdir(os.environ[ROBOT])
        os.execv("/bin/sh", ["sh", "-c", f"exec {command}"])  # noqa: S606 - as sshd does
    way = subprocess.Popen(  # noqa: S603 - as ssh does
        ["/bin/sh", "-c", f"exec {options['ProxyCommand']}"], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    assert way.stdin is not None  # noqa: S101 - they are pipes
    assert way.stdout is not None  # noqa: S101
    way.stdin.write(json.dumps(command).encode() + b"\n")
    way.stdin.flush()
    threading.Thread(target=_copy, args=(sys.stdin.buffer, way.stdin), daemon=True).start()
    last_frame = [time.monotonic()]
    silence_s = float(options["ServerAliveInterval"]) * float(options["ServerAliveCountMax"])
    threading.Thread(target=_exit_on_silence, args=(last_frame, silence_s), daemon=True).start()
    while len(head := way.stdout.read(_FRAME.size)) == _FRAME.size:
        last_frame[0] = time.monotonic()
        kind, number = _FRAME.unpack(head)
        if kind == _END:
            return int(number)
        stream = (sys.stdout if kind == _OUT else sys.stderr).buffer
        stream.write(way.stdout.read(number))
        stream.flush()
    sys.stderr.write("Connection closed\n")
    return _LOST_CODE


def _exit_on_silence(last_frame: Sequence[float], silence_s: float) -> None:
    while time.monotonic() < last_frame[0] + silence_s:
        time.sleep(_ALIVE_S)
    sys.stderr.write("Timeout, server not responding.\n")
    sys.stderr.flush()
    os._exit(_LOST_CODE)


def _emulate_systemctl(words: Sequence[str]) -> int:
    with Path(os.environ[LOCK]).open("a+") as lock_file:
        try:
            fcntl.flock(lock_file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            runs = False
        except BlockingIOError:
            runs = True
        if words[0] == "show":
            sys.stdout.write("active\n" if runs else "inactive\n")
        elif words[0] == "start" and not runs:
            unit = subprocess.Popen(  # noqa: S603 - a program of ours; it holds the lock as long as it runs
                shlex.split(os.environ[UNIT]),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
                pass_fds=(lock_file.fileno(),),
            )
            lock_file.truncate(0)
            lock_file.write(str(unit.pid))
        elif words[0] == "stop" and runs:
            lock_file.seek(0)
            os.killpg(int(lock_file.read()), signal.SIGTERM)
    return 0


if __name__ == "__main__":
    # Threads may wait for what never comes: nothing is waited for at the end.
    CODE = {"ssh": _emulate_ssh, "systemctl": _emulate_systemctl}[sys.argv[1]](sys.argv[2:])
    sys.stdout.flush()
    os._exit(CODE)
