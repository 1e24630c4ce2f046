"""All items on paper, row by row, with what they stand on.

Lists on paper: what to mend first, what was overridden, what has changed, what was not checked or rehearsed.

The first lines: what it is, how it ended, who vouches for it; and the last ones: what it was made from.
"""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.report import _words as words
from atlantis_netcfg.checklist.report._grid import grid
from atlantis_netcfg.checklist.report._pdf._sheet import SMALL, printable
from atlantis_netcfg.checklist.report._photos import attached
from atlantis_netcfg.checklist.report._states import SYMBOLS, State, state
from atlantis_netcfg.checklist.report._words import clock, counts, evidence_groups, headline, scope, signed

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.checklist.report._pdf._sheet import Sheet
    from atlantis_netcfg.checklist.report._photos import Attached, Photo
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
