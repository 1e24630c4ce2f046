"""What a drawing is made of, for whoever paints it: boxes, badges and wires, in pixels."""

from __future__ import annotations

import unicodedata
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.report._states import SYMBOLS
from atlantis_netcfg.core.printable import visible

if TYPE_CHECKING:
    from atlantis_netcfg.checklist.report._states import State

LETTER = 6.1
"""Width of a letter of 10 pixels' height, on the large side: fonts differ."""
BADGE_HEIGHT = 16.0


@dataclass(frozen=True, slots=True)
class Box:
    """A node."""

    x: float
    y: float
    width: float
    height: float
    label: str
    detail: str
    kind: str
    state: State | None
    """None: no item speaks of it."""

    @property
    def middle(self) -> float:
        """Of its width."""
        return self.x + self.width / 2


@dataclass(frozen=True, slots=True)
class Badge:
    """What a link is, and how."""

    x: float
    y: float
    width: float
    text: str
    state: State | None


@dataclass(frozen=True, slots=True)
class Wire:
    """A line through some points."""

    points: tuple[tuple[float, float], ...]
    state: State | None
    dashed: bool = False
    """It goes through a tunnel, or through water and air."""


@dataclass(frozen=True, slots=True)
class Layout:
    """A whole drawing; what comes first is painted first."""

    width: float
    height: float
    wires: tuple[Wire, ...]
    boxes: tuple[Box, ...]
    badges: tuple[Badge, ...]


def badge_width(label: str, state: State | None) -> float:
    """How wide a badge has to be."""
    return letters_of(badge_text(label, state)) * LETTER + 10


def badge_text(label: str, state: State | None) -> str:
    """The words of a badge: its sign before them."""
    return f"{SYMBOLS[state]} {label}" if state is not None else label


def letters_of(text: str) -> float:
    """How wide a text is, in letters."""
    return sum(2 if unicodedata.east_asian_width(letter) in "WF" else 1 for letter in text)


def cut(text: str, room: float, dots: str = "…") -> str:
    """Text in one line that has room; what is left out is shown by dots."""
    line = " ".join(visible(text).split())
    if letters_of(line) <= room:
        return line
    kept = ""
    for letter in line:
        if letters_of(kept + letter) > room - 1:
            break
        kept += letter
    return f"{kept.rstrip()}{dots}"
