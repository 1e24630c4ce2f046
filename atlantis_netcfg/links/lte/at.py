"""Reading of a modem on a serial port with AT commands; a port in use by another program is not touched.

The meaning of a modem's responses: 3GPP TS 27.007; the figures of `+CESQ` follow libmbim (devices.md section 4).

99 and 255 mean "not known" and give None. A response to a registration read has the mode before the state, an
unsolicited line of the same name has no mode; a line of another name is never used.
"""

from __future__ import annotations

import csv
import fcntl
import os
import re
import termios
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Self

import serial

from atlantis_netcfg.core.errors import DeviceError, NetcfgError
from atlantis_netcfg.core.messages import arg
from atlantis_netcfg.links.lte.judge import LteReading, Registration

if TYPE_CHECKING:
    from collections.abc import Mapping
    from types import TracebackType

_STATES = {
    0: Registration.SEARCHING,
    1: Registration.REGISTERED_HOME,
    2: Registration.SEARCHING,
    3: Registration.DENIED,
    4: Registration.UNKNOWN,
    5: Registration.REGISTERED_ROAMING,
    6: Registration.REGISTERED_HOME,
    7: Registration.REGISTERED_ROAMING,
    8: Registration.SEARCHING,
    9: Registration.REGISTERED_HOME,
    10: Registration.REGISTERED_ROAMING,
}
"""`<stat>`, 7.2, 10.1.20 and 10.1.22. 0 (not searching) and 8 (emergency only) have no value of their own."""
_REGISTERED_STATES = (Registration.REGISTERED_HOME, Registration.REGISTERED_ROAMING)
_CME = {
    10: Registration.SIM_MISSING,
    11: Registration.SIM_PIN_REQUIRED,
    12: Registration.SIM_PUK_REQUIRED,
    13: Registration.SIM_MISSING,
    15: Registration.SIM_MISSING,
    16: Registration.SIM_PIN_REQUIRED,
}
"""9.2: 10 not inserted, 11 PIN, 12 PUK, 13 failure, 15 wrong, 16 incorrect password. 14 (busy) indicates no state."""
_CME_WORDS = (
    ("not inserted", 10),
    ("puk required", 12),
    ("pin required", 11),
    ("incorrect password", 16),
    ("failure", 13),
)
_TECHNOLOGIES = {0: "gsm", 1: "gsm", 3: "gsm", 2: "umts", 4: "umts", 5: "umts", 6: "umts", 7: "lte", 9: "nb-iot"}
_TECHNOLOGIES |= {10: "lte", 11: "5g", 12: "5g", 13: "lte"}
"""`<AcT>`, 7.3."""


def reading_of(answers: Mapping[str, AtAnswer]) -> LteReading:
    """Combine the responses into one record; figures that the modem does not provide are None."""
    card, is_pin_refused, card_words = _card(answers)
    network, network_words = _network(answers)
    off = _first(answers, "AT+CFUN?")
    switched_off = bool(off) and off[0] in ("0", "4")
    state = card or (Registration.DISABLED if switched_off else network)
    operator, plmn, technology = _operator(answers)
    extra_plmn, band = _vendor(answers)
    is_registered = state in _REGISTERED_STATES
    rsrp, rsrq = _signal_quality(answers)
    return LteReading(
        source="at",
        state=state,
        access_tech=technology,
        operator=operator,
        plmn=plmn or extra_plmn,
        band=band,
        rsrp_dbm=rsrp,
        rsrq_db=rsrq,
        rssi_dbm=_strength(answers),
        roaming=state is Registration.REGISTERED_ROAMING if is_registered else None,
        address=_address(answers),
        apn=_apn(answers),
        pin_refused=is_pin_refused,
        last_error=None if is_registered else (card_words or network_words),
    )


def _rows(answers: Mapping[str, AtAnswer], command: str) -> list[list[str]]:
    """Return the fields of the response lines that begin with the command's name."""
    answer = answers.get(command)
    if answer is None or not answer.ok:
        return []
    name = command.removeprefix("AT").rstrip("?")
    bodies = (line.removeprefix(f"{name}:") for line in answer.lines if line.startswith(f"{name}:"))
    return [[each.strip() for each in row] for body in bodies for row in csv.reader([body.strip()])]


def _first(answers: Mapping[str, AtAnswer], command: str) -> list[str]:
    return next(iter(_rows(answers, command)), [])


