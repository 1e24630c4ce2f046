"""Block devices as the kernel reports them: which disk, who uses it, and whether it may be written.

Only `/sys` and `/proc` are read, so that tests can use another tree. The bus is derived from the device's path in
`/sys`: the flags `removable` and `hotplug` are unreliable (an SD slot says 0, an NVMe dock 1). A refusal lists every
reason, not only the first.
"""

from __future__ import annotations

import os
import re
import stat
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from atlantis_netcfg.computers.image.facts import BlockDeviceError
from atlantis_netcfg.core.messages import arg, msg

_SECTOR = 512
"""Bytes in the unit of `/sys/block/*/size`, whatever the device's own sectors are."""
_SYSTEM = ("/boot", "/usr", "/var", "/home", "/etc", "/opt", "/srv", "/nix", "/root")


class DeviceBus(StrEnum):
    """How a disk is attached."""

    USB = "USB"
    MMC = "SD/MMC slot"
    NVME = "NVMe"
    ATA = "SATA"
    VIRTIO = "virtio"
    VIRTUAL = "no hardware (loop, RAM, LVM, RAID)"
    OTHER = "an internal bus"


@dataclass(frozen=True, slots=True)
class Use:
    """A use of the disk or of one of its parts."""

    part: str
    """Kernel name, like sdb1."""
    how: str
    """In words, like `is mounted at /media/boot`."""
    system: bool
    """Whether this computer runs from it."""


@dataclass(frozen=True, slots=True)
class BlockDevice:
    """State of a block device at one moment; two reads of the same card are equal."""

    name: str
    number: str
    """MAJOR:MINOR."""
    size: int
    """Bytes; 0: a reader without a card."""
    bus: DeviceBus
    serial: str
    """Serial number of the card (SD/MMC slot) or of the reader (USB); empty where neither has one."""
    label: str
    """Vendor and model."""
    read_only: bool
    sector: int
    """Logical sector size in bytes."""
    diskseq: int | None
    """Increases with every card that is inserted (Linux 5.15 and later)."""
    whole: str
    """The disk that this is a partition of; empty for a whole disk."""
    uses: tuple[Use, ...]

    @property
    def proof(self) -> str:
        """What a person types to confirm this disk: its serial, or name and size if it has none."""
        return self.serial or f"{self.name}-{self.size}"

    @property
    def summary(self) -> str:
        """One-line description for people."""
        label = self.label or "without a name"
        serial = msg(f"serial {arg(self.serial)}" if self.serial else "without a serial")
        return f"{self.name}: {label}, {self.size / 1e9:.1f} GB, {self.bus}, {serial}"


@dataclass(frozen=True, slots=True)
class BlockTree:
    """Kernel folders that describe block devices."""

    sys: Path = Path("/sys")
    proc: Path = Path("/proc")

    def disk(self, path: Path) -> BlockDevice:
        """Return the disk at a path. Raises BlockDeviceError if there is none."""
        number = self._device_number(path)
        place = self.sys / "dev" / "block" / number
        try:
            return self._read(place.resolve(strict=True), number)
        except (OSError, ValueError) as error:
            raise BlockDeviceError(f"{arg(path)} is gone, or cannot be read", hint="insert the card again") from error

    @staticmethod
    def _device_number(path: Path) -> str:
        try:
            status = path.stat()
        except FileNotFoundError:
            raise BlockDeviceError(
                f"{arg(path)} does not exist",
                hint="`ls -l /dev/disk/by-id` lists the disks; the card may not be inserted",
            ) from None
        except OSError as error:
            raise BlockDeviceError(f"{arg(path)}: {arg(error.strerror)}") from error
        if not stat.S_ISBLK(status.st_mode):
            raise BlockDeviceError(
                f"{arg(path)} is not a block device",
                hint="`to=` needs a disk of /dev/disk/by-id; `--image-only FILE` writes a file",
            )
        return f"{os.major(status.st_rdev)}:{os.minor(status.st_rdev)}"

    def _read(self, place: Path, number: str) -> BlockDevice:
        partition = (place / "partition").exists()
        queue = (place.parent if partition else place) / "queue"
        diskseq = _text(place / "diskseq")
        return BlockDevice(
            name=place.name,
            number=number,
            size=int(_text(place / "size")) * _SECTOR,
            bus=_bus(place.relative_to(self.sys.resolve())),
            serial=self._serial(place),
            label=_label(place),
            read_only=_text(place / "ro") == "1",
            sector=int(_text(queue / "logical_block_size") or _SECTOR),
            diskseq=int(diskseq) if diskseq else None,
            whole=place.parent.name if partition else "",
            uses=tuple(self._uses(place)),
        )

    def _serial(self, place: Path) -> str:
        """Return the serial of the nearest parent device; a USB root hub has only a controller address."""
        for above in (place, *place.parents):
            if above == self.sys.resolve() or re.fullmatch(r"usb\d+", above.name):
                return ""
            if serial := _text(above / "serial"):
                return serial
        return ""

    def _uses(self, place: Path) -> list[Use]:
        """List uses of the disk, its partitions, and devices built on them."""
        uses: list[Use] = []
        mounts, swaps = self._mounts(), self._swaps()
        rest, seen_names = [place], set[str]()
        while rest:
            part = rest.pop(0)
            if part.name in seen_names:
                continue
            seen_names.add(part.name)
            for key in (_text(part / "dev"), part.name):
                uses += [
                    Use(part.name, msg(f"is mounted at {arg(at)}"), _is_system_mount(at)) for at in mounts.get(key, ())
                ]
            if part.name in swaps:
                uses.append(Use(part.name, "is swap space", system=True))
            rest += sorted(each.parent for each in part.glob("*/partition"))
            for holder in sorted((part / "holders").glob("*")):
                uses.append(
                    Use(part.name, msg(f"is in use by {arg(holder.name)} (LVM, RAID or encryption)"), system=False)
                )
                rest.append(holder.resolve())
        return list(dict.fromkeys(uses))

    def _mounts(self) -> dict[str, list[str]]:
        """Map MAJOR:MINOR and name to mount points; btrfs shows a number of no device (proc_pid_mountinfo(5))."""
        result: dict[str, list[str]] = {}
        for line in _text(self.proc / "self" / "mountinfo").splitlines():
            before, _, after = line.partition(" - ")
            fields, lines = before.split(), after.split()
            point = re.sub(r"\\([0-7]{3})", lambda octal: chr(int(octal[1], 8)), fields[4])
            result.setdefault(fields[2], []).append(point)
            if len(lines) > 1 and lines[1].startswith("/dev/"):
                result.setdefault(Path(lines[1]).resolve().name, []).append(point)
        return result

    def _swaps(self) -> set[str]:
        lines = _text(self.proc / "swaps").splitlines()[1:]
        return {Path(line.split()[0]).resolve().name for line in lines if line.strip()}


