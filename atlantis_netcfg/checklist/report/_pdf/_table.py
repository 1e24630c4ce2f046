"""Table 3 on paper: each cell by colour, sign, word and edge; what is beside the table in dashes and brackets."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.report._grid import grid
from atlantis_netcfg.checklist.report._pdf._sheet import FAMILY, SMALL, printable
from atlantis_netcfg.checklist.report._shapes import cut
from atlantis_netcfg.checklist.report._states import SYMBOLS, State
from atlantis_netcfg.checklist.report._words import title

if TYPE_CHECKING:
    from collections.abc import Sequence

    from atlantis_netcfg.checklist.report._grid import Cell, Grid
    from atlantis_netcfg.checklist.report._pdf._sheet import Sheet
    from atlantis_netcfg.checklist.report.document import Document

__all__ = ["table"]

_NAME, _GAP, _ROW = 27.0, 3.0, 9.0
_NAME_LETTERS = 16
_LOUD = frozenset({State.FAIL, State.ERROR})
_THICK = frozenset({State.FAIL, State.ERROR, State.INCONCLUSIVE, State.OPEN})


def table(sheet: Sheet, document: Document) -> None:
    """Draw the grid, its signs, and why a row differs from the report's."""
    sheet.head("Table 3")
    arranged = grid(document)
    if arranged.rows:
        _heads(sheet, arranged)
    place = False
    for row in sorted(arranged.rows, key=lambda grid_row: grid_row.is_location):
        sheet.room(_ROW + 2)
        if row.is_location and not place:
            place = True
            sheet.set_y(sheet.y + 1.5)
        y = sheet.y
        sheet.plain(SMALL, bold=True)
        _fitted(sheet, cut(printable(row.row.name), _NAME_LETTERS), (sheet.l_margin, y), (_NAME, _ROW), "L")
        for cell, x in zip(row.cells, _lefts(sheet, arranged), strict=True):
            _cell(sheet, cell, x, y, _width(sheet, arranged))
        sheet.set_xy(sheet.l_margin, y + _ROW + 0.6)
    _legend(sheet)
    for row in arranged.rows:
        if row.row.deviation:
            sheet.tell(f"{row.row.name} differs from the report: {row.row.deviation}", size=SMALL)


def _width(sheet: Sheet, arranged: Grid) -> float:
    return (sheet.epw - _NAME - _GAP) / max(len(arranged.columns) + len(arranged.beside), 1)


def _lefts(sheet: Sheet, arranged: Grid) -> list[float]:
    width, apart = _width(sheet, arranged), len(arranged.columns)
    every = range(apart + len(arranged.beside))
    return [sheet.l_margin + _NAME + width * number + (_GAP if number >= apart else 0) for number in every]


def _heads(sheet: Sheet, arranged: Grid) -> None:
    lefts, width, y = _lefts(sheet, arranged), _width(sheet, arranged), sheet.y
    sheet.plain(SMALL, faint=True)
    if arranged.beside:
        span = width * len(arranged.beside)
        _fitted(sheet, "not in Table 3", (lefts[len(arranged.columns)], y), (span, 4), "C")
    sheet.plain(SMALL, bold=True)
    for column, x in zip((*arranged.columns, *arranged.beside), lefts, strict=True):
        _fitted(sheet, printable(title(column)).replace("\n", " "), (x, y + 4), (width, 4), "C")
    sheet.set_xy(sheet.l_margin, y + 8.5)


def _cell(sheet: Sheet, cell: Cell, x: float, y: float, width: float) -> None:
    if cell.empty:
        sheet.set_draw_color(205)
        sheet.set_line_width(0.1)
        sheet.rect(x + 0.3, y, width - 0.6, _ROW)
        return
    sheet.tint(cell.state)
    sheet.set_line_width(0.7 if cell.state in _LOUD else 0.45 if cell.state in _THICK else 0.25)
    if cell.beside:
        sheet.set_dash_pattern(dash=1, gap=0.7)
    sheet.rect(x + 0.5, y + 0.2, width - 1, _ROW - 0.4, style="DF")
    sheet.set_dash_pattern()
    sheet.set_line_width(0.2)
    sign = f"({SYMBOLS[cell.state]})" if cell.beside else SYMBOLS[cell.state]
    sheet.set_font(FAMILY, "B", 10)
    _fitted(sheet, sign, (x, y + 0.8), (width, 4.2), "C")
    sheet.set_font(FAMILY, "B", 6)
    _fitted(sheet, str(cell.state), (x + 0.6, y + 5), (width - 1.2, 3), "C")
    if cell.first is not None:
        sheet.link(x, y, width, _ROW, sheet.link_of(cell.first))


def _fitted(sheet: Sheet, text: str, at: Sequence[float], size: Sequence[float], align: str) -> None:
    """One line in a box; letters are made smaller until it has room."""
    points = sheet.font_size_pt
    width = sheet.get_string_width(text)
    if width > size[0] - 0.4 > 0:
        sheet.set_font_size(max(points * (size[0] - 0.4) / width, 1))
    sheet.set_xy(at[0], at[1])
    sheet.c_margin, kept = 0.0, sheet.c_margin
    sheet.cell(size[0], size[1], text, align=align)
    sheet.c_margin = kept
    sheet.set_font_size(points)


def _legend(sheet: Sheet) -> None:
    signs = ", ".join(f"{symbol} {state}" for state, symbol in SYMBOLS.items())
    sheet.tell(f"{signs}, ( ) checked, but not a cell of Table 3", size=7, faint=True)
