"""How the images of boards are laid out: data, one row a board. A new board is a row."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.image.facts import ImageRefused

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

_SECTOR = 512
_TABLE = 446
_ENTRY = struct.Struct("<B3sB3sII")
_GPT_PROTECTIVE = 0xEE
_EXT4_MAGIC = (1024 + 56, b"\x53\xef")
_BOOT_MAGIC = (510, b"\x55\xaa")


@dataclass(frozen=True, slots=True)
class Layout:
    """One kind of image."""

    name: str
    root: int | None
    """Number of the partition with `/`; None: the only one that holds ext4."""
    root_at: int | None
    """Its first byte, where every image of this kind has the same; another one is refused."""
    boot: int | None
    """Number of a FAT partition; None: there may be none."""
    marker: str
    """A file that the FAT partition of every such image holds; empty: none is known."""
    interface: str
    """The LAN's interface, where the board has one name for it; empty: the one wired card, whatever its name."""


LAYOUTS: Mapping[str, Layout] = {
    layout.name: layout
    for layout in (
        # Hardkernel's minimal images: U-Boot in the gap from sector 1, FAT at sector 2048, ext4 at sector 264192
        # (facts of the project, from public code; not seen on a board). The N2 names its one Ethernet card eth0.
        Layout("odroid-n2", root=2, root_at=264192 * _SECTOR, boot=1, marker="boot.ini", interface="eth0"),
        # Whatever boots by a partition table alone: x86, Raspberry-type boards.
        Layout("plain", root=None, root_at=None, boot=None, marker="", interface=""),
    )
}


@dataclass(frozen=True, slots=True)
class FatAt:
    """Where the FAT partition begins, in bytes."""

    offset: int


@dataclass(frozen=True, slots=True)
class Places:
    """What was found in one image."""

    root: int
    """First byte of the ext4 file system with `/`."""
    boot: FatAt | None


def find(image: Path, layout: Layout) -> Places:
    """Look into an image's partition table. Raises ImageRefused where the image is not of that layout."""
    with image.open("rb") as file:
        starts = _partitions(file.read(_SECTOR * 34))
        ext4 = [number for number, at in starts.items() if _has(file.seek(at) and file.read(2048), _EXT4_MAGIC)]
        fat = [number for number, at in starts.items() if _is_fat(file.seek(at) and file.read(_SECTOR))]
    root = layout.root if layout.root is not None else _only(ext4)
    if root not in ext4:
        raise _other(layout, f"its partition {root} holds no ext4")
    if layout.root_at is not None and starts[root] != layout.root_at:
        raise _other(layout, f"its partition {root} begins at byte {starts[root]}, not at {layout.root_at}")
    if layout.boot is not None and layout.boot not in fat:
        raise _other(layout, f"its partition {layout.boot} holds no FAT")
    boot = layout.boot if layout.boot is not None else next(iter(fat), None)
    return Places(starts[root], None if boot is None else FatAt(starts[boot]))


def _other(layout: Layout, why: str) -> ImageRefused:
    return ImageRefused(
        f"the image is not of layout `{layout.name}`: {why}",
        hint=f"take the image of that board, or declare another `layout`: {', '.join(LAYOUTS)}",
    )


def _only(ext4: list[int]) -> int:
    if len(ext4) != 1:
        found = f"partitions {', '.join(map(str, ext4))} do" if ext4 else "none does"
        raise ImageRefused(
            f"one partition of the image must hold ext4, and {found}", hint="declare the board's `layout`"
        )
    return ext4[0]


def _partitions(start: bytes) -> dict[int, int]:
    """First bytes of the partitions by number, of an MBR (primary ones) or a GPT (UEFI 2.10, 5.3)."""
    if not _has(start, _BOOT_MAGIC):
        raise ImageRefused("the image holds no partition table", hint="is it an image of a whole card?")
    rows = [_ENTRY.unpack_from(start, _TABLE + _ENTRY.size * row) for row in range(4)]
    if not any(row[2] == _GPT_PROTECTIVE for row in rows):
        return {number: row[4] * _SECTOR for number, row in enumerate(rows, 1) if row[2] and row[4]}
    if start[_SECTOR : _SECTOR + 8] != b"EFI PART":
        raise ImageRefused("the GPT of the image is damaged", hint="fetch it again")
    where, count, size = struct.unpack_from("<QII", start, _SECTOR + 72)
    found = {}
    for row in range(min(count, 128)):
        at = where * _SECTOR + row * size
        if any(start[at : at + 16]):
            found[row + 1] = struct.unpack_from("<Q", start, at + 32)[0] * _SECTOR
    return found


def _has(data: bytes | int, magic: tuple[int, bytes]) -> bool:
    at, desired = magic
    return isinstance(data, bytes) and data[at : at + len(desired)] == desired


def _is_fat(sector: bytes | int) -> bool:
    return isinstance(sector, bytes) and (sector[54:57] == b"FAT" or sector[82:87] == b"FAT32")
