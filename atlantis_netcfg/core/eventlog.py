"""Append-only log file: each append is on disk when it returns, and an incomplete last line is detected.

The journal, the VPN's ledger and the records of a checklist are such files. They define the contents of a line.
"""

from __future__ import annotations

import os
from contextlib import contextmanager
from typing import TYPE_CHECKING, Self

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from atlantis_netcfg.core.errors import NetcfgError


def write_all(descriptor: int, data: bytes) -> None:
    """Write all bytes or raise OSError; on a full disk the first write may be short."""
    rest = memoryview(data)
    while rest:
        rest = rest[os.write(descriptor, rest) :]


def split(data: bytes) -> tuple[list[bytes], bytes]:
    """Split a file into complete lines and the rest: an unfinished line, or nothing."""
    *lines, rest = data.split(b"\n")
    return lines, rest


class EventLog:
    """An append-only file opened by one process; after a failed write it refuses all others."""

    def __init__(self, path: Path, error: Callable[[OSError], NetcfgError], *, create: bool = True) -> None:
        """Open the file, or create it if `create`; `error` builds the exception raised by failed writes."""
        self.path = path
        self.failure: NetcfgError | None = None
        self._error = error
        flags = os.O_RDWR | os.O_APPEND | os.O_CLOEXEC | os.O_NOFOLLOW | (os.O_CREAT if create else 0)
        try:
            self._descriptor = os.open(path, flags, 0o600)
        except OSError as failure:
            raise error(failure) from failure

    @property
    def present(self) -> bool:
        """Whether the path still leads to the open file; writes to a deleted file would be lost."""
        ours = os.fstat(self._descriptor)
        try:
            there = self.path.stat()
        except OSError:
            return False
        return (there.st_dev, there.st_ino) == (ours.st_dev, ours.st_ino)

    def append(self, data: bytes) -> None:
        """Append whole lines: one write, one fsync. On error none of them remains in the file."""
        if self.failure is not None:
            raise self.failure
        size = os.fstat(self._descriptor).st_size
        try:
            write_all(self._descriptor, data)
            os.fsync(self._descriptor)
        except OSError as error:
            self.failure = self._error(error)
            self._truncate_to(size, self.failure)
            raise self.failure from error
        except BaseException as interrupt:
            # Ctrl+C: the caller does not know of the record, so it must not be there.
            self._truncate_to(size, interrupt)
            raise

    def end_torn_line(self) -> None:
        """Terminate a line left unfinished by a killed process."""
        with self._close_on_error():
            size = os.fstat(self._descriptor).st_size
            if size and os.pread(self._descriptor, 1, size - 1) != b"\n":
                write_all(self._descriptor, b"\n")

    def cut(self, size: int) -> None:
        """Truncate the file to `size` bytes, removing an incomplete end."""
        with self._close_on_error():
            os.ftruncate(self._descriptor, size)
            os.fsync(self._descriptor)

    def close(self) -> None:
        """Close the file; nothing is pending."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _truncate_to(self, size: int, failure: BaseException) -> None:
        """Remove a half-written record; if that fails too, readers tolerate the incomplete line."""
        try:
            os.ftruncate(self._descriptor, size)
        except OSError as second:
            failure.add_note(f"nor could the half record be removed: {second}")

    @contextmanager
    def _close_on_error(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            self.close()
            raise self._error(error) from error
