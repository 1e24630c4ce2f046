"""Messages for people: English texts that know which parts of them are values, to be translated when shown.

A message is its English text for every program: comparisons, JSON, journals and logs see a `str`. `translate` of
`core.language` looks up the text around the values. Plural forms are written out with their condition
(`{'s' if count != 1 else ''}`), one entry of the catalogue each: Portuguese and English have the same two.
"""

from __future__ import annotations

import re
from functools import reduce
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from typing import Self

TEXT, NUMBER, MESSAGE, OLD = "\ue000", "\ue001", "\ue002", "\ue003"
"""Marks in front of a value, a number, a nested message, and the old text of a replacement."""
NEW, END = "\ue004", "\ue005"
"""Marks in front of the new text of a replacement, and behind each of these parts."""
_MARK = re.compile(f"[{TEXT}-{END}]")


class Message(str):
    """An English text; `source` is the same text with marks around its values."""

    __slots__ = ("source",)
    source: str

    def __new__(cls, source: str) -> Self:
        """Make a message of a text with marks; all else is in the text."""
        message = super().__new__(cls, _text(source))
        message.source = source
        return message

    def __str__(self) -> str:
        """Return the message itself: an error that is raised with it gives it back."""
        return self

    def __reduce__(self) -> tuple[type[Message], tuple[str]]:
        return Message, (self.source,)

    def __add__(self, other: str, /) -> str:
        return join("", (self, other))

    def __radd__(self, other: str, /) -> str:
        return join("", (other, self))

    def replace(self, old: str, new: str, count: int = -1, /) -> str:  # type: ignore[override]
        """Replace a placeholder such as `site=…` in the English text and in every translation."""
        if old not in self:
            return self
        if count >= 0:
            return str.replace(self, old, new, count)
        return Message(f"{self.source}{OLD}{old}{NEW}{_MARK.sub('', new)}{END}")


class _MarkedValue:
    """A value that puts marks around itself when it is formatted; what is shown as a message is that message."""

    def __init__(self, value: object) -> None:
        text = str(value)
        self._value = text if isinstance(value, Exception) or isinstance(text, Message) else value

    def __format__(self, spec: str) -> str:
        return self._mark(format(self._value, spec))

    def __str__(self) -> str:
        return self._mark(str(self._value))

    def __repr__(self) -> str:
        return self._mark(repr(self._value))

    def _mark(self, text: str) -> str:
        value = self._value
        if isinstance(value, Message) and value in text:
            return f"{MESSAGE}{str.replace(text, value, value.source, 1)}{END}"
        is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
        return f"{NUMBER if is_number else TEXT}{_MARK.sub('', text)}{END}"


def arg(value: object) -> _MarkedValue:
    """Return a value for an f-string inside `msg(…)` or inside the text of an error."""
    return _MarkedValue(value)


def msg(text: str) -> str:
    """Return the `Message` of an f-string whose values are in `arg(…)`, or of a text without values."""
    return text if isinstance(text, Message) else Message(text)


def join(separator: str, parts: Iterable[object]) -> str:
    """Return texts joined to one `Message`; each is translated by itself."""
    return Message(separator.join(str(_MarkedValue(part)) for part in parts))


def shorten(text: str, length: int) -> str:
    """Return a text with its middle left out if it is longer; values are kept if the gap is inside one text."""
    if len(text) <= length:
        return text
    source, half = msg(text).source, length // 2  # type: ignore[attr-defined]
    places = [place for place, letter in enumerate(source) if not _MARK.match(letter)]
    start, end = places[half - 1] + 1, places[-half]
    if OLD in source or _MARK.search(source, start, end):
        return f"{text[:half]} … {text[-half:]}"
    return Message(f"{source[:start]} … {source[end:]}")


def conjunction(parts: Iterable[object]) -> str:
    """Return texts joined by ` and ` to one `Message`; each is translated by itself."""
    first, *rest = [*parts] or [""]
    return reduce(lambda text, part: msg(f"{arg(text)} and {arg(part)}"), rest, join("", [first]))


def alternatives(parts: Iterable[object]) -> str:
    """Return texts joined by ` or ` to one `Message`; each is translated by itself."""
    first, *rest = [*parts] or [""]
    return reduce(lambda text, part: msg(f"{arg(text)} or {arg(part)}"), rest, join("", [first]))


def parse(source: str) -> Iterator[tuple[str, str]]:
    """Yield the parts of a marked text: the mark (empty for literal text) and what stands inside, with inner marks."""
    kind, depth, at = "", 0, 0
    for mark in _MARK.finditer(source):
        before = depth
        depth += (mark[0] < NEW) - (mark[0] == END and depth > 0)
        if before + depth <= 1:  # begin, end, or a mark without a counterpart
            yield kind, source[at : mark.start()]
            kind, at = mark[0] if depth else "", mark.end()
    yield kind, source[at:]


def _text(source: str) -> str:
    if OLD not in source:
        return _MARK.sub("", source)
    parts = list(parse(source))
    text = "".join(_text(part) for mark, part in parts if mark != OLD)
    for old, _, new in (part.partition(NEW) for mark, part in parts if mark == OLD):
        text = text.replace(old, new)
    return text