def _parse_int(text: str) -> int | None:
    return int(text) if re.fullmatch(r"-?\d{1,6}", text) else None


def _card(answers: Mapping[str, AtAnswer]) -> tuple[Registration | None, bool | None, str | None]:
    """Return the SIM state that blocks registration, whether a PIN was refused, and the modem's text."""
    answer = answers.get("AT+CPIN?")
    if answer is None:
        return None, None, None
    if not answer.ok:
        code = _cme(answer.final)
        is_pin_refused = True if code in (12, 16) else None
        return _CME.get(code or 0), is_pin_refused, answer.final
    words = next(iter(_first(answers, "AT+CPIN?")), "").upper()
    if words == "SIM PIN":
        return Registration.SIM_PIN_REQUIRED, None, words
    if words == "SIM PUK":
        return Registration.SIM_PUK_REQUIRED, True, words
    return None, None, None if words == "READY" else words or None


def _cme(final: str) -> int | None:
    """Return the number of a `+CME ERROR`, which may be a number or a text; None if there is none."""
    if not final.startswith("+CME ERROR"):
        return None
    cause = final.partition(":")[2].strip()
    if (number := _parse_int(cause)) is not None:
        return number
    return next((code for words, code in _CME_WORDS if words in cause.lower()), None)


def _network(answers: Mapping[str, AtAnswer]) -> tuple[Registration, str | None]:
    """Return the registration: EPS first, then packet; circuit-switched only if the modem reports neither."""
    data = [
        status
        for command in ("AT+CEREG?", "AT+CGREG?")
        if (status := _registration_status(answers, command)) is not None
    ]
    stats = data or [status for status in (_registration_status(answers, "AT+CREG?"),) if status is not None]
    states = [_STATES.get(stat, Registration.UNKNOWN) for stat in stats]
    ranking = (*_REGISTERED_STATES, Registration.DENIED, Registration.SEARCHING)
    state = next((each for each in ranking if each in states), Registration.UNKNOWN)
    idle = state is Registration.SEARCHING and set(stats) <= {0}
    return state, "not registered, and not searching" if idle else None


def _registration_status(answers: Mapping[str, AtAnswer], command: str) -> int | None:
    for row in _rows(answers, command):
        raw = row[1] if len(row) > 1 else ""
        if _parse_int(row[0]) is not None and re.fullmatch(r"\d{1,2}", raw):
            return int(raw)
    return None


def _operator(answers: Mapping[str, AtAnswer]) -> tuple[str | None, str | None, str | None]:
    """Return operator name, code and technology; in the numeric format the name is a code."""
    row = _first(answers, "AT+COPS?")
    name = row[2] if len(row) > 2 and row[2] else None  # noqa: PLR2004 - mode, format, operator, technology
    code = _parse_int(row[3]) if len(row) > 3 else None  # noqa: PLR2004 - as above
    technology = None if code is None else _TECHNOLOGIES.get(code)
    if name is not None and re.fullmatch(r"\d{5,6}", name):
        return None, name, technology
    return name, None, technology


def _strength(answers: Mapping[str, AtAnswer]) -> float | None:
    value = _parse_int(next(iter(_first(answers, "AT+CSQ")), ""))
    return -113.0 + 2 * value if value is not None and 0 <= value <= 31 else None  # noqa: PLR2004 - 8.5


def _signal_quality(answers: Mapping[str, AtAnswer]) -> tuple[float | None, float | None]:
    """Return RSRP in dBm and RSRQ in dB."""
    row = _first(answers, "AT+CESQ")
    if len(row) < 6:  # noqa: PLR2004 - rxlev, ber, rscp, ecno, rsrq, rsrp
        return None, None
    quality, power = _parse_int(row[4]), _parse_int(row[5])
    rsrp = -140.0 + power if power is not None and 0 <= power <= 97 else None  # noqa: PLR2004 - 8.69
    rsrq = -19.5 + quality / 2 if quality is not None and 0 <= quality <= 34 else None  # noqa: PLR2004 - 8.69
    return rsrp, rsrq


def _active(answers: Mapping[str, AtAnswer]) -> str | None:
    """Return the active context; None if none is active or the modem does not report it."""
    return next((row[0] for row in _rows(answers, "AT+CGACT?") if len(row) > 1 and row[1] == "1"), None)


