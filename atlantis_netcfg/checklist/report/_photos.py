"""Photos that are evidence, reduced to a size for a report; other files are only named, with their SHA-256.

A telephone's photo has 5 MB, and a report is sent over a satellite: large photos are reduced, and the page says so. The
evidence is the file stored beside the document; its hash is compared before anything is shown.
"""

from __future__ import annotations

import hashlib
import io
import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING

from PIL import Image, ImageOps

from atlantis_netcfg.core.messages import arg, msg

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.checklist.report.document import Document, Evidence

MAX_BYTES = 30_000_000
MAX_PIXELS = 60_000_000
"""Larger pictures are not opened."""
PLAIN_BYTES = 400_000
SIDE = 1400
"""A picture within `PLAIN_BYTES` and this many pixels each way is shown as it is; a larger one is reduced."""
ALL_BYTES = 12_000_000
"""Limit for all pictures of a page together; the others are only named."""
_QUALITY = 78
_MEDIA = {"JPEG": "image/jpeg", "PNG": "image/png", "GIF": "image/gif", "WEBP": "image/webp"}
_BESIDE = frozenset({"exif", "xmp", "photoshop", "comment", "XML:com.adobe.xmp", "Raw profile type exif"})
"""Pillow's names for data that a camera writes besides the picture."""


@dataclass(frozen=True, slots=True)
class Photo:
    """A picture as displayed on a page."""

    media: str
    data: bytes
    width: int
    height: int
    is_reduced: bool


@dataclass(frozen=True, slots=True)
class Attachment:
    """An evidence file as displayed on a page."""

    name: str
    words: str
    """Facts about it, above all its hash."""
    photo: Photo | None
    amiss: bool = False
    """Whether the file is missing, or differs from the document."""


def find_attachments(document: Document, files: Mapping[str, bytes]) -> dict[tuple[str, str | None], Attachment]:
    """Return every file that the document names, by name and SHA-256, in the order of the document."""
    values: dict[tuple[str, str | None], Attachment] = {}
    remaining_bytes = ALL_BYTES
    for evidence in (entry for item in document.items for entry in item.evidence):
        if evidence.file is not None and (evidence.file, evidence.sha256) not in values:
            picture = _build_attachment(evidence.file, evidence, files.get(evidence.file), remaining_bytes)
            remaining_bytes -= len(picture.photo.data) if picture.photo is not None else 0
            values[evidence.file, evidence.sha256] = picture
    return values


def _build_attachment(name: str, evidence: Evidence, data: bytes | None, remaining_bytes: int) -> Attachment:
    digest = f"SHA-256 {evidence.sha256}" if evidence.sha256 is not None else "without a SHA-256"
    if data is None:
        return Attachment(name, msg(f"{arg(digest)}; the file is not in the folder of this document"), None, amiss=True)
    actual_digest = hashlib.sha256(data).hexdigest()
    if evidence.sha256 is not None and evidence.sha256 != actual_digest:
        return Attachment(
            name, msg(f"{arg(digest)}; the file there is DIFFERENT, with {arg(actual_digest)}"), None, amiss=True
        )
    photo = _photo(data)
    if photo is not None and len(photo.data) > remaining_bytes:
        return Attachment(name, msg(f"{arg(digest)}; not shown, too many pictures"), None)
    smaller = "; shown reduced" if photo is not None and photo.is_reduced else ""
    return Attachment(name, msg(f"{arg(digest)}; {arg(len(data))} bytes{arg(smaller)}"), photo)


def _photo(data: bytes) -> Photo | None:
    """Return the picture; None if the data are no picture, damaged, or too large."""
    if len(data) > MAX_BYTES:
        return None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # its size is looked at below, and what is odd inside is not ours to mend
            with Image.open(io.BytesIO(data), formats=tuple(_MEDIA)) as image:
                return _photo_of(image, data) if image.width * image.height <= MAX_PIXELS else None
    except Exception:  # noqa: BLE001 - Pillow raises all sorts for damaged files; such a file is named like any other
        return None


def _photo_of(image: Image.Image, data: bytes) -> Photo:
    # A book of an earlier release has photos as the telephone made them, with the place where it stood.
    bare = not image.getexif() and _BESIDE.isdisjoint(image.info)
    small = len(data) <= PLAIN_BYTES and max(image.size) <= SIDE
    if small and bare and image.format in {"JPEG", "PNG"}:
        image.load()
        return Photo(_MEDIA[image.format], data, *image.size, is_reduced=False)
    whole = sorted(image.size)
    image.draft("RGB", (SIDE, SIDE))
    picture = ImageOps.exif_transpose(image).convert("RGB")
    picture.info.clear()  # a comment would be written again
    picture.thumbnail((SIDE, SIDE))
    buffer = io.BytesIO()
    picture.save(buffer, "JPEG", quality=_QUALITY)
    return Photo(_MEDIA["JPEG"], buffer.getvalue(), *picture.size, is_reduced=sorted(picture.size) != whole)
