"""The console over a serial line: log in, and log out whoever was left logged in by a session that was cut."""

from __future__ import annotations

import contextlib
import re
import time
from typing import TYPE_CHECKING

import serial

from atlantis_netcfg.console.terminal import CTRL_C, CTRL_D, ENTER, FLAGS, MOST, Screen, Terminal
from atlantis_netcfg.console.types import CONNECT_S, ConsoleLost, ConsoleUnreachable, LoginFailed, WireLost

if TYPE_CHECKING:
    from atlantis_netcfg.console.types import Console
    from atlantis_netcfg.core.secret import Secret

BAUD = 115200
"""RouterOS' own default on the console port (Manual, Serial Console)."""
_NUDGE_S = 2.0
_SERIAL_QUIET_S = 0.2
_LOGIN = re.compile(r"login:\s*\Z", re.IGNORECASE)
_LOGIN_PASSWORD = re.compile(r"^\s*password:\s*\Z", re.IGNORECASE)
_FAILED = re.compile(r"login failed|incorrect username or password", re.IGNORECASE)
_LOGGED_IN = re.compile(r"\][^\[\]<>]*(<SAFE>)?[ ]*>?[ ]*\Z")
_QUESTION = re.compile(r"\[Y/n\]|new password>|default configuration", re.IGNORECASE)


class SerialWire:
    """A tty. Nothing on it says that the other end is gone, but the tty itself may go (an adapter pulled out)."""

    def __init__(self, port: serial.Serial) -> None:
        self._port = port

    def read(self, timeout_s: float) -> bytes:
        """Whatever came."""
        try:
            self._port.timeout = max(timeout_s, 0.001)
            first: bytes = self._port.read(1)
            return first + self._port.read(self._port.in_waiting) if first else b""
        except (serial.SerialException, OSError, TypeError) as error:  # TypeError: closed under pyserial's feet
            raise WireLost from error

    def write(self, data: bytes) -> None:
        """Send, and wait until it is out."""
        try:
            self._port.write(data)
            self._port.flush()
        except (serial.SerialException, OSError) as error:
            raise WireLost from error

    def close(self) -> None:
        """Let the tty go; whoever is logged in stays so."""
        with contextlib.suppress(serial.SerialException, OSError):
            self._port.close()

    def hang_up(self) -> None:
        """Ctrl+D logs out and undoes safe mode (Manual, Configuration Management)."""
        self.write(CTRL_D)


def open_serial(
    device_path: str, user: str, password: Secret, *, baud: int = BAUD, timeout_s: float = CONNECT_S
) -> Console:
    """Log in over a serial line; a session that an earlier run left there is ended first, its safe mode undone.

    Raises ConsoleUnreachable (no such tty, in use, silent), LoginFailed, ConsoleLost.
    """
    try:
        port = serial.Serial(device_path, baud, timeout=1, write_timeout=timeout_s, exclusive=True)
    except (serial.SerialException, OSError, ValueError) as error:
        raise ConsoleUnreachable(
            f"{device_path}: the serial line cannot be opened: {error.__class__.__name__}",
            hint="is the adapter plugged in, may you use it (group dialout), and does nobody else (minicom, screen)?",
        ) from error
    wire = SerialWire(port)
    try:
        login = _Login(wire, device_path, time.monotonic() + timeout_s)
        login.log_in(user, password)
        terminal = Terminal(wire, user=user, name=device_path, screen=login.screen)
        terminal.settle(timeout_s)
    except WireLost as error:
        wire.close()
        raise ConsoleLost(f"{device_path}: the serial line was lost", in_flight=False) from error
    except BaseException:
        wire.close()
        raise
    return terminal


class _Login:
    """From whatever stands on the line to a session of ours."""

    def __init__(self, wire: SerialWire, name: str, deadline: float) -> None:
        self._wire = wire
        self._name = name
        self._deadline = deadline
        self.screen = Screen()

    def log_in(self, user: str, password: Secret) -> None:
        """Name and password; the rest is the terminal's."""
        self._reach_login()
        self._type(f"{user}{FLAGS}".encode() + ENTER)
        self._wait(_LOGIN_PASSWORD)
        self._type(password.reveal().encode() + ENTER)
        while True:
            tail = self._tail()
            if _FAILED.search("\n".join(self.screen.text())) or _LOGIN.search(tail):
                raise LoginFailed(
                    f"{self._name}: the device did not accept the user name and password",
                    hint="the factory's password is on the sticker of newer devices, and empty on older ones",
                )
            if _LOGGED_IN.search(tail) or _QUESTION.search("\n".join(self.screen.text())):
                return
            self._read()

    def _reach_login(self) -> None:
        """End what was left there: a half line by Ctrl+C, a session by `/quit`, one in safe mode by Ctrl+D."""
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
        """Read until nothing more comes for a moment: the answer to one key may come in pieces."""
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
            raise ConsoleUnreachable(
                f"{self._name}: nothing that looks like a RouterOS console answers on this line",
                hint="is the cable in the console port, the device switched on, and the speed right (115200)?",
            )
        data = self._wire.read(timeout_s)
        self.screen.feed(data)
        if self.screen.size > MOST:
            raise ConsoleUnreachable(f"{self._name}: what is on this line sends without an end: no RouterOS console")
        return data

    def _tail(self) -> str:
        return next((line for line in reversed(self.screen.text()) if line.strip()), "")
