"""The ledger's file: line format, reading the whole file, appending to it."""

from __future__ import annotations

import hashlib
import json
from binascii import crc32
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import partial
from typing import TYPE_CHECKING, Any, Self

from pydantic import TypeAdapter, ValidationError

from atlantis_netcfg.core.errors import ExitCode, NetcfgError
from atlantis_netcfg.core.eventlog import EventLog, split
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.vpn.ledger.records import Record, describe

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path


class CorruptLedgerError(NetcfgError):
    """A line was changed or damaged: nothing may be signed until the user has checked it."""

    exit = ExitCode.FAILED


class LedgerError(NetcfgError):
    """The ledger cannot be written: nothing unrecorded may be handed out."""

    exit = ExitCode.FAILED


GENESIS = "0" * 64
"""Value in the first line for the hash of the previous line."""
_RECORDS: TypeAdapter[Record] = TypeAdapter(Record)
_SEAL = len(',"crc":"00000000"}')


@dataclass(frozen=True, slots=True)
class LedgerEntry:
    """One event, with time and user."""

    number: int
    """Line number, from 1 without gaps."""
    at: datetime
    who: str
    operation: str
    """Operation id, the same for all entries of one command."""
    record: Record

    @property
    def words(self) -> str:
        """One-line description of the event."""
        return describe(self.record)

    def facts(self) -> dict[str, Any]:
        """Return the entry for `--json`: line, at, who, operation, kind, words, and the record's own fields."""
        return {**_head(self), "words": self.words, **_fields(self.record)}


class Misread(ValueError):
    """A damaged line; the text describes the damage."""


def encode(entry: LedgerEntry, previous: str) -> bytes:
    """Return the line, with its line end; `previous` is the `digest` of the line before."""
    data = {**_head(entry), "previous": previous, **_fields(entry.record)}
    text = json.dumps(data, ensure_ascii=True, separators=(",", ":")).encode()
    body = text[:-1]
    return body + b',"crc":"%08x"}\n' % crc32(body)


def digest(line: bytes) -> str:
    """Return the hash of a line, for the next one; the line end is not included."""
    return hashlib.sha256(line.removesuffix(b"\n")).hexdigest()


def parse(line: bytes, number: int, previous: str) -> LedgerEntry:
    """Parse a line without its end. Raises Misread."""
    body = line[:-_SEAL]
    if line != body + b',"crc":"%08x"}' % crc32(body):
        raise Misread("its checksum is wrong: it was changed, or the disk has lost part of it")
    data = _json(line)
    if data.pop("line") != number:
        raise Misread("lines before it are missing or out of order")
    if data.pop("previous") != previous:
        raise Misread("it does not continue the line before it")
    try:
        head = (datetime.fromisoformat(data.pop("at")), str(data.pop("who")), str(data.pop("operation")))
        return LedgerEntry(number, *head, _RECORDS.validate_python(data))
    except (ValueError, ValidationError, KeyError, TypeError):
        raise Misread("this version of the toolkit does not know its type") from None


def _json(line: bytes) -> dict[str, Any]:
    try:
        data = json.loads(line)
    except ValueError:
        data = None
    if not isinstance(data, dict) or not {"line", "previous"} <= data.keys():
        raise Misread("it is not a ledger record")
    return data


def _head(entry: LedgerEntry) -> dict[str, Any]:
    moment = entry.at.astimezone(UTC).isoformat(timespec="milliseconds")
    return {"line": entry.number, "at": moment, "who": entry.who, "operation": entry.operation}


def _fields(record: Record) -> dict[str, Any]:
    fields: dict[str, Any] = _RECORDS.dump_python(record, mode="json")
    return fields


FILE = "ledger.jsonl"
_WHO = 120


def utc_now() -> datetime:
    """Return the time of this computer, with the ledger's precision."""
    now = datetime.now(UTC)
    return now - timedelta(microseconds=now.microsecond % 1000)


