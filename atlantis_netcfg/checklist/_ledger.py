"""The log of one checklist: one record per line with the hash of the previous line, synced before the next step.

An interruption leaves at most an unterminated last line; that record was not acknowledged, so it is cut off. A
terminated last line that cannot be read is the result of a power cut: it is cut off too, and reported. Anything else is
damage.

Photos and files supplied as evidence are copied beside the records and identified by their SHA-256.

A telephone stores in a photo where and when it was taken, and with what. A report goes to partners, so only the picture
itself is kept: decoded, rotated upright and encoded again. A photo that cannot be decoded here is rejected.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import re
import stat
import warnings
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from atlantis_netcfg import runs
from atlantis_netcfg.checklist import _signing
from atlantis_netcfg.checklist.report import Document, Item
from atlantis_netcfg.core.eventlog import EventLog, split
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.core.stored_messages import marked_texts, unpack

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from pathlib import Path


FILE = "records.jsonl"


class _ChecklistRecord(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class ChecklistBegun(_ChecklistRecord):
    """The computed list; recorded again if a continued checklist has a different list."""

    record: Literal["begun"] = "begun"
    document: Document


class ReopenedRecord(_ChecklistRecord):
    """A checklist was opened again."""

    record: Literal["gone on"] = "gone on"


class RecordedResult(_ChecklistRecord):
    """New state of an item; earlier records hold its previous states."""

    record: Literal["settled", "confirmed", "overridden"]
    item: Item


class SupersedeResultRecord(_ChecklistRecord):
    """The checklist was replaced by a new one."""

    record: Literal["superseded"] = "superseded"
    why: str


Record = Annotated[
    ChecklistBegun | ReopenedRecord | RecordedResult | SupersedeResultRecord, Field(discriminator="record")
]
_RECORDS: TypeAdapter[ChecklistBegun | ReopenedRecord | RecordedResult | SupersedeResultRecord] = TypeAdapter(Record)


@dataclass(frozen=True, slots=True)
class ChecklistEntry:
    """One record and when it was written."""

    at: datetime
    record: ChecklistBegun | ReopenedRecord | RecordedResult | SupersedeResultRecord


@dataclass(frozen=True, slots=True)
class Lines:
    """Content of a log file, with its damage if any."""

    records: tuple[ChecklistEntry, ...] = ()
    good: int = 0
    """Bytes up to the end of the last readable record."""
    last: str = ""
    """SHA-256 of the line of the last readable record."""
    tail_error: str = ""
    """Why the end was cut off; empty: it was not."""
    damage: str = ""
    """Why the content is not what was written."""


def read(path: Path) -> Lines:
    """Read all records up to the first invalid line."""
    try:
        lines, rest = split(_signing.content(path))
    except OSError as error:
        return Lines(damage=msg(f"cannot be read: {arg(error.strerror)}"))
    records: list[ChecklistEntry] = []
    good, last = 0, ""
    for number, line in enumerate(lines, start=1):
        record = _record(line, last)
        if isinstance(record, str):
            tail = number == len(lines) and not rest and number > 1 and not record.startswith("does not follow")
            text = msg(f"line {arg(number)} {arg(record)}")
            return Lines(tuple(records), good, last, tail_error=text if tail else "", damage="" if tail else text)
        records.append(record)
        good, last = good + len(line) + 1, hashlib.sha256(line).hexdigest()
    tail_error = msg(
        f"line {arg(len(lines) + 1)} is incomplete: the program was killed while writing it" if rest else ""
    )
    return Lines(tuple(records), good, last, tail_error=tail_error)


def _record(line: bytes, before: str) -> ChecklistEntry | str:
    """Parse a line's record; return an error message if the line is invalid."""
    try:
        data = unpack(_signing.parse_json(line))
        at, follows = datetime.fromisoformat(data.pop("at")), data.pop("before")
        record = _RECORDS.validate_python(data)
    except (ValueError, ValidationError, KeyError, TypeError, AttributeError):
        return "cannot be read"
    return ChecklistEntry(at, record) if follows == before else "does not follow from the line above"


