"""An append-only file of lines: each append is on disk when it returns, and a torn end is recognised.

The journal, the VPN's ledger and the records of a checklist are such files. What a line holds is theirs.
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
    """Write every byte or raise OSError; a full disk first shows as a short write."""
    rest = memoryview(data)
    while rest:
        rest = rest[os.write(descriptor, rest) :]


def split(data: bytes) -> tuple[list[bytes], bytes]:
    """The whole lines of a file without their ends, and the rest: a line whose writer was killed, or nothing."""
    *lines, rest = data.split(b"\n")
    return lines, rest


class EventLog:
    """The file, open for appending by one process. After a failed write it refuses every other one."""

    def __init__(self, path: Path, error: Callable[[OSError], NetcfgError], *, create: bool = True) -> None:
        """Open it, or make it if `create`. `error` makes the exception that every failed write raises."""
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
        """Whether the path still leads to the open file: what is written to a deleted one is lost."""
        ours = os.fstat(self._descriptor)
        try:
            there = self.path.stat()
        except OSError:
            return False
        return (there.st_dev, there.st_ino) == (ours.st_dev, ours.st_ino)

    def append(self, data: bytes) -> None:
        """Put whole lines on disk: one write, one fsync. If it raises, nothing of them is left in the file."""
        if self.failure is not None:
            raise self.failure
        size = os.fstat(self._descriptor).st_size
        try:
            write_all(self._descriptor, data)
            os.fsync(self._descriptor)
        except OSError as error:
            self.failure = self._error(error)
            self._take_back(size, self.failure)
            raise self.failure from error
        except BaseException as interrupt:
            # Ctrl+C: the caller does not know of the record, so it must not be there.
            self._take_back(size, interrupt)
            raise

    def end_torn_line(self) -> None:
        """End a line that a killed process left open, so that the next one stands on its own."""
        with self._closed_if_it_fails():
            size = os.fstat(self._descriptor).st_size
            if size and os.pread(self._descriptor, 1, size - 1) != b"\n":
                write_all(self._descriptor, b"\n")

    def cut(self, size: int) -> None:
        """Remove what stands after the first `size` bytes: a torn end."""
        with self._closed_if_it_fails():
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

    def _take_back(self, size: int, failure: BaseException) -> None:
        """Half a record is worse than none; if even this fails, reading tolerates the torn line."""
        try:
            os.ftruncate(self._descriptor, size)
        except OSError as second:
            failure.add_note(f"nor could the half record be removed: {second}")

    @contextmanager
    def _closed_if_it_fails(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            self.close()
            raise self._error(error) from error
