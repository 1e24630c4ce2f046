"""Words and sentences of the RouterOS API as bytes, for the twin alone: no client's codec is tested by itself.

Manual, API: a word is its length and its bytes, a sentence is words up to a word of zero length. Text is kept byte for
byte (`surrogateescape`), since RouterOS knows no encoding.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

__all__ = ["Decoder", "ReservedLength", "WordTooLong", "encode_length", "encode_sentence", "encode_word"]

Sentence = tuple[str, ...]

_FORMS = ((0x80, 1, 0), (0x4000, 2, 0x8000), (0x20_0000, 3, 0xC0_0000), (0x1000_0000, 4, 0xE000_0000))
"""Length below, bytes on the wire, marker bits."""

_FIVE_BYTES = 0xF0
_FIRST_RESERVED = 0xF8


class ReservedLength(ValueError):
    """A length began with 0xF8 or above: control bytes that nobody has defined; what follows has no meaning."""


class WordTooLong(ValueError):
    """A word is longer than this end accepts at this moment."""


def encode_length(length: int) -> bytes:
    """Shortest form of a word's length."""
    for below, size, marker in _FORMS:
        if length < below:
            return (length | marker).to_bytes(size, "big")
    return bytes([_FIVE_BYTES]) + length.to_bytes(4, "big")


def encode_word(word: str) -> bytes:
    """One word with its length."""
    raw = word.encode("utf-8", "surrogateescape")
    return encode_length(len(raw)) + raw


def encode_sentence(words: Iterable[str]) -> bytes:
    """All words and the zero-length word that ends them."""
    return b"".join(map(encode_word, words)) + b"\0"


class Decoder:
    """Collects bytes as they arrive and gives out sentences once they are complete; empty sentences are ignored.

    `limit` is the longest word that is accepted; the server keeps it small until a login has succeeded.
    """

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self._bytes = bytearray()
        self._words: list[str] = []

    @property
    def midway(self) -> bool:
        """True if a sentence has begun and not ended."""
        return bool(self._bytes or self._words)

    def feed(self, data: bytes) -> Iterator[Sentence]:
        """Sentences completed by `data`; after them ReservedLength or WordTooLong if a length breaks it off."""
        self._bytes += data
        while (header := self._header()) is not None:
            size, length = header
            if size + length > len(self._bytes):
                return
            word = bytes(self._bytes[size : size + length])
            del self._bytes[: size + length]
            if word:
                self._words.append(word.decode("utf-8", "surrogateescape"))
            elif self._words:
                yield tuple(self._words)
                self._words = []

    def _header(self) -> tuple[int, int] | None:
        """Bytes taken by the length of the next word, and its value; None while incomplete."""
        if not self._bytes:
            return None
        first = self._bytes[0]
        if first >= _FIRST_RESERVED:
            raise ReservedLength(f"0x{first:02X}")
        size, mask = _shape(first)
        if size > len(self._bytes):
            return None
        length = int.from_bytes(self._bytes[:size], "big") & mask
        if length > self.limit:
            raise WordTooLong(str(length))
        return size, length


def _shape(first: int) -> tuple[int, int]:
    """Bytes of a length by its first byte, and the mask that takes the marker off."""
    for ceiling, size, mask in ((0x80, 1, 0x7F), (0xC0, 2, 0x3FFF), (0xE0, 3, 0x1F_FFFF), (0xF0, 4, 0x0FFF_FFFF)):
        if first < ceiling:
            return size, mask
    return 5, 0xFFFF_FFFF
