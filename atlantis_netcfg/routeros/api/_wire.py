"""The tagged multiplexer: many commands in one write, replies in any order, one failure for all that wait.

Encodes and decodes words and sentences without I/O.

Length prefixes are computed by librouteros. Its protocol classes do not fit: they own the socket, read word by word,
log every word (passwords too) and drop bytes that they cannot decode. Added here: five-byte lengths, a memory limit,
bytes that are not UTF-8 (kept as lone surrogates, so that they can be sent back unchanged), arbitrary chunks of the
stream, and detection of data that is not a reply.

Source: manual, API, "API words" and "API sentences".
"""

from __future__ import annotations

import asyncio
import itertools
import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, cast

from librouteros.protocol import (
    decode_length,
    determine_length,
    encode_length,
)

from atlantis_netcfg.core import printable
from atlantis_netcfg.core.messages import arg
from atlantis_netcfg.routeros.api import _values

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from atlantis_netcfg.routeros._types import Row
    from atlantis_netcfg.routeros.api._tls import TlsTransport


MAX_SENTENCE: Final = 16 * 1024 * 1024
"""Bytes; far more than any row, so that a garbled length is detected before memory runs out."""

MAX_WORDS: Final = 10_000
"""Maximum words of one sentence; a row has fewer than a hundred."""
MAX_DIGITS: Final = 1_000
"""Maximum consecutive digits. The largest counter has twenty; Python refuses to parse some thousands."""
_LONGER: Final = 0x80
"""From this first byte on, the length is encoded in more than one byte."""
_FIVE_BYTES: Final = 0xF0
_FIVE_BYTES_FROM: Final = 0x10000000
_REPLIES: Final = frozenset({"!re", "!done", "!empty", "!trap", "!fatal"})
_NUMBER: Final = re.compile(rf"[0-9]{{{MAX_DIGITS},}}")
_MAX_NAME: Final = 20
_SHOWN_TEXT: Final = 200


class Attributes(dict[str, str]):
    """Attributes of one sentence; a missing one was omitted by the device, so it raises ProtocolError."""

    def __missing__(self, name: str) -> str:
        raise _values.ProtocolError(
            f"the device has sent an answer without `{arg(name)}`, which every RouterOS sends",
            in_flight=False,
            hint="is this the device that is declared, and is its RouterOS whole?",
        )


class GarbageError(ValueError):
    """The bytes are not a valid sentence; the text gives kind and size, never the content."""


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
    """Decodes chunks of bytes, split anywhere, into sentences."""

    limit: int = MAX_SENTENCE
    _buffer: bytearray = field(default_factory=bytearray)
    _words: list[str] = field(default_factory=list)
    _size: int = 0

    @property
    def is_between(self) -> bool:
        """True if no part of a further sentence has been received."""
        return not self._buffer and not self._words

    def feed(self, chunk: bytes) -> list[tuple[str, ...]]:
        """Add a chunk, and return the sentences completed by it; empty ones are skipped. Raises GarbageError."""
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
        """Return the offsets of the word whose length prefix is at `start`; None if it is not complete yet."""
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
class AnswerReader:
    """One parsed reply sentence."""

    reply: str
    """`!re`, `!done`, `!empty`, `!trap` or `!fatal`."""
    tag: str | None
    attributes: dict[str, str]
    text: str = ""
    """The text of `!fatal`."""


def parse(words: tuple[str, ...]) -> AnswerReader:
    """Parse a reply sentence; API attributes other than `.tag` are ignored. Raises GarbageError."""
    reply, *rest = words
    if reply not in _REPLIES:
        raise GarbageError(f"{_describe_word(reply)} in the place of an answer")
    if reply == "!fatal":
        text = " ".join(word for word in rest if not word.startswith("."))
        return AnswerReader(
            reply, None, {}, "".join(char if char.isprintable() else " " for char in text[:_SHOWN_TEXT])
        )
    tag: str | None = None
    attributes = Attributes()
    for word in rest:
        name, equals, value = word[1:].partition("=")
        if not equals or word[0] not in "=.":
            raise GarbageError(f"{_describe_word(word)} in the place of an attribute of {reply}")
        if word.startswith("="):
            if len(value) > MAX_DIGITS and _NUMBER.search(value):
                raise GarbageError(f"a number of more than {MAX_DIGITS} digits as {_describe_name(name)}")
            attributes[name] = value
        elif name == "tag":
            tag = value
    return AnswerReader(reply, tag, attributes)


