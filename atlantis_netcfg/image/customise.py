"""Turn a working copy of an image into that of one host: look into it, plan, edit, check.

mtools reads and edits the FAT file system at its offset: no mount, no root.
"""

from __future__ import annotations

import subprocess
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.core import temporary
from atlantis_netcfg.image.ext4 import Ext4, tool
from atlantis_netcfg.image.facts import ImageFacts, ImageRefused, ImageRequest
from atlantis_netcfg.image.layouts import Layout, find
from atlantis_netcfg.image.plan import BOOT_WORDS, LISTED, READ, notes, paths_to_check, plan

if TYPE_CHECKING:
    from pathlib import Path


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


NOTE = "ATLANTIS.TXT"
"""On the FAT partition, for whoever puts the card into a laptop."""
_BOOT_FILES = ("cmdline.txt", "boot.ini")
"""Files there that hold the kernel's command line, of boards of the Raspberry and of the ODROID type."""


def look(root: Ext4, request: ImageRequest, boot: Fat | None = None) -> ImageFacts:
    """What the planner needs to know of an image. Raises ImageRefused where a link stands in the place of a file."""
    root.hold_no_link((*READ, *LISTED))
    files = {path: data.decode(errors="surrogateescape") for path in READ if (data := root.read(path)) is not None}
    present = frozenset(path for path in paths_to_check(request) if root.exists(path))
    words = {path: root.read(path) for path in BOOT_WORDS}
    if boot is not None:
        words |= {f"{name} on the FAT partition": boot.read(name) for name in _BOOT_FILES}
    values = {place: data.decode(errors="replace") for place, data in words.items() if data is not None}
    return ImageFacts(files, present, {path: root.names(path) for path in LISTED}, values)


def customise(image: Path, layout: Layout, request: ImageRequest) -> tuple[str, ...]:
    """Edit the working copy; return what a person should know. Raises ImageRefused. May be repeated."""
    places = find(image, layout)
    boot = None if places.boot is None else Fat(image, places.boot.offset)
    root = Ext4(image, places.root)
    root.recover()
    root.hold_editable()
    seen = look(root, request, boot)
    root.apply(plan(seen, request))
    if boot is not None:
        text = f"This card was made for {request.host} of site {request.site}\r\nfrom {request.source}\r\n"
        boot.write(NOTE, text.encode())
    return notes(seen, request)
