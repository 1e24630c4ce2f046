"""The checklist as PDF, A4: the same content as the page, for paper files.

fpdf2 writes it, which needs no system library; the fonts are included, so that a note in Greek or Cyrillic is not lost,
and characters that they lack are written as `U+4E2D`. Its timestamp is the document's, so the same document gives the
same bytes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.report._pdf import _items
from atlantis_netcfg.checklist.report._pdf._sheet import Sheet

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.checklist.report.document import Document


__all__ = ["pdf"]


def pdf(document: Document, files: Mapping[str, bytes]) -> bytes:
    """Return the file; the same document and files always give the same bytes."""
    sheet = Sheet(document)
    sheet.add_page()
    _items.top(sheet, document)
    _items.table(sheet, document)
    _items.first(sheet, document)
    _items.overridden(sheet, document)
    _items.since_green(sheet, document)
    _items.not_checked(sheet, document)
    _items.notes(sheet, document)
    _items.draw(sheet, document)
    _items.items(sheet, document, files)
    _items.not_rehearsed(sheet, document)
    _items.provenance(sheet, document)
    return sheet.to_bytes()
