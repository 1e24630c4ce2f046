"""Which disks may be written. Every reason to refuse is told, not only the first."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.image._errors import DeviceRefused
from atlantis_netcfg.image.blocks import Bus

if TYPE_CHECKING:
    from pathlib import Path

    from atlantis_netcfg.image.blocks import BlockTree, Disk

__all__ = ["admit", "confirmed", "reasons", "same"]

_CARDS = frozenset({Bus.USB, Bus.MMC})
"""The buses on which cards and their readers are."""
_MOST = 512 * 10**9
"""Bytes. No card of a gateway is larger; disks with somebody's backups are."""
_BY_ID = "name the card by its link in /dev/disk/by-id, and unmount what is on it"


def reasons(disk: Disk, needed: int = 0) -> tuple[str, ...]:
    """Why the disk must not be written with an image of so many bytes; empty where it may."""
    if disk.whole:
        return (f"{disk.name} is a partition of {disk.whole}: an image wants the whole disk",)
    found = [f"this computer runs from it: {use.part} {use.how}" for use in disk.uses if use.system]
    found += [f"{use.part} {use.how}" for use in disk.uses if not use.system]
    if disk.bus not in _CARDS:
        found.append(f"it is not removable: its bus is {disk.bus}, and cards are on USB or in an SD/MMC slot")
    if disk.read_only:
        found.append("it is write-protected")
    if disk.size == 0:
        found.append("there is no card in the reader")
    elif disk.size > _MOST:
        found.append(f"it has {disk.size / 1e9:.0f} GB, and no card of a gateway has more than {_MOST / 1e9:.0f}")
    elif disk.size < needed:
        found.append(f"it has {disk.size} bytes, and the image needs {needed}")
    return tuple(found)


def admit(tree: BlockTree, path: Path, needed: int = 0) -> Disk:
    """The disk at a path, if it may be written. Raises DeviceRefused with all reasons."""
    disk = tree.disk(path)
    if why := reasons(disk, needed):
        lines = "".join(f"\n  {each}" for each in why)
        raise DeviceRefused(f"{path} is refused, and nothing was written:{lines}", hint=_BY_ID)
    return disk


def same(tree: BlockTree, path: Path, shown: Disk, needed: int = 0) -> None:
    """Hold that the path still leads to the disk that was shown. Raises DeviceRefused."""
    disk = admit(tree, path, needed)
    rows = (
        ("kernel's name", shown.name, disk.name),
        ("device number", shown.number, disk.number),
        ("serial", shown.serial, disk.serial),
        ("size", shown.size, disk.size),
        ("sequence number", shown.diskseq, disk.diskseq),
        ("model", shown.label, disk.label),
    )
    if changed := [f"\n  its {what} was {was} and is {became}" for what, was, became in rows if was != became]:
        raise DeviceRefused(
            f"{path} has changed since it was shown, and nothing was written:{''.join(changed)}",
            hint="look at which card is in, then type the same again",
        )


def confirmed(disk: Disk, typed: str) -> None:
    """Hold a person's word to the disk that was shown. Raises DeviceRefused."""
    if typed.strip() != disk.proof:
        what = "serial" if disk.serial else "name and size (it has no serial)"
        raise DeviceRefused(
            f"`{typed.strip()}` is not the {what} of {disk.name}, and nothing was written",
            hint=f"read it from the card or its reader; the kernel says {disk.proof}",
        )
