"""Parts of the PDF report: first and last lines, Table 3, the drawing, and all items with their evidence."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.report import _photos, _shapes, _texts, _words
from atlantis_netcfg.checklist.report import _words as words
from atlantis_netcfg.checklist.report._pdf import _sheet
from atlantis_netcfg.checklist.report._svg import layout
from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.core.times import time_text
from atlantis_netcfg.runs.report import page_frame, signs

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from atlantis_netcfg.checklist.report.document import Document, Item, Override


def first(sheet: _sheet.Sheet, document: Document) -> None:
    """Print the items that need attention, the worst first, with what to do."""
    what, every = words.to_look_at(document)
    if every:
        sheet.head(translate(what))
    for item in every:
        sheet.room(20)
        shown_state = _shapes.state(item)
        sheet.badge_line(shown_state, str(shown_state), _texts.item_title(item), link=sheet.link_of(item))
        sheet.tell(translate(item.message), indent=_INDENT)
        if item.hint:
            sheet.tell(f"→ {translate(item.hint)}", indent=_INDENT)
        sheet.set_y(sheet.y + 1.5)


def overridden(sheet: _sheet.Sheet, document: Document) -> None:
    """Print the items that a person has overridden."""
    every = [item for item in document.items if item.override is not None]
    if every:
        sheet.head(translate(_texts.PageText.OVERRIDDEN))
    for item in every:
        if item.override is not None:
            sheet.room(20)
            sheet.badge_line(_shapes.state(item), str(item.verdict), _texts.item_title(item), link=sheet.link_of(item))
            responsible(sheet, item.override, document.time_zone)
            sheet.set_y(sheet.y + 1.5)


def responsible(sheet: _sheet.Sheet, override: Override, zone: str) -> None:
    """Print who has overridden an item, and why."""
    sheet.tell(translate(_texts.overridden_by(override, zone)), bold=True, indent=_INDENT)
    sheet.tell(override.reason, indent=_INDENT)


def since_green(sheet: _sheet.Sheet, document: Document) -> None:
    """Print the changes since the last green checklist."""
    green = document.since_green
    if green is None:
        return
    sheet.head(translate(_texts.PageText.SINCE))
    sheet.tell(translate(_texts.was_green(green, document.time_zone)))
    for change in green.changes:
        before, after = (
            signs.SYMBOLS[signs.ShownState(word)] + f" {word}" if word else translate(_texts.PageText.NO_SUCH_ITEM)
            for word in (change.before, change.after)
        )
        sheet.tell(f"{change.id}: {before} → {after}: {translate(change.message)}", indent=_INDENT)
    if not green.changes:
        sheet.tell(translate(_texts.PageText.NO_CHANGES))


def not_checked(sheet: _sheet.Sheet, document: Document) -> None:
    """Print what was not checked, and why."""
    sheet.head(translate(_texts.PageText.NOT_CHECKED))
    open_items = [
        item for item in document.items if _shapes.state(item) in {signs.ShownState.OPEN, signs.ShownState.INCONCLUSIVE}
    ]
    for entry in document.left_out:
        sheet.tell(f"{translate(entry.what)}: {translate(entry.why)}", indent=_INDENT)
    for item in open_items:
        sheet.tell(
            f"{signs.SYMBOLS[_shapes.state(item)]} {_texts.item_title(item)}: {translate(item.message)}", indent=_INDENT
        )
    if not document.left_out and not open_items:
        sheet.tell(translate(_texts.PageText.ALL_CHECKED))


def notes(sheet: _sheet.Sheet, document: Document) -> None:
    """Print the notes on the site, which affect no verdict."""
    _add_section(sheet, _texts.PageText.NOTES, document.notes)


def not_rehearsed(sheet: _sheet.Sheet, document: Document) -> None:
    """Print what no emulator covers."""
    _add_section(sheet, _texts.PageText.NOT_REHEARSED, document.not_rehearsed)


def _add_section(sheet: _sheet.Sheet, what: str, sentences: tuple[str, ...]) -> None:
    if sentences:
        sheet.head(translate(what))
    for sentence in sentences:
        sheet.tell(translate(sentence), indent=_INDENT)


_INDENT = 5.0
_PHOTO_WIDTH, _PHOTO_HEIGHT = 100.0, 80.0

_AttachmentMap = dict[tuple[str, str | None], "_photos.Attachment"]


def items(sheet: _sheet.Sheet, document: Document, files: Mapping[str, bytes]) -> None:
    """Print all items."""
    sheet.head(translate(_texts.PageText.ITEMS), room=56)
    attachments = _photos.find_attachments(document, files)
    for row in _shapes.grid(document).rows:
        if row.items:
            names = f" ({translate(_texts.also(row.row))})" if row.row.aliases else ""
            sheet.head(f"{row.row.name}{names}", size=11)
        for item in row.items:
            _item(sheet, item, attachments, document.time_zone)
    if not document.items:
        sheet.tell(translate(_texts.PageText.NOTHING))


def _item(sheet: _sheet.Sheet, item: Item, attachments: _AttachmentMap, zone: str) -> None:
    sheet.room(22)
    sheet.set_link(sheet.link_of(item), y=sheet.y, page=sheet.page)
    shown_state = _shapes.state(item)
    sheet.badge_line(shown_state, str(shown_state), _texts.item_title(item))
    sheet.tell(item.id, size=_sheet.SMALL, faint=True, indent=_INDENT)
    sheet.tell(translate(item.message), indent=_INDENT)
    if item.hint:
        sheet.tell(f"→ {translate(item.hint)}", indent=_INDENT)
    if item.override is not None:
        sheet.tell(translate(_texts.was(item)), bold=True, indent=_INDENT)
        responsible(sheet, item.override, zone)
    _findings(sheet, item)
    _evidence(sheet, item, attachments, zone)
    sheet.tell(_words.circumstances(item, translate, zone), size=7, faint=True, indent=_INDENT)
    sheet.set_y(sheet.y + 2)


def _findings(sheet: _sheet.Sheet, item: Item) -> None:
    result = [finding for finding in item.findings if len(item.findings) > 1 or finding.message != item.message]
    for entry in result:
        sign = signs.SYMBOLS[signs.ShownState(entry.verdict.value)]
        sheet.tell(
            f"{sign} {entry.verdict} {translate(entry.message)} ({entry.code})", size=_sheet.SMALL, indent=_INDENT + 3
        )
        if entry.hint and entry.hint != item.hint:
            sheet.tell(f"→ {translate(entry.hint)}", size=_sheet.SMALL, indent=_INDENT + 6)


def _evidence(sheet: _sheet.Sheet, item: Item, attachments: _AttachmentMap, zone: str) -> None:
    for kinds, every in _words.evidence_groups(item, translate, zone):
        text = join("; ", (f"{translate(evidence.what)}: {evidence.value}" for evidence in every))
        sheet.tell(msg(f"{arg(text)} ({arg(kinds)})"), size=_sheet.SMALL, indent=_INDENT + 3)
        last = every[-1]
        if last.file is not None:
            file = attachments[last.file, last.sha256]
            sheet.tell(f"{file.name}: {translate(file.words)}", size=_sheet.SMALL, bold=file.amiss, indent=_INDENT + 3)
            if file.photo is not None:
                _photo(sheet, file.photo)


def _photo(sheet: _sheet.Sheet, photo: _photos.Photo) -> None:
    scale = min(_PHOTO_WIDTH / photo.width, _PHOTO_HEIGHT / photo.height)
    width, height = photo.width * scale, photo.height * scale
    sheet.room(height + 2)
    sheet.image(io.BytesIO(photo.data), sheet.l_margin + _INDENT + 3, sheet.y + 1, width, height)
    sheet.set_y(sheet.y + height + 2)


def top(sheet: _sheet.Sheet, document: Document) -> None:
    """Write the first lines."""
    sheet.tell(translate(_texts.heading(document)), size=17, bold=True)
    if page_frame.unread():
        sheet.tell(page_frame.unread(), faint=True)
    sheet.tell(translate(_texts.subtitle(document)), faint=True)
    if document.rehearsed:
        _rehearsal_banner(sheet, document)
    _verdict(sheet, document)
    sheet.tell(translate(_words.signature_line(document)), size=11, bold=True)
    if document.signed is not None:
        sheet.tell(translate(f"digest {arg(document.signed.digest)}"), size=_sheet.SMALL)
        sheet.tell(translate(f"key {arg(document.signed.key)}"), size=_sheet.SMALL)


def _rehearsal_banner(sheet: _sheet.Sheet, document: Document) -> None:
    """Print a banner between two thick bars, without colour: only verdicts have a coloured box."""
    _draw_triangle_row(sheet)
    sheet.tell(translate(_texts.PageText.REHEARSAL), size=13, bold=True)
    sheet.tell(translate(_texts.PageText.EMULATION_NOTE))
    if document.broken:
        sheet.tell(translate(_texts.PageText.BROKEN), bold=True)
    for item in document.broken:
        sheet.tell(f"• {translate(item)}", indent=_INDENT)
    _draw_triangle_row(sheet)


def _draw_triangle_row(sheet: _sheet.Sheet) -> None:
    sheet.set_y(sheet.y + 1.5)
    sheet.set_fill_color(0)
    for number in range(int(sheet.epw / 4)):
        x = sheet.l_margin + number * 4
        points = [(x + 1, sheet.y), (x + 3.2, sheet.y), (x + 2.2, sheet.y + 1.6), (x, sheet.y + 1.6)]
        sheet.polygon(points, style="F")
    sheet.set_y(sheet.y + 3)


def _verdict(sheet: _sheet.Sheet, document: Document) -> None:
    state, words = _words.headline(document)
    message = join(", ", (f"{number} {item}" for item, number in _words.counts(document.items).items()))
    message = message or translate(_texts.PageText.NO_ITEMS)
    sheet.set_y(sheet.y + 3)
    for text, size, bold in ((f"{signs.SYMBOLS[state]} {translate(words)}", 13.0, True), (message, 9.0, False)):
        sheet.plain(size, bold=bold)
        sheet.tint(state)
        height = sheet.font_size * 1.5
        sheet.multi_cell(0, height, _sheet.printable(f" {text}"), fill=True, align="L", new_x="LMARGIN", new_y="NEXT")
    sheet.set_y(sheet.y + 3)


def provenance(sheet: _sheet.Sheet, document: Document) -> None:
    """Print the versions, run and times from which the report was made."""
    sheet.head(translate(_texts.PageText.MADE_FROM))
    zone, end = document.time_zone, document.ended
    for label, value in (
        (_texts.PageText.RUN, document.run),
        (_texts.PageText.BEGAN, time_text(document.started, zone)),
        (_texts.PageText.END, time_text(end, zone) if end is not None else translate(_texts.PageText.NOT_YET)),
        (_texts.PageText.TOOL, f"atlantis-netcfg {document.tool}"),
        (_texts.PageText.INVENTORY, document.inventory),
        (_texts.PageText.EXIT, str(int(document.exit))),
    ):
        sheet.tell(f"{translate(label)}: {value}", size=_sheet.SMALL)


_NAME, _GAP, _ROW = 27.0, 3.0, 9.0
_NAME_LETTERS = 16
_LOUD = frozenset({signs.ShownState.FAIL, signs.ShownState.ERROR})
_THICK = _LOUD | {signs.ShownState.INCONCLUSIVE, signs.ShownState.OPEN}


def table(sheet: _sheet.Sheet, document: Document) -> None:
    """Print the grid, its legend, and why a row differs from the report's table."""
    sheet.head(translate(_texts.PageText.TABLE))
    grid_layout = _shapes.grid(document)
    if grid_layout.rows:
        _draw_headings(sheet, grid_layout)
    place = False
    for row in sorted(grid_layout.rows, key=lambda grid_row: grid_row.is_location):
        sheet.room(_ROW + 2)
        if row.is_location and not place:
            place = True
            sheet.set_y(sheet.y + 1.5)
        y = sheet.y
        sheet.plain(_sheet.SMALL, bold=True)
        _fit_text(
            sheet, _shapes.cut(_sheet.printable(row.row.name), _NAME_LETTERS), (sheet.l_margin, y), (_NAME, _ROW), "L"
        )
        for cell, x in zip(row.cells, _column_positions(sheet, grid_layout), strict=True):
            _cell(sheet, cell, x, y, _width(sheet, grid_layout))
        sheet.set_xy(sheet.l_margin, y + _ROW + 0.6)
    _legend(sheet)
    for row in grid_layout.rows:
        if row.row.deviation:
            sheet.tell(translate(_texts.differs(row.row)), size=_sheet.SMALL)


