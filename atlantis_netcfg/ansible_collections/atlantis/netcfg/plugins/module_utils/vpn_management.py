"""The management interface of OpenVPN on its Unix socket: commands, their replies, and the server's notifications.

It serves one client at a time. The kernel accepts a second client, which then receives nothing (OpenVPN issue 660).
Every wait has a timeout, and silence raises its own exception, `ManagementBusy`. Source: doc/management-notes.txt.

In `status 3` the columns of a row are located by their names in the HEADER rows only.
"""

from __future__ import annotations

import contextlib
import os
import re
import select
import socket
import time
from typing import Any, Dict, Iterable, Iterator

from atlantis_netcfg.core.messages import arg, msg

END = "END"
Session = Dict[str, Any]
"""Keys: `cid`, `common_name` (`UNDEF` before the certificate), `real`, `virtual`, `since`, `received`, `sent`."""
_KIND = "CLIENT_LIST"


class IncompleteStatus(Exception):
    """The text is not a complete status of version 3."""


def rows(lines: Iterable[str], kind: str = _KIND) -> Iterator[dict[str, str]]:
    """Yield the rows of a kind, as a mapping of column name to value. Raises `IncompleteStatus`."""
    names: list[str] | None = None
    has_end = False
    for line in lines:
        first, *fields = line.rstrip("\r\n").split("\t")
        if first == "HEADER" and fields[:1] == [kind]:
            names = fields[1:]
        elif first == kind:
            if names is None or len(fields) != len(names):
                raise IncompleteStatus(msg(f"a row of {arg(kind)} does not match its header: {arg(line[:200])!r}"))
            yield dict(zip(names, fields))
        has_end = has_end or first == END
    if names is None or not has_end:
        raise IncompleteStatus(
            "the status is incomplete" if names is not None else msg(f"the status has no header of {arg(kind)}")
        )


def sessions(lines: Iterable[str]) -> list[Session]:
    """Parse all sessions of a status. Raises `IncompleteStatus`."""
    try:
        return [_session(row) for row in rows(lines)]
    except (KeyError, ValueError) as error:
        raise IncompleteStatus(msg(f"a row of {arg(_KIND)} is invalid: {arg(error)}")) from error


def parse_status_time(lines: Iterable[str]) -> int:
    """Return when a status was written, in seconds since 1970; 0 if it contains no time."""
    times = [line.rstrip("\r\n").split("\t") for line in lines if line.startswith("TIME\t")]
    return int(times[0][2]) if times and len(times[0]) > 2 and times[0][2].isdigit() else 0  # noqa: PLR2004 - TIME, words, seconds


def _session(row: dict[str, str]) -> Session:
    return {
        "cid": int(row["Client ID"]),
        "common_name": row["Common Name"],
        "real": row["Real Address"],
        "virtual": row["Virtual Address"],
        "since": int(row["Connected Since (time_t)"]),
        "received": int(row["Bytes Received"]),
        "sent": int(row["Bytes Sent"]),
    }


_GREETING = ">INFO:"
_CHUNK = 65536
_REAL = re.compile(r"(?:[a-z0-9-]+:)?[0-9a-fA-F.:\[\]]+:[0-9]{1,5}")
"""An address and a port; nothing that could end the line and start another command."""


class ServerDown(Exception):
    """Nobody listens on the socket: the server that created it does not run."""


class ManagementBusy(Exception):
    """The socket accepts the connection but does not respond: another client uses it, or the server hangs."""


class ConnectionEnd(Exception):
    """The server closed the connection: it stopped, or does not accept this user as its client."""


class ManagementSocket:
    """A connection to the management socket. Raises `ManagementBusy` on timeout, `ConnectionEnd` when it closes."""

    def __init__(self, connection: socket.socket, patience_s: float) -> None:
        self._socket = connection
        self._patience_s = patience_s
        self._buffer = b""

    def wait_for_greeting(self) -> None:
        """Wait for the greeting, which is sent only to the one client that is served."""
        end = time.monotonic() + self._patience_s
        while not self._line(end).startswith(_GREETING):
            pass

    def sessions(self) -> list[Session]:
        """Return the current sessions, including those whose handshake is not complete."""
        self._send("status 3")
        end = time.monotonic() + self._patience_s
        lines = []
        while True:
            line = self._word(end)
            if line.startswith("ERROR:"):
                raise ConnectionEnd(msg(f"the server does not report its status: {arg(line)}"))
            lines.append(line)
            if line == END:
                return sessions(lines)

    def halt(self, cid: int) -> str:
        """Make the server order a client to stop permanently; return the reply, `SUCCESS: …` or `ERROR: …`.

        The session remains until the client exits, or for five seconds more if the client ignores the order.
        """
        return self._run_command(f"client-kill {int(cid)} HALT")

    def kill(self, real: str) -> str:
        """End a session at once, by its client's real address, without notifying the client. Return the reply.

        The message of `halt` is sent in the server's next round: without 10 ms between them it is lost [measured]. Use
        it only for a client whose packets are blocked: see `vpn_disconnect`.
        """
        if not _REAL.fullmatch(real):
            raise ValueError(f"not the address and port of a client: {real!r}")
        return self._run_command(f"kill {real}")

    def _run_command(self, command: str) -> str:
        self._send(command)
        end = time.monotonic() + self._patience_s
        while True:
            line = self._word(end)
            if line.startswith(("SUCCESS:", "ERROR:")):
                return line

    def _send(self, command: str) -> None:
        try:
            self._socket.sendall(command.encode() + b"\n")
        except OSError as error:
            raise ConnectionEnd(
                msg(f"the server has closed its management socket: {arg(error.strerror or error)}")
            ) from error

    def _word(self, end: float) -> str:
        """Return the next line that is not a notification: those begin with `>` and may come at any time."""
        while True:
            line = self._line(end)
            if not line.startswith(">"):
                return line

    def _line(self, end: float) -> str:
        while b"\n" not in self._buffer:
            ready, _, _ = select.select([self._socket], [], [], max(0.0, end - time.monotonic()))
            if not ready:
                raise ManagementBusy(msg(f"the management socket has not responded for {arg(self._patience_s):g} s"))
            try:
                got = self._socket.recv(_CHUNK)
            except OSError as error:
                raise ConnectionEnd(
                    msg(f"the server has closed its management socket: {arg(error.strerror or error)}")
                ) from error
            if not got:
                raise ConnectionEnd("the server has closed its management socket")
            self._buffer += got
        line, _, self._buffer = self._buffer.partition(b"\n")
        return line.rstrip(b"\r").decode(errors="replace")


@contextlib.contextmanager
def open_socket(path: str, patience_s: float) -> Iterator[ManagementSocket]:
    """Connect, without waiting for the greeting. Raises `ServerDown` when nobody listens."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connection:
        connection.settimeout(patience_s)
        try:
            connection.connect(_short(path))
        except (FileNotFoundError, ConnectionRefusedError) as error:
            raise ServerDown(msg(f"no server listens on {arg(path)}")) from error
        except OSError as error:  # a full backlog among them: clients that wait before this one
            raise ManagementBusy(msg(f"{arg(path)} refuses the connection: {arg(error.strerror or error)}")) from error
        yield ManagementSocket(connection, patience_s)


def _short(path: str) -> str:
    """Shorten the path of a socket: the limit is 107 bytes, and a relative path may fit."""
    return os.path.relpath(path) if len(os.fsencode(path)) > 107 else path  # noqa: PLR2004 - unix(7)
