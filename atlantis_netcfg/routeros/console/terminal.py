"""The dialogue with a logged-in RouterOS console (prompts, commands, safe mode), and the serial line.

Success of a command is detected by a mark printed by the same line (`command; :put "mark"`): RouterOS stops a line at
its first error. The mark must be a whole line of output, so the echo is never mistaken for it.

Over a serial line: log in, after logging out a session that was left open when its connection was cut.
"""

from __future__ import annotations

import contextlib
import re
import time
from itertools import count
from typing import TYPE_CHECKING, Protocol

import serial

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.core.secret import MASK, Secret
from atlantis_netcfg.routeros.console import types

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence


WIDTH = 511
"""Columns asked for by the login flag `511w`."""
MOST = 2 * 1024 * 1024
"""Maximum characters between two clearings; a whole export, the longest text, has some hundred thousand."""

_LONGEST_ESCAPE = 32
_NUMBER = re.compile("[0-9]{1,4}")
_ESCAPE = re.compile(r"\x1b(?:\[([0-9;?]*)([@-~])|[()][A-Za-z0-9]|([^\[()]))")
_PARTIAL = re.compile(r"\x1b(?:\[[0-9;?]*|[()])?\Z")


class TerminalScreen:
    """Terminal emulation: bytes in, lines out. `replies` holds the terminal's pending replies."""

    def __init__(self) -> None:
        self.lines: list[str] = [""]
        self.replies = b""
        self.size = 0
        """Characters since the screen was cleared."""
        self._column = 0
        self._rest = ""

    def clear(self) -> None:
        """Clear the lines; the cursor is on one empty line."""
        self.lines = [""]
        self.size = 0
        self._column = 0

    def feed(self, data: bytes) -> None:
        """Process bytes from the device."""
        text = self._rest + data.decode("latin-1")
        self._rest = ""
        self.size += len(data)
        place = 0
        while place < len(text):
            char = text[place]
            if char == "\x1b":
                match = _ESCAPE.match(text, place)
                if match is None:
                    if len(text) - place < _LONGEST_ESCAPE and _PARTIAL.match(text, place):
                        self._rest = text[place:]
                        return
                    place += 1
                    continue
                self._handle_escape(match)
                place = match.end()
                continue
            place = self._put_plain(text, place)

    def text(self, first: int = 0, last: int | None = None) -> list[str]:
        """Return lines as text; bytes that are not UTF-8 are kept as lone surrogates."""
        return [line.encode("latin-1").decode("utf-8", "surrogateescape") for line in self.lines[first:last]]

    def _put_plain(self, text: str, place: int) -> int:
        char = text[place]
        if char == "\n":
            self.lines.append("")
            self._column = 0
        elif char == "\r":
            self._column = 0
        elif char == "\b":
            self._column = max(0, self._column - 1)
        elif char >= " ":
            end = place
            while end < len(text) and text[end] >= " " and text[end] != "\x7f":
                end += 1
            self._write(text[place : max(end, place + 1)])
            return max(end, place + 1)
        return place + 1

    def _write(self, run: str) -> None:
        line = self.lines[-1].ljust(self._column)
        self.lines[-1] = line[: self._column] + run + line[self._column + len(run) :]
        self._column += len(run)

    def _handle_escape(self, match: re.Match[str]) -> None:
        arguments, command, single = match.groups()
        if single == "Z" or command == "c":
            self.replies += b"\x1b[?1;2c"
        elif command == "n" and arguments == "6":
            self.replies += f"\x1b[1;{min(self._column + 1, WIDTH)}R".encode()
        elif command == "K":
            self._erase(arguments)
        elif command == "D":
            self._column = max(0, self._column - _count(arguments))
        elif command == "C":
            self._column = min(WIDTH - 1, self._column + _count(arguments))
        elif command == "J":
            self._erase(arguments)
        elif command == "G":
            self._column = min(WIDTH, _count(arguments)) - 1

    def _erase(self, arguments: str) -> None:
        if arguments in ("", "0"):
            self.lines[-1] = self.lines[-1][: self._column]
        elif arguments == "2":
            self.lines[-1] = ""


def _count(arguments: str) -> int:
    """Return the distance of a cursor movement; 1 if missing or not a number."""
    return max(1, min(int(arguments), WIDTH)) if _NUMBER.fullmatch(arguments) else 1


