"""Terminal output for several measured runs: a comparison of two runs, and the history of a link."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from atlantis_netcfg.core import printable
from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.core.times import time_text
from atlantis_netcfg.links.qualify import compare
from atlantis_netcfg.records.qualify.pages import STYLES
from atlantis_netcfg.records.qualify.sections import UNKNOWN, format_figure

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from atlantis_netcfg.links.qualify.record import QualifyRecord

_CHANGES: Final = {compare.FigureTrend.BETTER: printable.Style.GOOD, compare.FigureTrend.WORSE: printable.Style.BAD}
_HISTORY: Final = ("rtt_p50", "rtt_p95", "loss", "longest_gap", "goodput_up", "goodput_down")
_MARGIN = 6


def _title(record: QualifyRecord) -> str:
    suffix = "; over an emulated link" if record.run.emulated else ""
    return msg(
        f"{arg(record.run.id)}: {arg(record.run.link)}, "
        f"{arg(time_text(record.run.begun, record.run.time_zone))}{arg(suffix)}"
    )


def comparison_rows(
    first: QualifyRecord, second: QualifyRecord, comparison: compare.RunComparison
) -> Iterator[printable.Row]:
    """Yield the terminal rows that compare two runs."""
    for name, record in (("A", first), ("B", second)):
        verdict = printable.StyledText(record.verdict.value, STYLES[record.verdict])
        yield from printable.wrap_row(
            (f"{name}  ", verdict, f"  {translate(_title(record))}"), printable.NARROW, _MARGIN
        )
    for remark in comparison.remarks:
        yield from printable.wrap_row(
            (printable.StyledText("!  ", printable.Style.WARNING), translate(remark)), printable.NARROW, 3
        )
    yield ""
    yield f"{translate('figure'):<26}{'A':>13}{'B':>13}{'B - A':>9}"
    for item in comparison.figures:
        values = "".join(f"{translate(format_figure(value, item.unit)):>13}" for value in (item.first, item.second))
        difference = "" if item.difference is None else f"{100 * item.difference:+.0f} %"
        word = printable.StyledText(translate(item.change.value), _CHANGES.get(item.change, printable.Style.QUIET))
        yield f"{translate(item.title):<26}{values}{difference:>9}  ", word
    yield ""
    for fact in comparison.facts:
        both = (UNKNOWN if value is None else value for value in (fact.first, fact.second))
        first_words, second_words = map(translate, both)
        words = first_words if first_words == second_words else f"A: {first_words}; B: {second_words}"
        yield from printable.wrap_row(f"{translate(fact.title)}: {words}", printable.NARROW, _MARGIN)


def history_rows(records: Sequence[QualifyRecord]) -> Iterator[printable.Row]:
    """Yield two rows per run, oldest first: verdict and title, then the headline figures."""
    headline_by_key = {item.key: item for item in compare.HEADLINES if item.key in _HISTORY}
    for record in records:
        verdict = printable.StyledText(f"{record.verdict.value:<13}", STYLES[record.verdict])
        yield from printable.wrap_row((verdict, translate(_title(record))), printable.NARROW, _MARGIN)
        words = (
            f"{translate(item.title)} {translate(format_figure(item.value(record), item.unit))}"
            for item in headline_by_key.values()
        )
        yield from printable.wrap_row(f"      {'; '.join(words)}", printable.NARROW, _MARGIN)
