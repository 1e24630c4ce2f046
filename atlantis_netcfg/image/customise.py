"""Make a working copy of an image that of one host: look into it, plan, edit, check."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.image.ext4 import Ext4
from atlantis_netcfg.image.fat import Fat
from atlantis_netcfg.image.layouts import Layout, find
from atlantis_netcfg.image.plan import BOOT_WORDS, LISTED, READ, asked, notes, plan
from atlantis_netcfg.image.wish import Seen, Wish

if TYPE_CHECKING:
    from pathlib import Path

__all__ = ["NOTE", "customise", "look"]

NOTE = "ATLANTIS.TXT"
"""On the FAT partition, for whoever puts the card into a laptop."""
_BOOT_FILES = ("cmdline.txt", "boot.ini")
"""Files there that hold the kernel's command line, of boards of the Raspberry and of the ODROID type."""


def look(root: Ext4, request: Wish, boot: Fat | None = None) -> Seen:
    """What the planner needs to know of an image. Raises ImageRefused where a link stands in the place of a file."""
    root.hold_no_link((*READ, *LISTED))
    files = {path: data.decode(errors="surrogateescape") for path in READ if (data := root.read(path)) is not None}
    present = frozenset(path for path in asked(request) if root.exists(path))
    words = {path: root.read(path) for path in BOOT_WORDS}
    if boot is not None:
        words |= {f"{name} on the FAT partition": boot.read(name) for name in _BOOT_FILES}
    values = {place: data.decode(errors="replace") for place, data in words.items() if data is not None}
    return Seen(files, present, {path: root.names(path) for path in LISTED}, values)


def customise(image: Path, layout: Layout, request: Wish) -> tuple[str, ...]:
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