FLAGS = f"+ct{WIDTH}w4098h"
"""No colours, no terminal detection, wide and high (Manual, Command Line Interface: console login options)."""
ENTER, CTRL_C, CTRL_D, CTRL_X = b"\r", b"\x03", b"\x04", b"\x18"

_PROMPT = re.compile(r"\[[^\r\n]*\][^\[\]<>]*(?P<safe><SAFE>)?[ ]*>?[ ]*")
_LICENCE = re.compile(r"software license\?.*:?\s*\Z", re.IGNORECASE)
_DEFAULTS = re.compile(
    r'remove this default configuration.*|or hit any other key.*|"r".*default configuration', re.IGNORECASE
)
_PASSWORD = re.compile(r"new password>\s*\Z", re.IGNORECASE)
_ENTER = re.compile(r"press \"?enter\"? to continue", re.IGNORECASE)
_HIJACK = re.compile(r"Hijacking Safe Mode.*", re.IGNORECASE)
_QUIET_S = 0.3
"""Seconds of silence after which a prompt is final: RouterOS redraws it before the output comes."""
_TAKEN_S = 30.0
_BYE_S = 5.0


class _TerminalLine(types.ConsoleWire, Protocol):
    """A wire that can end a session without `/quit`."""

    def hang_up(self) -> None:
        """End the session so that the device undoes safe mode."""


