"""Hints about words of the inventory: near misses, what else there is, and what a name may look like."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from atlantis_netcfg.core.suggest import nearest

if TYPE_CHECKING:
    from collections.abc import Iterable


_MANY = 12


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


def why_no_name(text: str) -> tuple[str, str] | None:
    """What is wrong with a name and what to type instead; None if it is an RFC 1123 label of at most 32 characters."""
    if re.fullmatch(r"[a-z0-9](?:[a-z0-9-]{0,30}[a-z0-9])?", text):
        return None
    near = re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")[:32].strip("-")
    rule = "lower-case letters, digits and hyphens inside, 32 at most"
    return f"`{text}` is no name: a name has {rule}", near or "a name is like coastal-router"
