"""Words and sentences to bytes and back, without I/O.

Length prefixes are computed by librouteros. Its protocol classes do not fit: they own the socket, read word by word,
log every word (passwords too) and drop bytes that they cannot decode. Added here: lengths of five bytes, a limit on
what is kept in memory, bytes that are not UTF-8 (as lone surrogates, so that they go back as they came), any cut of the
stream into chunks, and garbage that is told apart from an answer.
Source: manual, API, "API words" and "API sentences".
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Final

from librouteros.protocol import (
    decode_length,
    determine_length,
    encode_length,
)

from atlantis_netcfg.routeros.api._errors import ProtocolError

__all__ = ["MAX_SENTENCE", "Answer", "Decoder", "GarbageError", "Row", "encode", "parse"]

MAX_SENTENCE: Final = 16 * 1024 * 1024
"""Bytes; far more than any row, so that a garbled length is noticed before memory is."""

MAX_WORDS: Final = 10_000
"""Of one sentence; a row has less than a hundred."""
MAX_DIGITS: Final = 1_000
"""Digits beside each other; the largest counter has twenty, and Python refuses to read a number of some thousands."""
_LONGER: Final = 0x80
"""From this first byte on a length has more than one byte."""
_FIVE_BYTES: Final = 0xF0
_FIVE_BYTES_FROM: Final = 0x10000000
_REPLIES: Final = frozenset({"!re", "!done", "!empty", "!trap", "!fatal"})
_NUMBER: Final = re.compile(rf"[0-9]{{{MAX_DIGITS},}}")
_SHOWN: Final = 20
_SHOWN_TEXT: Final = 200


class Row(dict[str, str]):
    """The attributes of one sentence; one that is not there is what the device has left out, and no mistake of ours."""

    def __missing__(self, name: str) -> str:
        raise ProtocolError(
            f"the device has sent an answer without `{name}`, which every RouterOS sends",
            in_flight=False,
            hint="is this the device that is declared, and is its RouterOS whole?",
        )


class GarbageError(ValueError):
    """The bytes are no sentence of a device; the text tells kind and size, never the content."""


def encode(words: tuple[str, ...]) -> bytes:
    """Encode one sentence, its closing empty word included."""
    return b"".join(_encode_word(word) for word in words) + b"\x00"


def _encode_word(word: str) -> bytes:
    raw = word.encode("utf-8", "surrogateescape")
    return encode_size(len(raw)) + raw


def encode_size(size: int) -> bytes:
    """Encode the length of a word in one to five bytes."""
    if size >= _FIVE_BYTES_FROM:
        return bytes([_FIVE_BYTES]) + size.to_bytes(4, "big")
    return bytes(encode_length(size))


@dataclass(slots=True)
class Decoder:
    """Turns chunks of bytes, cut anywhere, into sentences."""

    limit: int = MAX_SENTENCE
    _buffer: bytearray = field(default_factory=bytearray)
    _words: list[str] = field(default_factory=list)
    _size: int = 0

    @property
    def is_between(self) -> bool:
        """True if nothing of a further sentence has come yet."""
        return not self._buffer and not self._words

    def feed(self, chunk: bytes) -> list[tuple[str, ...]]:
        """Take a chunk, return the sentences that it completes; empty sentences are skipped. Raises GarbageError."""
        self._buffer += chunk
        sentences: list[tuple[str, ...]] = []
        start = 0
        while (word := self._word(start)) is not None:
            begin, start = word
            if begin < start:
                if len(self._words) >= MAX_WORDS:
                    raise GarbageError(f"an answer of more than {MAX_WORDS} words")
                self._words.append(self._buffer[begin:start].decode("utf-8", "surrogateescape"))
                self._size += start - begin
            elif self._words:
                sentences.append(tuple(self._words))
                self._words.clear()
                self._size = 0
        del self._buffer[:start]
        return sentences

    def _word(self, start: int) -> tuple[int, int] | None:
        """Find the word whose length prefix is at `start`, if all of it is there: offsets of its begin and end."""
        if start >= len(self._buffer):
            return None
        size, begin = self._buffer[start], start + 1
        if size >= _LONGER:
            begin = start + _prefix_size(size)
            if begin > len(self._buffer):
                return None
            size = _decode_size(bytes(self._buffer[start:begin]))
        if self._size + size > self.limit:
            raise GarbageError(f"a word of {size} bytes, where {self.limit} bytes are the most for a whole answer")
        end = begin + size
        return (begin, end) if end <= len(self._buffer) else None


def _prefix_size(first: int) -> int:
    if first > _FIVE_BYTES:
        raise GarbageError(f"a word that starts with the byte {first:#04x}, which no length starts with")
    return 5 if first == _FIVE_BYTES else 1 + int(determine_length(bytes([first])))


def _decode_size(prefix: bytes) -> int:
    return int.from_bytes(prefix[1:], "big") if prefix[0] == _FIVE_BYTES else int(decode_length(prefix))


@dataclass(frozen=True, slots=True)
class Answer:
    """One reply sentence, taken apart."""

    reply: str
    """`!re`, `!done`, `!empty`, `!trap` or `!fatal`."""
    tag: str | None
    attributes: dict[str, str]
    text: str = ""
    """The bare words of `!fatal`."""


def parse(words: tuple[str, ...]) -> Answer:
    """Take a reply sentence apart; API attributes other than `.tag` are skipped. Raises GarbageError."""
    reply, *rest = words
    if reply not in _REPLIES:
        raise GarbageError(f"{_shown(reply)} in the place of an answer")
    if reply == "!fatal":
        text = " ".join(word for word in rest if not word.startswith("."))
        return Answer(reply, None, {}, "".join(char if char.isprintable() else " " for char in text[:_SHOWN_TEXT]))
    tag: str | None = None
    attributes = Row()
    for word in rest:
        name, equals, value = word[1:].partition("=")
        if not equals or word[0] not in "=.":
            raise GarbageError(f"{_shown(word)} in the place of an attribute of {reply}")
        if word.startswith("="):
            if len(value) > MAX_DIGITS and _NUMBER.search(value):
                raise GarbageError(f"a number of more than {MAX_DIGITS} digits as {_plain(name)}")
            attributes[name] = value
        elif name == "tag":
            tag = value
    return Answer(reply, tag, attributes)


def _plain(name: str) -> str:
    return (
        f"`{name}`"
        if name.isascii() and name.isprintable() and len(name) <= _SHOWN
        else f"a name of {len(name)} characters"
    )


def _shown(word: str) -> str:
    if word.startswith("!") and word.isascii() and word.isprintable() and len(word) <= _SHOWN:
        return f"`{word}`"
    return f"a word of {len(word)} characters"
