"""Texts shared by all pages, and escaping of text from people and devices.

Also the console view of a checklist: 80 columns, ASCII symbols, the worst first, with what to do.
"""

from __future__ import annotations

from collections.abc import Callable
from textwrap import wrap
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.report import _shapes, _texts
from atlantis_netcfg.core import printable
from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.core.times import time_text
from atlantis_netcfg.runs.report import signs
from atlantis_netcfg.runs.report.summary import count_limits

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from atlantis_netcfg.checklist.report.document import Document, Evidence, Item, ItemChange


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
    "robot": "Robot",
    "integration": "Integration",
    "items": "Items",
    "vpn": "VPN",
}


def title(endpoint: str) -> str:
    """Return a column's title as in Table 3."""
    return _TITLES.get(endpoint, endpoint)


def counts(items: Iterable[Item]) -> dict[signs.ShownState, int]:
    """Count the items of each state, the worst first; states without items are left out."""
    states = [_shapes.state(item) for item in items]
    return {entry: states.count(entry) for entry in reversed(signs.ShownState) if entry in states}


def by_state(items: Iterable[Item]) -> list[Item]:
    """Sort by state, the worst first; within a state in the order of the list."""
    order = tuple(reversed(signs.ShownState))
    return sorted(items, key=lambda item: order.index(_shapes.state(item)))


def to_look_at(document: Document) -> tuple[str, list[Item]]:
    """Return a heading and the items that need attention, the worst first."""
    every = [item for item in by_state(document.items) if _shapes.state(item) not in _SETTLED_STATES]
    grave = any(_shapes.state(item) not in _shapes.GREEN for item in every)
    return "What to fix first" if grave else "What to check", every


_SETTLED_STATES = frozenset({signs.ShownState.PASS, signs.ShownState.SKIP, signs.ShownState.OVERRIDDEN})


def headline(document: Document) -> tuple[signs.ShownState, str]:
    """Return the overall verdict as one state and one sentence."""
    values = counts(document.items)
    if document.exit is ExitCode.NOTHING:
        return signs.ShownState.NOT_CHECKED, "Nothing was checked"
    shown_state = next(iter(values)) if document.exit is not ExitCode.DONE else _pass_state(values)
    of_all, of_some = _HEADLINES.get(shown_state, _NOT_PASSED) if document.exit is ExitCode.DONE else _NOT_PASSED
    return shown_state, msg(of_some.format(scope=arg(scope(document)))) if document.scope else of_all


def _pass_state(values: Mapping[signs.ShownState, int]) -> signs.ShownState:
    return next(
        (state for state in (signs.ShownState.OVERRIDDEN, signs.ShownState.WARN) if state in values),
        signs.ShownState.PASS,
    )


_NOT_PASSED = ("The checklist has not passed", "The checklist has not passed, for {scope} only")
_HEADLINES = {
    signs.ShownState.OVERRIDDEN: (
        "The checklist has passed, with items overridden by a person",
        "The checklist has passed, for {scope} only, with items overridden by a person",
    ),
    signs.ShownState.WARN: (
        "The checklist has passed, with warnings",
        "The checklist has passed, for {scope} only, with warnings",
    ),
    signs.ShownState.PASS: ("The checklist has passed", "The checklist has passed, for {scope} only"),
}


def scope(document: Document) -> str:
    """Format the scope as command-line arguments."""
    return " ".join(f"{name}={','.join(values)}" for name, values in document.scope.items())


def english(text: str) -> str:
    """Return the text untranslated, for machine-readable pages."""
    return text


Say = Callable[[str], str]
"""Translates a message into the language of the page: `translate`, or `english`."""


def closing(document: Document, say: Say) -> str:
    """Format the exit status and the counts."""
    words = join(", ", (f"{number} {item}" for item, number in counts(document.items).items()))
    return msg(
        f"{arg(say(headline(document)[1]))} ({arg(say(msg(f'exit {arg(int(document.exit))}')))}): "
        f"{arg(words or say(_texts.PageText.NO_ITEMS))}"
    )


def signature_line(document: Document) -> str:
    """Format who signed the document."""
    if document.signed is None:
        return "NOT SIGNED: nobody vouches for it"
    return msg(
        f"Signed by {arg(printable.visible(document.signed.by))}, "
        f"{arg(time_text(document.signed.at, document.time_zone))}"
    )


