"""Shapes of a checklist: boxes, badges and wires in pixels, the grid of Table 3, colours, and state symbols.

Text colours have a contrast of at least 4.5 to their background, edges one of 3 to the page (WCAG 2.2, 1.4.3 and
1.4.11); a test measures them. Each colour comes with a symbol and a word, for readers who cannot see colours.
"""

from __future__ import annotations

import unicodedata
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.report.document import Document, Item, Row
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.printable import visible

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping


class ShownState(StrEnum):
    """State of an item as shown, the worst last."""

    SKIP = "SKIP"
    PASS = "PASS"  # noqa: S105 - a verdict
    WARN = "WARN"
    OVERRIDDEN = "OVERRIDDEN"
    """It did not pass, and a person has taken the responsibility."""
    NOT_CHECKED = "NOT CHECKED"
    """A cell of the table without an item: the checklist was narrowed."""
    OPEN = "OPEN"
    """Nobody has looked or answered yet."""
    INCONCLUSIVE = "INCONCLUSIVE"
    FAIL = "FAIL"
    ERROR = "ERROR"


_ORDER = tuple(ShownState)
GREEN = frozenset({ShownState.SKIP, ShownState.PASS, ShownState.WARN, ShownState.OVERRIDDEN})
"""States that do not keep a checklist from being green, as in `Document.exit`."""

SYMBOLS = {
    ShownState.SKIP: "–",  # noqa: RUF001 - a dash
    ShownState.PASS: "✓",
    ShownState.WARN: "!",
    ShownState.OVERRIDDEN: "✎",
    ShownState.NOT_CHECKED: "…",
    ShownState.OPEN: "○",
    ShownState.INCONCLUSIVE: "?",
    ShownState.FAIL: "✗",
    ShownState.ERROR: "■",
}
"""No symbol has an emoji form, so every phone shows it in the colour of the text."""
ASCII = {
    ShownState.SKIP: "-",
    ShownState.PASS: "+",
    ShownState.WARN: "!",
    ShownState.OVERRIDDEN: "*",
    ShownState.NOT_CHECKED: ".",
    ShownState.OPEN: "o",
    ShownState.INCONCLUSIVE: "?",
    ShownState.FAIL: "X",
    ShownState.ERROR: "#",
}
"""For a console that may not support other symbols."""

_TAKEN_OVER = frozenset({Verdict.FAIL, Verdict.INCONCLUSIVE, Verdict.ERROR})
_GRAVE = frozenset({Verdict.FAIL, Verdict.ERROR})


def state(item: Item) -> ShownState:
    """Return the state to show for an item."""
    if item.override is not None and (item.open or item.verdict in _TAKEN_OVER):
        return ShownState.OVERRIDDEN
    if item.open and item.verdict not in _GRAVE:
        return ShownState.OPEN
    return ShownState(item.verdict.value)


def worst_state(items: Iterable[Item]) -> ShownState:
    """Return the worst state of some items; without items, NOT_CHECKED."""
    return max(map(state, items), key=_ORDER.index, default=ShownState.NOT_CHECKED)


LETTER = 6.1
"""Width of a letter of 10 pixels' height, on the large side: fonts differ."""
BADGE_HEIGHT = 16.0


@dataclass(frozen=True, slots=True)
class DrawnBox:
    """Rectangle of a node."""

    x: float
    y: float
    width: float
    height: float
    label: str
    detail: str
    kind: str
    state: ShownState | None
    """None: no item concerns it."""

    @property
    def middle(self) -> float:
        """Horizontal centre."""
        return self.x + self.width / 2


@dataclass(frozen=True, slots=True)
class Badge:
    """Label on a link, with the state of the link."""

    x: float
    y: float
    width: float
    text: str
    state: ShownState | None


@dataclass(frozen=True, slots=True)
class DrawnWire:
    """A polyline with a state."""

    points: tuple[tuple[float, float], ...]
    state: ShownState | None
    is_dashed: bool = False
    """Whether it goes through a tunnel, or through water and air."""


@dataclass(frozen=True, slots=True)
class DrawingLayout:
    """A complete drawing; shapes are painted in order."""

    width: float
    height: float
    wires: tuple[DrawnWire, ...]
    boxes: tuple[DrawnBox, ...]
    badges: tuple[Badge, ...]


def badge_width(label: str, state: ShownState | None) -> float:
    """Return the width that a badge needs."""
    return letters_of(badge_text(label, state)) * LETTER + 10


def badge_text(label: str, state: ShownState | None) -> str:
    """Return the text of a badge, with its symbol in front."""
    return f"{SYMBOLS[state]} {label}" if state is not None else label


def letters_of(text: str) -> float:
    """Return the width of a text, in letters."""
    return sum(2 if unicodedata.east_asian_width(letter) in "WF" else 1 for letter in text)


def cut(text: str, room: float, dots: str = "…") -> str:
    """Cut a text to one line of the given width; dots replace the omitted part."""
    line = " ".join(visible(text).split())
    if letters_of(line) <= room:
        return line
    prefix = ""
    for letter in line:
        if letters_of(prefix + letter) > room - 1:
            break
        prefix += letter
    return f"{prefix.rstrip()}{dots}"


