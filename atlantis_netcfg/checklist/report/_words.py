"""Words that every page shares, and what makes text of people and devices harmless to show.

What a console shows of a checklist: 80 columns, signs of ASCII, the worst first, what to do beside it.
"""

from __future__ import annotations

from textwrap import wrap
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.report._shapes import ASCII, GREEN, GridCell, GridRow, ShownState, cut, grid, state
from atlantis_netcfg.checklist.report.document import Document, Evidence, EvidenceType, Item
from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.printable import visible

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from datetime import datetime


_TITLES = {
    "wifi": "Wi-Fi",
    "acoustic": "Acoustic",
    "satellite": "Satellite",
    "usbl": "USBL",
    "rc_rf": "RC RF",
    "4g": "4G",
    "gps": "GPS",
    "ethernet": "Ethernet",
    "site": "Site",
    "vpn": "VPN",
}


def title(endpoint: str) -> str:
    """A column in the words of Table 3."""
    return _TITLES.get(endpoint, endpoint)


def clock(at: datetime) -> str:
    """A time as people compare it with their notes."""
    return f"{at:%Y-%m-%d %H:%M:%S} {at.tzname() or 'no time zone'}"


def counts(items: Iterable[Item]) -> dict[ShownState, int]:
    """How many there are of each state, the worst first, without those that there are none of."""
    states = [state(item) for item in items]
    return {entry: states.count(entry) for entry in reversed(ShownState) if entry in states}


def by_state(items: Iterable[Item]) -> list[Item]:
    """The worst first; those of one state in the order of the list."""
    order = tuple(reversed(ShownState))
    return sorted(items, key=lambda item: order.index(state(item)))


def first(document: Document) -> tuple[str, list[Item]]:
    """What somebody has to look at, the worst first, and a heading for it."""
    every = [item for item in by_state(document.items) if state(item) not in _SETTLED]
    grave = any(state(item) not in GREEN for item in every)
    return "What to mend first" if grave else "What to look at", every


_SETTLED = frozenset({ShownState.PASS, ShownState.SKIP, ShownState.OVERRIDDEN})


def headline(document: Document) -> tuple[ShownState, str]:
    """The verdict of the whole in one word and one sentence."""
    values = counts(document.items)
    narrowed = f", for {scope(document)} alone" if document.scope else ""
    if document.exit is ExitCode.NOTHING:
        return ShownState.NOT_CHECKED, "Nothing was checked"
    if document.exit is not ExitCode.DONE:
        return next(iter(values)), f"The checklist has not passed{narrowed}"
    unpleasant = (
        ShownState.OVERRIDDEN
        if ShownState.OVERRIDDEN in values
        else ShownState.WARN
        if ShownState.WARN in values
        else ShownState.PASS
    )
    return unpleasant, f"The checklist has passed{narrowed}{_AND[unpleasant]}"


_AND = {
    ShownState.OVERRIDDEN: ", with what a person has overruled",
    ShownState.WARN: ", with warnings",
    ShownState.PASS: "",
}


def scope(document: Document) -> str:
    """What it was narrowed to, in the words of the command line."""
    return " ".join(f"{name}={','.join(chosen)}" for name, chosen in document.scope.items())


def closing(document: Document) -> str:
    """The exit in words."""
    words = ", ".join(f"{number} {item}" for item, number in counts(document.items).items())
    return f"{headline(document)[1]} (exit {int(document.exit)}): {words or 'no items'}"


def signed(document: Document) -> str:
    """Who vouches for it."""
    if document.signed is None:
        return "NOT SIGNED: nobody vouches for it"
    return f"Signed by {visible(document.signed.by)}, {clock(document.signed.at)}"


_EVIDENCE = {
    EvidenceType.MEASURED: "measured",
    EvidenceType.READ: "read from the device",
    EvidenceType.CONFIRMED: "confirmed by a person",
    EvidenceType.DECLARED: "declared in the inventory",
    EvidenceType.FILE: "file",
}


def evidence_type(evidence: Evidence) -> str:
    """What it stands on, and whose and when it is."""
    by = f", {evidence.by}" if evidence.by is not None else ""
    at = f", {clock(evidence.at)}" if evidence.at is not None else ""
    return f"{_EVIDENCE[evidence.type]}{by}{at}"


def evidence_groups(item: Item) -> list[tuple[str, list[Evidence]]]:
    """Evidence that lies side by side and is of one kind, person and time, under its words; a file is on its own."""
    result: list[tuple[str, list[Evidence]]] = []
    for evidence in item.evidence:
        words = evidence_type(evidence)
        if result and result[-1][0] == words and evidence.file is None and result[-1][1][-1].file is None:
            result[-1][1].append(evidence)
        else:
            result.append((words, [evidence]))
    return result


def evidence_words(evidence: Evidence) -> str:
    """One line of evidence."""
    kept = f"; kept as {evidence.file}" if evidence.file is not None else ""
    digest = f", SHA-256 {evidence.sha256}" if evidence.sha256 is not None else ""
    return f"{evidence.what}: {evidence.value} ({evidence_type(evidence)}){kept}{digest}"


_WIDTH = 80
_NAME, _CELL = 14, 7
"""Columns of the grid, in characters."""
_MARGIN = 15
"""Where the words of an item begin."""
_GRID = {
    ShownState.PASS: "ok",
    ShownState.INCONCLUSIVE: "?",
    ShownState.OVERRIDDEN: "FAIL*",
    ShownState.NOT_CHECKED: ".",
}
_WORDS = {
    ShownState.INCONCLUSIVE: "? INCONCLUSIVE",
    ShownState.OVERRIDDEN: "FAIL* overridden by a person",
    ShownState.NOT_CHECKED: ". not checked",
}
_HEADS = {"acoustic": "Acous.", "satellite": "Satel.", "ethernet": "Ether."}
_BRIEF = frozenset({ShownState.OPEN, ShownState.SKIP, ShownState.PASS})
"""What is told after the rest, in a line each or by name alone."""


