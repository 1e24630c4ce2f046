"""A FAT file system inside an image file, read and edited by mtools at its offset: no mount, no root."""

from __future__ import annotations

import subprocess
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.core import temporary
from atlantis_netcfg.image._errors import ImageRefused
from atlantis_netcfg.image.ext4 import tool

if TYPE_CHECKING:
    from pathlib import Path

__all__ = ["Fat"]


@dataclass(frozen=True, slots=True)
class Fat:
    """One file system; file names are of its root folder, in 8.3."""

    image: Path
    offset: int

    def read(self, name: str) -> bytes | None:
        """A file's bytes; None where there is none."""
        done = self._run("mcopy", "-n", f"::{name}", "-")
        return done.stdout if done.returncode == 0 else None

    def write(self, name: str, content: bytes) -> None:
        """Replace a file, and read it back. Raises ImageRefused."""
        with temporary.folder("fat") as scratch:
            file = scratch / name
            file.write_bytes(content)
            done = self._run("mcopy", "-o", str(file), f"::{name}")
        if done.returncode or self.read(name) != content:
            why = done.stderr.decode(errors="replace").strip() or "what is read back is something else"
            raise ImageRefused(f"{name} could not be written to the image's FAT partition: {why}")

    def _run(self, program: str, *arguments: str) -> subprocess.CompletedProcess[bytes]:
        return subprocess.run(  # noqa: S603 - a program of the system, and arguments that are ours
            [tool(program), "-i", f"{self.image}@@{self.offset}", *arguments],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            check=False,
            env={"LC_ALL": "C", "MTOOLS_SKIP_CHECK": "1", "MTOOLSRC": "/dev/null"},
        )
