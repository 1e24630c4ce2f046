"""Photos and files that people give as evidence: copied beside the records, and known by their SHA-256."""

from __future__ import annotations

import hashlib
import re
import stat
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist._errors import Refused
from atlantis_netcfg.journal import make_private, translated, write_atomically

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

__all__ = ["COPY", "FOLDER", "MAX_BYTES", "Copied", "keep", "wrong_with"]

FOLDER = "files"
MAX_BYTES = 25_000_000
"""Of one file: a photo of a telephone has a fifth of it, and a video does not belong into a report."""
COPY = re.compile(FOLDER + r"/[0-9a-f]{12}-[A-Za-z0-9._-]+")
"""How we call a copy."""
_HASH_DIGITS = 12
_NAME_LENGTH = 80


@dataclass(frozen=True, slots=True)
class Copied:
    """A file that is kept."""

    file: str
    """Beside the document: `files/0123456789ab-photo.jpg`."""
    sha256: str
    size: int


def wrong_with(path: Path) -> tuple[str, str] | None:
    """Why a file cannot be evidence, and what to do; None if it can."""
    try:
        found = path.stat()
    except OSError:
        return f"there is no file `{path}`", "give the path of a photo or file, from here or from the file of answers"
    if not stat.S_ISREG(found.st_mode):
        return f"`{path}` is no file", "give a photo or file, not a folder"
    if found.st_size > MAX_BYTES:
        size = f"{found.st_size / 1e6:.0f} MB; {MAX_BYTES // 1_000_000} MB are the most"
        return f"`{path}` has {size}", "make it smaller, or give a part of it"
    return None if found.st_size else (f"`{path}` is empty", "give a file with something in it")


def keep(book: Path, files: Iterable[Path]) -> tuple[Copied, ...]:
    """Copy all of them into the book's folder, or none. Raises Refused, JournalFailed."""
    data = [(path.name, _bytes(path)) for path in files]
    return tuple(_copied(book, name, one) for name, one in data)


def _bytes(path: Path) -> bytes:
    wrong = wrong_with(path)
    if wrong is not None:
        raise Refused(wrong[0], hint=wrong[1])
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise Refused(f"`{path}` cannot be read: {error.strerror}", hint="correct its permissions") from error
    if len(data) > MAX_BYTES:
        raise Refused(f"`{path}` grows while it is read", hint="give it when it is whole")
    return data


def _copied(book: Path, name: str, data: bytes) -> Copied:
    digest = hashlib.sha256(data).hexdigest()
    plain = re.sub(r"[^A-Za-z0-9._-]+", "_", name).lstrip(".")[-_NAME_LENGTH:] or "file"
    copy = Copied(f"{FOLDER}/{digest[:_HASH_DIGITS]}-{plain}", digest, len(data))
    path = book / copy.file
    with translated("the evidence", path):
        make_private(path.parent)
        if not path.exists() or path.read_bytes() != data:
            write_atomically(path, data)
    return copy
