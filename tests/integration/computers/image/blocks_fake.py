"""A tree of /sys and /proc as the kernel shows it, for disks that this machine does not have.

A loop device can be shown as a card in a USB reader: the guard itself stays as it is, and sees what a person with
such a reader would have.
"""

import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from atlantis_netcfg.computers.image.blocks import BlockTree

USB = "pci0000:00/0000:00:14.0/usb1/1-2/1-2:1.0/host4/target4:0:0/4:0:0:0"
SLOT = "platform/sdhci/mmc_host/mmc0/mmc0:aaaa"
SATA = "pci0000:00/0000:00:17.0/ata1/host0/target0:0:0/0:0:0:0"
NVME = "pci0000:00/0000:01:00.0/nvme/nvme0"
DOCK = "pci0000:00/0000:00:1c.0/usb2/2-1/nvme/nvme1"
LOOP = "virtual"


@dataclass
class FakeDisk:
    """One disk; what is not said is as a usual card has it."""

    tree: "Tree"
    number: str
    name: str
    bus: str
    size: int
    place: Path = field(init=False)

    def __post_init__(self) -> None:
        self.place = self.tree.sys / "devices" / self.bus / "block" / self.name
        (self.place / "queue").mkdir(parents=True)
        (self.place / "holders").mkdir()
        (self.place / "device").mkdir()
        self.say(dev=self.number, size=str(self.size // 512), ro="0", removable="1", diskseq="7")
        (self.place / "queue" / "logical_block_size").write_text("512\n")
        self.tree.link(self.number, self.place)
        if self.bus == USB:
            (self.tree.sys / "devices" / "pci0000:00/0000:00:14.0/usb1" / "serial").write_text("0000:00:14.0\n")

    def say(self, **files: str) -> None:
        for name, text in files.items():
            (self.place / name).write_text(f"{text}\n")

    def serial(self, text: str) -> "FakeDisk":
        above = self.place.parents[5] if self.bus == USB else self.place.parents[1]
        (above / "serial").write_text(f"{text}\n")
        return self

    def partition(self, name: str, number: str) -> Path:
        part = self.place / name
        (part / "holders").mkdir(parents=True)
        (part / "partition").write_text("1\n")
        (part / "dev").write_text(f"{number}\n")
        (part / "size").write_text("2048\n")
        (part / "ro").write_text("0\n")
        self.tree.link(number, part)
        return part


class Tree:
    """The files; `blocks` reads them."""

    def __init__(self, folder: Path) -> None:
        self.sys, self.proc = folder / "sys", folder / "proc"
        (self.sys / "dev" / "block").mkdir(parents=True)
        (self.proc / "self").mkdir(parents=True)
        self.mounts = [("0:22", "/proc", "proc"), ("254:0", "/", "/dev/root")]
        self.swaps: list[str] = []
        self.write()

    @property
    def blocks(self) -> BlockTree:
        return BlockTree(self.sys, self.proc)

    def link(self, number: str, place: Path) -> None:
        (self.sys / "dev" / "block" / number).symlink_to(place)

    def disk(self, number: str = "7:0", name: str = "sdb", bus: str = USB, size: int = 8 * 10**9) -> FakeDisk:
        return FakeDisk(self, number, name, bus, size // 512 * 512)

    def mount(self, number: str, point: str, source: str) -> None:
        self.mounts.append((number, point, source))
        self.write()

    def swap(self, source: str) -> None:
        self.swaps.append(source)
        self.write()

    def write(self) -> None:
        rows = [
            f"{20 + row} 1 {number} / {point} rw,relatime shared:1 - ext4 {source} rw\n"
            for row, (number, point, source) in enumerate(self.mounts)
        ]
        (self.proc / "self" / "mountinfo").write_text("".join(rows))
        swaps = [f"{source} partition 1048572 0 -2\n" for source in self.swaps]
        (self.proc / "swaps").write_text("".join(["Filename Type Size Used Priority\n", *swaps]))


@dataclass
class LoopCard:
    """A loop device, and the file behind it."""

    device: Path
    file: Path
    number: str


@contextmanager
def loop(file: Path, size: int, fill: bytes = b"") -> Iterator[LoopCard]:
    """A loop device of so many bytes, full of what was there before."""
    if os.geteuid() != 0:
        pytest.skip("making a loop device needs root")
    with file.open("wb") as out:
        if fill:
            piece = (fill * (2**20 // len(fill) + 1))[: 2**20]
            for at in range(0, size, 2**20):
                out.write(piece[: min(2**20, size - at)])
        out.truncate(size)
    made = subprocess.run(["losetup", "--show", "-f", str(file)], check=True, capture_output=True, text=True)
    device = Path(made.stdout.strip())
    status = device.stat().st_rdev
    try:
        yield LoopCard(device, file, f"{os.major(status)}:{os.minor(status)}")
    finally:
        subprocess.run(["losetup", "-d", str(device)], check=True)