class Terminal:
    """Implementation of `Console`."""

    def __init__(
        self,
        wire: _TerminalLine,
        *,
        user: str,
        name: str,
        host_key: str | None = None,
        screen: TerminalScreen | None = None,
    ) -> None:
        """`screen`: the current content of the terminal."""
        self._wire = wire
        self._screen = screen or TerminalScreen()
        self._user = user
        self._name = name
        self._host_key = host_key
        self._numbers = count(1)
        self._safe = False
        self._lost = False

    @property
    def host_key(self) -> str | None:
        """The SSH host key."""
        return self._host_key

    @property
    def user(self) -> str:
        """The logged-in user."""
        return self._user

    @property
    def safe(self) -> bool:
        """True if the prompt contains `<SAFE>`."""
        return self._safe

    # --- first words -----------------------------------------------------------------------------------------------

    def settle(self, timeout_s: float) -> None:
        """Handle the prompts of the first login until a command prompt responds.

        The licence is not displayed; default configuration and password stay unchanged for now.
        """
        self._wait_until(self._answer_greeting, timeout_s, in_flight=False)
        self._sync(timeout_s, in_flight=False)

    def _answer_greeting(self) -> bool:
        tail = self._tail()
        if _LICENCE.search(tail):
            self._answer(b"n")
        elif _PASSWORD.search(tail):
            self._answer(CTRL_C)
        elif _ENTER.search(tail) or _DEFAULTS.search(tail):
            self._answer(ENTER)
        elif re.search(r"login failed|^login:\s*$", tail, re.IGNORECASE | re.MULTILINE):
            raise types.ConsoleLoginError(f"{arg(self._name)}: the device did not accept the user name and password")
        return self._is_at_prompt()

    def _tail(self) -> str:
        return "\n".join(line for line in self._screen.text(-8) if line.strip())

    def _answer(self, key: bytes) -> None:
        self._screen.clear()
        self._send(key, in_flight=False)

    # --- commands --------------------------------------------------------------------------------------------------

    def run(self, command: str, *, timeout_s: float = types.COMMAND_S, secrets: Sequence[Secret] = ()) -> str:
        """Run one command line, and return its output."""
        if "\n" in command or "\r" in command:
            raise ValueError("one line at a time: quote line ends as \\n")
        mark = f"atlantis-done-{next(self._numbers)}"
        self._screen.clear()
        self._send(f'{command}; :put "{mark}"'.encode("utf-8", "surrogateescape") + ENTER, in_flight=True)
        self._wait_until(lambda: self._has_mark(mark), timeout_s, in_flight=True)
        if mark not in self._screen.text():
            self._sync(timeout_s, in_flight=True)
        lines = [line.rstrip() for line in self._screen.text()]
        is_done = mark in lines
        output = self._output(lines, mark if is_done else None)
        if not is_done:
            words = _mask_secrets(" ".join(output.split()), secrets) or "no response"
            raise types.ConsoleCommandError(
                msg(f"{arg(self._name)}: the device refused a command: {arg(words)}"), words=words
            )
        return output

    def ask(self, command: str, question: str, answer: str, *, timeout_s: float = types.COMMAND_S) -> None:
        """Run a command that asks for confirmation, and send `answer`."""
        self._screen.clear()
        self._send(command.encode() + ENTER, in_flight=False)
        self._wait_until(lambda: question in self._tail() or self._quiet_prompt(), timeout_s, in_flight=False)
        if question not in self._tail():
            words = " ".join(self._output([line.rstrip() for line in self._screen.text()], None).split())
            raise types.ConsoleCommandError(
                msg(f"{arg(self._name)}: the device refused a command: {arg(words)}"), words=words
            )
        self._send(answer.encode(), in_flight=True)

    def rows(self, menu: str, *, where: str = "", timeout_s: float = types.COMMAND_S) -> list[dict[str, str]]:
        """Return the rows of a menu."""
        condition = f" where {where}" if where else ""
        output = self.run(f":put [{menu} print detail as-value{condition}]", timeout_s=timeout_s)
        return types.parse_rows(output.replace("\n", ""))

    def _has_mark(self, mark: str) -> bool:
        """Return True if mark and prompt have arrived, or the prompt alone: then the line stopped at an error."""
        if mark in (line.rstrip() for line in self._screen.lines):
            return self._is_at_prompt()
        return len(self._screen.lines) > 1 and self._quiet_prompt()

    def _output(self, lines: list[str], mark: str | None) -> str:
        """Return the lines between echo and mark; without a mark, those before the next prompt."""
        last = lines.index(mark) if mark is not None else len(lines)
        echo = next((place for place, line in enumerate(lines[:last]) if '; :put "atlantis-done-' in line), -1)
        output_lines = [
            line for line in lines[echo + 1 : last] if _PROMPT.match(line) is None or "atlantis-" not in line
        ]
        while output_lines and (not output_lines[-1].strip() or _PROMPT.fullmatch(output_lines[-1])):
            output_lines.pop()
        while output_lines and not output_lines[0].strip():
            output_lines.pop(0)
        return "\n".join(line for line in output_lines if not _PROMPT.fullmatch(line))

    def _sync(self, timeout_s: float, *, in_flight: bool) -> None:
        """Wait until the prompt responds and no earlier output remains."""
        mark = f"atlantis-here-{next(self._numbers)}"
        self._send(f':put "{mark}"'.encode() + ENTER, in_flight=in_flight)
        self._wait_until(
            lambda: mark in (line.rstrip() for line in self._screen.lines) and self._is_at_prompt(),
            timeout_s,
            in_flight=in_flight,
        )
        for place, line in enumerate(self._screen.lines):
            if f':put "{mark}"' in line or line.rstrip() == mark:
                self._screen.lines[place] = ""

    # --- safe mode -------------------------------------------------------------------------------------------------

    def take_safe_mode(self) -> None:
        """Take safe mode with Ctrl+X, unless the prompt shows that it is already ours."""
        if self._safe:
            return
        self._screen.clear()
        self._send(CTRL_X, in_flight=False)
        self._wait_until(
            lambda: self._is_asked_to_hijack() or (self._is_at_prompt() and self._safe), _TAKEN_S, in_flight=False
        )
        if self._is_asked_to_hijack():
            self._answer(b"d")
            self._sync(_TAKEN_S, in_flight=False)
            raise types.SafeModeHeld(
                f"{arg(self._name)}: somebody else holds safe mode on this device; nothing was changed",
                hint="wait until that session has ended, then run the same command again",
            )

    def release_safe_mode(self) -> None:
        """Release safe mode with Ctrl+X, unless it is not ours."""
        if not self._safe:
            return
        self._screen.clear()
        self._send(CTRL_X, in_flight=True)
        self._wait_until(lambda: self._is_at_prompt() and not self._safe, _TAKEN_S, in_flight=True)

    def _is_asked_to_hijack(self) -> bool:
        return any(_HIJACK.search(line) for line in self._screen.lines)

    def close(self) -> None:
        """End the session; if safe mode is held, hang up so that the device undoes the change."""
        try:
            if self._lost:
                return
            if self._safe:
                self._wire.hang_up()
                return
            self._screen.clear()
            self._wire.write(b"/quit" + ENTER)
            deadline = time.monotonic() + _BYE_S
            while time.monotonic() < deadline and "ogin:" not in self._tail():
                self._screen.feed(self._wire.read(0.2))
        except types.WireLost:
            pass
        finally:
            self._lost = True
            self._wire.close()

    # --- the wire --------------------------------------------------------------------------------------------------

    def _is_at_prompt(self) -> bool:
        match = _PROMPT.fullmatch(self._screen.lines[-1])
        if match is None or not self._screen.lines[-1].rstrip().endswith(">"):
            return False
        self._safe = match["safe"] is not None
        return True

    def _quiet_prompt(self) -> bool:
        """Return True if there is a prompt with no output after it."""
        if not self._is_at_prompt():
            return False
        data = self._receive(_QUIET_S, in_flight=True)
        return not data and self._is_at_prompt()

    def _send(self, data: bytes, *, in_flight: bool) -> None:
        if self._lost:
            raise self._loss_error("the session has ended", in_flight=False)
        try:
            self._wire.write(data)
        except types.WireLost as error:
            raise self._loss_error("the connection was lost", in_flight=in_flight) from error

    def _receive(self, timeout_s: float, *, in_flight: bool) -> bytes:
        try:
            data = self._wire.read(timeout_s)
        except types.WireLost as error:
            raise self._loss_error("the connection was lost", in_flight=in_flight) from error
        self._screen.feed(data)
        if self._screen.size > MOST:
            raise self._loss_error(
                msg(f"received more than {arg(MOST)} characters without an end"), in_flight=in_flight
            )
        if self._screen.replies:
            replies, self._screen.replies = self._screen.replies, b""
            self._send(replies, in_flight=in_flight)
        return data

    def _wait_until(self, condition: Callable[[], bool], timeout_s: float, *, in_flight: bool) -> None:
        deadline = time.monotonic() + timeout_s
        while not condition():
            remaining_s = deadline - time.monotonic()
            if remaining_s <= 0:
                raise self._loss_error(msg(f"no response within {arg(timeout_s):.0f} s"), in_flight=in_flight)
            self._receive(remaining_s, in_flight=in_flight)

    def _loss_error(self, why: str, *, in_flight: bool) -> types.ConsoleLost:
        self._lost = True
        self._wire.close()
        return types.ConsoleLost(
            msg(f"{arg(self._name)}: {arg(why)}"),
            in_flight=in_flight,
            hint="unknown whether the last command was executed" if in_flight else None,
        )