def _width(sheet: _sheet.Sheet, grid_layout: _shapes.Grid) -> float:
    return (sheet.epw - _NAME - _GAP) / max(len(grid_layout.columns) + len(grid_layout.beside), 1)


def _column_positions(sheet: _sheet.Sheet, grid_layout: _shapes.Grid) -> list[float]:
    width, apart = _width(sheet, grid_layout), len(grid_layout.columns)
    every = range(apart + len(grid_layout.beside))
    return [sheet.l_margin + _NAME + width * number + (_GAP if number >= apart else 0) for number in every]


def _draw_headings(sheet: _sheet.Sheet, grid_layout: _shapes.Grid) -> None:
    lefts, width, y = _column_positions(sheet, grid_layout), _width(sheet, grid_layout), sheet.y
    sheet.plain(_sheet.SMALL, faint=True)
    if grid_layout.beside:
        span = width * len(grid_layout.beside)
        _fit_text(
            sheet,
            _sheet.printable(translate(_texts.PageText.BESIDE_TABLE)),
            (lefts[len(grid_layout.columns)], y),
            (span, 4),
            "C",
        )
    sheet.plain(_sheet.SMALL, bold=True)
    for column, x in zip((*grid_layout.columns, *grid_layout.beside), lefts, strict=True):
        _fit_text(
            sheet, _sheet.printable(translate(_words.title(column))).replace("\n", " "), (x, y + 4), (width, 4), "C"
        )
    sheet.set_xy(sheet.l_margin, y + 8.5)


