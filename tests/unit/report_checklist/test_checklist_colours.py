"""Contrast by the formula of WCAG 2.2, and that no colour says what a sign does not."""

from __future__ import annotations

import pytest

from atlantis_netcfg.checklist.report._shapes import ASCII, DARK, SYMBOLS, TINTS, ShownState, Tint

PAGES = {"light": (TINTS, "#ffffff"), "dark": (DARK, "#12181f")}
CASES = [
    pytest.param(tint, page, id=f"{name}-{state}")
    for name, (all_, page) in PAGES.items()
    for state, tint in all_.items()
]


def luminance(colour: str) -> float:
    parts = [part / 255 for part in bytes.fromhex(colour[1:])]
    red, green, blue = (part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def contrast(one: str, other: str) -> float:
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize(("tint", "page"), CASES)
def test_words_can_be_read_and_edges_seen(tint: Tint, page: str) -> None:
    assert contrast(tint.ink, tint.paper) >= 4.5
    assert contrast(tint.edge, page) >= 3


@pytest.mark.parametrize("signs", [SYMBOLS, ASCII], ids=["page", "console"])
def test_every_state_has_a_sign_of_its_own(signs: dict[ShownState, str]) -> None:
    assert signs.keys() == set(ShownState)
    assert len(set(signs.values())) == len(ShownState)


def test_every_state_has_colours() -> None:
    assert TINTS.keys() == DARK.keys() == {None, *ShownState}
