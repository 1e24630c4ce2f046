"""Write an image to a card, and verify it by reading everything back.

Order, so that an unfinished card does not boot: the card's first MiB is cleared; zero ranges are cleared; the data is
written; everything is read back and compared; then the first MiB is written, its first 4 KiB last (partition table, and
the boot code of most boards), and read back.

The device is opened with O_EXCL (the kernel refuses a disk that is mounted or held anywhere, in other namespaces too)
and O_DIRECT (data is read from the device and not from this computer's memory; a cache of the card reader cannot be
excluded). Reading comes after all writing, which exposes cards with less capacity than they report.
"""

from __future__ import annotations

import errno
import fcntl
import mmap
import os
import stat
import struct
import time
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

from atlantis_netcfg.computers.image import blocks
from atlantis_netcfg.computers.image.facts import BlockDeviceError, CardWriteError
from atlantis_netcfg.computers.image.source import Segment, SourceKind
from atlantis_netcfg.core.messages import arg, msg

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path


class WriterStep(StrEnum):
    """A step that takes long, as shown to the user."""

    UNPACKING = "unpacking the image"
    CLEARING = "clearing areas that must be empty"
    WRITING = "writing"
    COMPARING = "reading back"


@dataclass(frozen=True, slots=True)
class Progress:
    """Progress of one step."""

    step: WriterStep
    done_bytes: int
    total: int
    """Number of bytes in this step."""
    elapsed_s: float

    @property
    def rate_bps(self) -> float:
        """Bytes per second since the step began; 0 while no time has passed."""
        return self.done_bytes / self.elapsed_s if self.elapsed_s > 0 else 0.0

    @property
    def left_s(self) -> float | None:
        """Remaining seconds at this speed; None while the speed is zero."""
        return (self.total - self.done_bytes) / self.rate_bps if self.rate_bps > 0 else None

    @property
    def words(self) -> str:
        """Progress line for people."""
        share = 100 * self.done_bytes // self.total if self.total else 100
        remaining_text = msg("" if self.left_s is None else f", {arg(self.left_s):.0f} s left")
        return msg(
            f"{arg(self.step)} {arg(share)} % of {arg(self.total / 1e6):.0f} MB, {arg(self.rate_bps / 1e6):.1f} "
            f"MB/s{arg(remaining_text)}"
        )


