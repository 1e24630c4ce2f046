"""Messages in JSON documents: their texts stand where they belong, and beside them what keeps their values.

A reader that does not know messages sees plain English; one that does can show each in its own language.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from atlantis_netcfg.core.messages import Message


def pack(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return a JSON document with the marked texts of its messages beside them, for `unpack`."""
    return {**document, **marked_texts(document)}


def marked_texts(document: object) -> dict[str, Any]:
    """Return what `pack` adds to a document: `texts`, or nothing if it has no messages with values."""
    texts = dict.fromkeys(message.source for message in _messages(document) if message.source != message)
    return {"texts": list(texts)} if texts else {}


def unpack(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return a document of `pack` with its messages where their texts stand."""
    texts = {message: message for message in map(Message, document.get("texts", ()))}
    return {name: _put_back(value, texts) for name, value in document.items() if name != "texts"}


def _messages(value: object) -> Iterator[Message]:
    if isinstance(value, Message):
        yield value
    elif hasattr(type(value), "model_fields"):
        yield from _messages(vars(value))
    elif isinstance(value, (Mapping, list, tuple)):
        for item in value.values() if isinstance(value, Mapping) else value:
            yield from _messages(item)


def _put_back(value: Any, texts: Mapping[Any, Message]) -> Any:  # noqa: ANN401 - JSON of any shape
    if isinstance(value, str):
        return texts.get(value, value)
    if isinstance(value, Mapping):
        return {name: _put_back(entry, texts) for name, entry in value.items()}
    return [_put_back(entry, texts) for entry in value] if isinstance(value, list) else value
