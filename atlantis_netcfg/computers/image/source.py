"""Unpack the vendor's file into a sparse working copy: checksum, xz, gz or raw, block map; little memory.

One pass over the file: its bytes are hashed as they are read. The checksum is compared before the copy is used.

A block map beside an image lists the blocks that matter, with a checksum of each range. Format: bmap-tools, versions
1.3 to 2.0 (XML; `BmapFileChecksum` is computed over the file with that checksum as zeros). `segments` are the parts
that a card must hold: data, zeros, and, where a block map defines them, parts that do not matter.
"""

from __future__ import annotations

import errno
import gzip
import hashlib
import io
import lzma
import os
import re
import zlib
from dataclasses import dataclass
from enum import Enum, auto
from typing import IO, TYPE_CHECKING, cast
from xml.etree import ElementTree as ET

from atlantis_netcfg.computers.image.facts import ImageError
from atlantis_netcfg.core.messages import arg, msg

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from pathlib import Path

_MOST = 16 * 2**20
"""Maximum size of a block map file in bytes; larger files are rejected."""
_HINT = "download it again, or move it away: without it, every block of the image is written"


@dataclass(frozen=True, slots=True)
class MappedRange:
    """A byte range that matters, with its checksum in hex; empty if the map has none."""

    start: int
    end: int
    digest: str


@dataclass(frozen=True, slots=True)
class Bmap:
    """A block map of an image (bmap-tools)."""

    size: int
    """Size of the image in bytes."""
    algorithm: str
    """Name of the checksum algorithm in hashlib."""
    ranges: tuple[MappedRange, ...]


def find_block_map(image: Path) -> Path | None:
    """Return the block map next to an image: for `x.img.xz`, `x.img.bmap` or `x.img.xz.bmap`."""
    names = dict.fromkeys((f"{image.name}.bmap", f"{image.name.removesuffix('.xz').removesuffix('.gz')}.bmap"))
    return next((image.with_name(name) for name in names if image.with_name(name).is_file()), None)


def read(path: Path) -> Bmap:
    """Parse a block map. Raises ImageError if it is damaged or not supported."""
    if path.stat().st_size > _MOST:
        raise ImageError(f"{arg(path)}: too large for a block map", hint=_HINT)
    text = path.read_bytes()
    try:
        return _parse_bmap(text)
    except (ValueError, ET.ParseError) as error:
        raise ImageError(f"{arg(path)}: not a block map, or damaged: {arg(error)}", hint=_HINT) from error


def _parse_bmap(text: bytes) -> Bmap:
    if b"<!DOCTYPE" in text or b"<!ENTITY" in text:
        raise ValueError("it contains XML entities")
    root = ET.fromstring(text)  # noqa: S314 - bounded in size, and entities are refused above
    algorithm = (root.findtext("ChecksumType") or "sha256").strip().lower()
    if algorithm not in {"sha256", "sha512"}:
        raise ValueError(msg(f"unknown checksum type `{arg(algorithm)}`"))
    _verify_own_checksum(text, (root.findtext("BmapFileChecksum") or "").strip(), algorithm)
    block, size = int(root.findtext("BlockSize") or ""), int(root.findtext("ImageSize") or "")
    if root.tag != "bmap" or block <= 0 or size <= 0:
        raise ValueError("it has no sizes")
    return Bmap(size, algorithm, tuple(_range(element, block, size) for element in root.iterfind("BlockMap/Range")))


def _verify_own_checksum(text: bytes, digest: str, algorithm: str) -> None:
    if digest and hashlib.new(algorithm, text.replace(digest.encode(), b"0" * len(digest))).hexdigest() != digest:
        raise ValueError("its own checksum is wrong")


def _range(element: ET.Element, block: int, size: int) -> MappedRange:
    if not (match := re.fullmatch(r"\s*(\d+)(?:\s*-\s*(\d+))?\s*", element.text or "")):
        raise ValueError(msg(f"`{arg(element.text)}` is not a range"))
    first = int(match[1])
    last = int(match[2]) if match[2] else first
    if last < first or first * block >= size:
        raise ValueError(msg(f"the range {arg(first)}-{arg(last)} is not in the image"))
    return MappedRange(first * block, min((last + 1) * block, size), element.get("chksum") or "")


_PIECE = 64 * 2**10
"""Block size in bytes: a block of zeros becomes a hole in the working copy."""
_CHUNK = 2**20
_PADDING = 4096
"""The working copy is padded to a multiple of this many bytes, so that it fits devices of any sector size."""
_ZEROS = bytes(_PIECE)
_OTHERS = ((b"\x28\xb5\x2f\xfd", "zstd", "zstd -d"), (b"PK\x03\x04", "zip", "unzip"), (b"BZh", "bzip2", "bunzip2"))


@dataclass(frozen=True, slots=True)
class Checksum:
    """Expected SHA-256 of the file, and its source."""

    sha256: str
    told_by: str