def _mask_secrets(words: str, secrets: Sequence[Secret]) -> str:
    for secret in secrets:
        if secret.reveal():
            words = words.replace(secret.reveal(), MASK)
    return words


BAUD = 115200
"""RouterOS's default on the console port (Manual, Serial Console)."""
_NUDGE_S = 2.0
_SERIAL_QUIET_S = 0.2
_LOGIN = re.compile(r"login:\s*\Z", re.IGNORECASE)
_LOGIN_PASSWORD = re.compile(r"^\s*password:\s*\Z", re.IGNORECASE)
_LOGIN_ERROR = re.compile(r"login failed|incorrect username or password", re.IGNORECASE)
_LOGGED_IN = re.compile(r"\][^\[\]<>]*(<SAFE>)?[ ]*>?[ ]*\Z")
_QUESTION = re.compile(r"\[Y/n\]|new password>|default configuration", re.IGNORECASE)


class SerialWire:
    """A tty. It cannot detect that the other end is gone, but the tty itself may vanish (adapter unplugged)."""

    def __init__(self, port: serial.Serial) -> None:
        self._port = port

    def read(self, timeout_s: float) -> bytes:
        """Return the data received until the timeout; may be empty. Raises WireLost."""
        try:
            self._port.timeout = max(timeout_s, 0.001)
            first: bytes = self._port.read(1)
            return first + self._port.read(self._port.in_waiting) if first else b""
        except (serial.SerialException, OSError, TypeError) as error:  # TypeError: closed under pyserial's feet
            raise types.WireLost from error

    def write(self, data: bytes) -> None:
        """Send, and wait until all data is transmitted."""
        try:
            self._port.write(data)
            self._port.flush()
        except (serial.SerialException, OSError) as error:
            raise types.WireLost from error

    def close(self) -> None:
        """Release the tty; a logged-in session remains on the device."""
        with contextlib.suppress(serial.SerialException, OSError):
            self._port.close()

    def hang_up(self) -> None:
        """Send Ctrl+D, which logs out and undoes safe mode (Manual, Configuration Management)."""
        self.write(CTRL_D)


