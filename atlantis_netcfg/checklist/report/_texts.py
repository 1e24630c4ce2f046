"""What the pages of a checklist say beside what was found: whole English messages, which the pages translate.

The documents themselves, and JUnit XML, stay English.
"""

from __future__ import annotations

import re
from enum import StrEnum

from atlantis_netcfg.checklist.report.document import (
    Document,
    EvidenceType,
    Item,
    ItemKind,
    Override,
    Row,
    SinceGreen,
)
from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.times import time_text
from atlantis_netcfg.inventory.model import Phase


class PageText(StrEnum):
    """Headings, labels and sentences without values."""

    REHEARSAL = "REHEARSAL: nothing real was checked."
    EMULATION_NOTE = "Devices were emulated; so was all that they answered."
    SEE_NOT_REHEARSED = "What was not rehearsed"
    REHEARSAL_NOTE = "REHEARSED, nothing real was checked"
    BROKEN = "Broken on purpose:"
    VERDICT = "Verdict"
    SIGNATURE = "Signature"
    SIGNS = "Signs"
    NO_ITEMS = "there are no items"
    NOT_EVERYTHING = "Not everything was looked at:"
    SEE_NOT_CHECKED = "what was not checked, and why"
    WHEN = "When"
    DIGEST = "Digest"
    KEY = "Key"
    NOT_SIGNED = "NOT SIGNED"
    NOBODY = "Nobody vouches for this page."
    TABLE = "Table 3"
    BESIDE_TABLE = "not in Table 3"
    CAPTION = "Each X of the report's table, with the worst that was found. A sign leads to what it stands on."
    BESIDE_SIGN = "checked, but not a cell of Table 3"
    NO_SUCH_ITEM = "no such item"
    OVERRIDDEN = "Overridden by a person"
    SINCE = "What changed since the last green"
    ITEM = "Item"
    BEFORE = "Before"
    NOW = "Now"
    WHAT = "What"
    NO_CHANGES = "Nothing has changed."
    NOT_CHECKED = "What was not checked, and why"
    ALL_CHECKED = "Everything on the list was looked at."
    NOTES = "Notes"
    SITE = "The site"
    ITEMS = "All items"
    NOTHING = "There are none: nothing was checked."
    NOT_REHEARSED = "Not rehearsed"
    MADE_FROM = "Made from"
    RUN = "Run"
    BEGAN = "Began"
    END = "Ended"
    NOT_YET = "not yet"
    TOOL = "Tool"
    INVENTORY = "Inventory"
    EXIT = "Exit"


EVIDENCE = {
    EvidenceType.MEASURED: "measured",
    EvidenceType.READ: "read from the device",
    EvidenceType.CONFIRMED: "confirmed by a person",
    EvidenceType.DECLARED: "declared in the inventory",
    EvidenceType.FILE: "file",
}
KINDS = {
    ItemKind.AUTOMATIC: "the tool looked by itself",
    ItemKind.ACTIVE: "the tool acts on a person's word",
    ItemKind.PERSON: "a person looks",
}
PHASES = {
    Phase.BENCH: "on the bench",
    Phase.QUAY: "at the quay",
    Phase.WATER: "in the water",
    Phase.RECOVERY: "when the vehicles are back",
    Phase.INTEGRATION: "when it joins the pilot",
}


def of_integration(document: Document) -> bool:
    """Whether it is the record of one robot, and no checklist before a test."""
    return document.scope.get("phase") == (Phase.INTEGRATION,)


def heading(document: Document) -> str:
    """What the page is."""
    if of_integration(document):
        return f"Integration record: {', '.join(row.name for row in document.rows)}, {document.title}"
    return f"Pre-test checklist: {document.title}"


def subtitle(document: Document) -> str:
    """Where, when, and of what alone."""
    at = time_text(document.started, document.time_zone)
    if document.mission and not document.scope:
        return f"Site `{document.site}`, {at}, mission `{document.mission}`"
    if not document.scope:
        return f"Site `{document.site}`, {at}"
    scope = " ".join(f"{name}={','.join(values)}" for name, values in document.scope.items())
    return f"Site `{document.site}`, {at}, only `{scope}`"


def also(row: Row) -> str:
    """Other names of a vehicle."""
    return f"also {', '.join(row.aliases)}"


def differs(row: Row) -> str:
    """Why a row is another one than the report's."""
    return f"{row.name} differs from the report: {row.deviation}"


def item_title(item: Item) -> str:
    """What is checked, in the person's language; what the pilot declares is shown as it stands there."""
    return item.title if item.endpoint == "items" else translate(item.title)


def was(item: Item) -> str:
    """What was found where a person has overridden it."""
    return f"It was {item.verdict}."


def photo(name: str) -> str:
    """For whoever does not see it."""
    return f"Photo {name}"


def overridden_by(override: Override, zone: str) -> str:
    """Who takes the responsibility, and since when."""
    return f"Overridden by {override.by}, {time_text(override.at, zone)}:"


def was_green(green: SinceGreen, zone: str) -> str:
    """With what the checklist is compared."""
    return f"Run `{green.run}` of {time_text(green.at, zone)} was green."


def name_of_page(document: Document) -> str:
    """What a browser and a reader of PDF call it."""
    if of_integration(document):
        return f"Integration record of {', '.join(row.name for row in document.rows)}, run {document.run}"
    return f"Checklist of {document.title}, run {document.run}"


_CODE = re.compile(r"`([^`\s](?:[^`\n]*[^`\s])?)`")


def split_code(text: str) -> list[tuple[str, bool]]:
    """Text in pieces; what stands between back-ticks is code (True), and the back-ticks are gone."""
    pieces = enumerate(_CODE.split(text))
    return [(piece, bool(number % 2)) for number, piece in pieces if piece]


def strip_code(text: str) -> str:
    """Text without the back-ticks around code, where a page has no letters for code."""
    return _CODE.sub(r"\1", text)
