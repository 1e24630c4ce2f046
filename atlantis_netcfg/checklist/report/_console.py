"""What a console shows of a checklist: 80 columns, signs of ASCII, the worst first, what to do beside it."""

from __future__ import annotations

from textwrap import wrap
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.report._grid import grid
from atlantis_netcfg.checklist.report._shapes import cut
from atlantis_netcfg.checklist.report._states import ASCII, State, state
from atlantis_netcfg.checklist.report._words import by_state, clock, closing, signed, title
from atlantis_netcfg.core.printable import visible

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.checklist.report._grid import Cell, GridRow
    from atlantis_netcfg.checklist.report.document import Document, Item

_WIDTH = 80
_NAME, _CELL = 14, 7
"""Columns of the grid, in characters."""
_MARGIN = 15
"""Where the words of an item begin."""
_GRID = {State.PASS: "ok", State.INCONCLUSIVE: "?", State.OVERRIDDEN: "FAIL*", State.NOT_CHECKED: "."}
_WORDS = {
    State.INCONCLUSIVE: "? INCONCLUSIVE",
    State.OVERRIDDEN: "FAIL* overridden by a person",
    State.NOT_CHECKED: ". not checked",
}
_HEADS = {"acoustic": "Acous.", "satellite": "Satel.", "ethernet": "Ether."}
_BRIEF = frozenset({State.OPEN, State.SKIP, State.PASS})
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


def _mark(cell: Cell) -> str:
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
    for entry in (State.OPEN, State.SKIP):
        for item in document.items:
            if state(item) is entry:
                yield from _wrapped(f"{ASCII[entry]} {entry}", f"{item.id}: {item.title} ({item.message})")
    passed = [item.id for item in document.items if state(item) is State.PASS]
    if passed:
        yield from _wrapped(f"{ASCII[State.PASS]} PASS", ", ".join(passed))


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