def _cell(sheet: _sheet.Sheet, cell: _shapes.GridCell, x: float, y: float, width: float) -> None:
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
    sign = f"({signs.SYMBOLS[cell.state]})" if cell.beside else signs.SYMBOLS[cell.state]
    sheet.set_font(_sheet.FAMILY, "B", 10)
    _fit_text(sheet, sign, (x, y + 0.8), (width, 4.2), "C")
    sheet.set_font(_sheet.FAMILY, "B", 6)
    _fit_text(sheet, str(cell.state), (x + 0.6, y + 5), (width - 1.2, 3), "C")
    if cell.first is not None:
        sheet.link(x, y, width, _ROW, sheet.link_of(cell.first))


def _fit_text(sheet: _sheet.Sheet, text: str, at: Sequence[float], size: Sequence[float], align: str) -> None:
    """Print one line in a box, with the font size reduced until it fits."""
    points = sheet.font_size_pt
    width = sheet.get_string_width(text)
    if width > size[0] - 0.4 > 0:
        sheet.set_font_size(max(points * (size[0] - 0.4) / width, 1))
    sheet.set_xy(at[0], at[1])
    sheet.c_margin, margin = 0.0, sheet.c_margin
    sheet.cell(size[0], size[1], text, align=align)
    sheet.c_margin = margin
    sheet.set_font_size(points)


