"""A machine's disk: the shared tree below, and what the machine writes above it, in memory and of a size of its own."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.lab._programs import program

if TYPE_CHECKING:
    from pathlib import Path

__all__ = ["Disk"]

_MB = 1024 * 1024


class Disk:
    """Mounted at `root` until it is thrown away; what was written outlives the machine's power, not the yard."""

    def __init__(self, folder: Path, tree: Path, size_mb: int | None) -> None:
        self.root = folder / "root"
        self._memory = folder / "disk"
        self._size = "50%" if size_mb is None else f"{size_mb * _MB}"
        for made in (self.root, self._memory):
            made.mkdir(parents=True)
        program("mount", "-t", "tmpfs", "-o", f"size={self._size},mode=0755", "atlantis", str(self._memory))
        upper, work = self._memory / "upper", self._memory / "work"
        upper.mkdir()
        work.mkdir()
        layers = f"lowerdir={tree.resolve()},upperdir={upper},workdir={work}"
        program("mount", "-t", "overlay", "-o", layers, "atlantis", str(self.root))

    def fill(self, leave_kb: int) -> None:
        """Make it as small as what is on it, and this much more."""
        there = os.statvfs(self._memory)
        used = (there.f_blocks - there.f_bfree) * there.f_frsize
        self._resize(f"{used + leave_kb * 1024}")

    def free(self) -> None:
        """Give it its size back."""
        self._resize(self._size)

    def _resize(self, size: str) -> None:
        program("mount", "-o", f"remount,size={size}", str(self._memory))
