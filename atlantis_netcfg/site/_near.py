"""Near misses: the word that a person most likely meant."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

__all__ = ["choices", "meant", "nearest", "shown_key"]

_MANY = 12


def nearest(word: str, known: Iterable[str]) -> str | None:
    """The known word nearest to `word`, or None if nothing is near."""
    from difflib import get_close_matches  # noqa: PLC0415 - only errors need it

    by_key = {_key(candidate): candidate for candidate in known}
    close = get_close_matches(_key(word), by_key, n=1, cutoff=0.65)
    return by_key[close[0]] if close else None


def meant(word: str, known: Iterable[str], *, none: str) -> str:
    """The hint for an unknown word: the near miss, else all that is known, else `none`."""
    words = list(known)
    near = nearest(word, words)
    if near is not None:
        return f"did you mean `{near}`?"
    return f"there are: {choices(words)}" if words else none


def choices(words: Iterable[str]) -> str:
    """The words, comma-separated; a long list is cut."""
    every = list(words)
    return ", ".join(every[:_MANY]) + (f" … ({len(every)} in all)" if len(every) > _MANY else "")


def shown_key(key: str) -> str:
    """A key as errors may show it: only its first word, because a slip of the finger can put a password behind it."""
    word = re.match(r"[\w.-]*", key)
    return key if word is None or word.group() == key else f"{word.group()}…"


def _key(word: str) -> str:
    return word.lower().replace("-", "_").replace(" ", "_")