def _text(path: Path) -> str:
    """Read a kernel file; return an empty string if it does not exist."""
    try:
        return path.read_text(errors="replace").strip()
    except OSError:
        return ""


def _label(place: Path) -> str:
    parts = [_text(place / "device" / name) for name in ("vendor", "model", "name")]
    return " ".join(filter(None, parts))


def _bus(place: Path) -> DeviceBus:
    """Return the bus of a disk: NVMe behind any adapter is NVMe; a SATA disk in a USB case is USB."""
    parts = place.parts
    rows = (
        (r"nvme\d+.*", DeviceBus.NVME),
        (r"usb\d+", DeviceBus.USB),
        (r"mmc_host", DeviceBus.MMC),
        (r"ata\d+", DeviceBus.ATA),
        (r"virtio\d+", DeviceBus.VIRTIO),
        (r"virtual", DeviceBus.VIRTUAL),
    )
    return next((bus for word, bus in rows if any(re.fullmatch(word, part) for part in parts)), DeviceBus.OTHER)


def _is_system_mount(point: str) -> bool:
    return point == "/" or any(point == each or point.startswith(f"{each}/") for each in _SYSTEM)


_CARDS = frozenset({DeviceBus.USB, DeviceBus.MMC})
"""Buses of cards and of card readers."""
_MOST = 512 * 10**9
"""Bytes. No card of a gateway is larger; disks with backups are."""
_BY_ID = "name the card by its link in /dev/disk/by-id, and unmount what is on it"


def write_objections(disk: BlockDevice, image_size: int = 0) -> tuple[str, ...]:
    """Return why the disk must not be written with an image of that size in bytes; empty if it may."""
    if disk.whole:
        return (msg(f"{arg(disk.name)} is a partition of {arg(disk.whole)}: an image needs the whole disk"),)
    objections = [msg(f"this computer runs from it: {arg(use.part)} {arg(use.how)}") for use in disk.uses if use.system]
    objections += [f"{use.part} {use.how}" for use in disk.uses if not use.system]
    if disk.bus not in _CARDS:
        objections.append(msg(f"it is not removable (bus {arg(disk.bus)}); cards are on USB or in an SD/MMC slot"))
    if disk.read_only:
        objections.append("it is write-protected")
    if disk.size == 0:
        objections.append("there is no card in the reader")
    elif disk.size > _MOST:
        objections.append(
            msg(
                f"it has {arg(disk.size / 1000000000.0):.0f} GB, but no card of a gateway has more than "
                f"{arg(_MOST / 1000000000.0):.0f}"
            )
        )
    elif disk.size < image_size:
        objections.append(msg(f"it has {arg(disk.size)} bytes, but the image needs {arg(image_size)}"))
    return tuple(objections)


def require_writable_disk(tree: BlockTree, path: Path, image_size: int = 0) -> BlockDevice:
    """Return the disk at a path if it may be written. Raises BlockDeviceError with all reasons."""
    disk = tree.disk(path)
    if why := write_objections(disk, image_size):
        lines = "".join(f"\n  {each}" for each in why)
        raise BlockDeviceError(f"{arg(path)} is refused, and nothing was written:{arg(lines)}", hint=_BY_ID)
    return disk


def require_same_disk(tree: BlockTree, path: Path, expected_disk: BlockDevice, image_size: int = 0) -> None:
    """Raise BlockDeviceError if the path no longer leads to the disk that was shown."""
    disk = require_writable_disk(tree, path, image_size)
    rows = (
        ("kernel's name", expected_disk.name, disk.name),
        ("device number", expected_disk.number, disk.number),
        ("serial", expected_disk.serial, disk.serial),
        ("size", expected_disk.size, disk.size),
        ("sequence number", expected_disk.diskseq, disk.diskseq),
        ("model", expected_disk.label, disk.label),
    )
    if changes := [
        msg(f"\n  its {arg(what)} was {arg(was)} and is {arg(became)}") for what, was, became in rows if was != became
    ]:
        raise BlockDeviceError(
            f"{arg(path)} has changed since it was shown, and nothing was written:{arg(''.join(changes))}",
            hint="check which card is inserted, then run the same command again",
        )


def require_confirmation(disk: BlockDevice, answer: str) -> None:
    """Raise BlockDeviceError if a person's answer does not identify the disk."""
    if answer.strip() != disk.proof:
        what = "serial" if disk.serial else "name and size (it has no serial)"
        raise BlockDeviceError(
            f"`{arg(answer.strip())}` is not the {arg(what)} of {arg(disk.name)}, and nothing was written",
            hint=f"read it from the card or its reader; the kernel reports {arg(disk.proof)}",
        )
