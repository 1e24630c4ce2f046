"""A measured run as screen text, as a self-contained HTML page, and as PDF."""

from __future__ import annotations

import io
from functools import cache
from typing import TYPE_CHECKING, Final

from markupsafe import Markup

from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.core.printable import NARROW, Row, Style, StyledText, wrap_row
from atlantis_netcfg.records.qualify.sections import (
    EMULATED_NOTICE,
    FigureTable,
    PageSection,
    closing_sentence,
    heading,
    sections,
    subtitle,
)
from atlantis_netcfg.runs.report import page_frame, signs

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from jinja2 import Environment

    from atlantis_netcfg.checklist.report._pdf._sheet import Paper
    from atlantis_netcfg.links.qualify.record import QualifyRecord
    from atlantis_netcfg.records.qualify.plots import Plot

PAGE_FILE: Final = "page.html"
PAPER_FILE: Final = "page.pdf"
_PLOT_MM = 160.0
_INDENT = 2
_LABEL = 34
"""Column at which the values of a two-column table begin."""
_LAST = 12
"""Minimum width of the last column; longer text wraps."""
_IN_WORDS = frozenset({"verdict", "why"})
"""Columns that are not aligned like numbers."""
STYLES: Final = {
    Verdict.PASS: Style.GOOD,
    Verdict.WARN: Style.WARNING,
    Verdict.FAIL: Style.BAD,
    Verdict.ERROR: Style.BAD,
    Verdict.INCONCLUSIVE: Style.WARNING,
    Verdict.SKIP: Style.QUIET,
}


def rows(record: QualifyRecord, location: str) -> Iterator[Row]:
    """Yield the lines for the screen; `location`: the path of the run."""
    yield StyledText(translate(heading(record)), Style.TITLE)
    yield translate(subtitle(record))
    if record.run.emulated:
        yield StyledText(translate(EMULATED_NOTICE), Style.WARNING)
    for section in sections(record):
        yield ""
        yield StyledText(translate(section.title), Style.TITLE)
        for note in section.notes:
            yield from wrap_row(f"  {translate(note)}", NARROW, _INDENT)
        if section.key == "verdicts":
            yield from _judgements(record)
        elif section.table is not None:
            yield from table_rows(section.table)
    yield ""
    yield from wrap_row(translate(f"saved: {arg(location)}"), NARROW, _INDENT)
    words = f": {translate(closing_sentence(record))}"
    yield from wrap_row((StyledText(record.verdict.value, STYLES[record.verdict]), words), NARROW, _INDENT)


def _judgements(record: QualifyRecord) -> Iterator[Row]:
    table = next(section.table for section in sections(record) if section.key == "verdicts")
    for criterion, value, limit, verdict, reason in () if table is None else table.rows:
        why = "" if verdict == Verdict.PASS else f"; {translate(reason)}"
        limits = translate(f"limit {arg(limit)}")
        words = f"{translate(criterion)}: {translate(value)}, {limits}{why}"
        yield from wrap_row(("  ", StyledText(f"{verdict:<13}", STYLES[Verdict(verdict)]), words), NARROW, 15)


