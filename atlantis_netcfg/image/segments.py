"""Which parts of an image a card must hold: data, zeros, and (where a bmap file says so) what does not matter."""

from __future__ import annotations

import errno
import os
from dataclasses import dataclass
from enum import Enum, auto
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

__all__ = ["Kind", "Segment", "segments"]

_ALIGN = 4096
Span = tuple[int, int]
"""First byte, and the byte after the last."""


class Kind(Enum):
    """What stands in a segment."""

    DATA = auto()
    ZERO = auto()
    """Nothing but zero bytes, which count: what the card held before must not shine through."""


@dataclass(frozen=True, slots=True)
class Segment:
    """Bytes of an image that a card must hold."""

    start: int
    end: int
    kind: Kind

    @property
    def size(self) -> int:
        """In bytes."""
        return self.end - self.start


def segments(image: Path, size: int, mapped: Iterable[Span] | None = None) -> tuple[Segment, ...]:
    """The segments of a sparse image file, in order, apart from each other.

    A hole of the file is zeros. With `mapped` (of a bmap file) a hole outside of it does not matter and has no segment;
    what was written there since, by customising, is data nevertheless. Where a file system knows no holes, all is data.
    """
    data = _joined(_data(image, size), size)
    desired = [(0, size)] if mapped is None else _joined([*mapped, *data], size)
    found = [Segment(start, end, Kind.DATA) for start, end in data]
    found += [Segment(start, end, Kind.ZERO) for start, end in _without(desired, data)]
    return tuple(sorted(found, key=lambda each: each.start))


def _data(image: Path, size: int) -> Iterator[Span]:
    descriptor = os.open(image, os.O_RDONLY | os.O_CLOEXEC)
    try:
        end = 0
        while end < size:
            try:
                start = os.lseek(descriptor, end, os.SEEK_DATA)
            except OSError as error:
                if error.errno == errno.ENXIO:  # nothing but a hole to the end
                    return
                raise
            end = min(os.lseek(descriptor, start, os.SEEK_HOLE), size)
            yield start, end
    finally:
        os.close(descriptor)


def _joined(spans: Iterable[Span], size: int) -> list[Span]:
    """Widened to whole blocks of 4 KiB (the end of the image excepted), sorted, and joined where they touch."""
    found: list[Span] = []
    for start, end in sorted(spans):
        first, last = start // _ALIGN * _ALIGN, min(-(-end // _ALIGN) * _ALIGN, size)
        if found and first <= found[-1][1]:
            found[-1] = (found[-1][0], max(found[-1][1], last))
        elif first < last:
            found.append((first, last))
    return found


def _without(spans: Iterable[Span], taken: Iterable[Span]) -> Iterator[Span]:
    """What is left of the spans; both are sorted and joined."""
    rest = list(taken)
    for start, end in spans:
        at = start
        for first, last in rest:
            if last <= at or first >= end:
                continue
            if first > at:
                yield at, first
            at = max(at, last)
        if at < end:
            yield at, end
