"""Write and read the journal of a run: one record a line, on disk before the next step."""

from __future__ import annotations

import hashlib
import json
import os
import re
from dataclasses import Field, dataclass, fields, replace
from datetime import UTC, datetime
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, TypeVar

from pydantic import TypeAdapter, ValidationError

from atlantis_netcfg.core.atomic_files import write_atomically
from atlantis_netcfg.core.eventlog import EventLog, split
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.core.stored_messages import marked_texts, unpack
from atlantis_netcfg.runs import files
from atlantis_netcfg.runs.records import Record, StateBackup, StateConfirmation

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
    """A journal as read from disk. A record of a damaged line is not among the entries."""

    entries: tuple[LogEntry, ...]
    damage: tuple[str, ...] = ()
    """Each damaged line, with its device if still readable."""
    has_torn_end: bool = False
    """The last line is incomplete: the run was killed while writing, or the file has lost its end."""
    checksum: bytes = b""
    """Checksum of the last line: the next one continues from it."""

    @property
    def records(self) -> tuple[Record, ...]:
        """The records without their times."""
        return tuple(entry.record for entry in self.entries)


def line(entry: LogEntry, previous: bytes = b"") -> bytes:
    """Return the record as one line of the file; its checksum continues that of the `previous` line."""
    data = {"at": entry.at.isoformat(timespec="milliseconds"), **_RECORDS.dump_python(entry.record, mode="json")}
    data |= marked_texts(entry.record)
    text = json.dumps(data, ensure_ascii=False, separators=(",", ":")).encode(errors="replace").removesuffix(b"}")
    return b'%s,"sum":"%s"}\n' % (text, _checksum(previous, text))


_BEGIN = b'{"at":"'
_SUM = re.compile(rb',"sum":"([0-9a-f]{16})"}\n?\Z')
_SUM_LENGTH = len(',"sum":"0123456789abcdef"}')
_DEVICE = re.compile(rb'"device":"([^"\\]+)"')


def _checksum(previous: bytes, text: bytes) -> bytes:
    return hashlib.sha256(previous + text).hexdigest()[:16].encode()


def _stored_checksum(text: bytes) -> bytes:
    match = _SUM.search(text)
    return match[1] if match else b""


def read(path: Path) -> Log:
    """Read a journal."""
    return parse(path.read_bytes())


def parse(data: bytes) -> Log:
    """Return every record with an intact line.

    Lines of earlier versions have no checksum; after the first line with a checksum, every line has one.
    """
    lines, torn_line = split(data)
    entries: list[LogEntry] = []
    damage: list[str] = []
    previous, has_checksums = {b""}, False
    for number, text in enumerate(lines, start=1):
        own_checksum = _stored_checksum(text)
        has_checksums = has_checksums or bool(own_checksum)
        candidates = {_checksum(each, text[:-_SUM_LENGTH] if has_checksums else text) for each in previous}
        is_intact = own_checksum in candidates or not has_checksums
        entry = _entry(text) if is_intact else None
        if entry is None:
            device = _DEVICE.search(text)
            host = msg(f" ({arg(device[1].decode(errors='replace'))})" if device else "")
            damage.append(msg(f"line {arg(number)}{arg(host)} is damaged"))
        else:
            entries.append(entry)
        # Of a damaged line either the text or the checksum may be what was written.
        previous = candidates if is_intact else {*candidates, own_checksum}
    return Log(tuple(entries), tuple(damage), bool(torn_line), next(iter(previous)))


def _fields(record: Record) -> dict[str, Any]:
    return {item.name: getattr(record, item.name) for item in fields(record)}


def _entry(text: bytes) -> LogEntry | None:
    try:
        data: dict[str, Any] = json.loads(text)
        data.pop("sum", None)
        at = datetime.fromisoformat(data.pop("at"))
        texts = data.pop("texts", ())
        record = _RECORDS.validate_python(data)
        return LogEntry(at, replace(record, **unpack({**_fields(record), "texts": texts})) if texts else record)
    except (ValueError, ValidationError, KeyError, TypeError, AttributeError):
        return None


FILE = "journal.jsonl"
NOT_RECORDED = "not recorded"
"""Text in the message of a result that is not in the journal."""


def utc_now() -> datetime:
    """Return the time of the laptop's clock."""
    return datetime.now(UTC)


class Recorder(Protocol):
    """The journal interface that the engine needs."""

    def write(self, record: Record) -> None:
        """Write a record to disk. Raises JournalError: then nothing more may be changed."""

    def save(self, device: str, text: str) -> None:
        """Save a device's state before the first change to disk, and record it. Raises JournalError."""

    def confirm(self, device: str, text: Callable[[], str]) -> None:
        """Save the state read back at the end to disk, and record it. Raises JournalError."""


class NoJournal:
    """Implementation for runs that change nothing."""

    def write(self, record: Record) -> None:
        """Discard the record."""

    def save(self, device: str, text: str) -> None:
        """Discard the state."""

    def confirm(self, device: str, text: Callable[[], str]) -> None:
        """Discard the state without calling `text`."""


