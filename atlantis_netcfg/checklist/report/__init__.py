"""The pre-test checklist as a document, and the pages that are made from it.

One document of plain data holds all results, with the person and the evidence; it is what `--json` prints, what is
stored and what is signed. Every page (HTML, PDF, JUnit XML, console text) is a pure function of that document, so no
page can contain anything that was not signed.
"""

from __future__ import annotations

from atlantis_netcfg.checklist.report._pages import pages
from atlantis_netcfg.checklist.report._svg import drawing_svg
from atlantis_netcfg.checklist.report._texts import item_title
from atlantis_netcfg.checklist.report._words import body, ending, lines, seal, signature_line, to_look_at
from atlantis_netcfg.checklist.report.document import (
    Document,
    Drawing,
    DrawnLink,
    DrawnNode,
    Evidence,
    EvidenceType,
    Item,
    ItemChange,
    ItemFinding,
    ItemKind,
    LeftOut,
    Override,
    Row,
    Signature,
    SinceGreen,
)
from atlantis_netcfg.inventory.model import Phase

__all__ = [
    "Document",
    "Drawing",
    "DrawnLink",
    "DrawnNode",
    "Evidence",
    "EvidenceType",
    "Item",
    "ItemChange",
    "ItemFinding",
    "ItemKind",
    "LeftOut",
    "Override",
    "Phase",
    "Row",
    "Signature",
    "SinceGreen",
    "body",
    "drawing_svg",
    "ending",
    "item_title",
    "lines",
    "pages",
    "seal",
    "signature_line",
    "to_look_at",
]
