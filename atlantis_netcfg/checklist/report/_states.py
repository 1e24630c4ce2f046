"""What a page shows of an item: a verdict, or why there is none, each with a symbol for whoever sees no colours."""

from __future__ import annotations

from enum import StrEnum
from typing import TYPE_CHECKING

from atlantis_netcfg.core.verdicts import Verdict

if TYPE_CHECKING:
    from collections.abc import Iterable

    from atlantis_netcfg.checklist.report.document import Item


class State(StrEnum):
    """Worst last."""

    SKIP = "SKIP"
    PASS = "PASS"  # noqa: S105 - a verdict
    WARN = "WARN"
    OVERRIDDEN = "OVERRIDDEN"
    """It did not pass, and a person has taken the responsibility."""
    NOT_CHECKED = "NOT CHECKED"
    """A cell of the table without an item: the checklist was narrowed."""
    OPEN = "OPEN"
    """Nobody has looked or answered yet."""
    INCONCLUSIVE = "INCONCLUSIVE"
    FAIL = "FAIL"
    ERROR = "ERROR"


_ORDER = tuple(State)
GREEN = frozenset({State.SKIP, State.PASS, State.WARN, State.OVERRIDDEN})
"""What does not keep a checklist from being green, as `Document.exit` has it."""

SYMBOLS = {
    State.SKIP: "–",  # noqa: RUF001 - a dash
    State.PASS: "✓",
    State.WARN: "!",
    State.OVERRIDDEN: "✎",
    State.NOT_CHECKED: "…",
    State.OPEN: "○",
    State.INCONCLUSIVE: "?",
    State.FAIL: "✗",
    State.ERROR: "■",
}
"""None of them has a form as an emoji, so that every phone prints them in the colour of the text."""
ASCII = {
    State.SKIP: "-",
    State.PASS: "+",
    State.WARN: "!",
    State.OVERRIDDEN: "*",
    State.NOT_CHECKED: ".",
    State.OPEN: "o",
    State.INCONCLUSIVE: "?",
    State.FAIL: "X",
    State.ERROR: "#",
}
"""For a console, which may know no others."""

_TAKEN_OVER = frozenset({Verdict.FAIL, Verdict.INCONCLUSIVE, Verdict.ERROR})
_GRAVE = frozenset({Verdict.FAIL, Verdict.ERROR})


def state(item: Item) -> State:
    """What is shown of one item."""
    if item.override is not None and (item.open or item.verdict in _TAKEN_OVER):
        return State.OVERRIDDEN
    if item.open and item.verdict not in _GRAVE:
        return State.OPEN
    return State(item.verdict.value)


def worst_state(items: Iterable[Item]) -> State:
    """The worst of some items; of none, that nothing was checked."""
    return max(map(state, items), key=_ORDER.index, default=State.NOT_CHECKED)