@dataclass(frozen=True, slots=True)
class UnpackedImage:
    """A working copy of an image."""

    path: Path
    size: int
    """Size of the image in bytes; the copy may be up to one block longer."""
    sha256: str
    """SHA-256 of the vendor's file, computed while reading it."""
    told_by: str
    """Source of the expected checksum that it matches; empty: there was none to compare with."""
    spans: tuple[tuple[int, int], ...] | None
    """Spans that must be written according to the block map; None: the whole image."""


def checksum(image: Path, sum_text: str | None = None) -> Checksum | None:
    """Return the checksum given by the user or stored beside the image, None if neither. Raises ImageError."""
    if sum_text is not None:
        if not re.fullmatch(r"[0-9a-fA-F]{64}", sum_text):
            raise ImageError(f"`{arg(sum_text)}` is not a SHA-256 (64 hex digits)", hint=f"sha256sum {arg(image)}")
        return Checksum(sum_text.lower(), "sha256=")
    for name in (f"{image.name}.sha256", f"{image.name}.sha256sum", "SHA256SUMS", "sha256sums.txt"):
        sum_file = image.with_name(name)
        if sum_file.is_file() and (digest := _read_sum(sum_file, image.name)):
            return Checksum(digest, name)
    return None


def _read_sum(path: Path, name: str) -> str | None:
    """Read a checksum from `sha256sum` output, or from a file with only the checksum."""
    for line in path.read_text(errors="replace").splitlines():
        match = re.fullmatch(r"([0-9a-fA-F]{64})(?:[ *]+(\S.*))?", line.strip())
        if match and (match[2] or name).rpartition("/")[2] == name:
            return match[1].lower()
    return None


def expand(image: Path, copy: Path, expected_sum: Checksum | None, tell: Callable[[int, int], None]) -> UnpackedImage:
    """Make the working copy; `tell` receives bytes read and total bytes. Raises ImageError."""
    try:
        with image.open("rb") as file, copy.open("xb") as out:
            copy.chmod(0o600)
            reader = _HashingReader(file, image.stat().st_size, tell)
            writer = _Sparse(out, _read_block_map(image))
            _unpack_image(image, reader, writer)
            reader.drain()
            size = writer.finish(image)
    except OSError as error:
        raise ImageError(
            f"{arg(image)} cannot be unpacked to {arg(copy.parent)}: {arg(error.strerror or error)}",
            hint="the unpacked image needs space there; to use another place: TMPDIR=/some/directory provision …",
        ) from error
    if expected_sum is not None and reader.hexdigest() != expected_sum.sha256:
        raise ImageError(
            f"{arg(image)}: its SHA-256 is {arg(reader.hexdigest())}, but {arg(expected_sum.told_by)} says "
            f"{arg(expected_sum.sha256)}",
            hint="the file is damaged or a different one: download it again",
        )
    told_by = expected_sum.told_by if expected_sum else ""
    return UnpackedImage(copy, size, reader.hexdigest(), told_by, writer.spans)


class _HashingReader(io.RawIOBase):
    """Reader of the vendor's file that hashes and counts its bytes."""

    def __init__(self, file: IO[bytes], size: int, tell: Callable[[int, int], None]) -> None:
        self._file = file
        self._size = size
        self._tell = tell
        self._sha256 = hashlib.sha256()
        self._done = 0
        self.start = file.read(512)
        file.seek(0)

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: object) -> int:
        view = cast("memoryview", buffer)
        data = self._file.read(len(view))
        view[: len(data)] = data
        self._sha256.update(data)
        self._done += len(data)
        self._tell(self._done, self._size)
        return len(data)

    def drain(self) -> None:
        """Read the bytes that a decompressor left: the checksum covers the whole file."""
        while self.read(_CHUNK):
            pass

    def hexdigest(self) -> str:
        return self._sha256.hexdigest()


def _unpack_image(image: Path, reader: _HashingReader, out: _Sparse) -> None:
    for magic, name, tool in _OTHERS:
        if reader.start.startswith(magic):
            raise ImageError(
                f"{arg(image)} is packed with {arg(name)}", hint=f"unpack it first: {arg(tool)} {arg(image.name)}"
            )
    buffer = io.BufferedReader(reader, _CHUNK)
    plain: IO[bytes] = buffer
    if reader.start.startswith(b"\xfd7zXZ\x00"):
        plain = cast("IO[bytes]", lzma.LZMAFile(buffer))  # noqa: SIM115 - the buffer is not ours to close
    elif reader.start.startswith(b"\x1f\x8b"):
        plain = cast("IO[bytes]", gzip.GzipFile(fileobj=buffer))
    try:
        while chunk := plain.read(_CHUNK):
            out.write(chunk)
    except (EOFError, lzma.LZMAError, gzip.BadGzipFile, zlib.error) as error:
        raise ImageError(
            f"{arg(image)} is damaged or was not downloaded completely: {arg(error)}", hint="download it again"
        ) from error
    finally:
        while buffer.read(_CHUNK):  # what was read ahead is in the checksum already
            pass