def evidence_type(evidence: Evidence, say: Say, zone: str) -> str:
    """Format the type of evidence, with person and time."""
    by = msg(f", {arg(evidence.by)}" if evidence.by is not None else "")
    at = msg(f", {arg(time_text(evidence.at, zone))}" if evidence.at is not None else "")
    return f"{say(_texts.EVIDENCE[evidence.type])}{by}{at}"


def evidence_groups(item: Item, say: Say, zone: str) -> list[tuple[str, list[Evidence]]]:
    """Group adjacent evidence of one type, person and time under one title; a file is its own group."""
    result: list[tuple[str, list[Evidence]]] = []
    for evidence in item.evidence:
        words = evidence_type(evidence, say, zone)
        if result and result[-1][0] == words and evidence.file is None and result[-1][1][-1].file is None:
            result[-1][1].append(evidence)
        else:
            result.append((words, [evidence]))
    return result


def evidence_words(evidence: Evidence) -> str:
    """Format one line of evidence, in English."""
    file_note = msg(f"; saved as {arg(evidence.file)}" if evidence.file is not None else "")
    digest = f", SHA-256 {evidence.sha256}" if evidence.sha256 is not None else ""
    return msg(
        f"{arg(evidence.what)}: {arg(evidence.value)} "
        f"({arg(evidence_type(evidence, english, ''))}){arg(file_note)}{arg(digest)}"
    )


def circumstances(item: Item, say: Say, zone: str) -> str:
    """Format who checks, where, when, how long, and whether it belongs to the table."""
    words = [say(_texts.KINDS[item.kind]), say(_texts.PHASES[item.phase])]
    if item.at is not None:
        words.append(time_text(item.at, zone))
    if item.seconds is not None:
        words.append(f"{item.seconds:.1f} s")
    if not item.table3:
        words.append(say(_texts.PageText.BESIDE_TABLE))
    return join(", ", words)


_WIDTH = 80
_NAME, _CELL = 14, 7
"""Columns of the grid, in characters."""
_MARGIN = 15
"""Column at which the text of an item begins."""
_GRID = {
    signs.ShownState.PASS: "ok",
    signs.ShownState.INCONCLUSIVE: "?",
    signs.ShownState.OVERRIDDEN: "FAIL*",
    signs.ShownState.NOT_CHECKED: ".",
}
_WORDS = {
    signs.ShownState.INCONCLUSIVE: "? INCONCLUSIVE",
    signs.ShownState.OVERRIDDEN: "FAIL* overridden by a person",
    signs.ShownState.NOT_CHECKED: ". not checked",
}
_BELOW = ("robot", "integration", "items")
"""Columns that a console shows below the table in lines of their own, because the table fills its width."""
_HEADS = {"acoustic": "Acous.", "satellite": "Satel.", "ethernet": "Ether."}
_BRIEF = frozenset({signs.ShownState.OPEN, signs.ShownState.SKIP, signs.ShownState.PASS})
"""States that are listed last, in a line each or by name alone."""


def lines(document: Document) -> str:
    """Return the console text, without a final line feed."""
    return "\n".join([*body(document), "", *map(printable.plain, ending(document))])


def body(document: Document) -> Iterator[str]:
    """Yield all lines except the last ones."""
    yield from _wrap_words(
        "", translate(f"Checklist of {arg(document.site)} ({arg(document.title)}), run {arg(document.run)}")
    )
    if document.rehearsed:
        yield from _wrap_words("", translate("REHEARSAL on emulated devices: nothing real was checked"))
        yield from _wrap_all(msg(f"injected fault: {arg(item)}") for item in document.broken)
    yield ""
    yield from _grid(document)
    for item in by_state(document.items):
        if _shapes.state(item) not in _BRIEF:
            yield ""
            yield from _item(item, document.time_zone)
    yield ""
    yield from _brief(document)
    yield from _note_lines(document)
    if document.signed is not None:
        yield ""
        yield from seal(document)


def seal(document: Document) -> Iterator[str]:
    """Yield the lines that identify the signature."""
    if document.signed is not None:
        yield from _wrap_words("", translate(f"digest {arg(document.signed.digest)}"))
        yield from _wrap_words("", translate(f"key {arg(document.signed.key)}"))


