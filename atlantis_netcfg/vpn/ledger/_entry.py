"""One line of the ledger: its form on disk, and what was read of it."""

from __future__ import annotations

import hashlib
import json
from binascii import crc32
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from pydantic import TypeAdapter, ValidationError

from atlantis_netcfg.vpn.ledger._words import describe
from atlantis_netcfg.vpn.ledger.records import Record

__all__ = ["GENESIS", "Entry", "Misread", "digest", "encode", "parse"]

GENESIS = "0" * 64
"""What the first line has for the hash of the line before."""
_RECORDS: TypeAdapter[Record] = TypeAdapter(Record)
_SEAL = len(',"crc":"00000000"}')


@dataclass(frozen=True, slots=True)
class Entry:
    """What happened, when, by whom."""

    number: int
    """From 1 on, without gaps."""
    at: datetime
    who: str
    operation: str
    """Same for all entries of one command."""
    record: Record

    @property
    def words(self) -> str:
        """What happened, in plain words, one line."""
        return describe(self.record)

    def facts(self) -> dict[str, Any]:
        """The entry for `--json`: line, at, who, operation, kind, words, and the record's own fields."""
        return {**_head(self), "words": self.words, **_fields(self.record)}


class Misread(ValueError):
    """A line that is not what was written; its text says in which way."""


def encode(entry: Entry, previous: str) -> bytes:
    """The line, its end included; `previous` is the `digest` of the line before."""
    data = {**_head(entry), "previous": previous, **_fields(entry.record)}
    text = json.dumps(data, ensure_ascii=True, separators=(",", ":")).encode()
    body = text[:-1]
    return body + b',"crc":"%08x"}\n' % crc32(body)


def digest(line: bytes) -> str:
    """Hash of a line, for the one after it; its end does not count."""
    return hashlib.sha256(line.removesuffix(b"\n")).hexdigest()


def parse(line: bytes, number: int, previous: str) -> Entry:
    """The entry of a line without its end. Raises Misread."""
    body = line[:-_SEAL]
    if line != body + b',"crc":"%08x"}' % crc32(body):
        raise Misread("its checksum is wrong: it was changed, or the disk has lost a part of it")
    data = _json(line)
    if data.pop("line") != number:
        raise Misread("lines before it are missing or out of order")
    if data.pop("previous") != previous:
        raise Misread("the line before it is not the one that it was written after")
    try:
        head = (datetime.fromisoformat(data.pop("at")), str(data.pop("who")), str(data.pop("operation")))
        return Entry(number, *head, _RECORDS.validate_python(data))
    except (ValueError, ValidationError, KeyError, TypeError):
        raise Misread("this version of the toolkit does not know what it says") from None


def _json(line: bytes) -> dict[str, Any]:
    try:
        data = json.loads(line)
    except ValueError:
        data = None
    if not isinstance(data, dict) or not {"line", "previous"} <= data.keys():
        raise Misread("it is no line of a ledger")
    return data


def _head(entry: Entry) -> dict[str, Any]:
    moment = entry.at.astimezone(UTC).isoformat(timespec="milliseconds")
    return {"line": entry.number, "at": moment, "who": entry.who, "operation": entry.operation}


def _fields(record: Record) -> dict[str, Any]:
    fields: dict[str, Any] = _RECORDS.dump_python(record, mode="json")
    return fields
