"""Table 3 on paper: each cell by colour, sign, word and edge; what is beside the table in dashes and brackets.

The site's drawing on paper, from the same shapes as the page's.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.report._grid import grid
from atlantis_netcfg.checklist.report._pdf._sheet import FAMILY, SMALL, printable
from atlantis_netcfg.checklist.report._shapes import BADGE_HEIGHT, cut
from atlantis_netcfg.checklist.report._states import SYMBOLS, State
from atlantis_netcfg.checklist.report._svg import layout
from atlantis_netcfg.checklist.report._words import title

if TYPE_CHECKING:
    from collections.abc import Sequence

    from atlantis_netcfg.checklist.report._grid import Cell, Grid
    from atlantis_netcfg.checklist.report._pdf._sheet import Sheet
    from atlantis_netcfg.checklist.report._shapes import Badge, Box, Layout, Wire
    from atlantis_netcfg.checklist.report.document import Document


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


_WIDTH = 132.0
_POINTS = 72 / 25.4


def draw(sheet: Sheet, document: Document) -> None:
    """Draw it, as wide as the page lets it be high."""
    if not document.drawing.nodes:
        return
    shapes = layout(document)
    most = sheet.eph - 30
    scale = min(_WIDTH / shapes.width, most / shapes.height)
    sheet.room(shapes.height * scale + 20)
    sheet.head("The site")
    _Pen(sheet, scale).draw(shapes)


class _Pen:
    """Pixels of the drawing to millimetres of the paper."""

    def __init__(self, sheet: Sheet, scale: float) -> None:
        self._sheet, self._scale = sheet, scale
        self._x, self._y = sheet.l_margin, sheet.y

    def draw(self, shapes: Layout) -> None:
        sheet = self._sheet
        sheet.set_auto_page_break(False)
        for wire in shapes.wires:
            self._wire(wire)
        for box in shapes.boxes:
            self._box(box)
        for badge in shapes.badges:
            self._badge(badge)
        sheet.set_line_width(0.2)
        sheet.set_auto_page_break(True, 16)
        sheet.set_xy(sheet.l_margin, self._y + shapes.height * self._scale + 2)

    def _at(self, x: float, y: float) -> tuple[float, float]:
        return self._x + x * self._scale, self._y + y * self._scale

    def _wire(self, wire: Wire) -> None:
        self._sheet.tint(wire.state)
        self._sheet.set_line_width(0.5 if wire.state in _LOUD else 0.3)
        if wire.dashed:
            self._sheet.set_dash_pattern(dash=1.2, gap=0.8)
        self._sheet.polyline([self._at(*point) for point in wire.points])
        self._sheet.set_dash_pattern()

    def _face(self, shape: Box | Badge, height: float) -> None:
        self._sheet.tint(shape.state)
        self._sheet.set_line_width(0.7 if shape.state in _LOUD else 0.25)
        x, y = self._at(shape.x, shape.y)
        width, height = shape.width * self._scale, height * self._scale
        self._sheet.rect(x, y, width, height, style="DF", round_corners=True, corner_radius=1.2)

    def _box(self, box: Box) -> None:
        self._face(box, box.height)
        sign = f"{SYMBOLS[box.state]} " if box.state is not None else ""
        self._write(f"{sign}{box.label}", box, box.y + (4 if box.detail else 12), 11, "B")
        if box.detail:
            self._write(box.detail, box, box.y + 20, 9, "")

    def _badge(self, badge: Badge) -> None:
        self._face(badge, BADGE_HEIGHT)
        self._write(badge.text, badge, badge.y + 1, 10, "")

    def _write(self, text: str, shape: Box | Badge, top: float, size: float, style: str) -> None:
        sheet, width = self._sheet, shape.width * self._scale
        words = printable(text).replace("\n", " ")
        sheet.set_font(FAMILY, style, size * self._scale * _POINTS)
        long = sheet.get_string_width(words)
        if long > width - 1:
            sheet.set_font_size(sheet.font_size_pt * max(width - 1, 0.5) / long)
        x, y = self._at(shape.x, top)
        sheet.set_xy(x, y)
        sheet.c_margin, kept = 0.0, sheet.c_margin
        sheet.cell(width, 14 * self._scale, words, align="C")
        sheet.c_margin = kept
