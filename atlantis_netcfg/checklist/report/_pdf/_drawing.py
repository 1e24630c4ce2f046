"""The site's drawing on paper, from the same shapes as the page's."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.report._layout import layout
from atlantis_netcfg.checklist.report._pdf._sheet import FAMILY, printable
from atlantis_netcfg.checklist.report._shapes import BADGE_HEIGHT
from atlantis_netcfg.checklist.report._states import SYMBOLS, State

if TYPE_CHECKING:
    from atlantis_netcfg.checklist.report._pdf._sheet import Sheet
    from atlantis_netcfg.checklist.report._shapes import Badge, Box, Layout, Wire
    from atlantis_netcfg.checklist.report.document import Document

__all__ = ["draw"]

_WIDTH = 132.0
_LOUD = frozenset({State.FAIL, State.ERROR})
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
