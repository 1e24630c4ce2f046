"""Lists on paper: what to mend first, what was overridden, what has changed, what was not checked or rehearsed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.report import _words as words
from atlantis_netcfg.checklist.report._states import SYMBOLS, State, state
from atlantis_netcfg.checklist.report._words import clock

if TYPE_CHECKING:
    from atlantis_netcfg.checklist.report._pdf._sheet import Sheet
    from atlantis_netcfg.checklist.report.document import Document, Override

__all__ = ["first", "not_checked", "not_rehearsed", "notes", "overridden", "responsible", "since_green"]

_INDENT = 5.0


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
            SYMBOLS[State(word)] + f" {word}" if word else "no such item" for word in (change.before, change.after)
        )
        sheet.tell(f"{change.id}: {before} → {after}: {change.message}", indent=_INDENT)
    if not green.changes:
        sheet.tell("Nothing has changed.")


def not_checked(sheet: Sheet, document: Document) -> None:
    """What was not checked, and why."""
    sheet.head("What was not checked, and why")
    unsettled = [item for item in document.items if state(item) in {State.OPEN, State.INCONCLUSIVE}]
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
