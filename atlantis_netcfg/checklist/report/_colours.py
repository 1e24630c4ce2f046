"""The colours of the states, in light and in dark; each is told by a symbol and a word as well.

Every ink has a contrast of at least 4.5 to its paper, every edge one of 3 to the page (WCAG 2.2, 1.4.3 and 1.4.11); a
test measures them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.report._states import State

if TYPE_CHECKING:
    from collections.abc import Mapping


@dataclass(frozen=True, slots=True)
class Tint:
    """Colours of one state."""

    ink: str
    paper: str
    edge: str


TINTS: Mapping[State | None, Tint] = {
    None: Tint("#1c2730", "#ffffff", "#6b7884"),
    State.SKIP: Tint("#46525c", "#eef1f3", "#75818c"),
    State.PASS: Tint("#0a5226", "#e2f5e6", "#2c8a4b"),
    State.WARN: Tint("#5f3d00", "#fff0c2", "#a87400"),
    State.OVERRIDDEN: Tint("#6d2f00", "#ffe6d1", "#b65a14"),
    State.NOT_CHECKED: Tint("#46525c", "#ffffff", "#75818c"),
    State.OPEN: Tint("#0b4470", "#e2f0fc", "#3279b3"),
    State.INCONCLUSIVE: Tint("#4a2786", "#efe7fc", "#8160bd"),
    State.FAIL: Tint("#8c0c12", "#fde1df", "#c8332f"),
    State.ERROR: Tint("#ffffff", "#7a0d3d", "#7a0d3d"),
}
DARK: Mapping[State | None, Tint] = {
    None: Tint("#e6edf3", "#1b232c", "#8b98a5"),
    State.SKIP: Tint("#b7c2cc", "#262f38", "#7b8894"),
    State.PASS: Tint("#a5ebb9", "#0f3a20", "#3f9e62"),
    State.WARN: Tint("#ffdf85", "#463300", "#b78a1d"),
    State.OVERRIDDEN: Tint("#ffc9a0", "#4a2608", "#cf7a3a"),
    State.NOT_CHECKED: Tint("#b7c2cc", "#12181f", "#7b8894"),
    State.OPEN: Tint("#a9d6fb", "#0d3353", "#4c93cd"),
    State.INCONCLUSIVE: Tint("#d6c3fa", "#352058", "#9a7cd6"),
    State.FAIL: Tint("#ffb8b3", "#561317", "#e0605b"),
    State.ERROR: Tint("#ffffff", "#8f1b50", "#e67cab"),
}


def css_class(state: State | None) -> str:
    """The class that a page gives to whatever shows a state."""
    return "s-none" if state is None else f"s-{state.lower().replace(' ', '-')}"