def ending(document: Document, room: int = 8, *, with_signature: bool = True) -> list[printable.Row]:
    """Return the result in at most `room` lines: verdict, counts, and the worst item with what to do.

    `with_signature`: also who has signed.
    """
    rows: list[printable.Row] = [*_verdict_rows(document), *_counts_rows(document)]
    last = [*_wrap_words("", translate(signature_line(document)))] if with_signature else []
    return [*rows, *_worst_rows(document, room - len(rows) - len(last)), *last]


_STYLES = {
    signs.ShownState.PASS: printable.Style.GOOD,
    signs.ShownState.WARN: printable.Style.WARNING,
    signs.ShownState.OVERRIDDEN: printable.Style.WARNING,
    signs.ShownState.INCONCLUSIVE: printable.Style.WARNING,
    signs.ShownState.OPEN: printable.Style.WARNING,
    signs.ShownState.FAIL: printable.Style.BAD,
    signs.ShownState.ERROR: printable.Style.BAD,
}


def _colour(shown_state: signs.ShownState, text: str) -> str | printable.StyledText:
    return printable.StyledText(text, _STYLES[shown_state]) if shown_state in _STYLES else text


def _verdict_rows(document: Document) -> Iterator[printable.Row]:
    shown_state, words = headline(document)
    mark = f"{_shapes.ASCII[shown_state]} {shown_state}"
    first, *rest = _wrap_words("", f"{mark}: {translate(words)}")
    yield (_colour(shown_state, mark), first.removeprefix(mark))
    yield from rest


def _counts_rows(document: Document) -> Iterator[printable.Row]:
    """Yield the counts, the exit code, and whether it was a rehearsal."""
    count_texts = [(shown_state, f"{number} {shown_state}") for shown_state, number in counts(document.items).items()]
    words = join(", ", (text for _, text in count_texts)) or translate(_texts.PageText.NO_ITEMS)
    rest = f"; {translate(f'exit {arg(int(document.exit))}')}"
    if document.rehearsed:
        rest += f"; {translate('rehearsed')}"
    if not count_texts or len(words + rest) > _WIDTH:
        yield from _wrap_words("", words + rest)
        return
    pieces = [piece for shown_state, text in count_texts for piece in (", ", _colour(shown_state, text))]
    yield (*pieces[1:], rest)