def _read_block_map(image: Path) -> Bmap | None:
    place = find_block_map(image)
    return read(place) if place is not None else None


class _Sparse:
    """Sparse writer of the working copy: zeros, and ranges outside the block map, become holes."""

    def __init__(self, file: IO[bytes], block_map: Bmap | None) -> None:
        self._file = file
        self._map = block_map
        self._at = 0
        self._rest = list(block_map.ranges) if block_map else []
        self._digest = hashlib.new(block_map.algorithm) if block_map else None

    @property
    def spans(self) -> tuple[tuple[int, int], ...] | None:
        """Byte ranges that matter; None: all."""
        return None if self._map is None else tuple((each.start, each.end) for each in self._map.ranges)

    def write(self, data: bytes) -> None:
        """Write the next bytes of the image."""
        for start in range(0, len(data), _PIECE):
            piece = data[start : start + _PIECE]
            if self._map is None:
                self._write_nonzero(self._at, piece)
            else:
                self._put_mapped(piece)
            self._at += len(piece)

    def _write_nonzero(self, at: int, piece: bytes) -> None:
        if piece != (_ZEROS if len(piece) == _PIECE else bytes(len(piece))):
            self._file.seek(at)
            self._file.write(piece)

    def _put_mapped(self, piece: bytes) -> None:
        end = self._at + len(piece)
        while self._rest and self._rest[0].start < end:
            mapped_range = self._rest[0]
            start, stop = max(mapped_range.start, self._at), min(mapped_range.end, end)
            part = piece[start - self._at : stop - self._at]
            self._write_nonzero(start, part)
            if self._digest is not None:
                self._digest.update(part)
            if mapped_range.end > end:
                return
            self._end_range(mapped_range)

    def _end_range(self, mapped_range: MappedRange) -> None:
        self._rest.pop(0)
        if self._map is None or self._digest is None:
            return
        if mapped_range.digest and self._digest.hexdigest() != mapped_range.digest:
            raise ImageError(
                f"bytes {arg(mapped_range.start)} to {arg(mapped_range.end)} of the image do not match its block map",
                hint="the image or its .bmap file is damaged: download both again",
            )
        self._digest = hashlib.new(self._map.algorithm)

    def finish(self, image: Path) -> int:
        """Extend the copy to its full length; return the image's length."""
        if self._map is not None and self._map.size != self._at:
            raise ImageError(
                f"{arg(image)} has {arg(self._at)} bytes, but its block map says {arg(self._map.size)}",
                hint="the image is incomplete, or the .bmap file belongs to another one",
            )
        self._file.truncate(-(-self._at // _PADDING) * _PADDING)
        return self._at


_ALIGN = 4096
Span = tuple[int, int]
"""First byte, and the byte after the last one."""


class SourceKind(Enum):
    """Content of a segment."""

    DATA = auto()
    ZERO = auto()
    """Zeros that must be on the card, so that no earlier data of the card remains there."""


@dataclass(frozen=True, slots=True)
class Segment:
    """A byte range of an image that a card must hold."""

    start: int
    end: int
    kind: SourceKind

    @property
    def size(self) -> int:
        """Size in bytes."""
        return self.end - self.start


def segments(image: Path, size: int, spans: Iterable[Span] | None = None) -> tuple[Segment, ...]:
    """Return the segments of a sparse image file, in order, without overlap.

    A hole of the file counts as zeros. With `spans` (of a bmap file) a hole outside them does not matter and has no
    segment; data that customising wrote there still counts. On a file system without holes, everything is data.
    """
    data = _merge_spans(_data(image, size), size)
    relevant_spans = [(0, size)] if spans is None else _merge_spans([*spans, *data], size)
    result = [Segment(start, end, SourceKind.DATA) for start, end in data]
    result += [Segment(start, end, SourceKind.ZERO) for start, end in _without(relevant_spans, data)]
    return tuple(sorted(result, key=lambda each: each.start))


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


def _merge_spans(spans: Iterable[Span], size: int) -> list[Span]:
    """Align spans to 4 KiB blocks (except the end of the image), sort them, and join adjacent ones."""
    result: list[Span] = []
    for start, end in sorted(spans):
        first, last = start // _ALIGN * _ALIGN, min(-(-end // _ALIGN) * _ALIGN, size)
        if result and first <= result[-1][1]:
            result[-1] = (result[-1][0], max(result[-1][1], last))
        elif first < last:
            result.append((first, last))
    return result


def _without(spans: Iterable[Span], excluded_spans: Iterable[Span]) -> Iterator[Span]:
    """Yield the spans without the excluded ones; both are sorted and joined."""
    rest = list(excluded_spans)
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
