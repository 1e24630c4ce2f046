"""The checklist as PDF, A4: the same as the page, for whoever files paper.

fpdf2 writes it, which needs no library of the system; the fonts are ours, so that a note in Greek or Cyrillic is not
lost, and what they lack is written as `U+4E2D`. Its time is the document's, so the same document gives the same bytes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.report._pdf._items import (
    draw,
    first,
    items,
    not_checked,
    not_rehearsed,
    notes,
    overridden,
    provenance,
    since_green,
    table,
    top,
)
from atlantis_netcfg.checklist.report._pdf._sheet import Sheet

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.checklist.report.document import Document


__all__ = ["pdf"]


def pdf(document: Document, files: Mapping[str, bytes]) -> bytes:
    """The file, the same for the same document and files."""
    sheet = Sheet(document)
    sheet.add_page()
    top(sheet, document)
    table(sheet, document)
    first(sheet, document)
    overridden(sheet, document)
    since_green(sheet, document)
    not_checked(sheet, document)
    notes(sheet, document)
    draw(sheet, document)
    items(sheet, document, files)
    not_rehearsed(sheet, document)
    provenance(sheet, document)
    return sheet.to_bytes()