def table_rows(table: FigureTable) -> Iterator[Row]:
    """Yield a table within 80 columns; a wider one is printed row by row."""
    cells = [[*map(translate, table.columns)], *(in_words(table, row) for row in table.rows)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    if len(widths) == 2:  # noqa: PLR2004 - a name and a value
        yield from (line for name, value in cells[1:] for line in _label_rows(name, value))
    elif sum(widths[:-1]) + len(widths) + min(widths[-1], _LAST) + 1 <= NARROW:
        indent = sum(widths[:-1]) + len(widths) + 1
        words = table.columns[-1] in _IN_WORDS
        for row in cells:
            padded_cells = [f"{cell:>{width}}" for cell, width in zip(row[1:], widths[1:], strict=True)]
            last = row[-1] if words else padded_cells[-1]
            yield from wrap_row(f"  {' '.join((f'{row[0]:<{widths[0]}}', *padded_cells[:-1], last))}", NARROW, indent)
    else:
        for row in cells[1:]:
            pairs = (f"{column} {cell}" for column, cell in zip(cells[0][1:], row[1:], strict=True))
            yield from wrap_row(msg(f"  {arg(row[0])}: {arg(join('; ', pairs))}"), NARROW, _INDENT + 2)


def in_words(table: FigureTable, row: Sequence[str]) -> list[str]:
    """Return a row in the person's language; names stay as they are."""
    return [cell if table.has_names and not place else translate(cell) for place, cell in enumerate(row)]


def _label_rows(name: str, value: str) -> Iterator[Row]:
    if len(value) > NARROW - _LABEL and " " not in value:
        yield from (f"  {name}", f"    {value}")
    else:
        yield from wrap_row(msg(f"  {arg(name):<{_LABEL - 3}} {arg(value)}"), NARROW, _LABEL)


def html(record: QualifyRecord, plots: Sequence[Plot]) -> bytes:
    """Return the page: no script, no request; the same for the same record."""
    header = page_frame.PageHeader(
        heading(record),
        subtitle(record),
        EMULATED_NOTICE if record.run.emulated else "",
        page_frame.PageVerdict(signs.ShownState(record.verdict.value), record.verdict.value, closing_sentence(record)),
    )
    return page_frame.page(
        _environment(),
        "qualify.html.j2",
        header,
        sections=sections(record),
        plots={plot.name: Markup(plot.svg()) for plot in plots},  # noqa: S704 - made by ElementTree, which escapes
    )


@cache
def _environment() -> Environment:
    result = page_frame.environment("atlantis_netcfg.records.qualify")
    result.globals.update(in_words=in_words)
    return result


def pdf(record: QualifyRecord, plots: Sequence[Plot]) -> bytes:
    """Return the PDF with the same drawings; the same bytes for the same record."""
    from atlantis_netcfg.checklist.report._pdf._sheet import Paper  # noqa: PLC0415 - fpdf2 takes long to import

    paper = Paper(translate(heading(record)), record.run.tool, record.run.begun)
    words = [translate(subtitle(record)), *([translate("EMULATED LINK")] if record.run.emulated else [])]
    paper.head_line = join("; ", words)
    paper.foot_line = f"{record.verdict.value}; {translate(heading(record))}"
    paper.add_page()
    paper.tell(translate(heading(record)), size=17, bold=True)
    if page_frame.unread():
        paper.tell(page_frame.unread(), faint=True)
    paper.tell(translate(subtitle(record)), faint=True)
    if record.run.emulated:
        paper.tell(translate(EMULATED_NOTICE), size=13, bold=True)
    paper.tell(f"{record.verdict.value}: {translate(closing_sentence(record))}", size=11, bold=True)
    by_name = {plot.name: plot for plot in plots}
    for section in sections(record):
        _write_section(paper, section, [by_name[name] for name in section.plots if name in by_name])
    return paper.to_bytes()


def _write_section(paper: Paper, section: PageSection, plots: Sequence[Plot]) -> None:
    from atlantis_netcfg.checklist.report._pdf._sheet import FAMILY, SMALL, printable  # noqa: PLC0415 - as above

    paper.head(translate(section.title))
    for note in section.notes:
        paper.tell(translate(note))
    if section.table is not None:
        paper.plain(SMALL)
        with paper.table(text_align="LEFT", line_height=4.2, padding=0.6, col_widths=_widths(section.table)) as table:
            heads = [*map(translate, section.table.columns)]
            for cells in (heads, *(in_words(section.table, row) for row in section.table.rows)):
                row = table.row()
                for cell in cells:
                    row.cell(printable(cell))
    for plot in plots:
        height = _PLOT_MM * plot.height / plot.width
        paper.set_y(paper.y + 3)
        paper.room(height)
        paper.image(io.BytesIO(plot.svg(FAMILY, has_description=False).encode()), x=paper.l_margin, w=_PLOT_MM)


def _widths(table: FigureTable) -> tuple[int, ...]:
    """Return column widths from the longest cells, within limits."""
    return tuple(min(32, max(7, *map(len, column))) for column in zip(table.columns, *table.rows, strict=True))
