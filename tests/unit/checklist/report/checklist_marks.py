"""A catalogue that shows where it was: each message that passes it stands between « and »."""

import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from atlantis_netcfg.checklist.report import _pages
from atlantis_netcfg.core.language import translate


def mark(text: str) -> str:
    """The message, marked."""
    return f"«{text}»"


@contextmanager
def marked(monkeypatch: pytest.MonkeyPatch, catalogue: Callable[[str], str] = mark) -> Iterator[None]:
    """Put the catalogue in the place of the product's, in every module that has taken it."""
    for module in list(sys.modules.values()):
        if module.__name__.startswith("atlantis_netcfg.") and getattr(module, "translate", None) is translate:
            monkeypatch.setattr(module, "translate", catalogue)
    _pages._environment.cache_clear()
    try:
        yield
    finally:
        monkeypatch.undo()
        _pages._environment.cache_clear()


def without_marks(text: str) -> str:
    """What did not pass the catalogue. Raises AssertionError where something has passed it twice."""
    depth, rest = 0, []
    for letter in text:
        depth += {"«": 1, "»": -1}.get(letter, 0)
        assert 0 <= depth <= 1, f"a message has passed twice: {text}"
        rest.append(letter if depth == 0 and letter != "»" else " ")
    return "".join(rest)


def rest_of(text: str, values: str) -> list[str]:
    """Words that neither passed the catalogue nor are values; numbers and signs are nobody's language."""
    known = set(_words(values))
    return [word for word in _words(without_marks(text)) if word not in known]


def _words(text: str) -> list[str]:
    return re.findall(r"[^\W\d_]+", text)
