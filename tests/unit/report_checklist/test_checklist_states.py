"""Every verdict, open or not, overridden or not: what it is called, and that all pages agree on what is green."""

from __future__ import annotations

from itertools import product

import checklist_example as made
import pytest
from checklist_html import parsed

from atlantis_netcfg.errors import ExitCode
from atlantis_netcfg.report.checklist import Item, Kind, Override, lines
from atlantis_netcfg.report.checklist._html import html
from atlantis_netcfg.report.checklist._junit import junit
from atlantis_netcfg.report.checklist._states import GREEN, SYMBOLS, State, state, worst_state
from atlantis_netcfg.verdicts import Verdict

OVERRIDE = Override(reason="the crew stands beside it", by="B. Captain", at=made.AT)
NAMES = {
    (Verdict.PASS, False, False): State.PASS,
    (Verdict.WARN, False, False): State.WARN,
    (Verdict.FAIL, False, False): State.FAIL,
    (Verdict.INCONCLUSIVE, False, False): State.INCONCLUSIVE,
    (Verdict.ERROR, False, False): State.ERROR,
    (Verdict.SKIP, False, False): State.SKIP,
    (Verdict.PASS, True, False): State.OPEN,
    (Verdict.WARN, True, False): State.OPEN,
    (Verdict.FAIL, True, False): State.FAIL,
    (Verdict.INCONCLUSIVE, True, False): State.OPEN,
    (Verdict.ERROR, True, False): State.ERROR,
    (Verdict.SKIP, True, False): State.OPEN,
    (Verdict.PASS, False, True): State.PASS,
    (Verdict.WARN, False, True): State.WARN,
    (Verdict.SKIP, False, True): State.SKIP,
}
"""Verdict, open, overridden; whatever is not here is overridden."""
CASES = [(*how, kind) for how in product(Verdict, (False, True), (False, True)) for kind in Kind]


def one(verdict: Verdict, kind: Kind, *, is_open: bool, taken: bool) -> Item:
    return made.item("sparus/wifi", verdict, "as it is", open=is_open, kind=kind, override=OVERRIDE if taken else None)


@pytest.mark.parametrize(
    ("verdict", "is_open", "taken", "kind"),
    CASES,
    ids=[
        f"{verdict}-{'open' if is_open else 'settled'}-{'taken' if taken else 'left'}-{kind}"
        for verdict, is_open, taken, kind in CASES
    ],
)
def test_all_pages_say_the_same(verdict: Verdict, is_open: bool, taken: bool, kind: Kind) -> None:  # noqa: FBT001 - cases
    item = one(verdict, kind, is_open=is_open, taken=taken)
    document = made.green(items=(item, made.item("sparus/gps")))
    shown = NAMES.get((verdict, is_open, taken), State.OVERRIDDEN)
    assert state(item) is shown
    assert (document.exit is ExitCode.DONE) == (shown in GREEN)

    page = parsed(html(document, {}))
    cell = page.cell("Sparus", "Wi-Fi")
    assert cell.words.startswith(SYMBOLS[shown] + shown)
    assert f"s-{shown.lower()}" in cell.classes
    assert ("Overridden by B. Captain" in page.text) == taken
    assert ("the crew stands beside it" in page.text) == taken

    bad = b"<failure" in (xml := junit(document)) or b"<error" in xml
    assert bad == (shown not in GREEN)
    assert (b"<skipped" in xml) == (shown is State.SKIP)
    assert (b"OVERRIDDEN by B. Captain: the crew stands beside it" in xml) == taken

    told = lines(document)
    assert f"(exit {int(document.exit)}): " in told
    assert "sparus/wifi" in told
    assert shown is State.PASS or f" {shown} " in told


def test_the_worst_of_none_is_that_nothing_was_checked() -> None:
    assert worst_state(()) is State.NOT_CHECKED


def test_the_order_is_that_of_the_verdicts() -> None:
    order = list(State)
    assert [word for word in map(str, order) if word in set(map(str, Verdict))] == list(map(str, Verdict))