@dataclass(frozen=True, slots=True)
class Reading:
    """A ledger as read from disk."""

    path: Path
    entries: tuple[LedgerEntry, ...]
    size: int
    """Bytes up to the end of the last valid line."""
    digests: tuple[str, ...]
    """Hash of each valid line."""
    is_torn: bool
    """An incomplete line follows: it was being written, or its writer was killed."""
    damage: str | None
    """Damage of the first altered line; nothing after it was read. None: no damage."""

    @property
    def last(self) -> str:
        """Hash of the last good line."""
        return self.digests[-1] if self.digests else GENESIS

    def sound(self) -> Self:
        """Return itself if nothing is damaged. Raises CorruptLedgerError."""
        if self.damage is not None:
            raise CorruptLedgerError(
                f"{arg(self.damage)} ({arg(self.path)})",
                hint="sign nothing; compare this ledger line by line with the one in the last backup",
            )
        return self


def read(path: Path) -> Reading:
    """Read every entry up to the first damage. Raises LedgerError if the file cannot be read."""
    try:
        lines, tail = split(path.read_bytes())
    except OSError as error:
        raise _build_error("read", path, error) from error
    entries: list[LedgerEntry] = []
    digests: list[str] = []
    size, damage = 0, None
    for number, line in enumerate(lines, start=1):
        try:
            entries.append(parse(line, number, digests[-1] if digests else GENESIS))
        except Misread as misread:
            damage = msg(f"line {arg(number)} of the ledger is damaged: {arg(misread)}")
            break
        digests.append(digest(line))
        size += len(line) + 1
    return Reading(path, tuple(entries), size, tuple(digests), bool(tail), damage)


def first_lines(records: Sequence[Record], who: str, operation: str, now: datetime) -> bytes:
    """Return the content of a new ledger file."""
    return b"".join(line for _, line in _lines(records, (0, GENESIS), (now, who, operation)))


class Ledger(EventLog):
    """The ledger file open for writing, by the process that holds the authority's lock.

    After a failed write it refuses all others; the next process reads what is on disk.
    """

    def __init__(self, path: Path) -> None:
        """Read the file, and remove an incomplete last line. Raises CorruptLedgerError, LedgerError."""
        reading = read(path).sound()
        self.entries = list(reading.entries)
        self.digests = list(reading.digests)
        """Hash of each ledger line."""
        super().__init__(path, partial(_build_error, "written", path), create=False)
        if reading.is_torn:
            self.cut(reading.size)

    @property
    def usable(self) -> bool:
        """True if no write has failed so far."""
        return self.failure is None

    def write(self, records: Sequence[Record], who: str, operation: str, now: datetime) -> tuple[LedgerEntry, ...]:
        """Write records to disk in one write and one fsync. Raises LedgerError, and then on every later call."""
        if self.failure is not None:
            raise self.failure
        last = self.digests[-1] if self.digests else GENESIS
        lines = _lines(records, (len(self.entries), last), (now, who, operation))
        if not lines:
            return ()
        self.append(b"".join(line for _, line in lines))
        entries = tuple(entry for entry, _ in lines)
        self.entries.extend(entries)
        self.digests.extend(digest(line) for _, line in lines)
        return entries


def _lines(
    records: Sequence[Record], after: tuple[int, str], common: tuple[datetime, str, str]
) -> list[tuple[LedgerEntry, bytes]]:
    number, last = after
    now, who, operation = common
    lines = []
    for record in records:
        number += 1
        entry = LedgerEntry(number, now, _one_line(who), operation, record)
        line = encode(entry, last)
        last = digest(line)
        lines.append((entry, line))
    return lines


def _one_line(who: str) -> str:
    """Return a user name made safe for the auditor's terminal."""
    return "".join(letter if letter.isprintable() else "?" for letter in who)[:_WHO]


def _build_error(what: str, path: Path, error: OSError) -> LedgerError:
    return LedgerError(
        f"the ledger cannot be {arg(what)}: {arg(error.strerror or error)} ({arg(path)})",
        hint="free disk space or correct the permissions, then run the same command again",
    )