def rebuild_document(lines: Lines) -> Document | None:
    """Rebuild the unsigned checklist from the records; None if they contain no list."""
    documents = [entry.record.document for entry in lines.records if isinstance(entry.record, ChecklistBegun)]
    if not documents:
        return None
    results = {
        record.record.item.id: record.record.item
        for record in lines.records
        if isinstance(record.record, RecordedResult)
    }
    return documents[-1].model_copy(update={"items": tuple(results.get(item.id, item) for item in documents[-1].items)})


class ChecklistLog(EventLog):
    """The log, open for appending. After a failed write it rejects all further writes."""

    def __init__(self, path: Path, now: Callable[[], datetime] = runs.utc_now) -> None:
        """Open or create the log and cut off an incomplete end. The caller has to check for damage before."""
        lines = read(path) if path.exists() else Lines()
        self._now = now
        self._last = lines.last
        super().__init__(path, partial(runs.unwritable, "the checklist", path))
        self.cut(lines.good)

    def write(self, record: ChecklistBegun | ReopenedRecord | RecordedResult | SupersedeResultRecord) -> None:
        """Append a record and sync it. Raises JournalError, and after the first failure always."""
        line = self._line(record)
        self.append(line + b"\n")
        self._last = hashlib.sha256(line).hexdigest()

    def _line(self, record: ChecklistBegun | ReopenedRecord | RecordedResult | SupersedeResultRecord) -> bytes:
        head = {"at": self._now().isoformat(timespec="milliseconds"), "before": self._last}
        data = head | _RECORDS.dump_python(record, mode="json") | marked_texts(record)
        return json.dumps(data, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode(errors="replace")


FOLDER = "files"
MAX_BYTES = 25_000_000
"""Limit for one file: a phone photo has a fifth of it, and a video does not belong in a report."""
COPY = re.compile(FOLDER + r"/[0-9a-f]{12}-[A-Za-z0-9._-]+")
"""Path of a copied file."""
_PICTURES = {
    "JPEG": re.compile(rb"\xff\xd8\xff"),
    "PNG": re.compile(rb"\x89PNG\r\n"),
    "GIF": re.compile(rb"GIF8[79]a"),
    "WEBP": re.compile(rb"RIFF....WEBP", re.DOTALL),
    "TIFF": re.compile(rb"II\*\0|MM\0\*"),
    "HEIC": re.compile(rb"....ftyp(hei|hev|mif1|msf1|avi[fs])", re.DOTALL),
}
"""Picture format -> bytes at the start of such a file."""
_READ = ("JPEG", "PNG", "GIF", "WEBP")
"""Formats that every build of Pillow decodes."""
_MAX_PIXELS = 120_000_000
"""Limit for a picture; phones have up to 108 million."""
_SAVE_OPTIONS: dict[str, dict[str, Any]] = {"JPEG": {"quality": 90}, "WEBP": {"lossless": True}}
"""Encoder options that replace defaults of the encoder."""
_AS_JPEG = "use JPEG or PNG: telephones have a setting for that, and every viewer can export it"
_HASH_DIGITS = 12
_NAME_LENGTH = 80


@dataclass(frozen=True, slots=True)
class CopiedFile:
    """An evidence file copied into the checklist's folder."""

    file: str
    """Path relative to the document: `files/0123456789ab-photo.jpg`."""
    sha256: str
    size: int


def evidence_problem(path: Path) -> tuple[str, str] | None:
    """Return why a file cannot be evidence, and what to do; None if it can."""
    try:
        status = path.lstat()
    except OSError:
        return (
            msg(f"file `{arg(path)}` does not exist"),
            "give the path of a photo or file, relative to this folder or to the answers file",
        )
    if stat.S_ISLNK(status.st_mode):
        return msg(f"`{arg(path)}` is a symbolic link, which is not followed"), "give the photo or file itself"
    if not stat.S_ISREG(status.st_mode):
        return msg(f"`{arg(path)}` is not a file"), "give a photo or file, not a folder"
    if status.st_size > MAX_BYTES:
        size = msg(f"{arg(status.st_size / 1000000.0):.0f} MB; the maximum is {arg(MAX_BYTES // 1000000)} MB")
        return msg(f"`{arg(path)}` has {arg(size)}"), "make it smaller, or use a part of it"
    return None if status.st_size else (msg(f"`{arg(path)}` is empty"), "use a file that is not empty")


def is_picture(path: Path) -> bool:
    """Return whether a file starts like a supported picture format."""
    try:
        with path.open("rb") as file:
            start = file.read(16)
    except OSError:
        return False
    return any(_PICTURES[kind].match(start) for kind in _READ)


def keep(book: Path, files: Iterable[Path]) -> tuple[CopiedFile, ...]:
    """Copy all files into the checklist's folder, or none. Raises ChecklistUsageError, JournalError."""
    data = [(path.name, _picture(path, _read_evidence(path))) for path in files]
    return tuple(_store_copy(book, name, item) for name, item in data)


def _read_evidence(path: Path) -> bytes:
    wrong = evidence_problem(path)
    if wrong is not None:
        raise _signing.ChecklistUsageError(wrong[0], hint=wrong[1])
    try:
        with os.fdopen(os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC), "rb") as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise _signing.ChecklistUsageError(
            f"`{arg(path)}` cannot be read: {arg(error.strerror)}", hint="correct its permissions"
        ) from error
    if len(data) > MAX_BYTES:
        raise _signing.ChecklistUsageError(
            f"`{arg(path)}` grows while it is being read", hint="use it when it is complete"
        )
    return data


