"""Files that survive a kill or a power cut at any moment, private to their owner."""

from __future__ import annotations

import os
import re
from contextlib import contextmanager
from typing import TYPE_CHECKING

from atlantis_netcfg.journal._errors import JournalFailed

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

__all__ = ["component", "make_private", "sync_directory", "translated", "unwritable", "write_all", "write_atomically"]

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")


def component(name: str) -> str:
    """`name`, if it can be the name of a file wherever it comes from; ValueError otherwise."""
    if _NAME.fullmatch(name) is None:
        raise ValueError(f"not usable as a file name: {name!r}")
    return name


def make_private(path: Path) -> Path:
    """Make a directory, and those above it that are missing, with mode 0700; on disk when this returns."""
    missing = [path, *path.parents]
    missing = [directory for directory in missing if not directory.exists()]
    for directory in reversed(missing):
        directory.mkdir(mode=0o700, exist_ok=True)
        sync_directory(directory.parent)
    return path


def sync_directory(path: Path) -> None:
    """Put a directory's entries on disk: a new file is only safe when its name is."""
    descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def write_all(descriptor: int, data: bytes) -> None:
    """Write every byte or raise OSError; a full disk first shows as a short write."""
    rest = memoryview(data)
    while rest:
        rest = rest[os.write(descriptor, rest) :]


def write_atomically(path: Path, data: bytes) -> None:
    """Replace a file so that a reader sees the old bytes or the new ones, never a part; mode 0600."""
    scratch = path.with_name(f".{path.name}.{os.getpid()}")
    descriptor = os.open(scratch, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    try:
        try:
            write_all(descriptor, data)
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
        scratch.replace(path)
    except OSError:
        scratch.unlink(missing_ok=True)
        raise
    sync_directory(path.parent)


@contextmanager
def translated(what: str, path: Path) -> Iterator[None]:
    """Say in words that a file of the state directory could not be written."""
    try:
        yield
    except OSError as error:
        raise unwritable(what, path, error) from error


def unwritable(what: str, path: Path, error: OSError) -> JournalFailed:
    """The error for a file that could not be written."""
    reason = error.strerror or str(error)
    return JournalFailed(
        f"{what} cannot be written: {reason} ({path})",
        hint="make room on the disk or correct its permissions, then run the same command again",
    )