def _legend(sheet: _sheet.Sheet) -> None:
    legend = join(", ", (f"{symbol} {state}" for state, symbol in signs.SYMBOLS.items()))
    sheet.tell(f"{legend}, ( ) {translate(_texts.PageText.BESIDE_SIGN)}", size=7, faint=True)


_MOST_HIGH = 0.42
"""Share of a page's height: a drawing never takes half of it."""
_POINTS = 72 / 25.4


def draw(sheet: _sheet.Sheet, document: Document) -> None:
    """Print the drawing, as wide as the page if its height allows."""
    if not document.drawing.nodes:
        return
    shapes = layout(document, wide=True)
    scale = min(sheet.epw / shapes.width, sheet.eph * _MOST_HIGH / shapes.height)
    sheet.room(shapes.height * scale + 20)
    sheet.head(translate(_texts.PageText.SITE))
    _Pen(sheet, scale).draw(shapes)


class _Pen:
    """Converts pixels of the drawing to millimetres on paper."""

    def __init__(self, sheet: _sheet.Sheet, scale: float) -> None:
        self._sheet, self._scale = sheet, scale
        self._x, self._y = sheet.l_margin, sheet.y

    def draw(self, shapes: _shapes.DrawingLayout) -> None:
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

    def _page_position(self, x: float, y: float) -> tuple[float, float]:
        return self._x + x * self._scale, self._y + y * self._scale

    def _wire(self, wire: _shapes.DrawnWire) -> None:
        self._sheet.tint(wire.state)
        self._sheet.set_line_width(0.5 if wire.state in _LOUD else 0.3)
        if wire.is_dashed:
            self._sheet.set_dash_pattern(dash=1.2, gap=0.8)
        self._sheet.polyline([self._page_position(*point) for point in wire.points])
        self._sheet.set_dash_pattern()

    def _face(self, shape: _shapes.DrawnBox | _shapes.Badge, height: float) -> None:
        self._sheet.tint(shape.state)
        self._sheet.set_line_width(0.7 if shape.state in _LOUD else 0.25)
        x, y = self._page_position(shape.x, shape.y)
        width, height = shape.width * self._scale, height * self._scale
        self._sheet.rect(x, y, width, height, style="DF", round_corners=True, corner_radius=1.2)

    def _box(self, box: _shapes.DrawnBox) -> None:
        self._face(box, box.height)
        sign = f"{signs.SYMBOLS[box.state]} " if box.state is not None else ""
        self._write(f"{sign}{box.label}", box, box.y + (4 if box.detail else 12), 11, "B")
        if box.detail:
            self._write(box.detail, box, box.y + 20, 9, "")

    def _badge(self, badge: _shapes.Badge) -> None:
        self._face(badge, _shapes.BADGE_HEIGHT)
        self._write(badge.text, badge, badge.y + 1, 10, "")

    def _write(self, text: str, shape: _shapes.DrawnBox | _shapes.Badge, top: float, size: float, style: str) -> None:
        sheet, width = self._sheet, shape.width * self._scale
        words = _sheet.printable(text).replace("\n", " ")
        sheet.set_font(_sheet.FAMILY, style, size * self._scale * _POINTS)
        long = sheet.get_string_width(words)
        if long > width - 1:
            sheet.set_font_size(sheet.font_size_pt * max(width - 1, 0.5) / long)
        x, y = self._page_position(shape.x, top)
        sheet.set_xy(x, y)
        sheet.c_margin, margin = 0.0, sheet.c_margin
        sheet.cell(width, 14 * self._scale, words, align="C")
        sheet.c_margin = margin
