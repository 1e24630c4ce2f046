"""Every refusal, on trees of /sys and /proc as the kernel shows them; the device node is only looked at."""

import os
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from blocks_fake import DOCK, LOOP, NVME, SATA, SLOT, USB, FakeDisk, Tree

from atlantis_netcfg.computers.image.blocks import (
    BlockTree,
    DeviceBus,
    require_confirmation,
    require_same_disk,
    require_writable_disk,
)
from atlantis_netcfg.computers.image.facts import BlockDeviceError
from atlantis_netcfg.core.errors import ExitCode

NODE = Path("/dev/loop0")
"""A block device of number 7:0, which the tree shows as the disk in question; nothing is read from it."""


def usual(tree: Tree) -> FakeDisk:
    return tree.disk().serial("20090516388200")


def _mounted(tree: Tree, point: str) -> None:
    usual(tree).partition("sdb1", "8:17")
    tree.mount("8:17", point, "/dev/sdb1")


def _held(tree: Tree) -> None:
    part = usual(tree).partition("sdb2", "8:18")
    holder = tree.disk("253:0", "dm-0", LOOP)
    (part / "holders" / "dm-0").symlink_to(holder.place)
    tree.mount("253:0", "/srv/data", "/dev/mapper/vg-data")


def _swap(tree: Tree) -> None:
    usual(tree).partition("sdb3", "8:19")
    tree.swap("/dev/sdb3")


def _btrfs(tree: Tree) -> None:
    usual(tree).partition("sdb1", "8:17")
    tree.mount("0:45", "/mnt/with\\040blank", "/dev/sdb1")


def _partition(tree: Tree) -> None:
    (tree.sys / "dev" / "block" / "7:0").unlink(missing_ok=True)
    disk = tree.disk("8:16")
    disk.partition("sdb1", "7:0")


CASES: dict[str, tuple[Callable[[Tree], object], str]] = {
    "system": (lambda tree: _mounted(tree, "/boot/efi"), r"this computer runs from it: sdb1 is mounted at /boot/efi"),
    "mounted": (lambda tree: _mounted(tree, "/media/me/BOOT"), r"sdb1 is mounted at /media/me/BOOT"),
    "btrfs": (_btrfs, r"sdb1 is mounted at /mnt/with blank"),
    "swap": (_swap, r"this computer runs from it: sdb3 is swap space"),
    "held": (_held, r"sdb2 is in use by dm-0.*"),
    "held and mounted": (_held, r"this computer runs from it: dm-0 is mounted at /srv/data"),
    "sata": (lambda tree: tree.disk(bus=SATA), r"it is not removable \(bus SATA.*"),
    "nvme": (lambda tree: tree.disk(bus=NVME), r"it is not removable \(bus NVMe.*"),
    "nvme in a dock": (lambda tree: tree.disk(bus=DOCK), r"it is not removable \(bus NVMe.*"),
    "loop": (lambda tree: tree.disk(bus=LOOP), r"it is not removable \(bus no hardware.*"),
    "write-protected": (lambda tree: usual(tree).say(ro="1"), r"it is write-protected"),
    "no card": (lambda tree: tree.disk(size=0), r"there is no card in the reader"),
    "too small": (lambda tree: tree.disk(size=10**6), r"it has 999936 bytes, but the image needs 1000000000"),
    "backup disk": (lambda tree: tree.disk(size=2 * 10**12), r"it has 2000 GB.*"),
    "partition": (_partition, r"sdb1 is a partition of sdb.*"),
}


@pytest.mark.parametrize("name", CASES)
def test_unsuitable_disk_is_refused_with_the_reason(name: str, tmp_path: Path) -> None:
    tree = Tree(tmp_path)
    make, said = CASES[name]
    make(tree)
    with pytest.raises(BlockDeviceError) as caught:
        require_writable_disk(tree.blocks, NODE, 10**9)
    assert caught.value.exit is ExitCode.USAGE
    head, *why = str(caught.value).splitlines()
    assert head == "/dev/loop0 is refused, and nothing was written:"
    assert any(re.fullmatch(said, line.strip()) for line in why), why