def _worst_rows(document: Document, room: int) -> Iterator[printable.Row]:
    """Yield the worst item; a long text is cut to the available lines, as the full text is shown above."""
    every = to_look_at(document)[1]
    if not every:
        return
    worst, hint = every[0], every[0].hint
    message = [*_wrap_words("", f"{worst.id}: {translate(worst.message)}")]
    advice = [*_wrap_words("", f"-> {translate(hint)}", indent=2)] if hint else []
    for_advice = min(len(advice), max(room - len(message), room // 2))
    yield from _shorten(message, room - for_advice)
    yield from _shorten(advice, for_advice)


def _shorten(text: list[str], most: int) -> list[str]:
    if len(text) <= most:
        return text
    return [*text[: most - 1], f"{text[most - 1][: _WIDTH - 4]} ..."] if most > 0 else []


def _grid(document: Document) -> Iterator[str]:
    table = _shapes.grid(document)
    if not table.rows:
        return
    beside = [column for column in table.beside if column not in _BELOW]
    names = [translate(_HEADS.get(column, title(column)))[: _CELL - 1] for column in (*table.columns, *beside)]
    if names:
        yield _line("", [*names[: len(table.columns)], "|", *names[len(table.columns) :]] if beside else names)
    for row in table.rows if names else ():
        yield _line(_shapes.cut(row.row.name, _NAME - 1, "~"), _marks(row, len(table.columns), beside=bool(beside)))
    for column in _BELOW:
        yield from _below(table, column)
    yield from _legend(document)


def _below(table: _shapes.Grid, column: str) -> Iterator[str]:
    """Yield one column, row by row."""
    marks = [
        f"{printable.visible(row.row.name)} {_GRID.get(cell.state, str(cell.state))}"
        for row in table.rows
        for cell in row.cells
        if cell.column == column and cell.items
    ]
    if marks:
        head = translate(title(column))
        yield from (
            f"{'' if number else head:<{_NAME}}{line}"
            for number, line in enumerate(wrap(join(", ", marks), _WIDTH - _NAME))
        )


def _marks(row: _shapes.GridRow, columns: int, *, beside: bool) -> list[str]:
    marks = [_mark(cell) for cell in row.cells if cell.column not in _BELOW]
    return [*marks[:columns], "|", *marks[columns:]] if beside else marks


def _mark(cell: _shapes.GridCell) -> str:
    if cell.empty:
        return ""
    words = _GRID.get(cell.state, str(cell.state))
    return words if cell.table3 else f"({words})"


def _line(name: str, marks: list[str]) -> str:
    words = "".join("| " if mark == "|" else f"{mark:<{_CELL}}" for mark in marks)
    return f"{name:<{_NAME}}{words}".rstrip()


def _legend(document: Document) -> Iterator[str]:
    cells = [cell for row in _shapes.grid(document).rows for cell in row.cells if not cell.empty]
    result = []
    if any(not cell.table3 for cell in cells):
        result.append(translate("( ) not part of Table 3"))
    result += [translate(text) for item, text in _WORDS.items() if any(cell.state is item for cell in cells)]
    if result:
        yield from _wrap_words("", join(", ", result))
    for row in document.rows:
        if row.deviation is not None:
            yield from _wrap_words("", translate(_texts.differs(row)))


def _item(item: Item, zone: str) -> Iterator[str]:
    shown_state = _shapes.state(item)
    yield from _wrap_words(
        f"{_shapes.ASCII[shown_state]} {shown_state}", msg(f"{arg(item.id)}: {arg(_texts.item_title(item))}")
    )
    yield from _wrap_words("", translate(item.message), indent=_MARGIN)
    if item.hint:
        yield from _wrap_words("", f"-> {translate(item.hint)}", indent=_MARGIN)
    if item.override is not None:
        at = time_text(item.override.at, zone)
        words = msg(
            f"{arg(item.verdict)}, overridden by {arg(item.override.by)}, {arg(at)}: {arg(item.override.reason)}"
        )
        yield from _wrap_words("", translate(words), indent=_MARGIN)


def _brief(document: Document) -> Iterator[str]:
    """Yield open and skipped items with their reason, and passed ones by name only."""
    for entry in (signs.ShownState.OPEN, signs.ShownState.SKIP):
        for item in document.items:
            if _shapes.state(item) is entry:
                words = f"{item.id}: {_texts.item_title(item)} ({translate(item.message)})"
                yield from _wrap_words(f"{_shapes.ASCII[entry]} {entry}", words)
    passed_ids = [item.id for item in document.items if _shapes.state(item) is signs.ShownState.PASS]
    if passed_ids:
        yield from _wrap_words(f"{_shapes.ASCII[signs.ShownState.PASS]} PASS", join(", ", passed_ids))


def _note_lines(document: Document) -> Iterator[str]:
    reasons = dict.fromkeys(entry.why for entry in document.left_out)
    for why in reasons:
        what = join(", ", (translate(item.what) for item in document.left_out if item.why == why))
        yield from _wrap_words("", f"{translate('not checked')}: {what} ({translate(why)})")
    for note in document.notes:
        yield from _wrap_words("", f"{translate('note')}: {translate(note)}")
    if document.since_green is not None:
        green = document.since_green
        at = time_text(green.at, document.time_zone)
        yield from _wrap_all([msg(f"changes since run {arg(green.run)} of {arg(at)}, which was green:")])
        for change in green.changes:
            yield from _wrap_words("", change_line(change, translate), indent=2)
        if not green.changes:
            yield translate("  nothing has changed")
    if document.rehearsed and document.not_rehearsed:
        yield translate(count_limits(len(document.not_rehearsed)))


def change_line(change: ItemChange, say: Say) -> str:
    """Format a change since the last green checklist."""
    before, after = (str(word) if word is not None else say("none") for word in (change.before, change.after))
    return msg(f"{arg(change.id)}: {arg(before)} -> {arg(after)}: {arg(say(change.message))}")


def _wrap_all(every: Iterable[str]) -> Iterator[str]:
    for item in every:
        yield from _wrap_words("", translate(item))


def _wrap_words(mark: str, words: str, *, indent: int = 0) -> Iterator[str]:
    """Wrap text behind a symbol to the console's width; its own line feeds also break."""
    start = _MARGIN if mark else indent
    width = _WIDTH - start
    every = printable.visible(words).expandtabs(1).split("\n")
    parts = (part for line in every for part in wrap(line, width, break_on_hyphens=False) or [""])
    for number, part in enumerate(parts):
        yield f"{'' if number else mark:<{start}}{part}".rstrip()