def _apn(answers: Mapping[str, AtAnswer]) -> str | None:
    """Return the APN in use as given by the network; otherwise that of the active, or only, context."""
    active = _active(answers)
    for row in _rows(answers, "AT+CGCONTRDP"):
        if len(row) > 2 and row[0] == (active or row[0]) and row[2]:  # noqa: PLR2004 - cid, bearer, apn
            return re.sub(r"\.mnc\d+\.mcc\d+\.gprs$", "", row[2], flags=re.IGNORECASE)
    contexts = [row for row in _rows(answers, "AT+CGDCONT?") if len(row) > 2]  # noqa: PLR2004 - cid, type, apn
    candidates = [row for row in contexts if row[0] == active] if active is not None else contexts[:1]
    return next((row[2] for row in candidates if row[2]), None)


def _address(answers: Mapping[str, AtAnswer]) -> str | None:
    active = _active(answers)
    for row in _rows(answers, "AT+CGPADDR"):
        if len(row) > 1 and row[0] == (active or row[0]):
            match = re.fullmatch(r"(\d{1,3}(?:\.\d{1,3}){3})", row[1])
            if match is not None and match[1] != "0.0.0.0":  # noqa: S104 - no address yet
                return match[1]
    return None


def _vendor(answers: Mapping[str, AtAnswer]) -> tuple[str | None, str | None]:
    """Parse operator code and band from `+QNWINFO: "FDD LTE","26803","LTE BAND 3",1300` (Quectel)."""
    row = _first(answers, "AT+QNWINFO")
    if len(row) < 3:  # noqa: PLR2004 - technology, operator, band, channel
        return None, None
    band = re.fullmatch(r"(?:LTE BAND (\d+)|NR5G BAND (\d+))", row[2])
    code = row[1] if re.fullmatch(r"\d{5,6}", row[1]) else None
    if band is None:
        return code, None
    return code, f"B{band[1]}" if band[1] else f"n{band[2]}"


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
"""Commands of one reading, in the order in which they are sent."""

VENDOR_READS: dict[str, tuple[str, ...]] = {"quectel": ("AT+QNWINFO",)}
"""Further read commands by a word in the manufacturer's name; sent after `READS`."""

