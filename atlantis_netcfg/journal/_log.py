"""Reading a journal back: typed records, and what a kill or a power cut has torn."""

from __future__ import annotations

import json
from dataclasses import dataclass
from datetime import datetime
from typing import TYPE_CHECKING, Any

from pydantic import TypeAdapter, ValidationError

from atlantis_netcfg.core.eventlog import split
from atlantis_netcfg.journal.records import Record

if TYPE_CHECKING:
    from pathlib import Path

__all__ = ["Entry", "Log", "line", "read"]

_RECORDS: TypeAdapter[Record] = TypeAdapter(Record)


@dataclass(frozen=True, slots=True)
class Entry:
    """One record and when it was written."""

    at: datetime
    record: Record


@dataclass(frozen=True, slots=True)
class Log:
    """A journal as it was found; `damage` says which lines could not be read."""

    entries: tuple[Entry, ...]
    damage: tuple[str, ...] = ()

    @property
    def records(self) -> tuple[Record, ...]:
        """The records alone."""
        return tuple(entry.record for entry in self.entries)


def line(entry: Entry) -> bytes:
    """The record as one line of the file."""
    data = {"at": entry.at.isoformat(timespec="milliseconds"), **_RECORDS.dump_python(entry.record, mode="json")}
    return json.dumps(data, ensure_ascii=False, separators=(",", ":")).encode(errors="replace") + b"\n"


def read(path: Path) -> Log:
    """Every record that can be read. A last line without its end was being written when the process was killed."""
    lines, torn = split(path.read_bytes())
    entries: list[Entry] = []
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


def _entry(text: bytes) -> Entry | None:
    try:
        data: dict[str, Any] = json.loads(text)
        at = datetime.fromisoformat(data.pop("at"))
        return Entry(at, _RECORDS.validate_python(data))
    except (ValueError, ValidationError, KeyError, TypeError, AttributeError):
        return None
