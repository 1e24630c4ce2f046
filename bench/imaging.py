"""`python -m bench.imaging`: writing and reading back an image, by us and by `dd` and `cmp`, on one loop device.

Both write the same image to a card that is full of old data and to one that is empty, and both read it back past the
page cache. The loop device is as fast as this computer's disk: a real card is slower, and what we do beside writing
counts less there. Needs root. A figure of one machine, not a test.
"""

from __future__ import annotations

import argparse
import random
import resource
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from atlantis_netcfg.computers.image.blocks import BlockDevice, BlockTree, DeviceBus
from atlantis_netcfg.computers.image.source import segments
from atlantis_netcfg.computers.image.writer import Card, write

if TYPE_CHECKING:
    from collections.abc import Iterator

_MIB = 2**20


class _AsCard(BlockTree):
    """The kernel's tree, in which the loop device of this bench is a card: the product has no such door."""

    def disk(self, path: Path) -> BlockDevice:
        return replace(super().disk(path), bus=DeviceBus.USB)


def main() -> int:
    """Print seconds and the ratio (more than 1: we are quicker)."""
    given = _parser().parse_args()
    with tempfile.TemporaryDirectory(prefix="bench-imaging-", dir=given.place) as name:
        folder = Path(name)
        image = _image(folder / "image", given.size * _MIB, given.data)
        for old in ("old data", "empty"):
            theirs = min(_dd(folder, image, old) for _ in range(given.runs))
            ours = min(_ours(folder, image, old) for _ in range(given.runs))
            ratio = theirs / ours
            print(f"card with {old:<9} dd and cmp {theirs:6.2f} s   ours {ours:6.2f} s   throughput {ratio:.2f} of dd")
    print(f"our memory at its most: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m bench.imaging", description=__doc__)
    parser.add_argument("--size", type=int, default=1024, help="of the image in MiB")
    parser.add_argument("--data", type=float, default=0.4, help="share of it that is not zero")
    parser.add_argument("--runs", type=int, default=3, help="the best of so many counts")
    parser.add_argument("--place", default="/var/tmp", help="where image and card are kept")  # noqa: S108 - a private directory is made in it
    return parser


def _image(path: Path, size: int, share: float) -> Path:
    dice = random.Random(1)  # noqa: S311 - the same image each time
    with path.open("wb") as file:
        for at in range(0, size, 16 * _MIB):
            file.seek(at)
            file.write(dice.randbytes(int(16 * _MIB * share) // 4096 * 4096))
        file.truncate(size)
    return path


@contextmanager
def _card(folder: Path, image: Path, old: str) -> Iterator[Path]:
    file = folder / "card"
    with file.open("wb") as out:
        if old != "empty":
            for _ in range(0, image.stat().st_size, _MIB):
                out.write(b"\xa5" * _MIB)
        out.truncate(image.stat().st_size)
    subprocess.run(["/bin/sync"], check=True)
    made = ["losetup", "--direct-io=on", "--show", "-f", str(file)]
    device = subprocess.run(made, check=True, capture_output=True, text=True).stdout.strip()  # noqa: S603 - our own words
    try:
        yield Path(device)
    finally:
        subprocess.run(["losetup", "-d", device], check=True)  # noqa: S603, S607 - a tool by name
        file.unlink()


def _dd(folder: Path, image: Path, old: str) -> float:
    with _card(folder, image, old) as device:
        began = time.perf_counter()
        quiet = ["bs=4M", "status=none"]
        subprocess.run(["dd", f"if={image}", f"of={device}", "oflag=direct", "conv=fsync", *quiet], check=True)  # noqa: S603, S607 - a tool by name
        back = f"dd if={device} iflag=direct bs=4M status=none | cmp -n {image.stat().st_size} - {image}"
        subprocess.run(["sh", "-c", back], check=True)  # noqa: S603, S607 - our own words
        return time.perf_counter() - began


def _ours(folder: Path, image: Path, old: str) -> float:
    with _card(folder, image, old) as device:
        tree = _AsCard()
        card = Card(device, tree.disk(device), tree)
        began = time.perf_counter()
        write(image, segments(image, image.stat().st_size), card, lambda _progress: None)
        return time.perf_counter() - began


if __name__ == "__main__":
    sys.exit(main())