def _picture(path: Path, data: bytes) -> bytes:
    """Strip a photo of everything but the picture; return other files unchanged. Raises ChecklistUsageError."""
    kind = next((name for name, start in _PICTURES.items() if start.match(data)), None)
    if kind is None:
        return data
    if kind not in _READ:
        raise _signing.ChecklistUsageError(
            f"`{arg(path)}` is a picture of type {arg(kind)}, whose position cannot be removed here", hint=_AS_JPEG
        )
    from PIL import Image, ImageOps  # noqa: PLC0415 - most commands see no photo

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # its size is looked at below, and what is odd inside does not stay
            with Image.open(io.BytesIO(data), formats=(kind,)) as image:
                pixels = image.width * image.height
                picture = _encode(ImageOps.exif_transpose(image), kind) if pixels <= _MAX_PIXELS else b""
    except Exception as error:  # Pillow raises all sorts for damaged files
        raise _signing.ChecklistUsageError(
            f"`{arg(path)}` is a damaged picture of type {arg(kind)}: {arg(error)}", hint=_AS_JPEG
        ) from error
    if not picture:
        raise _signing.ChecklistUsageError(
            f"`{arg(path)}` has {arg(pixels)} pixels; the maximum is {arg(_MAX_PIXELS)}", hint="make it smaller"
        )
    return picture


def _encode(image: Any, kind: str) -> bytes:  # noqa: ANN401 - Pillow is imported where it is needed
    """Encode only the pixels; the result is the same for the same photo."""
    from PIL import Image  # noqa: PLC0415 - as above

    mode = {"JPEG": "L" if image.mode == "L" else "RGB"}.get(kind, "RGBA" if image.has_transparency_data else "RGB")
    pixels = image.convert(mode)
    bare = Image.frombytes(mode, pixels.size, pixels.tobytes())
    buffer = io.BytesIO()
    bare.save(buffer, kind, **_SAVE_OPTIONS.get(kind, {}))
    return buffer.getvalue()


def _store_copy(book: Path, name: str, data: bytes) -> CopiedFile:
    digest = hashlib.sha256(data).hexdigest()
    plain = re.sub(r"[^A-Za-z0-9._-]+", "_", name).lstrip(".")[-_NAME_LENGTH:] or "file"
    copy = CopiedFile(f"{FOLDER}/{digest[:_HASH_DIGITS]}-{plain}", digest, len(data))
    path = book / copy.file
    with runs.os_errors_as("the evidence", path):
        runs.make_private(path.parent)
        if not path.exists() or path.read_bytes() != data:
            runs.write_atomically(path, data)
    return copy
