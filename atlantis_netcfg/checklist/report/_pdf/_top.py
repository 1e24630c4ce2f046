"""The first lines: what it is, how it ended, who vouches for it; and the last ones: what it was made from."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.report._pdf._sheet import SMALL, printable
from atlantis_netcfg.checklist.report._states import SYMBOLS
from atlantis_netcfg.checklist.report._words import clock, counts, headline, scope, signed

if TYPE_CHECKING:
    from atlantis_netcfg.checklist.report._pdf._sheet import Sheet
    from atlantis_netcfg.checklist.report.document import Document

__all__ = ["provenance", "top"]


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
    for words in (
        f"Run: {document.run}",
        f"Began: {clock(document.started)}; ended: {ended}",
        f"Tool: atlantis-netcfg {document.tool}",
        f"Inventory: {document.inventory}",
        f"Exit: {int(document.exit)}",
    ):
        sheet.tell(words, size=SMALL)
