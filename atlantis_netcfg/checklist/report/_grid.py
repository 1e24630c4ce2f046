"""Table 3 as a grid: rows and columns in the report's order, and apart from them what we check beside the table."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.report._states import State, state, worst_state
from atlantis_netcfg.checklist.report.document import Row

if TYPE_CHECKING:
    from atlantis_netcfg.checklist.report.document import Document, Item


@dataclass(frozen=True, slots=True)
class Cell:
    """Where a row and a column meet."""

    column: str
    table3: bool
    """The report marks it; of a location, the declaration."""
    beside: bool
    """It is checked though the table does not mark it."""
    items: tuple[Item, ...]

    @property
    def empty(self) -> bool:
        """There is nothing to check."""
        return not (self.table3 or self.beside)

    @property
    def state(self) -> State:
        """The worst of its items."""
        return worst_state(self.items)

    @property
    def first(self) -> Item | None:
        """The item that makes it so."""
        return next((item for item in self.items if state(item) is self.state), None)


@dataclass(frozen=True, slots=True)
class GridRow:
    """A vehicle, or the location."""

    row: Row
    cells: tuple[Cell, ...]
    """One for each column of the table, then one for each beside it."""
    items: tuple[Item, ...]

    @property
    def is_location(self) -> bool:
        """It stands below the vehicles."""
        return self.row.kind == "location"


@dataclass(frozen=True, slots=True)
class Grid:
    """The table."""

    columns: tuple[str, ...]
    beside: tuple[str, ...]
    """Columns that Table 3 does not have."""
    rows: tuple[GridRow, ...]


def grid(document: Document) -> Grid:
    """Arrange a document. An item whose row nobody declared gets a row: none is left out."""
    rows = [*document.rows, *_undeclared(document)]
    named = [endpoint for row in rows for endpoint in (*row.table3, *row.beside)]
    every = dict.fromkeys([*named, *(item.endpoint for item in document.items)])
    beside = tuple(endpoint for endpoint in every if endpoint not in document.columns)
    columns = (*document.columns, *beside)
    return Grid(document.columns, beside, tuple(_row(document, row, columns) for row in rows))


def _undeclared(document: Document) -> list[Row]:
    known = {(row.key, row.kind == "location") for row in document.rows}
    keys = dict.fromkeys((item.vehicle or item.location, item.vehicle is None) for item in document.items)
    return [
        Row(key=key, name=key, kind="location" if place else "vehicle", table3=())
        for key, place in keys
        if (key, place) not in known
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
        marked = column in row.table3 or any(item.table3 for item in items)
        cells.append(Cell(column, marked, not marked and (column in row.beside or bool(items)), items))
    return GridRow(row, tuple(cells), tuple(here))
