"""All items on paper, row by row, with what they stand on.

Lists on paper: what to mend first, what was overridden, what has changed, what was not checked or rehearsed.

The first lines: what it is, how it ended, who vouches for it; and the last ones: what it was made from.

Table 3 on paper: each cell by colour, sign, word and edge; what is beside the table in dashes and brackets.

The site's drawing on paper, from the same shapes as the page's.
"""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.report import _words as words
from atlantis_netcfg.checklist.report._pages import Attached, Photo, attached
from atlantis_netcfg.checklist.report._pdf._sheet import FAMILY, SMALL, Sheet, printable
from atlantis_netcfg.checklist.report._shapes import BADGE_HEIGHT, SYMBOLS, ShownState, cut, grid, state
from atlantis_netcfg.checklist.report._svg import layout
from atlantis_netcfg.checklist.report._words import clock, counts, evidence_groups, headline, scope, signed, title

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from atlantis_netcfg.checklist.report._shapes import Badge, DrawingLayout, DrawnBox, DrawnWire, Grid, GridCell
    from atlantis_netcfg.checklist.report.document import Document, Item, Override


def first(sheet: Sheet, document: Document) -> None:
    """What somebody has to look at, the worst first, with what to do."""
    heading, every = words.first(document)
    if every:
        sheet.head(heading)
    for item in every:
        sheet.room(20)
        shown = state(item)
        sheet.titled(shown, str(shown), item.title, link=sheet.link_of(item))
        sheet.tell(item.message, indent=_INDENT)
        if item.hint:
            sheet.tell(f"→ {item.hint}", indent=_INDENT)
        sheet.set_y(sheet.y + 1.5)


def overridden(sheet: Sheet, document: Document) -> None:
    """What a person has taken the responsibility for."""
    every = [item for item in document.items if item.override is not None]
    if every:
        sheet.head("Overridden by a person")
    for item in every:
        if item.override is not None:
            sheet.room(20)
            sheet.titled(state(item), str(item.verdict), item.title, link=sheet.link_of(item))
            responsible(sheet, item.override)
            sheet.set_y(sheet.y + 1.5)


def responsible(sheet: Sheet, override: Override) -> None:
    """Who has overridden an item, and why."""
    sheet.tell(f"Overridden by {override.by}, {clock(override.at)}:", bold=True, indent=_INDENT)
    sheet.tell(override.reason, indent=_INDENT)


def since_green(sheet: Sheet, document: Document) -> None:
    """What has changed."""
    green = document.since_green
    if green is None:
        return
    sheet.head("What changed since the last green")
    sheet.tell(f"Run {green.run} of {clock(green.at)} was green.")
    for change in green.changes:
        before, after = (
            SYMBOLS[ShownState(word)] + f" {word}" if word else "no such item" for word in (change.before, change.after)
        )
        sheet.tell(f"{change.id}: {before} → {after}: {change.message}", indent=_INDENT)
    if not green.changes:
        sheet.tell("Nothing has changed.")


def not_checked(sheet: Sheet, document: Document) -> None:
    """What was not checked, and why."""
    sheet.head("What was not checked, and why")
    unsettled = [item for item in document.items if state(item) in {ShownState.OPEN, ShownState.INCONCLUSIVE}]
    for entry in document.left_out:
        sheet.tell(f"{entry.what}: {entry.why}", indent=_INDENT)
    for item in unsettled:
        sheet.tell(f"{SYMBOLS[state(item)]} {item.title}: {item.message}", indent=_INDENT)
    if not document.left_out and not unsettled:
        sheet.tell("Everything on the list was looked at.")


def notes(sheet: Sheet, document: Document) -> None:
    """What holds at the site and is of no verdict."""
    _plain(sheet, "Notes", document.notes)


def not_rehearsed(sheet: Sheet, document: Document) -> None:
    """What no emulated device stands for."""
    _plain(sheet, "Not rehearsed", document.not_rehearsed)