class WriteMeter:
    """Progress reporter of one step: at most one report per interval, and one at the end."""

    def __init__(
        self,
        step: WriterStep,
        tell: Callable[[Progress], None],
        *,
        every_s: float = 2.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._step = step
        self._tell = tell
        self._every_s = every_s
        self._clock = clock
        self._began = self._reported = clock()
        self._ended = False

    def __call__(self, done_bytes: int, total: int) -> None:
        """Report the number of bytes done and the total."""
        at = self._clock()
        if self._ended:
            return
        self._ended = done_bytes >= total
        if self._ended or at - self._reported >= self._every_s:
            self._reported = at
            self._tell(Progress(self._step, done_bytes, total, at - self._began))


_HEAD = 2**20
_FIRST = 4096
_CHUNK = 4 * 2**20
_ZEROS = bytes(_CHUNK)
_BLKGETSIZE64 = 0x80081272
"""ioctl that returns the size of a block device in bytes (linux/fs.h)."""


@dataclass(frozen=True, slots=True)
class WrittenCard:
    """Result of writing and verifying a card."""

    data: int
    """Bytes of data written."""
    cleared: int
    """Bytes overwritten with zeros because the card held something else there."""
    skipped: int
    """Bytes of the image not written: already zero on the card, or not needed."""
    compared: int
    """Bytes read back for verification."""
    seconds: float


@dataclass(frozen=True, slots=True)
class Card:
    """The disk that was shown to the user, and its path."""

    device: Path
    disk: blocks.BlockDevice
    tree: blocks.BlockTree

    def require_unchanged(self, image_size: int) -> None:
        """Raise BlockDeviceError if the disk has changed or must not be written."""
        blocks.require_same_disk(self.tree, self.device, self.disk, image_size)


def write(copy: Path, parts: Sequence[Segment], card: Card, tell: Callable[[Progress], None]) -> WrittenCard:
    """Write the segments to a card. Raises BlockDeviceError before the first byte, CardWriteError after it."""
    image_size = max((part.end for part in parts), default=0)
    card.require_unchanged(image_size)
    card_fd = _open(card.device)
    source = os.open(copy, os.O_RDONLY | os.O_CLOEXEC)
    try:
        _check_device(card_fd, card.device, card.disk)
        card.require_unchanged(image_size)
        return _CardWriter(card_fd, source, parts, tell).run()
    finally:
        os.close(source)
        os.close(card_fd)


def _open(device: Path) -> int:
    try:
        return os.open(device, os.O_RDWR | os.O_EXCL | os.O_DIRECT | os.O_CLOEXEC)
    except OSError as error:
        if error.errno == errno.EBUSY:
            raise BlockDeviceError(
                f"{arg(device)} is in use by this computer, and nothing was written",
                hint="unmount it; another program may be writing to it",
            ) from error
        why = "only root may write to it" if error.errno in {errno.EACCES, errno.EPERM} else error.strerror
        raise BlockDeviceError(f"{arg(device)} cannot be opened: {arg(why)}", hint="run it with sudo") from error


def _check_device(card: int, device: Path, disk: blocks.BlockDevice) -> None:
    """Check the opened device against the disk that was shown, since the path may have been re-pointed."""
    status = os.fstat(card)
    number = f"{os.major(status.st_rdev)}:{os.minor(status.st_rdev)}"
    if not stat.S_ISBLK(status.st_mode) or number != disk.number:
        raise BlockDeviceError(f"{arg(device)} has changed since it was shown, and nothing was written")
    (size,) = struct.unpack("Q", fcntl.ioctl(card, _BLKGETSIZE64, bytes(8)))
    if size != disk.size:
        raise BlockDeviceError(
            f"{arg(device)} has {arg(size)} bytes, not the {arg(disk.size)} that were shown; nothing was written"
        )


class _VerifyError(Exception):
    """Read-back does not match: the card or the working copy has other bytes."""


class _CardWriter:
    """Writes and verifies one card."""

    def __init__(self, card: int, source: int, parts: Sequence[Segment], tell: Callable[[Progress], None]) -> None:
        self._card, self._source, self._tell = card, source, tell
        self._head = min(_HEAD, max(part.end for part in parts))
        self._body = tuple(_after(parts, self._head))
        self._total = max(part.end for part in parts)
        self._ours, self._theirs = mmap.mmap(-1, _CHUNK), mmap.mmap(-1, _CHUNK)
        self._data = self._cleared = self._compared = 0

    def run(self) -> WrittenCard:
        """Write and compare everything; after any failure the first MiB is cleared."""
        began = time.monotonic()
        try:
            self._write_chunk(0, self._head, zero=True)
            os.fsync(self._card)
            self._clear()
            self._copy()
            os.fsync(self._card)
            self._compare(self._body)
            self._finish()
        except (OSError, KeyboardInterrupt, _VerifyError) as error:
            raise self._write_error(error) from error
        skipped_bytes = self._total - self._data - self._cleared
        return WrittenCard(self._data, self._cleared, skipped_bytes, self._compared, time.monotonic() - began)

    def _write_error(self, error: BaseException) -> CardWriteError:
        """Clear the first MiB after a failure, so that the card does not boot, and return the error."""
        why = str(error)
        if isinstance(error, KeyboardInterrupt):
            why = "it was stopped"
        elif isinstance(error, OSError):
            why = msg(f"the write to the card failed ({arg(error.strerror)})")
        try:
            self._write_chunk(0, self._head, zero=True)
            os.fsync(self._card)
        except OSError:
            now = "Its first block could not be cleared either: do not use this card"
        else:
            now = "Its first block is empty, so it does not boot"
        return CardWriteError(
            f"the card was not written completely: {arg(why)}. {arg(now)}",
            hint="run the same command again; if it fails at the same place, use another card",
        )

    def _clear(self) -> None:
        """Clear the zero segments; parts that are zero already are only read, which is faster."""
        zeros = [part for part in self._body if part.kind is SourceKind.ZERO]
        meter, done_bytes, total = WriteMeter(WriterStep.CLEARING, self._tell), 0, sum(part.size for part in zeros)
        for part in zeros:
            dirty = False
            for at, size in _chunks(part):
                dirty = dirty or self._read(at, size) != _zeros(size)
                if dirty:
                    self._write_chunk(at, size, zero=True)
                    self._cleared += size
                done_bytes += size
                meter(done_bytes, total)

    def _copy(self) -> None:
        data = [part for part in self._body if part.kind is SourceKind.DATA]
        meter, done_bytes, total = WriteMeter(WriterStep.WRITING, self._tell), 0, sum(part.size for part in data)
        for part in data:
            for at, size in _chunks(part):
                self._write_chunk(at, size)
                done_bytes += size
                meter(done_bytes, total)
        self._data += done_bytes

    def _compare(self, parts: Sequence[Segment]) -> None:
        meter, done_bytes, total = WriteMeter(WriterStep.COMPARING, self._tell), 0, sum(part.size for part in parts)
        for part in parts:
            for at, size in _chunks(part):
                expected_data = _zeros(size) if part.kind is SourceKind.ZERO else self._source_data(at, size)
                if self._read(at, size) != expected_data:
                    raise _VerifyError(
                        msg(f"bytes {arg(at)} to {arg(at + size)} read back from it differ from those written")
                    )
                done_bytes += size
                meter(done_bytes, total)
        self._compared += done_bytes

    def _finish(self) -> None:
        """Write the first MiB, its first 4 KiB last."""
        first = min(_FIRST, self._head)
        if self._head > first:
            self._write_chunk(first, self._head - first)
            os.fsync(self._card)
        self._write_chunk(0, first)
        os.fsync(self._card)
        self._data += self._head
        self._compare([Segment(0, self._head, SourceKind.DATA)])

    def _write_chunk(self, at: int, size: int, *, zero: bool = False) -> None:
        self._ours[:size] = _zeros(size) if zero else self._source_data(at, size)
        with memoryview(self._ours) as view:
            offset = 0
            while offset < size:
                offset += os.pwrite(self._card, view[offset:size], at + offset)

    def _source_data(self, at: int, size: int) -> bytes:
        data = os.pread(self._source, size, at)
        os.posix_fadvise(self._source, at + size, _CHUNK, os.POSIX_FADV_WILLNEED)
        if len(data) != size:
            raise _VerifyError(msg(f"the working copy of the image ends at byte {arg(at + len(data))}"))
        return data

    def _read(self, at: int, size: int) -> bytes:
        with memoryview(self._theirs) as view:
            offset = 0
            while offset < size:
                got = os.preadv(self._card, [view[offset:size]], at + offset)
                if not got:
                    raise _VerifyError(msg(f"the card ends at byte {arg(at + offset)}"))
                offset += got
        return self._theirs[:size]


def _zeros(size: int) -> bytes:
    return _ZEROS if size == _CHUNK else bytes(size)


def _after(parts: Sequence[Segment], start: int) -> Iterator[Segment]:
    """Yield the parts of the segments after a byte offset."""
    for part in parts:
        if part.end > start:
            yield Segment(max(part.start, start), part.end, part.kind)


def _chunks(part: Segment) -> Iterator[tuple[int, int]]:
    for at in range(part.start, part.end, _CHUNK):
        yield at, min(_CHUNK, part.end - at)