def lines(document: Document) -> str:
    """The text, without a line feed at the end."""
    return "\n".join(_lines(document))


def _lines(document: Document) -> Iterator[str]:
    yield from _wrapped("", f"Checklist of {document.site} ({document.title}), run {document.run}")
    if document.rehearsed:
        yield from _wrapped("", "REHEARSED on emulated devices: nothing real was checked")
        yield from _listed("broken on purpose: ", document.broken)
    yield ""
    yield from _grid(document)
    for item in by_state(document.items):
        if state(item) not in _BRIEF:
            yield ""
            yield from _item(item)
    yield ""
    yield from _brief(document)
    yield from _beside(document)
    yield ""
    yield from _wrapped("", closing(document))
    yield from _wrapped("", signed(document))
    if document.signed is not None:
        yield from _wrapped("", f"digest {document.signed.digest}")
        yield from _wrapped("", f"key {document.signed.key}")


def _grid(document: Document) -> Iterator[str]:
    table = grid(document)
    if not table.rows:
        return
    names = [_HEADS.get(column, title(column))[: _CELL - 1] for column in (*table.columns, *table.beside)]
    yield _line("", [*names[: len(table.columns)], "|", *names[len(table.columns) :]] if table.beside else names)
    for row in table.rows:
        yield _line(cut(row.row.name, _NAME - 1, "~"), _marks(row, len(table.columns), beside=bool(table.beside)))
    yield from _legend(document)


def _marks(row: GridRow, columns: int, *, beside: bool) -> list[str]:
    marks = [_mark(cell) for cell in row.cells]
    return [*marks[:columns], "|", *marks[columns:]] if beside else marks


def _mark(cell: GridCell) -> str:
    if cell.empty:
        return ""
    words = _GRID.get(cell.state, str(cell.state))
    return words if cell.table3 else f"({words})"


def _line(name: str, marks: list[str]) -> str:
    words = "".join("| " if mark == "|" else f"{mark:<{_CELL}}" for mark in marks)
    return f"{name:<{_NAME}}{words}".rstrip()


def _legend(document: Document) -> Iterator[str]:
    cells = [cell for row in grid(document).rows for cell in row.cells if not cell.empty]
    result = []
    if any(not cell.table3 for cell in cells):
        result.append("( ) not part of Table 3")
    result += [text for item, text in _WORDS.items() if any(cell.state is item for cell in cells)]
    if result:
        yield from _wrapped("", ", ".join(result))
    for row in document.rows:
        if row.deviation is not None:
            yield from _wrapped("", f"{row.name} differs from the report: {row.deviation}")


def _item(item: Item) -> Iterator[str]:
    shown = state(item)
    yield from _wrapped(f"{ASCII[shown]} {shown}", f"{item.id}: {item.title}")
    yield from _wrapped("", item.message, indent=_MARGIN)
    if item.hint:
        yield from _wrapped("", f"-> {item.hint}", indent=_MARGIN)
    if item.override is not None:
        at = clock(item.override.at)
        words = f"{item.verdict}, overridden by {item.override.by}, {at}: {item.override.reason}"
        yield from _wrapped("", words, indent=_MARGIN)


def _brief(document: Document) -> Iterator[str]:
    """What is open or was skipped with the reason, what passed by name alone."""
    for entry in (ShownState.OPEN, ShownState.SKIP):
        for item in document.items:
            if state(item) is entry:
                yield from _wrapped(f"{ASCII[entry]} {entry}", f"{item.id}: {item.title} ({item.message})")
    passed = [item.id for item in document.items if state(item) is ShownState.PASS]
    if passed:
        yield from _wrapped(f"{ASCII[ShownState.PASS]} PASS", ", ".join(passed))


def _beside(document: Document) -> Iterator[str]:
    reasons = dict.fromkeys(entry.why for entry in document.left_out)
    for why in reasons:
        what = ", ".join(item.what for item in document.left_out if item.why == why)
        yield from _listed("not checked: ", [f"{what} ({why})"])
    yield from _listed("note: ", document.notes)
    if document.since_green is not None:
        green = document.since_green
        yield from _wrapped("", f"since run {green.run} of {clock(green.at)}, which was green:")
        for change in green.changes:
            words = f"{change.id}: {change.before or 'none'} -> {change.after or 'none'}: {change.message}"
            yield from _wrapped("", words, indent=2)
        if not green.changes:
            yield "  nothing has changed"
    yield from _listed("not rehearsed: ", document.not_rehearsed if document.rehearsed else ())


def _listed(what: str, every: tuple[str, ...] | list[str]) -> Iterator[str]:
    for item in every:
        yield from _wrapped("", f"{what}{item}")


def _wrapped(mark: str, words: str, *, indent: int = 0) -> Iterator[str]:
    """Words that begin behind a mark, broken where the console ends; a line feed of theirs breaks as well."""
    start = _MARGIN if mark else indent
    width = _WIDTH - start
    every = visible(words).expandtabs(1).split("\n")
    parts = (part for line in every for part in wrap(line, width, break_on_hyphens=False) or [""])
    for number, part in enumerate(parts):
        yield f"{'' if number else mark:<{start}}{part}".rstrip()