class StatesOnly:
    """A journal for a backup that is part of a run: records nothing but the saved state."""

    def __init__(self, journal: Recorder) -> None:
        self._journal = journal

    def write(self, record: Record) -> None:
        """Discard the record."""

    def save(self, device: str, text: str) -> None:
        """Save the state in the run's journal."""
        self._journal.save(device, text)

    def confirm(self, device: str, text: Callable[[], str]) -> None:
        """Discard the state without calling `text`."""


def conclude(journal: Recorder, *records: Record) -> files.JournalError | None:
    """Write the last records of a run to disk; return the error instead of raising, so the result is not lost.

    A result that is not recorded is never a success.
    """
    try:
        for record in records:
            journal.write(record)
    except files.JournalError as failure:
        return failure
    return None


class _ReadResult(Protocol):
    """Attributes common to all device results."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    @property
    def exit(self) -> ExitCode: ...
    @property
    def message(self) -> str: ...
    @property
    def notes(self) -> tuple[str, ...]: ...


_R = TypeVar("_R", bound=_ReadResult)


def mark_unrecorded(result: _R, failure: files.JournalError | None) -> _R:
    """Add to a result that it could not be recorded, which is then not a success; None: it was recorded."""
    if failure is None:
        return result
    existing_text = f"{result.message} {' '.join(result.notes)}"
    changes: dict[str, Any] = {"exit": result.exit.unproven_code}
    if NOT_RECORDED not in result.message:
        changes["message"] = msg(f"{arg(result.message)}; {arg(NOT_RECORDED)}")
    if str(failure) not in existing_text:
        changes["notes"] = (*result.notes, str(failure))
    if "hint" in result.__dataclass_fields__:
        changes["hint"] = getattr(result, "hint", None) or failure.hint
    return replace(result, **changes)


def _put(what: str, path: Path, data: bytes) -> None:
    with files.os_errors_as(what, path):
        files.make_private(path.parent)
        write_atomically(path, data)


class Journal(EventLog):
    """The journal of one run, open for appending. After a failed write it refuses every other one."""

    def __init__(self, directory: Path, now: Callable[[], datetime] = utc_now) -> None:
        """`directory` is the run's own; its journal file is created or appended to."""
        self.directory = directory
        self._now = now
        super().__init__(path := directory / FILE, partial(files.unwritable, "the journal", path))
        self._checksum = self._last_checksum()

    @property
    def run(self) -> str:
        """The run's name, sortable by time."""
        return self.directory.name

    def write(self, record: Record) -> None:
        """Write a record to disk. Raises JournalError, and then on every later call."""
        data = line(LogEntry(self._now(), record), self._checksum)
        self.append(data)
        self._checksum = _stored_checksum(data)
        self._require_present("the journal")

    def save(self, device: str, text: str) -> None:
        """Save a device's state before the first change, and record it; an earlier one is kept beside it."""
        self._require_present("the state before the run")
        data = text.encode()
        first = self.directory / "before" / f"{files.component(device)}.rsc"
        if first.exists() and not any(
            isinstance(record, StateBackup) and record.device == device for record in parse(self._content()).records
        ):
            self._record_state(device, first, first.read_bytes())  # its record was lost, or its run was killed
        path = self._free_path(device, data)
        try:
            _put("the state before the run", path, data)
        except files.JournalError as failure:
            self.failure = failure
            raise
        self._record_state(device, path, data)

    def _record_state(self, device: str, path: Path, data: bytes) -> None:
        file = str(path.relative_to(self.directory))
        self.write(StateBackup(device=device, file=file, sha256=hashlib.sha256(data).hexdigest()))

    def confirm(self, device: str, text: Callable[[], str]) -> None:
        """Save the state read back, and record it. Equal states share one file, named by hash.

        If that fails the journal remains usable: nothing will be changed any more, and the outcome can still be
        recorded.
        """
        self._require_present("the confirmed state")
        data = text().encode()
        digest = hashlib.sha256(data).hexdigest()
        site = self.directory.parent.parent
        path = site / "confirmed" / f"{files.component(device)}-{digest[:16]}.rsc"
        if not path.exists() or path.read_bytes() != data:
            _put("the confirmed state", path, data)
        self.write(StateConfirmation(device=device, file=str(path.relative_to(site)), sha256=digest))

    def _last_checksum(self) -> bytes:
        """Return the checksum that the next line continues; an incomplete line of a killed process is removed."""
        data = self._content()
        torn_line = split(data)[1]
        if torn_line and torn_line[: len(_BEGIN)] == _BEGIN[: len(torn_line)] and b"\0" not in torn_line:
            self.cut(len(data) - len(torn_line))
        else:  # what is not our writing stays, and is reported as damage
            self.end_torn_line()
        return parse(self._content()).checksum

    def _content(self) -> bytes:
        return os.pread(self._descriptor, os.fstat(self._descriptor).st_size, 0)

    def _require_present(self, what: str) -> None:
        """Check that the open file is still the one at its path. Raises JournalError, and then always."""
        if not self.present:
            self.failure = self.failure or files.missing_file_error("the journal", self.path)
            raise files.missing_file_error(what, self.path)

    def _free_path(self, device: str, data: bytes) -> Path:
        folder = self.directory / "before"
        path = folder / f"{device}.rsc"
        number = 1
        while path.exists() and path.read_bytes() != data:
            number += 1
            path = folder / f"{device}.{number}.rsc"
        return path
