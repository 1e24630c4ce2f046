"""The file: read as a whole, written to at its end."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import partial
from typing import TYPE_CHECKING, Self

from atlantis_netcfg.core.eventlog import EventLog, split
from atlantis_netcfg.vpn.ledger._entry import GENESIS, Entry, Misread, digest, encode, parse
from atlantis_netcfg.vpn.ledger._errors import LedgerDamaged, LedgerFailed

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from atlantis_netcfg.vpn.ledger.records import Record

__all__ = ["FILE", "Ledger", "Reading", "first_lines", "read", "utc_now"]

FILE = "ledger.jsonl"
_WHO = 120


def utc_now() -> datetime:
    """This computer's clock, as fine as the ledger keeps it."""
    now = datetime.now(UTC)
    return now - timedelta(microseconds=now.microsecond % 1000)


@dataclass(frozen=True, slots=True)
class Reading:
    """A ledger as it was found."""

    path: Path
    entries: tuple[Entry, ...]
    size: int
    """Bytes up to the end of the last good line."""
    digests: tuple[str, ...]
    """Hash of each of these lines."""
    torn: bool
    """A line without its end follows: it was being written, or its writer was killed."""
    damage: str | None
    """What is wrong with the first line that is not what was written; nothing after it was read."""

    @property
    def last(self) -> str:
        """Hash of the last good line."""
        return self.digests[-1] if self.digests else GENESIS

    def sound(self) -> Self:
        """Itself, if nothing is damaged. Raises LedgerDamaged."""
        if self.damage is not None:
            raise LedgerDamaged(
                f"{self.damage} ({self.path})",
                hint="sign nothing; put the ledger of the last backup beside this one, and compare them line by line",
            )
        return self


def read(path: Path) -> Reading:
    """Every entry up to the first damage. Raises LedgerFailed if the file cannot be read."""
    try:
        lines, torn = split(path.read_bytes())
    except OSError as error:
        raise _failed("read", path, error) from error
    entries: list[Entry] = []
    digests: list[str] = []
    size, damage = 0, None
    for number, line in enumerate(lines, start=1):
        try:
            entries.append(parse(line, number, digests[-1] if digests else GENESIS))
        except Misread as misread:
            damage = f"line {number} of the ledger is damaged: {misread}"
            break
        digests.append(digest(line))
        size += len(line) + 1
    return Reading(path, tuple(entries), size, tuple(digests), bool(torn), damage)


def first_lines(records: Sequence[Record], who: str, operation: str, now: datetime) -> bytes:
    """A whole new ledger, for a file that is not there yet."""
    return b"".join(line for _, line in _lines(records, (0, GENESIS), (now, who, operation)))


class Ledger(EventLog):
    """The file open for writing, by the one process that holds the authority's lock.

    After a failed write it refuses every other one: what is on disk is then for the next to read.
    """

    def __init__(self, path: Path) -> None:
        """Read it, and cut off a torn line. Raises LedgerDamaged, LedgerFailed."""
        reading = read(path).sound()
        self.entries = list(reading.entries)
        self.digests = list(reading.digests)
        """Hash of each line."""
        super().__init__(path, partial(_failed, "written", path), create=False)
        if reading.torn:
            self.cut(reading.size)

    @property
    def usable(self) -> bool:
        """Whether nothing has gone wrong with it so far."""
        return self.failure is None

    def write(self, records: Sequence[Record], who: str, operation: str, now: datetime) -> tuple[Entry, ...]:
        """Put records on disk: one write, one fsync, for however many. Raises LedgerFailed, and from then on always."""
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
) -> list[tuple[Entry, bytes]]:
    number, last = after
    now, who, operation = common
    lines = []
    for record in records:
        number += 1
        entry = Entry(number, now, _one_line(who), operation, record)
        line = encode(entry, last)
        last = digest(line)
        lines.append((entry, line))
    return lines


def _one_line(who: str) -> str:
    """A person's name as it may be printed: nobody writes to the auditor's terminal."""
    return "".join(letter if letter.isprintable() else "?" for letter in who)[:_WHO]


def _failed(what: str, path: Path, error: OSError) -> LedgerFailed:
    return LedgerFailed(
        f"the ledger cannot be {what}: {error.strerror or error} ({path})",
        hint="make room on the disk or correct its permissions, then run the same command again",
    )
