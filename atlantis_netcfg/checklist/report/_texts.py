"""Fixed texts of the checklist pages: whole English messages, which the pages translate.

The documents themselves, and JUnit XML, stay English.
"""

from __future__ import annotations

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
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.core.printable import split_code
from atlantis_netcfg.core.times import time_text
from atlantis_netcfg.inventory.model import Phase


class PageText(StrEnum):
    """Headings, labels and sentences without values."""

    REHEARSAL = "REHEARSAL: nothing real was checked."
    EMULATION_NOTE = "The devices and all their responses were emulated."
    SEE_NOT_REHEARSED = "Limits of the rehearsal"
    REHEARSAL_NOTE = "REHEARSAL, nothing real was checked"
    BROKEN = "Injected faults:"
    VERDICT = "Verdict"
    SIGNATURE = "Signature"
    SIGNS = "Symbols"
    NO_ITEMS = "there are no items"
    NOT_EVERYTHING = "Not everything was checked:"
    SEE_NOT_CHECKED = "what was not checked, and why"
    WHEN = "When"
    DIGEST = "Digest"
    KEY = "Key"
    NOT_SIGNED = "NOT SIGNED"
    NOBODY = "Nobody vouches for this page."
    TABLE = "Table 3"
    BESIDE_TABLE = "not in Table 3"
    CAPTION = "Each X of the report's table, with its worst verdict. Each symbol links to its item."
    BESIDE_SIGN = "checked, but not a cell of Table 3"
    NO_SUCH_ITEM = "no such item"
    OVERRIDDEN = "Overridden by a person"
    SINCE = "Changes since the last green checklist"
    ITEM = "Item"
    BEFORE = "Before"
    NOW = "Now"
    WHAT = "What"
    NO_CHANGES = "Nothing has changed."
    NOT_CHECKED = "What was not checked, and why"
    ALL_CHECKED = "Everything on the list was checked."
    NOTES = "Notes"
    SITE = "The site"
    ITEMS = "All items"
    NOTHING = "None: nothing was checked."
    NOT_REHEARSED = "Limits of the rehearsal"
    MADE_FROM = "Created from"
    RUN = "Run"
    BEGAN = "Started"
    END = "Ended"
    NOT_YET = "not yet"
    TOOL = "Tool"
    INVENTORY = "Inventory"
    EXIT = "Exit code"


EVIDENCE = {
    EvidenceType.MEASURED: "measured",
    EvidenceType.READ: "read from the device",
    EvidenceType.CONFIRMED: "confirmed by a person",
    EvidenceType.DECLARED: "from the inventory",
    EvidenceType.FILE: "file",
}
KINDS = {
    ItemKind.AUTOMATIC: "checked by the program",
    ItemKind.ACTIVE: "checked by the program with a person's consent",
    ItemKind.PERSON: "checked by a person",
}
PHASES = {
    Phase.BENCH: "on the bench",
    Phase.QUAY: "at the quay",
    Phase.WATER: "in the water",
    Phase.RECOVERY: "when the vehicles are back",
    Phase.INTEGRATION: "when it joins the pilot",
}


def of_integration(document: Document) -> bool:
    """Return whether it is the integration record of one robot, not a checklist before a test."""
    return document.scope.get("phase") == (Phase.INTEGRATION,)


def heading(document: Document) -> str:
    """Return the heading of the page."""
    if of_integration(document):
        return msg(f"Integration record: {arg(join(', ', (row.name for row in document.rows)))}, {arg(document.title)}")
    return msg(f"Pre-test checklist: {arg(document.title)}")


def subtitle(document: Document) -> str:
    """Return the subtitle: site, time, mission and scope."""
    at = time_text(document.started, document.time_zone)
    if document.mission and not document.scope:
        return msg(f"Site `{arg(document.site)}`, {arg(at)}, mission `{arg(document.mission)}`")
    if not document.scope:
        return msg(f"Site `{arg(document.site)}`, {arg(at)}")
    scope = " ".join(f"{name}={','.join(values)}" for name, values in document.scope.items())
    return msg(f"Site `{arg(document.site)}`, {arg(at)}, only `{arg(scope)}`")


def also(row: Row) -> str:
    """Format the other names of a vehicle."""
    return msg(f"also {arg(join(', ', row.aliases))}")


def differs(row: Row) -> str:
    """Format why a row differs from the report's table."""
    return msg(f"{arg(row.name)} differs from the report: {arg(row.deviation)}")


def item_title(item: Item) -> str:
    """Return the title of an item, translated; inventory items are shown unchanged."""
    return item.title if item.endpoint == "items" else translate(item.title)


def was(item: Item) -> str:
    """Format the verdict that a person has overridden."""
    return msg(f"It was {arg(item.verdict)}.")


def photo(name: str) -> str:
    """Return the alternative text of a photo."""
    return msg(f"Photo {arg(name)}")


def overridden_by(override: Override, zone: str) -> str:
    """Format who has overridden an item, and when."""
    return msg(f"Overridden by {arg(override.by)}, {arg(time_text(override.at, zone))}:")


def was_green(green: SinceGreen, zone: str) -> str:
    """Format the run with which the checklist is compared."""
    return msg(f"Run `{arg(green.run)}` of {arg(time_text(green.at, zone))} was green.")


def name_of_page(document: Document) -> str:
    """Return the title for browsers and PDF readers."""
    if of_integration(document):
        return msg(
            f"Integration record of {arg(join(', ', (row.name for row in document.rows)))}, run {arg(document.run)}"
        )
    return msg(f"Checklist of {arg(document.title)}, run {arg(document.run)}")


def strip_code(text: str) -> str:
    """Remove the back-ticks around code, for pages without a code font."""
    return "".join(piece for piece, _ in split_code(text))
