"""Shapes of a checklist: boxes, badges and wires in pixels, and the grid of Table 3."""

from __future__ import annotations

import unicodedata
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.report.document import Document, Item, Row
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.printable import visible
from atlantis_netcfg.runs.report import signs

if TYPE_CHECKING:
    from collections.abc import Iterable


_ORDER = tuple(signs.ShownState)
GREEN = frozenset(
    {
        signs.ShownState.SKIP,
        signs.ShownState.PASS,
        signs.ShownState.WARN,
        signs.ShownState.OVERRIDDEN,
    }
)
"""States that do not keep a checklist from being green, as in `Document.exit`."""

ASCII = {
    signs.ShownState.SKIP: "-",
    signs.ShownState.PASS: "+",
    signs.ShownState.WARN: "!",
    signs.ShownState.OVERRIDDEN: "*",
    signs.ShownState.NOT_CHECKED: ".",
    signs.ShownState.OPEN: "o",
    signs.ShownState.INCONCLUSIVE: "?",
    signs.ShownState.FAIL: "X",
    signs.ShownState.ERROR: "#",
}
"""For a console that may not support other symbols."""

_TAKEN_OVER = frozenset({Verdict.FAIL, Verdict.INCONCLUSIVE, Verdict.ERROR})
_GRAVE = frozenset({Verdict.FAIL, Verdict.ERROR})


def state(item: Item) -> signs.ShownState:
    """Return the state to show for an item."""
    if item.override is not None and (item.open or item.verdict in _TAKEN_OVER):
        return signs.ShownState.OVERRIDDEN
    if item.open and item.verdict not in _GRAVE:
        return signs.ShownState.OPEN
    return signs.ShownState(item.verdict.value)


def worst_state(items: Iterable[Item]) -> signs.ShownState:
    """Return the worst state of some items; without items, NOT_CHECKED."""
    return max(map(state, items), key=_ORDER.index, default=signs.ShownState.NOT_CHECKED)


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
    state: signs.ShownState | None
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
    state: signs.ShownState | None


@dataclass(frozen=True, slots=True)
class DrawnWire:
    """A polyline with a state."""

    points: tuple[tuple[float, float], ...]
    state: signs.ShownState | None
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


def badge_width(label: str, state: signs.ShownState | None) -> float:
    """Return the width that a badge needs."""
    return letters_of(badge_text(label, state)) * LETTER + 10


def badge_text(label: str, state: signs.ShownState | None) -> str:
    """Return the text of a badge, with its symbol in front."""
    return f"{signs.SYMBOLS[state]} {label}" if state is not None else label


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
    def state(self) -> signs.ShownState:
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