ALLOW_LIST: frozenset[str] = frozenset(
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
    """A command that is not a read was about to be sent: an error in this toolkit; nothing was sent."""


def require_allowed(command: str) -> str:
    """Return the command if it is allowed; raise CommandForbidden otherwise."""
    if command not in ALLOW_LIST:
        word = command.partition("=")[0]
        raise CommandForbidden(f"`{arg(word)}` is not on the allow-list of modem commands: it was not sent")
    return command


_PTY = "/dev/pts/"
_UNIX98 = range(136, 144)
"""Major numbers of pseudo-terminals (Linux, Documentation/admin-guide/devices.txt)."""
_LOCKS = (Path("/var/lock"), Path("/run/lock"))


class PortBusy(DeviceError):
    """Another program has the port; nothing was sent to it."""


def require_free(port: str, *, proc: Path = Path("/proc"), locks: tuple[Path, ...] = _LOCKS) -> None:
    """Raise PortBusy if a program has the port open or locked, or if ModemManager runs: it owns every modem.

    An ordinary user cannot see the open files of other users' processes: then only the lock file and the exclusive
    flag, which is tried when the port is opened, remain. A pseudo-terminal is no modem to ModemManager.
    """
    if not port.startswith(_PTY) and (pid := _modemmanager_pid(proc)) is not None:
        raise PortBusy(
            f"{arg(port)}: ModemManager runs on this computer (process {arg(pid)}) and owns its modems",
            hint="write `driver: modemmanager` (and no `serial`), or stop ModemManager while the port is read",
        )
    if (holder := _holder(port, proc) or _lock_holder(port, proc, locks)) is not None:
        raise PortBusy(
            f"{arg(port)}: another program has this port ({arg(holder)}), and is not disturbed",
            hint="end that program, or read the modem in the way that it offers",
        )


def _modemmanager_pid(proc: Path) -> int | None:
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
    """Return the identity of the device behind a path; pseudo-terminals are numbered per container file system."""
    file_status = path.stat()
    return file_status.st_rdev, file_status.st_dev if os.major(file_status.st_rdev) in _UNIX98 else 0


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


def _lock_holder(port: str, proc: Path, locks: tuple[Path, ...]) -> str | None:
    """Return the holder of a UUCP lock file that names a running process (pppd, minicom); None if there is none."""
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
"""Timeout in seconds for one command: reads are fast, but a modem that is registering may be slow."""
BAUD = 115200
"""Baud rate: USB modems ignore it, and serial modems have it as their default."""
_LONGEST = 65536
"""Maximum number of bytes without an end of line; more is treated as noise."""
_MOST = 262_144
"""Maximum number of characters in one response; the longest, a list of networks, has some thousand."""


class AtUnreachable(DeviceError):
    """The port cannot be opened; nothing was sent."""


class AtSilent(DeviceError):
    """The modem does not respond, or the port has disappeared; only reads were sent."""


@dataclass(frozen=True, slots=True)
class AtAnswer:
    """A modem's response: its information lines and the final result (`OK`, `ERROR`, `+CME ERROR: 10`)."""

    lines: tuple[str, ...]
    final: str

    @property
    def ok(self) -> bool:
        """Whether the modem accepted the command."""
        return self.final == "OK"


class AtModem:
    """A serial port opened for exclusive use; `with` opens and closes it."""

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
                raise PortBusy(
                    f"{arg(self._path)}: another program has this port, and is not disturbed", hint="end that program"
                ) from error
            raise AtUnreachable(
                f"{arg(self._path)}: the modem's port cannot be opened ({arg(_error_text(error))})",
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

    def ask(self, command: str) -> AtAnswer:
        """Send one allowed command; raise CommandForbidden (nothing sent) or AtSilent."""
        data = require_allowed(command).encode("ascii") + b"\r"
        port = self._port
        assert port is not None  # noqa: S101 - entered
        try:
            self.sent.append(command)
            port.write(data)
            port.flush()
            return self._answer(port, command)
        except (serial.SerialException, OSError, TypeError) as error:  # TypeError: closed under pyserial's feet
            raise AtSilent(
                f"{arg(self._path)}: the modem has gone while it was read ({arg(_error_text(error))})",
                hint="has it power, and is its cable firm? It may be starting anew: wait a minute",
            ) from error

    def _answer(self, port: serial.Serial, command: str) -> AtAnswer:
        until = time.monotonic() + self._answer_s
        lines: list[str] = []
        while True:
            for line in self._lines(port):
                if _is_final_line(line):
                    return AtAnswer(tuple(lines), line)
                if line != command:
                    lines.append(line)
            if sum(map(len, lines)) > _MOST:
                raise AtSilent(
                    f"{arg(self._path)}: more than {arg(_MOST)} characters came in answer to {arg(command)}, "
                    "and no end",
                    hint="is this the modem's command port? Many have several: try the next number",
                )
            if time.monotonic() > until:
                raise AtSilent(
                    f"{arg(self._path)}: no answer to {arg(command)} within {arg(self._answer_s):g} s",
                    hint="is this the modem's command port? Many have several: try the next number",
                )

    def _lines(self, port: serial.Serial) -> list[str]:
        """Return the complete lines received; an incomplete line stays buffered."""
        self._rest += port.read(max(1, port.in_waiting))
        *whole, self._rest = self._rest.replace(b"\r", b"\n").split(b"\n")
        if len(self._rest) > _LONGEST:
            self._rest = b""
        texts = (line.decode("ascii", "replace").strip() for line in whole)
        return [text for text in texts if text]


_BUSY = (11, 16)
"""Error numbers of a port in use: EAGAIN of the file lock, EBUSY of the exclusive flag."""


def _is_final_line(line: str) -> bool:
    return line in ("OK", "ERROR", "NO CARRIER", "COMMAND NOT SUPPORT") or line.startswith(("+CME ERROR", "+CMS ERROR"))


def _error_text(error: BaseException) -> str:
    return (isinstance(error, OSError) and error.strerror) or type(error).__name__


@dataclass(frozen=True, slots=True)
class AtLook:
    """The result of reading a modem once."""

    reading: LteReading
    commands: int
    """Number of commands that were sent and answered."""


def read(port: str, *, answer_s: float = ANSWER_S) -> AtLook:
    """Read the modem at `port`; raise PortBusy or AtUnreachable (nothing was sent), or AtSilent."""
    with AtModem(port, answer_s=answer_s) as modem:
        answers = {command: modem.ask(command) for command in READS}
        maker = " ".join(answers["AT+CGMI"].lines).lower()
        for word, commands in VENDOR_READS.items():
            if word in maker:
                answers |= {command: modem.ask(command) for command in commands}
        return AtLook(reading_of(answers), len(modem.sent))
