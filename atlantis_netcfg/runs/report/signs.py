"""How states are shown on pages and paper: symbol, colours and CSS class of each.

Text colours have a contrast of at least 4.5 to their background, edges one of 3 to the page (WCAG 2.2, 1.4.3 and
1.4.11); a test measures them. Each colour comes with a symbol and a word, for readers who cannot see colours.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping


class ShownState(StrEnum):
    """State of an item as shown, the worst last."""

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


SYMBOLS = {
    ShownState.SKIP: "–",  # noqa: RUF001 - a dash
    ShownState.PASS: "✓",
    ShownState.WARN: "!",
    ShownState.OVERRIDDEN: "✎",
    ShownState.NOT_CHECKED: "…",
    ShownState.OPEN: "○",
    ShownState.INCONCLUSIVE: "?",
    ShownState.FAIL: "✗",
    ShownState.ERROR: "■",
}
"""No symbol has an emoji form, so every phone shows it in the colour of the text."""


@dataclass(frozen=True, slots=True)
class Tint:
    """Colours of one state."""

    ink: str
    paper: str
    edge: str


TINTS: Mapping[ShownState | None, Tint] = {
    None: Tint("#1c2730", "#ffffff", "#6b7884"),
    ShownState.SKIP: Tint("#46525c", "#eef1f3", "#75818c"),
    ShownState.PASS: Tint("#0a5226", "#e2f5e6", "#2c8a4b"),
    ShownState.WARN: Tint("#5f3d00", "#fff0c2", "#a87400"),
    ShownState.OVERRIDDEN: Tint("#6d2f00", "#ffe6d1", "#b65a14"),
    ShownState.NOT_CHECKED: Tint("#46525c", "#ffffff", "#75818c"),
    ShownState.OPEN: Tint("#0b4470", "#e2f0fc", "#3279b3"),
    ShownState.INCONCLUSIVE: Tint("#4a2786", "#efe7fc", "#8160bd"),
    ShownState.FAIL: Tint("#8c0c12", "#fde1df", "#c8332f"),
    ShownState.ERROR: Tint("#ffffff", "#7a0d3d", "#7a0d3d"),
}
DARK: Mapping[ShownState | None, Tint] = {
    None: Tint("#e6edf3", "#1b232c", "#8b98a5"),
    ShownState.SKIP: Tint("#b7c2cc", "#262f38", "#7b8894"),
    ShownState.PASS: Tint("#a5ebb9", "#0f3a20", "#3f9e62"),
    ShownState.WARN: Tint("#ffdf85", "#463300", "#b78a1d"),
    ShownState.OVERRIDDEN: Tint("#ffc9a0", "#4a2608", "#cf7a3a"),
    ShownState.NOT_CHECKED: Tint("#b7c2cc", "#12181f", "#7b8894"),
    ShownState.OPEN: Tint("#a9d6fb", "#0d3353", "#4c93cd"),
    ShownState.INCONCLUSIVE: Tint("#d6c3fa", "#352058", "#9a7cd6"),
    ShownState.FAIL: Tint("#ffb8b3", "#561317", "#e0605b"),
    ShownState.ERROR: Tint("#ffffff", "#8f1b50", "#e67cab"),
}


def css_class(state: ShownState | None) -> str:
    """Return the CSS class of elements that show a state."""
    return "s-none" if state is None else f"s-{state.lower().replace(' ', '-')}"
