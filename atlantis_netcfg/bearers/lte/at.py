"""Read a modem on a serial port over AT commands; the port is left alone while another program has it."""

from __future__ import annotations

import fcntl
import os
import termios
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import serial

from atlantis_netcfg.bearers.lte.at_parse import reading_of
from atlantis_netcfg.core.errors import DeviceFailed, NetcfgError

if TYPE_CHECKING:
    from types import TracebackType
    from typing import Self

    from atlantis_netcfg.bearers.lte.record import LteReading

__all__ = [
    "ALLOWED",
    "ANSWER_S",
    "READS",
    "VENDOR_READS",
    "Answer",
    "AtLook",
    "AtSilent",
    "AtUnreachable",
    "CommandForbidden",
    "Modem",
    "PortOwned",
    "checked",
    "read",
    "reading_of",
    "require_free",
]


READS: tuple[str, ...] = (
    "AT+CGMI",
    "AT+CFUN?",
    "AT+CPIN?",
    "AT+CEREG?",
    "AT+CGREG?",
    "AT+CREG?",
    "AT+COPS?",
    "AT+CESQ",
    "AT+CSQ",
    "AT+CGACT?",
    "AT+CGCONTRDP",
    "AT+CGPADDR",
    "AT+CGDCONT?",
)
"""Sent one after another for a reading, in this order."""

VENDOR_READS: dict[str, tuple[str, ...]] = {"quectel": ("AT+QNWINFO",)}
"""Sent afterwards if the manufacturer's name holds the word."""

ALLOWED: frozenset[str] = frozenset(
    {
        *READS,
        *(command for commands in VENDOR_READS.values() for command in commands),
        "ATI",
        "AT+CGMM",
        "AT+CGMR",
        'AT+QENG="servingcell"',
        "AT+QCSQ",
        "AT^HCSQ?",
        "AT^SYSCFG?",
    }
)


class CommandForbidden(NetcfgError):
    """Our own code was about to send something that is no read: a fault of ours, and nothing was sent."""


def checked(command: str) -> str:
    """Give the command back if it is allowed. Raises CommandForbidden."""
    if command not in ALLOWED:
        word = command.partition("=")[0]
        raise CommandForbidden(f"`{word}` is not on the allow-list of modem commands: it was not sent")
    return command


_PTY = "/dev/pts/"
_UNIX98 = range(136, 144)
"""Major numbers of pseudo-terminals (Linux, Documentation/admin-guide/devices.txt)."""
_LOCKS = (Path("/var/lock"), Path("/run/lock"))


class PortOwned(DeviceFailed):
    """Another program has the port; nothing was sent to it."""


def require_free(port: str, *, proc: Path = Path("/proc"), locks: tuple[Path, ...] = _LOCKS) -> None:
    """Raise PortOwned if a program has the port open or locked, or ModemManager runs, which owns every modem.

    Of other users' processes an ordinary user sees no open files: then the lock file and the exclusive flag, which is
    tried when the port is opened, are all that is left. A pseudo-terminal is no modem to ModemManager.
    """
    if not port.startswith(_PTY) and (pid := _manager(proc)) is not None:
        raise PortOwned(
            f"{port}: ModemManager runs on this computer (process {pid}) and owns its modems",
            hint="write `driver: modemmanager` (and no `serial`), or stop ModemManager while the port is read",
        )
    if (holder := _holder(port, proc) or _locked(port, proc, locks)) is not None:
        raise PortOwned(
            f"{port}: another program has this port ({holder}), and is not disturbed",
            hint="end that program, or read the modem in the way that it offers",
        )


def _manager(proc: Path) -> int | None:
    return next((pid for pid in _processes(proc) if _name(proc, pid) == "ModemManager"), None)


def _holder(port: str, proc: Path) -> str | None:
    try:
        device = _identity(Path(port))
    except OSError:
        return None
    for pid in _processes(proc):
        if pid != os.getpid() and _has_open(proc / str(pid) / "fd", device):
            return f"{_name(proc, pid)}, process {pid}"
    return None


def _identity(path: Path) -> tuple[int, int]:
    """The device behind a path; each container numbers its pseudo-terminals anew, in a file system of its own."""
    found = path.stat()
    return found.st_rdev, found.st_dev if os.major(found.st_rdev) in _UNIX98 else 0


def _has_open(files: Path, device: tuple[int, int]) -> bool:
    try:
        links = list(files.iterdir())
    except OSError:
        return False
    for link in links:
        try:
            # A link that does not lead into /dev is not opened: a stat of a dead network share would hang.
            if str(link.readlink()).startswith("/dev/") and _identity(link) == device:
                return True
        except OSError:
            continue
    return False


def _locked(port: str, proc: Path, locks: tuple[Path, ...]) -> str | None:
    """A lock file of the old kind, which holds the number of a process that lives (pppd, minicom)."""
    for folder in locks:
        path = folder / f"LCK..{Path(port).name}"
        try:
            pid = int(path.read_text(encoding="ascii").split()[0])
        except (OSError, ValueError, IndexError):
            continue
        if (proc / str(pid)).is_dir():
            return f"{_name(proc, pid)}, process {pid}, by {path}"
    return None


def _processes(proc: Path) -> list[int]:
    return sorted(int(path.name) for path in proc.iterdir() if path.name.isdigit())


def _name(proc: Path, pid: int) -> str:
    try:
        return (proc / str(pid) / "comm").read_text(encoding="utf-8").strip()
    except OSError:
        return "unknown"


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


@dataclass(frozen=True, slots=True)
class AtLook:
    """What one look at a modem has given."""

    reading: LteReading
    commands: int
    """Sent, and answered."""


def read(port: str, *, answer_s: float = ANSWER_S) -> AtLook:
    """Ask the modem at `port`. Raises PortOwned and AtUnreachable (nothing was sent), AtSilent."""
    with Modem(port, answer_s=answer_s) as modem:
        answers = {command: modem.ask(command) for command in READS}
        maker = " ".join(answers["AT+CGMI"].lines).lower()
        for word, commands in VENDOR_READS.items():
            if word in maker:
                answers |= {command: modem.ask(command) for command in commands}
        return AtLook(reading_of(answers), len(modem.sent))
