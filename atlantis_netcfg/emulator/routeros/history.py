"""The undo history and safe mode (Manual, Configuration Management: Safe Mode, Undo/Redo)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from atlantis_netcfg.emulator.routeros.answers import Caller
    from atlantis_netcfg.emulator.routeros.store import Change, Store


@dataclass(slots=True)
class Entry:
    """One action, one row changed; `undo` and `redo` are its console commands."""

    number: int
    action: str
    by: str
    policy: str
    time: str
    undo: str
    redo: str
    changes: tuple[Change, ...]
    floating: bool = False
    """Safe mode would undo it."""
    undone: bool = False


@dataclass(slots=True)
class History:
    """The latest actions, oldest first, and who holds safe mode."""

    limit: int
    entries: list[Entry] = field(default_factory=list)
    holder: Caller | None = None
    """The session that holds safe mode; it stays the holder after it has closed, until its changes are undone."""
    _count: int = 0

    def record(self, store: Store, action: str, *, by: str, time: str, commands: tuple[str, str]) -> None:
        """Close an action: take the changes that the store has collected; `commands` undo and redo it.

        In safe mode the action that no longer fits ends it without a word, and nothing will be undone.
        """
        changes, store.changes = tuple(store.changes), []
        if not changes:
            return
        self._count += 1
        self.entries = [entry for entry in self.entries if not entry.undone]
        policy = "write,policy" if changes[0].menu.startswith("/user") else "write"
        self.entries.append(
            Entry(self._count, action, by, policy, time, *commands, changes, floating=self.holder is not None)
        )
        if sum(entry.floating for entry in self.entries) > self.limit:
            self.release()
        del self.entries[: -self.limit]

    def join(self, first: int) -> None:
        """Let all entries from this place on be one, whose commands are those of the first."""
        later = self.entries[first:]
        if later:
            changes = tuple(change for entry in later for change in entry.changes)
            self.entries[first:] = [replace(later[0], changes=changes)]

    def settle(self, first: int) -> None:
        """Let safe mode forget the entries from this place on."""
        for entry in self.entries[first:]:
            entry.floating = False

    def take(self, caller: Caller) -> None:
        """Enter safe mode."""
        self.holder = caller

    def release(self) -> None:
        """Leave safe mode and keep everything."""
        self.holder = None
        for entry in self.entries:
            entry.floating = False

    def unroll(self, store: Store) -> None:
        """Undo everything since safe mode was taken, whoever did it, newest first, and leave safe mode."""
        for entry in reversed([entry for entry in self.entries if entry.floating and not entry.undone]):
            _put_back(store, entry)
        self.entries = [entry for entry in self.entries if not entry.floating]
        self.holder = None

    def undo(self, store: Store) -> bool:
        """Undo the newest action that is not undone."""
        for entry in reversed(self.entries):
            if not entry.undone:
                _put_back(store, entry)
                entry.undone = True
                return True
        return False

    def redo(self, store: Store) -> bool:
        """Do the oldest undone action again."""
        for entry in self.entries:
            if entry.undone:
                for change in entry.changes:
                    store.put_back(change, forward=True)
                entry.undone = False
                return True
        return False

    def clear(self) -> None:
        """Forget everything, as a reboot does."""
        self.entries.clear()
        self.holder = None


def _put_back(store: Store, entry: Entry) -> None:
    for change in reversed(entry.changes):
        store.put_back(change)
