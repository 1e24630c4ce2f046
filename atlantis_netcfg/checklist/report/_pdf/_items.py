"""All items on paper, row by row, with what they stand on."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.report._grid import grid
from atlantis_netcfg.checklist.report._pdf._lists import responsible
from atlantis_netcfg.checklist.report._pdf._sheet import SMALL
from atlantis_netcfg.checklist.report._photos import attached
from atlantis_netcfg.checklist.report._states import SYMBOLS, State, state
from atlantis_netcfg.checklist.report._words import clock, evidence_groups

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.checklist.report._pdf._sheet import Sheet
    from atlantis_netcfg.checklist.report._photos import Attached, Photo
    from atlantis_netcfg.checklist.report.document import Document, Item

__all__ = ["items"]

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
        sign = SYMBOLS[State(entry.verdict.value)]
        sheet.tell(f"{sign} {entry.verdict} {entry.message} ({entry.code})", size=SMALL, indent=_INDENT + 3)
        if entry.hint and entry.hint != item.hint:
            sheet.tell(f"→ {entry.hint}", size=SMALL, indent=_INDENT + 6)


def _evidence(sheet: Sheet, item: Item, kept: _Kept) -> None:
    for words, every in evidence_groups(item):
        text = "; ".join(f"{evidence.what}: {evidence.value}" for evidence in every)
        sheet.tell(f"{text} ({words})", size=SMALL, indent=_INDENT + 3)
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
