"""Block maps beside an image: which blocks of it matter, with a checksum of each range.

Format: bmap-tools, versions 1.3 to 2.0 (XML; `BmapFileChecksum` is taken over the file with that checksum as zeros).
"""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

from atlantis_netcfg.image._errors import ImageRefused

if TYPE_CHECKING:
    from pathlib import Path

__all__ = ["Bmap", "MappedRange", "beside", "read"]

_MOST = 16 * 2**20
"""Bytes of a map file that is still read."""
_HINT = "fetch it again, or move it away: without it every block of the image is written"


@dataclass(frozen=True, slots=True)
class MappedRange:
    """Bytes that matter, and their checksum in hex; empty where the map has none."""

    start: int
    end: int
    digest: str


@dataclass(frozen=True, slots=True)
class Bmap:
    """A block map."""

    size: int
    """Of the image, in bytes."""
    algorithm: str
    """As hashlib names it."""
    ranges: tuple[MappedRange, ...]


def beside(image: Path) -> Path | None:
    """The map that lies beside an image: `x.img.bmap`, or `x.img.xz.bmap`, for `x.img.xz`."""
    names = dict.fromkeys((f"{image.name}.bmap", f"{image.name.removesuffix('.xz').removesuffix('.gz')}.bmap"))
    return next((image.with_name(name) for name in names if image.with_name(name).is_file()), None)


def read(path: Path) -> Bmap:
    """Read a map. Raises ImageRefused where it is damaged or not understood."""
    if path.stat().st_size > _MOST:
        raise ImageRefused(f"{path}: too large for a block map", hint=_HINT)
    text = path.read_bytes()
    try:
        return _understood(text)
    except (ValueError, ET.ParseError) as error:
        raise ImageRefused(f"{path}: damaged or no block map: {error}", hint=_HINT) from error


def _understood(text: bytes) -> Bmap:
    if b"<!DOCTYPE" in text or b"<!ENTITY" in text:
        raise ValueError("it declares entities")
    root = ET.fromstring(text)  # noqa: S314 - bounded in size, and entities are refused above
    algorithm = (root.findtext("ChecksumType") or "sha256").strip().lower()
    if algorithm not in {"sha256", "sha512"}:
        raise ValueError(f"checksums by `{algorithm}` are not known")
    _hold(text, (root.findtext("BmapFileChecksum") or "").strip(), algorithm)
    block, size = int(root.findtext("BlockSize") or ""), int(root.findtext("ImageSize") or "")
    if root.tag != "bmap" or block <= 0 or size <= 0:
        raise ValueError("it has no sizes")
    return Bmap(size, algorithm, tuple(_range(element, block, size) for element in root.iterfind("BlockMap/Range")))


def _hold(text: bytes, digest: str, algorithm: str) -> None:
    if digest and hashlib.new(algorithm, text.replace(digest.encode(), b"0" * len(digest))).hexdigest() != digest:
        raise ValueError("its own checksum is wrong")


def _range(element: ET.Element, block: int, size: int) -> MappedRange:
    if not (found := re.fullmatch(r"\s*(\d+)(?:\s*-\s*(\d+))?\s*", element.text or "")):
        raise ValueError(f"`{element.text}` is no range")
    first = int(found[1])
    last = int(found[2]) if found[2] else first
    if last < first or first * block >= size:
        raise ValueError(f"the range {first}-{last} is not in the image")
    return MappedRange(first * block, min((last + 1) * block, size), element.get("chksum") or "")
