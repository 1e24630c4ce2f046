"""The console's interface, its errors, and the connection below it."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Protocol

from atlantis_netcfg.core.errors import DeviceError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from atlantis_netcfg.core.secret import Secret


COMMAND_S = 180.0
"""How long a command may take; Certus has gaps of 70 s in practice (FFI report 20/01338)."""
CONNECT_S = 180.0
"""How long connecting and logging in may take."""


class Tally(Protocol):
    """Who counts what the wire carries; `routeros.api.Traffic` is one."""

    def connect(self) -> None:
        """Count a connection that has just been made."""

    def send(self, size: int) -> None:
        """Count bytes that go out."""

    def receive(self, size: int) -> None:
        """Count bytes that have come in."""


class Console(Protocol):
    """A text console on which somebody is logged in. Synchronous: callers in asyncio use `asyncio.to_thread`."""

    @property
    def host_key(self) -> str | None:
        """`SHA256:...` of the SSH host key that the session was opened with; None on a serial line."""

    @property
    def user(self) -> str:
        """Who is logged in, without login flags."""

    @property
    def safe(self) -> bool:
        """Whether this session holds safe mode, as the last prompt said."""

    def run(self, command: str, *, timeout_s: float = COMMAND_S, secrets: Sequence[Secret] = ()) -> str:
        """Run one line and return what it printed, lines parted by a newline, without echo and prompt.

        `secrets` are masked in whatever is raised. Raises ConsoleRefused with the device's words, ConsoleLost.
        """

    def ask(self, command: str, question: str, answer: str, *, timeout_s: float = COMMAND_S) -> None:
        """Type a command that asks back (`/system/reboot`), and answer once `question` stands on the line.

        Returns when the answer is on its way: what follows may be the end of the session. Raises ConsoleLost.
        """

    def rows(self, menu: str, *, where: str = "", timeout_s: float = COMMAND_S) -> list[dict[str, str]]:
        """Rows of a menu with all their properties (`:put [menu print detail as-value where ...]`)."""

    def take_safe_mode(self) -> None:
        """Ctrl+X; returns when the prompt says so. Raises SafeModeHeld; the question of hijacking is answered `d`."""

    def release_safe_mode(self) -> None:
        """Ctrl+X again: what was changed is kept."""

    def close(self) -> None:
        """End the session.

        Without safe mode by `/quit`. With safe mode held the connection is dropped instead (on a serial line: Ctrl+D),
        because `/quit` would keep what safe mode has to undo (Manual, Configuration Management).
        """


class ConsoleUnreachable(DeviceError):
    """No console came about (no route, no serial line, no answer); nothing was typed."""


class UnknownHostKey(DeviceError):
    """The device was never met over SSH; it showed `fingerprint`, and no password was sent."""

    def __init__(self, message: str, *, fingerprint: str, hint: str | None = None) -> None:
        super().__init__(message, hint=hint)
        self.fingerprint = fingerprint


class HostKeyMismatch(DeviceError):
    """The SSH host key is not the pinned one; no password was sent."""

    def __init__(self, message: str, *, pinned_key: str, actual_key: str, hint: str | None = None) -> None:
        super().__init__(message, hint=hint)
        self.pinned_key = pinned_key
        self.actual_key = actual_key


class ConsoleLoginError(DeviceError):
    """The device did not take name and password."""


class ConsoleCommandError(DeviceError):
    """The device refused one command; `words` are its own, the session lives on."""

    def __init__(self, message: str, *, words: str, hint: str | None = None) -> None:
        super().__init__(message, hint=hint)
        self.words = words


class ConsoleLost(DeviceError):
    """The session is over, or silent for too long. `in_flight`: a command was typed and may have been done."""

    def __init__(self, message: str, *, in_flight: bool, hint: str | None = None) -> None:
        super().__init__(message, hint=hint)
        self.in_flight = in_flight


class SafeModeHeld(DeviceError):
    """Another session holds safe mode; it was left alone."""


_FIELD = re.compile(r"(?:\A|;)(\.?[a-z0-9][a-z0-9.-]*)=")


def parse_rows(text: str) -> list[dict[str, str]]:
    """Rows by property name.

    A list's own `;` parts belong to the value before it: a part without `name=` is no field. A value that itself holds
    `;name=` cannot be told from a field; ask for such properties one by one (`get`).
    """
    rows: list[dict[str, str]] = []
    starts = list(_FIELD.finditer(text))
    for place, match in enumerate(starts):
        end = starts[place + 1].start() if place + 1 < len(starts) else len(text)
        name, value = match[1], text[match.end() : end]
        if name == ".id" or not rows:
            rows.append({})
        rows[-1][name] = value.rstrip(";")
    return rows


class WireLost(Exception):
    """The other end is gone."""


class ConsoleWire(Protocol):
    """Characters both ways."""

    def read(self, timeout_s: float) -> bytes:
        """Whatever came, at least one byte; empty when nothing came in time. Raises WireLost."""

    def write(self, data: bytes) -> None:
        """Send all of it. Raises WireLost."""

    def close(self) -> None:
        """Hang up; never raises."""
