"""What the callers see of a console."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Sequence

    from atlantis_netcfg.core.secret import Secret

__all__ = ["COMMAND_S", "CONNECT_S", "Console", "Tally"]

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
