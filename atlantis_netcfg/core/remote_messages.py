"""Marked texts in results of programs on other computers, which may be forged, and may hold secrets."""

from __future__ import annotations

import re
from itertools import accumulate
from typing import TYPE_CHECKING

from atlantis_netcfg.core import messages, printable, stored_messages

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from typing import Any

_MAX_DEPTH = 10
"""Messages in messages; a program of ours has four at most."""
_BETWEEN_MARKS = re.compile(f"[^{messages.TEXT}-{messages.END}]+")


def unpack(result: Mapping[str, Any], request_texts: Sequence[str] = ()) -> dict[str, Any]:
    """Return a result with its messages where their texts stand, as far as they are safe.

    `request_texts`: marked texts of what the program was given in plain English; it returns them, also inside others.
    """
    texts = checked_texts(result).get("texts", [])
    for source in request_texts:
        value = f"{messages.TEXT}{messages.Message(source)}{messages.END}"
        texts = [text.replace(value, f"{messages.MESSAGE}{source}{messages.END}") for text in texts]
    return stored_messages.unpack({**result, "texts": [*request_texts, *texts]})


def checked_texts(result: Mapping[str, Any], mask: Callable[[str], str] = str) -> dict[str, Any]:
    """Return `texts` of a result for `stored_messages.unpack`, masked and printable; nothing if none is left.

    A text is left out if a secret reaches across one of its marks, or if no program of ours makes such a text: then
    the plain English text is all that is shown.
    """
    texts = result.get("texts")
    safe_texts = list(_check(texts, mask)) if isinstance(texts, list) else []
    return {"texts": safe_texts} if safe_texts else {}


def _check(texts: list[object], mask: Callable[[str], str]) -> Iterator[str]:
    for text in texts:
        if isinstance(text, str) and _is_simple(text):
            masked_text = mask(text)
            if str.__str__(messages.Message(masked_text)) == mask(str.__str__(messages.Message(text))):
                yield _BETWEEN_MARKS.sub(lambda part: printable.lines(part[0]), masked_text)


def _is_simple(text: str) -> bool:
    """Return whether a text has no replacements, which could multiply it, and few messages in messages."""
    if messages.OLD in text or messages.NEW in text:
        return False
    marks = _BETWEEN_MARKS.sub("", text)
    return max(accumulate(-1 if mark == messages.END else 1 for mark in marks), default=0) <= _MAX_DEPTH