@dataclass(frozen=True, slots=True)
class Tint:
    """Colours of one state."""

    ink: str
    paper: str
    edge: str


TINTS: Mapping[ShownState | None, Tint] = {
    None: Tint("#1c2730", "#ffffff", "#6b7884"),
    ShownState.SKIP: Tint("#46525c", "#eef1f3", "#75818c"),
    ShownState.PASS: Tint("#0a5226", "#e2f5e6", "#2c8a4b"),
    ShownState.WARN: Tint("#5f3d00", "#fff0c2", "#a87400"),
    ShownState.OVERRIDDEN: Tint("#6d2f00", "#ffe6d1", "#b65a14"),
    ShownState.NOT_CHECKED: Tint("#46525c", "#ffffff", "#75818c"),
    ShownState.OPEN: Tint("#0b4470", "#e2f0fc", "#3279b3"),
    ShownState.INCONCLUSIVE: Tint("#4a2786", "#efe7fc", "#8160bd"),
    ShownState.FAIL: Tint("#8c0c12", "#fde1df", "#c8332f"),
    ShownState.ERROR: Tint("#ffffff", "#7a0d3d", "#7a0d3d"),
}
DARK: Mapping[ShownState | None, Tint] = {
    None: Tint("#e6edf3", "#1b232c", "#8b98a5"),
    ShownState.SKIP: Tint("#b7c2cc", "#262f38", "#7b8894"),
    ShownState.PASS: Tint("#a5ebb9", "#0f3a20", "#3f9e62"),
    ShownState.WARN: Tint("#ffdf85", "#463300", "#b78a1d"),
    ShownState.OVERRIDDEN: Tint("#ffc9a0", "#4a2608", "#cf7a3a"),
    ShownState.NOT_CHECKED: Tint("#b7c2cc", "#12181f", "#7b8894"),
    ShownState.OPEN: Tint("#a9d6fb", "#0d3353", "#4c93cd"),
    ShownState.INCONCLUSIVE: Tint("#d6c3fa", "#352058", "#9a7cd6"),
    ShownState.FAIL: Tint("#ffb8b3", "#561317", "#e0605b"),
    ShownState.ERROR: Tint("#ffffff", "#8f1b50", "#e67cab"),
}


def css_class(state: ShownState | None) -> str:
    """Return the CSS class of elements that show a state."""
    return "s-none" if state is None else f"s-{state.lower().replace(' ', '-')}"


@dataclass(frozen=True, slots=True)
class GridCell:
    """Cell of the grid: one row and one column."""

    column: str
    table3: bool
    """Whether the report marks it, or for a location the inventory."""
    beside: bool
    """Whether it is checked although the table does not mark it."""
    items: tuple[Item, ...]

    @property
    def empty(self) -> bool:
        """Whether there is nothing to check in the cell."""
        return not (self.table3 or self.beside)

    @property
    def state(self) -> ShownState:
        """Worst state of the cell's items."""
        return worst_state(self.items)

    @property
    def first(self) -> Item | None:
        """First item with the cell's state."""
        return next((item for item in self.items if state(item) is self.state), None)


@dataclass(frozen=True, slots=True)
class GridRow:
    """Row of the grid: a vehicle, or the location."""

    row: Row
    cells: tuple[GridCell, ...]
    """One cell for each column of the table, then one for each column outside it."""
    items: tuple[Item, ...]

    @property
    def is_location(self) -> bool:
        """Whether the row is the location, which is placed below the vehicles."""
        return self.row.kind == "location"


@dataclass(frozen=True, slots=True)
class Grid:
    """Layout of Table 3 with its items."""

    columns: tuple[str, ...]
    beside: tuple[str, ...]
    """Columns that Table 3 does not have."""
    rows: tuple[GridRow, ...]


def grid(document: Document) -> Grid:
    """Arrange a document. An item whose row is not in the inventory gets an extra row: none is left out."""
    rows = [*document.rows, *_undeclared_rows(document)]
    endpoints = [endpoint for row in rows for endpoint in (*row.table3, *row.beside)]
    every = dict.fromkeys([*endpoints, *(item.endpoint for item in document.items)])
    beside = tuple(endpoint for endpoint in every if endpoint not in document.columns)
    columns = (*document.columns, *beside)
    return Grid(document.columns, beside, tuple(_row(document, row, columns) for row in rows))


def _undeclared_rows(document: Document) -> list[Row]:
    known_keys = {(row.key, row.kind == "location") for row in document.rows}
    keys = dict.fromkeys((item.vehicle or item.location, item.vehicle is None) for item in document.items)
    return [
        Row(key=key, name=key, kind="location" if place else "vehicle", table3=())
        for key, place in keys
        if (key, place) not in known_keys
    ]


def _row(document: Document, row: Row, columns: tuple[str, ...]) -> GridRow:
    place = row.kind == "location"
    here = [
        entry
        for entry in document.items
        if (entry.vehicle or entry.location, entry.vehicle is None) == (row.key, place)
    ]
    cells = []
    for column in columns:
        items = tuple(item for item in here if item.endpoint == column)
        is_in_table3 = column in row.table3 or any(item.table3 for item in items)
        cells.append(GridCell(column, is_in_table3, not is_in_table3 and (column in row.beside or bool(items)), items))
    return GridRow(row, tuple(cells), tuple(here))
