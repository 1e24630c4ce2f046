"""Make a working copy of an image that of one host: look into it, plan, edit, check."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.image.ext4 import Ext4
from atlantis_netcfg.image.fat import Fat
from atlantis_netcfg.image.layouts import Layout, find
from atlantis_netcfg.image.plan import LISTED, READ, asked, notes, plan
from atlantis_netcfg.image.wish import Seen, Wish

if TYPE_CHECKING:
    from pathlib import Path

__all__ = ["NOTE", "customise", "look"]

NOTE = "ATLANTIS.TXT"
"""On the FAT partition, for whoever puts the card into a laptop."""


def look(root: Ext4, wish: Wish) -> Seen:
    """What the planner needs to know of an image."""
    files = {path: data.decode(errors="surrogateescape") for path in READ if (data := root.read(path)) is not None}
    present = frozenset(path for path in asked(wish) if root.exists(path))
    return Seen(files, present, {path: root.names(path) for path in LISTED})


def customise(image: Path, layout: Layout, wish: Wish) -> tuple[str, ...]:
    """Edit the working copy; return what a person should know. Raises ImageRefused. May be repeated."""
    places = find(image, layout)
    root = Ext4(image, places.root)
    root.recover()
    seen = look(root, wish)
    root.apply(plan(seen, wish))
    if places.boot is not None:
        text = f"This card was made for {wish.host} of site {wish.site}\r\nfrom {wish.source}\r\n"
        Fat(image, places.boot.offset).write(NOTE, text.encode())
    return notes(seen, wish)