def _describe_name(name: str) -> str:
    return (
        f"`{name}`"
        if name.isascii() and name.isprintable() and len(name) <= _MAX_NAME
        else f"a name of {len(name)} characters"
    )


def _describe_word(word: str) -> str:
    if word.startswith("!") and word.isascii() and word.isprintable() and len(word) <= _MAX_NAME:
        return f"`{word}`"
    return f"a word of {len(word)} characters"


_CATEGORIES = frozenset("01234567")
"""Error categories of `!trap` (manual, API, "Possible responses")."""
LONGEST_S = 900.0
"""Timeout for all replies of one batch, even if data arrives: some MB over a satellite link with gaps."""
_MOST_BYTES = 16 * 1024 * 1024
"""Maximum bytes of the replies to one batch; a whole export, the longest text, has some hundred thousand."""
_MOST_ROWS = 100_000
_MOST_ATTRIBUTES = 300_000
_PROGRESS_BYTES = 4096
"""A peer that has sent neither a complete reply nor this many bytes counts as silent."""


@dataclass(slots=True)
class _Pending:
    """Partial reply to one command."""

    command: _values.Command
    rows: list[Row] = field(default_factory=list)
    trap: _values.Trap | None = None
    reply: _values.Reply | None = None

    def take(self, answer: AnswerReader) -> None:
        if answer.reply == "!re":
            self.rows.append(answer.attributes)
        elif answer.reply == "!trap" and self.trap is None:
            category = answer.attributes.get("category", "")
            message = printable.line(answer.attributes.get("message", ""))
            self.trap = _values.Trap(message, int(category) if category in _CATEGORIES else None)
        elif answer.reply == "!done":
            self.reply = _values.Reply(tuple(self.rows), answer.attributes.get("ret"), self.trap, self.command.path)


