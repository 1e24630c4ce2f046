"""The console's interface, its errors, and the wire protocol below it."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Protocol

from atlantis_netcfg.core.errors import DeviceError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from atlantis_netcfg.core.secret import Secret


COMMAND_S = 180.0
"""Timeout of a command; Certus has gaps of 70 s in practice (FFI report 20/01338)."""
CONNECT_S = 180.0
"""Timeout for connecting and logging in."""


class Tally(Protocol):
    """Counter of bytes on the wire; implemented by `routeros.api.Traffic`."""

    def connect(self) -> None:
        """Count a new connection."""

    def send(self, size: int) -> None:
        """Count sent bytes."""

    def receive(self, size: int) -> None:
        """Count received bytes."""


class Console(Protocol):
    """A logged-in text console. Synchronous: asyncio callers use `asyncio.to_thread`."""

    @property
    def host_key(self) -> str | None:
        """`SHA256:...` of the SSH host key that the session was opened with; None on a serial line."""

    @property
    def user(self) -> str:
        """The logged-in user, without login flags."""

    @property
    def safe(self) -> bool:
        """True if this session held safe mode at the last prompt."""

    def run(self, command: str, *, timeout_s: float = COMMAND_S, secrets: Sequence[Secret] = ()) -> str:
        """Run one line and return its output, lines separated by newlines, without echo and prompt.

        `secrets` are masked in any exception. Raises ConsoleCommandError with the device's message, ConsoleLost.
        """

    def ask(self, command: str, question: str, answer: str, *, timeout_s: float = COMMAND_S) -> None:
        """Run a command that asks for confirmation (`/system/reboot`); send `answer` when `question` appears.

        Returns as soon as the answer is sent, since the session may end after it. Raises ConsoleLost.
        """

    def rows(self, menu: str, *, where: str = "", timeout_s: float = COMMAND_S) -> list[dict[str, str]]:
        """Return the rows of a menu with all properties (`:put [menu print detail as-value where ...]`)."""

    def take_safe_mode(self) -> None:
        """Send Ctrl+X and wait for the prompt; never takes over another's (replies `d`). Raises SafeModeHeld."""

    def release_safe_mode(self) -> None:
        """Send Ctrl+X again: the changes are kept."""

    def close(self) -> None:
        """End the session.

        Without safe mode by `/quit`. If safe mode is held, the connection is dropped instead (on a serial line:
        Ctrl+D), because `/quit` would keep the changes that safe mode must undo (Manual, Configuration Management).
        """


class ConsoleUnreachable(DeviceError):
    """No console could be opened (no route, no serial line, no response); nothing was typed."""


class UnknownHostKey(DeviceError):
    """No host key is pinned for the device; it presented `fingerprint`, and no password was sent."""

    def __init__(self, message: str, *, fingerprint: str, hint: str | None = None) -> None:
        super().__init__(message, hint=hint)
        self.fingerprint = fingerprint


class HostKeyMismatch(DeviceError):
    """The SSH host key differs from the pinned one; no password was sent."""

    def __init__(self, message: str, *, pinned_key: str, actual_key: str, hint: str | None = None) -> None:
        super().__init__(message, hint=hint)
        self.pinned_key = pinned_key
        self.actual_key = actual_key


class ConsoleLoginError(DeviceError):
    """The device refused name and password."""


class ConsoleCommandError(DeviceError):
    """The device refused one command; `words` is its message. The session continues."""

    def __init__(self, message: str, *, words: str, hint: str | None = None) -> None:
        super().__init__(message, hint=hint)
        self.words = words


class ConsoleLost(DeviceError):
    """The session is closed, or silent for too long. `in_flight`: a typed command may have been executed."""

    def __init__(self, message: str, *, in_flight: bool, hint: str | None = None) -> None:
        super().__init__(message, hint=hint)
        self.in_flight = in_flight


class SafeModeHeld(DeviceError):
    """Another session holds safe mode; it was left alone."""


_FIELD = re.compile(r"(?:\A|;)(\.?[a-z0-9][a-z0-9.-]*)=")


def parse_rows(text: str) -> list[dict[str, str]]:
    """Parse rows into dicts by property name.

    A `;` part without `name=` is not a field but belongs to the list value before it. A value that contains `;name=`
    cannot be distinguished from a field; read such properties one by one (`get`).
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
    """The connection to the other end is lost."""


class ConsoleWire(Protocol):
    """A character stream in both directions."""

    def read(self, timeout_s: float) -> bytes:
        """Return the received data, at least one byte; empty after the timeout. Raises WireLost."""

    def write(self, data: bytes) -> None:
        """Send all of it. Raises WireLost."""

    def close(self) -> None:
        """Close the connection; never raises."""