def _plain(sheet: Sheet, heading: str, sentences: tuple[str, ...]) -> None:
    if sentences:
        sheet.head(heading)
    for sentence in sentences:
        sheet.tell(sentence, indent=_INDENT)


_INDENT = 5.0
_PHOTO_WIDTH, _PHOTO_HEIGHT = 100.0, 80.0

_Kept = dict[tuple[str, str | None], "Attached"]


def items(sheet: Sheet, document: Document, files: Mapping[str, bytes]) -> None:
    """Write all of them."""
    sheet.head("All items", room=56)
    kept = attached(document, files)
    for row in grid(document).rows:
        if row.items:
            also = f" (also {', '.join(row.row.aliases)})" if row.row.aliases else ""
            sheet.head(f"{row.row.name}{also}", size=11)
        for item in row.items:
            _item(sheet, item, kept)
    if not document.items:
        sheet.tell("There are none: nothing was checked.")


def _item(sheet: Sheet, item: Item, kept: _Kept) -> None:
    sheet.room(22)
    sheet.set_link(sheet.link_of(item), y=sheet.y, page=sheet.page)
    shown = state(item)
    sheet.titled(shown, str(shown), item.title)
    sheet.tell(item.id, size=SMALL, faint=True, indent=_INDENT)
    sheet.tell(item.message, indent=_INDENT)
    if item.hint:
        sheet.tell(f"→ {item.hint}", indent=_INDENT)
    if item.override is not None:
        sheet.tell(f"It was {item.verdict}.", bold=True, indent=_INDENT)
        responsible(sheet, item.override)
    _findings(sheet, item)
    _evidence(sheet, item, kept)
    sheet.tell(_beside(item), size=7, faint=True, indent=_INDENT)
    sheet.set_y(sheet.y + 2)


def _findings(sheet: Sheet, item: Item) -> None:
    result = [finding for finding in item.findings if len(item.findings) > 1 or finding.message != item.message]
    for entry in result:
        sign = SYMBOLS[ShownState(entry.verdict.value)]
        sheet.tell(f"{sign} {entry.verdict} {entry.message} ({entry.code})", size=SMALL, indent=_INDENT + 3)
        if entry.hint and entry.hint != item.hint:
            sheet.tell(f"→ {entry.hint}", size=SMALL, indent=_INDENT + 6)


def _evidence(sheet: Sheet, item: Item, kept: _Kept) -> None:
    for kinds, every in evidence_groups(item):
        text = "; ".join(f"{evidence.what}: {evidence.value}" for evidence in every)
        sheet.tell(f"{text} ({kinds})", size=SMALL, indent=_INDENT + 3)
        last = every[-1]
        if last.file is not None:
            file = kept[last.file, last.sha256]
            sheet.tell(f"{file.name}: {file.words}", size=SMALL, bold=file.amiss, indent=_INDENT + 3)
            if file.photo is not None:
                _photo(sheet, file.photo)


def _photo(sheet: Sheet, photo: Photo) -> None:
    scale = min(_PHOTO_WIDTH / photo.width, _PHOTO_HEIGHT / photo.height)
    width, height = photo.width * scale, photo.height * scale
    sheet.room(height + 2)
    sheet.image(io.BytesIO(photo.data), sheet.l_margin + _INDENT + 3, sheet.y + 1, width, height)
    sheet.set_y(sheet.y + height + 2)


def _beside(item: Item) -> str:
    at = f", {clock(item.at)}" if item.at is not None else ""
    seconds = f", {item.seconds:.1f} s" if item.seconds is not None else ""
    return f"{item.kind}, {item.phase}{at}{seconds}{'' if item.table3 else ', not in Table 3'}"