class Wire(asyncio.Protocol):
    """One connection: sends sentences, sorts replies by tag; after a failure it stays failed."""

    def __init__(self, name: str, traffic: _values.Traffic) -> None:
        self.name = name
        self.traffic = traffic
        """Traffic counter, updated by the transport below."""
        self.closed = asyncio.Event()
        self._transport: TlsTransport | None = None
        self._decoder = Decoder()
        self._tags: Iterator[int] = itertools.count(1)
        self._pending: dict[str, _Pending] = {}
        self._settled: asyncio.Future[None] | None = None
        self._failure: _values.SessionLost | None = None
        self._received = 0.0
        self._partial = self._bytes = self._rows = self._attributes = 0
        """Bytes since the last progress, and bytes, rows and attributes of the replies to this batch."""

    @property
    def transport(self) -> TlsTransport:
        """The transport below; set from `connection_made` on."""
        if self._transport is None:
            raise RuntimeError("asyncio connects a protocol before it hands it out")
        return self._transport

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Store the transport; it calls this after the TLS handshake."""
        self._transport = cast("TlsTransport", transport)

    def data_received(self, data: bytes) -> None:
        """Decode received bytes; called by the transport."""
        self._bytes += len(data)
        self._partial += len(data)
        try:
            sentences = self._decoder.feed(data)
            if sentences or self._partial >= _PROGRESS_BYTES:
                self._received, self._partial = asyncio.get_running_loop().time(), 0
            for words in sentences:
                self._dispatch(parse(words))
            self._bound(sentences)
        except GarbageError as error:
            self._fail(f"sent {error}", kind=_values.ProtocolError)

    def _bound(self, sentences: Sequence[Sequence[str]]) -> None:
        """Raise GarbageError for endless replies: none of our requests has a reply of that size."""
        self._rows += len(sentences)
        self._attributes += sum(map(len, sentences))
        if self._bytes > _MOST_BYTES or self._rows > _MOST_ROWS or self._attributes > _MOST_ATTRIBUTES:
            raise GarbageError(f"answers without end: {self._bytes} bytes, {self._rows} rows")

    def connection_lost(self, exc: Exception | None) -> None:
        """Fail on a lost connection; `exc` is None if the device closed it. Called by the transport."""
        if not self._decoder.is_between:
            self._fail("fell silent in the middle of an answer: the connection is lost", kind=_values.ProtocolError)
        self._fail("lost the connection" if exc else "closed the connection")
        self.closed.set()

    async def exchange(
        self, commands: Sequence[_values.Command], silence_s: float, longest_s: float = LONGEST_S
    ) -> list[_values.Reply]:
        """Send all commands in one write and wait for all replies. Raises SessionLost, also after that much silence.

        A device that keeps on replying is abandoned after `longest_s`, or after `silence_s` if that is longer. Only one
        batch at a time: a caller with several tasks must serialise them.
        """
        if self._failure is not None:
            raise type(self._failure)(str(self._failure), in_flight=False)
        batch = {str(next(self._tags)): _Pending(command) for command in commands}
        self._pending = dict(batch)
        self._bytes = self._rows = self._attributes = 0
        self._settled = asyncio.get_running_loop().create_future()
        self._send(b"".join(encode((*item.command.words(), f".tag={tag}")) for tag, item in batch.items()))
        try:
            await self._wait(self._settled, silence_s, longest_s)
        except asyncio.CancelledError:
            self._settled.cancel()
            self.abort()
            raise
        return [item.reply for item in batch.values() if item.reply is not None]

    def close(self, *, wait: bool) -> None:
        """Close the connection cleanly, with `wait` after the device; `closed` is set when done."""
        self._fail("was left: this session is closed", abort=False)
        self.transport.close(wait=wait)

    def abort(self) -> None:
        """Drop the connection at once; pending commands fail."""
        self._fail("was dropped by us")
        self.transport.abort()

    def _send(self, data: bytes) -> None:
        self.transport.write(data)
        self._received = asyncio.get_running_loop().time()

    async def _wait(self, completion: asyncio.Future[None], silence_s: float, longest_s: float) -> None:
        loop = asyncio.get_running_loop()
        longest_s = max(longest_s, silence_s)
        end = loop.time() + longest_s
        while not completion.done():
            now = loop.time()
            if now >= self._received + silence_s:
                self._fail(f"has not answered for {silence_s:g} s", kind=_values.FellSilent)
            elif now >= end:
                self._fail(f"has gone on answering for {longest_s:g} s without an end", kind=_values.ProtocolError)
            else:
                await asyncio.wait([completion], timeout=min(self._received + silence_s, end) - now)
        completion.result()

    def _dispatch(self, answer: AnswerReader) -> None:
        if answer.reply == "!fatal":
            self._fail(f"ended the session: {answer.text}")
            return
        if answer.tag not in self._pending:
            raise GarbageError(f"an answer `{answer.reply}` to a command that it was not asked")
        item = self._pending[answer.tag]
        item.take(answer)
        if item.reply is not None:
            del self._pending[answer.tag]
        if not self._pending and self._settled is not None and not self._settled.done():
            self._settled.set_result(None)

    def _fail(self, how: str, *, kind: type[_values.SessionLost] = _values.SessionLost, abort: bool = True) -> None:
        """Fail permanently, unless already failed: waiting and later commands raise the failure."""
        if self._failure is not None:
            return
        self._failure = kind(f"{self.name} {how}", in_flight=bool(self._pending))
        self._pending.clear()
        if self._settled is not None and not self._settled.done():
            self._settled.set_exception(self._failure)
        if abort:
            self.transport.abort()
