"""What this computer remembers of a PIN that a SIM has not taken: no run enters it a second time.

The device cannot tell: a PIN that was taken back leaves no trace on it but the SIM's own count, which RouterOS does not
show. So a file stands in the state directory from before the PIN is sent until it is known to have been right. It holds
no PIN, nor anything from which one could be found; a person who has corrected the declaration deletes it.

    <state>/<real|rehearsal>/<site>/sim/<device>.tried
"""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING

from atlantis_netcfg.journal import ActionsConfirmed, JournalFailed, LayerSent, Planned, write_atomically

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from atlantis_netcfg.journal import Record, Recorder

_MENU, _FIELD = "/interface/lte", "pin"


class TriedPin:
    """The memory of one SIM. `root` is that of the `Store`."""

    def __init__(self, root: Path, site: str, device: str) -> None:
        self.path = root / site / "sim" / f"{device}.tried"

    @property
    def why_not(self) -> str:
        """Why the PIN must not be sent; empty: nothing is known against it."""
        try:
            when = self.path.read_text(encoding="ascii").strip()
        except FileNotFoundError:
            return ""
        except (OSError, ValueError):
            when = "an earlier time"
        return (
            f"the PIN was sent at {when}, and it was not seen that the SIM took it; it is not tried again."
            f" Compare `sim.pin` with the SIM's letter, then delete {self.path}"
        )

    def remember(self) -> None:
        """Note on disk that a PIN is about to be sent. Raises JournalFailed: then it must not be sent."""
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            write_atomically(self.path, f"{datetime.now(UTC):%Y-%m-%d %H:%M:%S} UTC\n".encode())
        except OSError as error:
            raise JournalFailed(
                f"it cannot be noted that a PIN is tried: {error.strerror or error} ({self.path})",
                hint="make room on the disk or correct its permissions, then run the same command again",
            ) from error

    def forget(self) -> None:
        """The SIM has taken it."""
        self.path.unlink(missing_ok=True)


class PinRecorder:
    """A journal that notes, before a PIN is sent, that it is tried; and forgets that once it was read back as taken."""

    def __init__(self, inner: Recorder, tried: TriedPin) -> None:
        self._inner = inner
        self._tried = tried
        self._numbers: frozenset[int] = frozenset()
        self._sent = False

    def write(self, record: Record) -> None:
        """Put a record on disk. Raises JournalFailed."""
        if isinstance(record, Planned):
            self._numbers = frozenset(
                action.number for action in record.actions if action.menu == _MENU and _FIELD in dict(action.values)
            )
        elif isinstance(record, LayerSent) and self._numbers & set(record.actions):
            self._tried.remember()
            self._sent = True
        self._inner.write(record)
        if isinstance(record, ActionsConfirmed) and self._sent:
            self._tried.forget()

    def save(self, device: str, text: str) -> None:
        """As the journal does."""
        self._inner.save(device, text)

    def confirm(self, device: str, text: Callable[[], str]) -> None:
        """As the journal does."""
        self._inner.confirm(device, text)