def test_all_reasons_are_reported_together(tmp_path: Path) -> None:
    tree = Tree(tmp_path)
    disk = tree.disk(bus=SATA, size=10**6)
    disk.say(ro="1")
    tree.mount("7:0", "/", "/dev/root")
    with pytest.raises(BlockDeviceError) as caught:
        require_writable_disk(tree.blocks, NODE, 10**9)
    assert len(str(caught.value).splitlines()) == 5


@pytest.mark.parametrize(
    ("bus", "serial", "kind"),
    [(USB, "20090516388200", DeviceBus.USB), (SLOT, "0x5f2b1c3d", DeviceBus.MMC), (USB, "", DeviceBus.USB)],
)
def test_card_is_accepted(bus: str, serial: str, kind: DeviceBus, tmp_path: Path) -> None:
    tree = Tree(tmp_path)
    disk = tree.disk(bus=bus)
    if serial:
        disk.serial(serial)
    found = require_writable_disk(tree.blocks, NODE, 10**9)
    assert (found.bus, found.serial, found.size, found.diskseq) == (kind, serial, 8 * 10**9, 7)
    assert found.proof == (serial or "sdb-8000000000")
    require_confirmation(found, f" {found.proof}\n")


def test_a_wrong_serial_is_refused(tmp_path: Path) -> None:
    tree = Tree(tmp_path)
    usual(tree)
    with pytest.raises(BlockDeviceError, match="`yes` is not the serial of sdb, and nothing was written"):
        require_confirmation(require_writable_disk(tree.blocks, NODE), "yes")


def test_a_plain_file_and_a_missing_path_are_refused(tmp_path: Path) -> None:
    tree = Tree(tmp_path)
    file = tmp_path / "sdb"
    file.write_bytes(b"kept")
    with pytest.raises(BlockDeviceError, match="is not a block device"):
        require_writable_disk(tree.blocks, file)
    with pytest.raises(BlockDeviceError, match="sdx does not exist"):
        require_writable_disk(tree.blocks, tmp_path / "sdx")
    assert file.read_bytes() == b"kept"
    assert not (tmp_path / "sdx").exists()


def test_a_device_that_the_kernel_does_not_know_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BlockDeviceError, match="is gone, or cannot be read"):
        require_writable_disk(Tree(tmp_path).blocks, NODE)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda disk: disk.say(diskseq="8"), "its sequence number was 7 and is 8"),
        (lambda disk: disk.say(size="2000000"), "its size was 8000000000 and is 1024000000"),
        (lambda disk: disk.serial("another"), "its serial was 20090516388200 and is another"),
    ],
    ids=["swapped", "size", "serial"],
)
def test_a_device_that_has_changed_is_refused(change: Callable[[FakeDisk], object], said: str, tmp_path: Path) -> None:
    tree = Tree(tmp_path)
    disk = usual(tree)
    shown = require_writable_disk(tree.blocks, NODE)
    require_same_disk(tree.blocks, NODE, shown, 10**9)
    change(disk)
    with pytest.raises(BlockDeviceError) as caught:
        require_same_disk(tree.blocks, NODE, shown, 10**9)
    assert said in str(caught.value)
    assert "nothing was written" in str(caught.value)


def test_the_disk_that_this_computer_runs_from_is_refused() -> None:
    """The real trees: whatever carries `/var/tmp` here, if it is a disk at all, may not be written."""
    disks = [path for path in Path("/sys/block").iterdir() if (path / "dev").exists()]
    admitted = []
    for path in disks:
        node = Path("/dev") / path.name
        if node.is_block_device():
            try:
                admitted.append(require_writable_disk(BlockTree(), node).name)
            except BlockDeviceError:
                continue
    uses = {name: BlockTree().disk(Path("/dev") / name).uses for name in admitted}
    assert all(use == () for use in uses.values())
    assert not any(name.startswith(("loop", "vd", "nvme", "dm-", "md")) for name in admitted)
    number = Path("/var/tmp").stat().st_dev  # noqa: S108 - where this computer's system lies
    place = Path(f"/sys/dev/block/{os.major(number)}:{os.minor(number)}")
    if place.exists():  # else: a file system without a disk, as in a container
        part = place.resolve()
        system = part.parent if (part / "partition").exists() else part
        with pytest.raises(BlockDeviceError):
            require_writable_disk(BlockTree(), Path("/dev") / system.name)
