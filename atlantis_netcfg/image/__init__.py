"""Images of gateway computers: customised offline and without root, written to a card, and read back.

Nothing here knows the declaration: `operations.imaging` says what a host shall be. What cannot be known without the
board is not promised: no ODROID was seen, and that a card boots there is for the first one to show.
"""

from __future__ import annotations

from atlantis_netcfg.image._errors import CardUnfinished, DeviceRefused, ImageRefused
from atlantis_netcfg.image.blocks import BlockTree, Bus, Disk, Use
from atlantis_netcfg.image.customise import customise
from atlantis_netcfg.image.guard import admit, confirmed
from atlantis_netcfg.image.layouts import LAYOUTS, Layout
from atlantis_netcfg.image.progress import Meter, Progress, Step
from atlantis_netcfg.image.segments import Kind, Segment, segments
from atlantis_netcfg.image.source import Checksum, Expanded, checksum, expand
from atlantis_netcfg.image.wish import Static, Wish
from atlantis_netcfg.image.writer import Card, Written, write

__all__ = [
    "LAYOUTS",
    "BlockTree",
    "Bus",
    "Card",
    "CardUnfinished",
    "Checksum",
    "DeviceRefused",
    "Disk",
    "Expanded",
    "ImageRefused",
    "Kind",
    "Layout",
    "Meter",
    "Progress",
    "Segment",
    "Static",
    "Step",
    "Use",
    "Wish",
    "Written",
    "admit",
    "checksum",
    "confirmed",
    "customise",
    "expand",
    "segments",
    "write",
]
