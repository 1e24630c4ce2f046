"""The log of one checklist: a line a record, each holding the hash of the line before, on disk before anything follows.

A kill leaves at most a last line without its end; nobody was told of that record, so it is cut off. A last line that
has its end and cannot be read is what a power cut leaves: it is cut off too, and told. Anything else is damage.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from atlantis_netcfg.checklist._canonical import content, parsed
from atlantis_netcfg.checklist.report import Document, Item
from atlantis_netcfg.core.eventlog import EventLog, split
from atlantis_netcfg.journal import unwritable, utc_now

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

FILE = "records.jsonl"


class _Record(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Begun(_Record):
    """The list as it was worked out; once more when it is gone on with and is another one."""

    record: Literal["begun"] = "begun"
    document: Document


class GoneOn(_Record):
    """Somebody opened the book again."""

    record: Literal["gone on"] = "gone on"


class Result(_Record):
    """An item as it is from now on; what it was before stands above."""

    record: Literal["settled", "confirmed", "overridden"]
    item: Item


class Superseded(_Record):
    """A new book was begun in its place."""

    record: Literal["superseded"] = "superseded"
    why: str


Record = Annotated[Begun | GoneOn | Result | Superseded, Field(discriminator="record")]
_RECORDS: TypeAdapter[Begun | GoneOn | Result | Superseded] = TypeAdapter(Record)


@dataclass(frozen=True, slots=True)
class Recorded:
    """One record and when it was written."""

    at: datetime
    record: Begun | GoneOn | Result | Superseded


@dataclass(frozen=True, slots=True)
class Lines:
    """A log as it was found."""

    records: tuple[Recorded, ...] = ()
    good: int = 0
    """Bytes up to the end of the last record that can be read."""
    last: str = ""
    """SHA-256 of that record's line."""
    torn: str = ""
    """Why the end was cut off; empty: it was not."""
    damage: str = ""
    """Why what stands there is not what was written."""


def read(path: Path) -> Lines:
    """Every record up to the first line that is not as it was written."""
    try:
        lines, rest = split(content(path))
    except OSError as error:
        return Lines(damage=f"cannot be read: {error.strerror}")
    records: list[Recorded] = []
    good, last = 0, ""
    for number, line in enumerate(lines, start=1):
        record = _record(line, last)
        if isinstance(record, str):
            tail = number == len(lines) and not rest and number > 1 and not record.startswith("does not follow")
            text = f"line {number} {record}"
            return Lines(tuple(records), good, last, torn=text if tail else "", damage="" if tail else text)
        records.append(record)
        good, last = good + len(line) + 1, hashlib.sha256(line).hexdigest()
    torn = f"line {len(lines) + 1} is torn: the program was killed while it wrote it" if rest else ""
    return Lines(tuple(records), good, last, torn=torn)


def _record(line: bytes, before: str) -> Recorded | str:
    """A line's record, or what is wrong with the line."""
    try:
        data = parsed(line)
        at, follows = datetime.fromisoformat(data.pop("at")), data.pop("before")
        record = _RECORDS.validate_python(data)
    except (ValueError, ValidationError, KeyError, TypeError, AttributeError):
        return "cannot be read"
    return Recorded(at, record) if follows == before else "does not follow the line above"


def replayed(lines: Lines) -> Document | None:
    """The checklist as the records leave it, unsigned; None where there is not even a list."""
    begun = [recorded.record.document for recorded in lines.records if isinstance(recorded.record, Begun)]
    if not begun:
        return None
    results = {
        record.record.item.id: record.record.item for record in lines.records if isinstance(record.record, Result)
    }
    return begun[-1].model_copy(update={"items": tuple(results.get(item.id, item) for item in begun[-1].items)})


class Ledger(EventLog):
    """The log, open for appending. After a failed write it refuses every other one."""

    def __init__(self, path: Path, now: Callable[[], datetime] = utc_now) -> None:
        """Open it, or make it; a torn end is cut off. Damage is for the caller to look for before."""
        lines = read(path) if path.exists() else Lines()
        self._now = now
        self._last = lines.last
        super().__init__(path, partial(unwritable, "the checklist", path))
        self.cut(lines.good)

    def write(self, record: Begun | GoneOn | Result | Superseded) -> None:
        """Put a record on disk. Raises JournalFailed, and from then on always."""
        line = self._line(record)
        self.append(line + b"\n")
        self._last = hashlib.sha256(line).hexdigest()

    def _line(self, record: Begun | GoneOn | Result | Superseded) -> bytes:
        head = {"at": self._now().isoformat(timespec="milliseconds"), "before": self._last}
        data = head | _RECORDS.dump_python(record, mode="json")
        return json.dumps(data, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode(errors="replace")
