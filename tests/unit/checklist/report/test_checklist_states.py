"""Every verdict, open or not, overridden or not: what it is called, and that all pages agree on what is green."""

from itertools import product
from typing import Any

import checklist_example as made
import pytest
from checklist_html import parsed

from atlantis_netcfg.checklist.report import Item, ItemKind, Override, lines
from atlantis_netcfg.checklist.report._junit import junit
from atlantis_netcfg.checklist.report._pages import html
from atlantis_netcfg.checklist.report._shapes import ASCII, GREEN, state, worst_state
from atlantis_netcfg.checklist.report._texts import KINDS
from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.runs.report.signs import SYMBOLS, ShownState

OVERRIDE = Override(reason="the crew stands beside it", by="B. Captain", at=made.AT)
NAMES = {
    (Verdict.PASS, False, False): ShownState.PASS,
    (Verdict.WARN, False, False): ShownState.WARN,
    (Verdict.FAIL, False, False): ShownState.FAIL,
    (Verdict.INCONCLUSIVE, False, False): ShownState.INCONCLUSIVE,
    (Verdict.ERROR, False, False): ShownState.ERROR,
    (Verdict.SKIP, False, False): ShownState.SKIP,
    (Verdict.PASS, True, False): ShownState.OPEN,
    (Verdict.WARN, True, False): ShownState.OPEN,
    (Verdict.FAIL, True, False): ShownState.FAIL,
    (Verdict.INCONCLUSIVE, True, False): ShownState.OPEN,
    (Verdict.ERROR, True, False): ShownState.ERROR,
    (Verdict.SKIP, True, False): ShownState.OPEN,
    (Verdict.PASS, False, True): ShownState.PASS,
    (Verdict.WARN, False, True): ShownState.WARN,
    (Verdict.SKIP, False, True): ShownState.SKIP,
}
"""Verdict, open, overridden; whatever is not here is overridden."""
CASES = list(product(Verdict, (False, True), (False, True)))
ROWS = dict(zip(("girona500", "sparus", "zarco"), ItemKind, strict=True))


def alike(verdict: Verdict, *, is_open: bool, taken: bool) -> list[Item]:
    """One of each kind."""
    given: dict[str, Any] = {"open": is_open, "override": OVERRIDE if taken else None}
    return [made.item(f"{row}/wifi", verdict, "as it is", kind=kind, **given) for row, kind in ROWS.items()]


@pytest.mark.parametrize(
    ("verdict", "is_open", "taken"),
    CASES,
    ids=[
        f"{verdict}-{'open' if is_open else 'settled'}-{'taken' if taken else 'left'}"
        for verdict, is_open, taken in CASES
    ],
)
def test_all_pages_show_the_same_state(verdict: Verdict, is_open: bool, taken: bool) -> None:  # noqa: FBT001 - cases
    items = alike(verdict, is_open=is_open, taken=taken)
    document = made.green(items=(*items, made.item("sparus/gps")))
    shown = NAMES.get((verdict, is_open, taken), ShownState.OVERRIDDEN)
    assert {state(item) for item in items} == {shown}
    assert (document.exit is ExitCode.DONE) == (shown in GREEN)

    page = parsed(html(document, {}))
    for row in ROWS:
        cell = page.cell(made.NAMES[row][0], "Wi-Fi")
        assert cell.words.startswith(SYMBOLS[shown] + shown)
        assert f"s-{shown.lower()}" in cell.classes
    assert ("Overridden by B. Captain" in page.text) == taken
    assert ("the crew stands beside it" in page.text) == taken
    assert all(f"{KINDS[kind]}, on the bench" in page.text for kind in ItemKind)

    xml = junit(document)
    assert xml.count(b"<failure") + xml.count(b"<error") == (0 if shown in GREEN else 3)
    assert xml.count(b"<skipped") == (3 if shown is ShownState.SKIP else 0)
    assert xml.count(b"OVERRIDDEN by B. Captain: the crew stands beside it") == (3 if taken else 0)

    told = lines(document)
    assert f"; exit {int(document.exit)}" in told
    assert all(item.id in told for item in items)
    assert shown is ShownState.PASS or told.count(f"\n{ASCII[shown]} {shown} ") == 3


def test_worst_state_of_nothing_is_not_checked() -> None:
    assert worst_state(()) is ShownState.NOT_CHECKED


def test_states_are_ordered_like_verdicts() -> None:
    order = list(ShownState)
    assert [word for word in map(str, order) if word in set(map(str, Verdict))] == list(map(str, Verdict))
