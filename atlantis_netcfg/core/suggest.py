"""Near misses: the word that a person most likely meant, for every message that offers one."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

_ALIKE = 0.65
"""Ratio of difflib from which on two words count as one of them mistyped."""


def nearest(word: str, known: Iterable[str]) -> str | None:
    """The known word nearest to `word`, or None; neither case counts, nor which of `-`, `_` and space stands."""
    from difflib import get_close_matches  # noqa: PLC0415 - only errors need it

    by_key = {_key(candidate): candidate for candidate in known}
    close = get_close_matches(_key(word), by_key, n=1, cutoff=_ALIKE)
    return by_key[close[0]] if close else None


def _key(word: str) -> str:
    return word.lower().replace("-", "_").replace(" ", "_")
