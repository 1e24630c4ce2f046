"""Messages in JSON documents: their texts stand where they belong, and beside them what keeps their values.

A reader that does not know messages sees plain English; one that does can show each in its own language.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any

from atlantis_netcfg.core.messages import Message


def pack(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return a JSON document with the marked texts of its messages beside them, for `unpack`."""
    return {**document, **marked_texts(document)}


def marked_texts(document: object) -> dict[str, Any]:
    """Return what `pack` adds to a document: `texts`, or nothing if it has no messages with values."""
    sources = [message.source for message in messages_by_text(document).values()]
    return {"texts": sources} if sources else {}


def unpack(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return a document of `pack` with its messages where their texts stand."""
    texts = {message: message for message in map(Message, document.get("texts", ()))}
    return {name: put_back(value, texts) for name, value in document.items() if name != "texts"}


def parse(text: str | bytes) -> dict[str, Any]:
    """Parse the JSON of a document of `pack`; raise ValueError if it is none."""
    try:
        return unpack(json.loads(text))
    except (AttributeError, TypeError) as error:
        raise ValueError(str(error)) from error


def messages_by_text(value: object) -> dict[str, Message]:
    """Return the messages with values in a document, by their English text."""
    return {message: message for message in _messages(value) if message.source != message}


def put_back(value: Any, texts: Mapping[Any, Message]) -> Any:  # noqa: ANN401 - JSON of any shape
    """Return a value with these messages where their texts stand."""
    if type(value) in (str, Message):  # not a member of an enumeration of texts
        return texts.get(value, value)
    if isinstance(value, Mapping):
        return {name: put_back(entry, texts) for name, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return type(value)(put_back(entry, texts) for entry in value)
    if is_dataclass(value) and not isinstance(value, type):
        return replace(value, **put_back(_fields(value), texts))
    return value


def _messages(value: object) -> Iterator[Message]:
    if isinstance(value, Message):
        yield value
    elif hasattr(type(value), "model_fields"):
        yield from _messages(vars(value))
    elif isinstance(value, (Mapping, list, tuple)):
        for item in value.values() if isinstance(value, Mapping) else value:
            yield from _messages(item)
    elif is_dataclass(value):
        yield from _messages(_fields(value))


def _fields(value: Any) -> dict[str, Any]:  # noqa: ANN401 - any dataclass
    return {field.name: getattr(value, field.name) for field in fields(value)}
