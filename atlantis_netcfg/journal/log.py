"""Write and read the journal of a run: one record a line, on disk before the next step."""

from __future__ import annotations

import hashlib
import json
from dataclasses import Field, dataclass, replace
from datetime import UTC, datetime
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, TypeVar

from pydantic import TypeAdapter, ValidationError

from atlantis_netcfg.core.eventlog import EventLog, split
from atlantis_netcfg.journal.files import (
    JournalFailed,
    component,
    make_private,
    os_errors_as,
    unwritable,
    vanished,
    write_atomically,
)
from atlantis_netcfg.journal.records import Record, StateConfirmed, StateSaved

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from atlantis_netcfg.core.errors import ExitCode


_RECORDS: TypeAdapter[Record] = TypeAdapter(Record)


@dataclass(frozen=True, slots=True)
class LogEntry:
    """One record and when it was written."""

    at: datetime
    record: Record


@dataclass(frozen=True, slots=True)
class Log:
    """A journal as it was found; `damage` says which lines could not be read."""

    entries: tuple[LogEntry, ...]
    damage: tuple[str, ...] = ()

    @property
    def records(self) -> tuple[Record, ...]:
        """The records alone."""
        return tuple(entry.record for entry in self.entries)


def line(entry: LogEntry) -> bytes:
    """The record as one line of the file."""
    data = {"at": entry.at.isoformat(timespec="milliseconds"), **_RECORDS.dump_python(entry.record, mode="json")}
    return json.dumps(data, ensure_ascii=False, separators=(",", ":")).encode(errors="replace") + b"\n"


def read(path: Path) -> Log:
    """Every record that can be read. A last line without its end was being written when the process was killed."""
    lines, torn = split(path.read_bytes())
    entries: list[LogEntry] = []
    damage: list[str] = []
    for number, text in enumerate(lines, start=1):
        entry = _entry(text)
        if entry is None:
            damage.append(f"line {number} cannot be read")
        else:
            entries.append(entry)
    if torn:
        damage.append(f"line {len(lines) + 1} is torn: the run was killed while it wrote it")
    return Log(tuple(entries), tuple(damage))


def _entry(text: bytes) -> LogEntry | None:
    try:
        data: dict[str, Any] = json.loads(text)
        at = datetime.fromisoformat(data.pop("at"))
        return LogEntry(at, _RECORDS.validate_python(data))
    except (ValueError, ValidationError, KeyError, TypeError, AttributeError):
        return None


FILE = "journal.jsonl"
NOT_RECORDED = "not recorded"
"""What a result says that is not in the journal."""


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


class StatesOnly:
    """The journal of a run, for a backup that is a part of it: how the backup ended is not how the run ends."""

    def __init__(self, journal: Recorder) -> None:
        self._journal = journal

    def write(self, record: Record) -> None:
        """Forget it."""

    def save(self, device: str, text: str) -> None:
        """As the journal does."""
        self._journal.save(device, text)

    def confirm(self, device: str, text: Callable[[], str]) -> None:
        """Do not even ask for it."""


def conclude(journal: Recorder, *records: Record) -> JournalFailed | None:
    """Put the last records of a run on disk. Returns why that was not possible, for the result, which must not be lost.

    A result that is not recorded is never a green one.
    """
    try:
        for record in records:
            journal.write(record)
    except JournalFailed as failure:
        return failure
    return None


class _ReadResult(Protocol):
    """What every result of a device has."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    @property
    def exit(self) -> ExitCode: ...
    @property
    def message(self) -> str: ...
    @property
    def notes(self) -> tuple[str, ...]: ...


_R = TypeVar("_R", bound=_ReadResult)


def unrecorded(result: _R, failure: JournalFailed | None) -> _R:
    """Say in a result that it is not in the journal, and why; it is not green then. None: it is there."""
    if failure is None:
        return result
    known = f"{result.message} {' '.join(result.notes)}"
    changes: dict[str, Any] = {"exit": result.exit.unproved}
    if NOT_RECORDED not in result.message:
        changes["message"] = f"{result.message}; {NOT_RECORDED}"
    if str(failure) not in known:
        changes["notes"] = (*result.notes, str(failure))
    if "hint" in result.__dataclass_fields__:
        changes["hint"] = getattr(result, "hint", None) or failure.hint
    return replace(result, **changes)


def _put(what: str, path: Path, data: bytes) -> None:
    with os_errors_as(what, path):
        make_private(path.parent)
        write_atomically(path, data)


class Journal(EventLog):
    """The journal of one run, open for appending. After a failed write it refuses every other one."""

    def __init__(self, directory: Path, now: Callable[[], datetime] = utc_now) -> None:
        """`directory` is the run's own; the file in it is made if it is missing, else appended to."""
        self.directory = directory
        self._now = now
        super().__init__(path := directory / FILE, partial(unwritable, "the journal", path))
        self.end_torn_line()

    @property
    def run(self) -> str:
        """The run's name, sortable by time."""
        return self.directory.name

    def write(self, record: Record) -> None:
        """Put a record on disk. Raises JournalFailed, and from then on always."""
        self.append(line(LogEntry(self._now(), record)))
        self._require_present("the journal")

    def save(self, device: str, text: str) -> None:
        """Put a device's state before the first change on disk, and record it; an earlier one is kept beside it."""
        self._require_present("the state before the run")
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
        self._require_present("the confirmed state")
        data = text().encode()
        digest = hashlib.sha256(data).hexdigest()
        site = self.directory.parent.parent
        path = site / "confirmed" / f"{component(device)}-{digest[:16]}.rsc"
        if not path.exists() or path.read_bytes() != data:
            _put("the confirmed state", path, data)
        self.write(StateConfirmed(device=device, file=str(path.relative_to(site)), sha256=digest))

    def _require_present(self, what: str) -> None:
        """See that the open file is still the one that its name leads to. Raises JournalFailed, and then always."""
        if not self.present:
            self.failure = self.failure or vanished("the journal", self.path)
            raise vanished(what, self.path)

    def _free(self, device: str, data: bytes) -> Path:
        folder = self.directory / "before"
        path = folder / f"{device}.rsc"
        number = 1
        while path.exists() and path.read_bytes() != data:
            number += 1
            path = folder / f"{device}.{number}.rsc"
        return path