def top(sheet: Sheet, document: Document) -> None:
    """Write the first lines."""
    sheet.tell(f"Pre-test checklist: {document.title}", size=17, bold=True)
    only = f", only {scope(document)}" if document.scope else ""
    sheet.tell(f"Site {document.site}, {clock(document.started)}{only}", faint=True)
    if document.rehearsed:
        _rehearsed(sheet, document)
    _verdict(sheet, document)
    sheet.tell(signed(document), size=11, bold=True)
    if document.signed is not None:
        sheet.tell(f"digest {document.signed.digest}", size=SMALL)
        sheet.tell(f"key {document.signed.key}", size=SMALL)


def _rehearsed(sheet: Sheet, document: Document) -> None:
    sheet.set_y(sheet.y + 2)
    sheet.tell("REHEARSAL: nothing real was checked.", size=11, bold=True)
    sheet.tell("Devices were emulated; so was all that they answered.")
    for item in document.broken:
        sheet.tell(f"Broken on purpose: {item}")


def _verdict(sheet: Sheet, document: Document) -> None:
    state, words = headline(document)
    message = ", ".join(f"{number} {item}" for item, number in counts(document.items).items()) or "there are no items"
    sheet.set_y(sheet.y + 3)
    for text, size, bold in ((f"{SYMBOLS[state]} {words}", 13.0, True), (message, 9.0, False)):
        sheet.plain(size, bold=bold)
        sheet.tint(state)
        height = sheet.font_size * 1.5
        sheet.multi_cell(0, height, printable(f" {text}"), fill=True, align="L", new_x="LMARGIN", new_y="NEXT")
    sheet.set_y(sheet.y + 3)


def provenance(sheet: Sheet, document: Document) -> None:
    """Write what it was made from and by."""
    sheet.head("Made from")
    ended = clock(document.ended) if document.ended is not None else "not yet"
    for line in (
        f"Run: {document.run}",
        f"Began: {clock(document.started)}; ended: {ended}",
        f"Tool: atlantis-netcfg {document.tool}",
        f"Inventory: {document.inventory}",
        f"Exit: {int(document.exit)}",
    ):
        sheet.tell(line, size=SMALL)


_NAME, _GAP, _ROW = 27.0, 3.0, 9.0
_NAME_LETTERS = 16
_LOUD = frozenset({ShownState.FAIL, ShownState.ERROR})
_THICK = frozenset({ShownState.FAIL, ShownState.ERROR, ShownState.INCONCLUSIVE, ShownState.OPEN})


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


def _cell(sheet: Sheet, cell: GridCell, x: float, y: float, width: float) -> None:
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

    def draw(self, shapes: DrawingLayout) -> None:
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

    def _wire(self, wire: DrawnWire) -> None:
        self._sheet.tint(wire.state)
        self._sheet.set_line_width(0.5 if wire.state in _LOUD else 0.3)
        if wire.dashed:
            self._sheet.set_dash_pattern(dash=1.2, gap=0.8)
        self._sheet.polyline([self._at(*point) for point in wire.points])
        self._sheet.set_dash_pattern()

    def _face(self, shape: DrawnBox | Badge, height: float) -> None:
        self._sheet.tint(shape.state)
        self._sheet.set_line_width(0.7 if shape.state in _LOUD else 0.25)
        x, y = self._at(shape.x, shape.y)
        width, height = shape.width * self._scale, height * self._scale
        self._sheet.rect(x, y, width, height, style="DF", round_corners=True, corner_radius=1.2)

    def _box(self, box: DrawnBox) -> None:
        self._face(box, box.height)
        sign = f"{SYMBOLS[box.state]} " if box.state is not None else ""
        self._write(f"{sign}{box.label}", box, box.y + (4 if box.detail else 12), 11, "B")
        if box.detail:
            self._write(box.detail, box, box.y + 20, 9, "")

    def _badge(self, badge: Badge) -> None:
        self._face(badge, BADGE_HEIGHT)
        self._write(badge.text, badge, badge.y + 1, 10, "")

    def _write(self, text: str, shape: DrawnBox | Badge, top: float, size: float, style: str) -> None:
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