def open_serial(
    device_path: str, user: str, password: Secret, *, baud: int = BAUD, timeout_s: float = types.CONNECT_S
) -> types.Console:
    """Log in over a serial line; a session left there by an earlier run is ended first, its safe mode undone.

    Raises ConsoleUnreachable (no such tty, in use, silent), ConsoleLoginError, ConsoleLost.
    """
    try:
        port = serial.Serial(device_path, baud, timeout=1, write_timeout=timeout_s, exclusive=True)
    except (serial.SerialException, OSError, ValueError) as error:
        raise types.ConsoleUnreachable(
            f"{arg(device_path)}: the serial line cannot be opened: {arg(error.__class__.__name__)}",
            hint=(
                "check that the adapter is plugged in, that you may use it (group dialout), and that no other "
                "program (minicom, screen) does"
            ),
        ) from error
    wire = SerialWire(port)
    try:
        login = _Login(wire, device_path, time.monotonic() + timeout_s)
        login.log_in(user, password)
        terminal = Terminal(wire, user=user, name=device_path, screen=login.screen)
        terminal.settle(timeout_s)
    except types.WireLost as error:
        wire.close()
        raise types.ConsoleLost(msg(f"{arg(device_path)}: the serial line was lost"), in_flight=False) from error
    except BaseException:
        wire.close()
        raise
    return terminal


class _Login:
    """Login over a serial line, whatever state the line is in."""

    def __init__(self, wire: SerialWire, name: str, deadline: float) -> None:
        self._wire = wire
        self._name = name
        self._deadline = deadline
        self.screen = TerminalScreen()

    def log_in(self, user: str, password: Secret) -> None:
        """Send name and password; the rest is handled by Terminal."""
        self._reach_login()
        self._type(f"{user}{FLAGS}".encode() + ENTER)
        self._wait(_LOGIN_PASSWORD)
        self._type(password.reveal().encode() + ENTER)
        while True:
            tail = self._tail()
            if _LOGIN_ERROR.search("\n".join(self.screen.text())) or _LOGIN.search(tail):
                raise types.ConsoleLoginError(
                    f"{arg(self._name)}: the device did not accept the user name and password",
                    hint="the factory's password is on the sticker of newer devices, and empty on older ones",
                )
            if _LOGGED_IN.search(tail) or _QUESTION.search("\n".join(self.screen.text())):
                return
            self._read()

    def _reach_login(self) -> None:
        """End what is open on the line: input by Ctrl+C, a session by `/quit`, one in safe mode by Ctrl+D."""
        self._nudge()
        while True:
            self._settle()
            tail = self._tail()
            if _LOGIN.search(tail):
                return
            if safe := _LOGGED_IN.search(tail):
                self._type(CTRL_D if safe[1] else b"/quit" + ENTER)
            elif _LOGIN_PASSWORD.search(tail):
                self._type(ENTER)
            elif _QUESTION.search(tail):
                self._type(CTRL_C if "password" in tail else b"n")
            else:
                self._nudge()

    def _nudge(self) -> None:
        self._wire.write(CTRL_C)
        self._type(ENTER)

    def _settle(self) -> None:
        """Read until no data arrives for a moment: the response to one key may come in pieces."""
        self._read(_NUDGE_S)
        while self._read(_SERIAL_QUIET_S):
            pass

    def _type(self, keys: bytes) -> None:
        self.screen.clear()
        self._wire.write(keys)

    def _wait(self, pattern: re.Pattern[str]) -> None:
        while not pattern.search(self._tail()):
            self._read()

    def _read(self, timeout_s: float = _NUDGE_S) -> bytes:
        if time.monotonic() > self._deadline:
            raise types.ConsoleUnreachable(
                f"{arg(self._name)}: no RouterOS console responds on this line",
                hint="check that the cable is in the console port, the device is on and the speed is right (115200)",
            )
        data = self._wire.read(timeout_s)
        self.screen.feed(data)
        if self.screen.size > MOST:
            raise types.ConsoleUnreachable(
                f"{arg(self._name)}: the device on this line sends without an end: not a RouterOS console"
            )
        return data

    def _tail(self) -> str:
        return next((line for line in reversed(self.screen.text()) if line.strip()), "")
