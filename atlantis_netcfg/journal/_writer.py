"""Writing a journal: one record, one write, one fsync."""

from __future__ import annotations

import hashlib
import os
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Protocol, Self

from atlantis_netcfg.journal._errors import JournalFailed
from atlantis_netcfg.journal._files import component, make_private, translated, unwritable, write_all, write_atomically
from atlantis_netcfg.journal._log import Entry, line
from atlantis_netcfg.journal.records import Record, StateConfirmed, StateSaved

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

__all__ = ["FILE", "Journal", "NoJournal", "Recorder", "utc_now"]

FILE = "journal.jsonl"


def utc_now() -> datetime:
    """The laptop's clock."""
    return datetime.now(UTC)


class Recorder(Protocol):
    """What the engine needs of a journal."""

    def write(self, record: Record) -> None:
        """Put a record on disk. Raises JournalFailed: then nothing more may be changed."""

    def save(self, device: str, text: str) -> None:
        """Put a device's state before the first change on disk, and record it. Raises JournalFailed."""

    def confirm(self, device: str, text: Callable[[], str]) -> None:
        """Put the state that was read back at the end on disk, and record it. Raises JournalFailed."""


class NoJournal:
    """For runs that change nothing."""

    def write(self, record: Record) -> None:
        """Forget it."""

    def save(self, device: str, text: str) -> None:
        """Forget it."""

    def confirm(self, device: str, text: Callable[[], str]) -> None:
        """Do not even ask for it."""


def _put(what: str, path: Path, data: bytes) -> None:
    with translated(what, path):
        make_private(path.parent)
        write_atomically(path, data)


class Journal:
    """The journal of one run, open for appending. After a failed write it refuses every other one."""

    def __init__(self, directory: Path, now: Callable[[], datetime] = utc_now) -> None:
        """`directory` is the run's own; the file in it is made if it is missing, else appended to."""
        self.directory = directory
        self.failure: JournalFailed | None = None
        self._now = now
        self._path = directory / FILE
        with translated("the journal", self._path):
            self._descriptor = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o600)
            self._close_torn_line()

    @property
    def run(self) -> str:
        """The run's name, sortable by time."""
        return self.directory.name

    def write(self, record: Record) -> None:
        """Put a record on disk. Raises JournalFailed, and from then on always."""
        if self.failure is not None:
            raise self.failure
        size = os.fstat(self._descriptor).st_size
        try:
            write_all(self._descriptor, line(Entry(self._now(), record)))
            os.fsync(self._descriptor)
        except OSError as error:
            self._fail(error, size)

    def save(self, device: str, text: str) -> None:
        """Put a device's state before the first change on disk, and record it; an earlier one is kept beside it."""
        data = text.encode()
        path = self._free(component(device), data)
        try:
            _put("the state before the run", path, data)
        except JournalFailed as failure:
            self.failure = failure
            raise
        file = str(path.relative_to(self.directory))
        self.write(StateSaved(device=device, file=file, sha256=hashlib.sha256(data).hexdigest()))

    def confirm(self, device: str, text: Callable[[], str]) -> None:
        """Put what was read back on disk, and record it. Runs that read the same share one file, called by its hash.

        If that fails the journal goes on: nothing will be changed any more, and the outcome can still be recorded.
        """
        data = text().encode()
        digest = hashlib.sha256(data).hexdigest()
        site = self.directory.parent.parent
        path = site / "confirmed" / f"{component(device)}-{digest[:16]}.rsc"
        if not path.exists() or path.read_bytes() != data:
            _put("the confirmed state", path, data)
        self.write(StateConfirmed(device=device, file=str(path.relative_to(site)), sha256=digest))

    def close(self) -> None:
        """Close the file; nothing is pending."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _free(self, device: str, data: bytes) -> Path:
        folder = self.directory / "before"
        path = folder / f"{device}.rsc"
        number = 1
        while path.exists() and path.read_bytes() != data:
            number += 1
            path = folder / f"{device}.{number}.rsc"
        return path

    def _close_torn_line(self) -> None:
        """End a line that a killed run left open, so that the next record stands on its own."""
        size = os.fstat(self._descriptor).st_size
        if size and os.pread(self._descriptor, 1, size - 1) != b"\n":
            write_all(self._descriptor, b"\n")

    def _fail(self, error: OSError, size: int) -> None:
        self.failure = unwritable("the journal", self._path, error)
        # Half a record is worse than none; if even this fails, reading tolerates the torn line.
        try:
            os.ftruncate(self._descriptor, size)
        except OSError as second:
            self.failure.add_note(f"nor could the half record be removed: {second}")
        raise self.failure from error
