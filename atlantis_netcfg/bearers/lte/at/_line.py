"""The talk with a modem: one command, its lines, one final result; echo, unsolicited lines and noise are sorted out."""

from __future__ import annotations

import fcntl
import termios
import time
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

import serial

from atlantis_netcfg.bearers.lte.at._commands import checked
from atlantis_netcfg.bearers.lte.at._owner import PortOwned, require_free
from atlantis_netcfg.core.errors import DeviceFailed

if TYPE_CHECKING:
    from types import TracebackType
    from typing import Self

__all__ = ["ANSWER_S", "Answer", "AtSilent", "AtUnreachable", "Modem"]

ANSWER_S = 30.0
"""For one command; reads answer at once, but a modem that is busy registering may take its time."""
BAUD = 115200
"""What USB modems ignore and serial ones default to."""
_LONGEST = 65536
"""Bytes without an end of line after which a line is noise."""
_MOST = 262_144
"""Characters in answer to one command; the longest, a list of networks, has some thousand."""


class AtUnreachable(DeviceFailed):
    """The port cannot be opened; nothing was sent."""


class AtSilent(DeviceFailed):
    """The modem does not answer, or the port has gone; only reads were sent."""


@dataclass(frozen=True, slots=True)
class Answer:
    """The lines of information, and how it ended: `OK`, `ERROR`, `+CME ERROR: 10`."""

    lines: tuple[str, ...]
    final: str

    @property
    def ok(self) -> bool:
        """Whether the modem has done what was asked."""
        return self.final == "OK"


class Modem:
    """A serial port on which nobody else is; `with` opens and closes it."""

    def __init__(self, path: str, *, answer_s: float = ANSWER_S) -> None:
        self._path = path
        self._answer_s = answer_s
        self._port: serial.Serial | None = None
        self._rest = b""
        self.sent: list[str] = []

    def __enter__(self) -> Self:
        require_free(self._path)
        try:
            self._port = serial.Serial(self._path, BAUD, timeout=0.1, write_timeout=self._answer_s, exclusive=True)
            fcntl.ioctl(self._port.fileno(), termios.TIOCEXCL)
        except (serial.SerialException, OSError, ValueError) as error:
            if getattr(error, "errno", None) in _BUSY:
                raise PortOwned(
                    f"{self._path}: another program has this port, and is not disturbed", hint="end that program"
                ) from error
            raise AtUnreachable(
                f"{self._path}: the modem's port cannot be opened ({_why(error)})",
                hint="is the modem plugged in, may you use it (group dialout), and is it this port?",
            ) from error
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._port is not None:
            with suppress(OSError, serial.SerialException):
                fcntl.ioctl(self._port.fileno(), termios.TIOCNXCL)
                self._port.close()

    def ask(self, command: str) -> Answer:
        """Send one allowed command. Raises CommandForbidden (nothing sent), AtSilent."""
        data = checked(command).encode("ascii") + b"\r"
        port = self._port
        assert port is not None  # noqa: S101 - entered
        try:
            self.sent.append(command)
            port.write(data)
            port.flush()
            return self._answer(port, command)
        except (serial.SerialException, OSError, TypeError) as error:  # TypeError: closed under pyserial's feet
            raise AtSilent(
                f"{self._path}: the modem has gone while it was read ({_why(error)})",
                hint="has it power, and is its cable firm? It may be starting anew: wait a minute",
            ) from error

    def _answer(self, port: serial.Serial, command: str) -> Answer:
        until = time.monotonic() + self._answer_s
        lines: list[str] = []
        while True:
            for line in self._lines(port):
                if _final(line):
                    return Answer(tuple(lines), line)
                if line != command:
                    lines.append(line)
            if sum(map(len, lines)) > _MOST:
                raise AtSilent(
                    f"{self._path}: more than {_MOST} characters came in answer to {command}, and no end",
                    hint="is this the modem's command port? Many have several: try the next number",
                )
            if time.monotonic() > until:
                raise AtSilent(
                    f"{self._path}: no answer to {command} within {self._answer_s:g} s",
                    hint="is this the modem's command port? Many have several: try the next number",
                )

    def _lines(self, port: serial.Serial) -> list[str]:
        """Whole lines that have come; what has no end of line yet is kept."""
        self._rest += port.read(max(1, port.in_waiting))
        *whole, self._rest = self._rest.replace(b"\r", b"\n").split(b"\n")
        if len(self._rest) > _LONGEST:
            self._rest = b""
        texts = (line.decode("ascii", "replace").strip() for line in whole)
        return [text for text in texts if text]


_BUSY = (11, 16)
"""EAGAIN of the file lock, EBUSY of the exclusive flag."""


def _final(line: str) -> bool:
    return line in ("OK", "ERROR", "NO CARRIER", "COMMAND NOT SUPPORT") or line.startswith(("+CME ERROR", "+CMS ERROR"))


def _why(error: BaseException) -> str:
    return (isinstance(error, OSError) and error.strerror) or type(error).__name__
