"""The router's end of one connection: bytes to sentences, sentences to replies, with faults."""

from __future__ import annotations

import asyncio
import ssl
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.wire import link
from atlantis_netcfg.emulator.routeros.wire.dialogue import Reply, tag_of
from atlantis_netcfg.emulator.routeros.wire.host import Pipe, RouterHost

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from atlantis_netcfg.emulator.routeros.answers import Answer
    from atlantis_netcfg.emulator.routeros.wire.tls import ByteChannel


Sentence = tuple[str, ...]

_FORMS = ((0x80, 1, 0), (0x4000, 2, 0x8000), (0x20_0000, 3, 0xC0_0000), (0x1000_0000, 4, 0xE000_0000))
"""Upper limit of the length, bytes on the wire, marker bits."""

_FIVE_BYTES = 0xF0
_FIRST_RESERVED = 0xF8


class ReservedLength(ValueError):
    """A length begins with 0xF8 or above, reserved control bytes; the rest of the stream is undefined."""


class WordTooLong(ValueError):
    """A word is longer than currently accepted."""


def encode_length(length: int) -> bytes:
    """Encode a word's length in the shortest form."""
    for below, size, marker in _FORMS:
        if length < below:
            return (length | marker).to_bytes(size, "big")
    return bytes([_FIVE_BYTES]) + length.to_bytes(4, "big")


def encode_word(word: str) -> bytes:
    """Encode one word with its length."""
    raw = word.encode("utf-8", "surrogateescape")
    return encode_length(len(raw)) + raw


def encode_sentence(words: Iterable[str]) -> bytes:
    """Encode all words and the terminating empty word."""
    return b"".join(map(encode_word, words)) + b"\0"


class Decoder:
    """Decoder of incoming bytes to complete sentences; empty sentences are ignored.

    `limit`: longest accepted word; the server keeps it small until the login.
    """

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self._bytes = bytearray()
        self._words: list[str] = []

    def feed(self, data: bytes) -> Iterator[Sentence]:
        """Yield the sentences completed by `data`. Raises ReservedLength or WordTooLong at an invalid length."""
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
        """Return size and value of the next word's length field; None while incomplete."""
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
    """Return size and value mask of a length field, by its first byte."""
    for ceiling, size, mask in ((0x80, 1, 0x7F), (0xC0, 2, 0x3FFF), (0xE0, 3, 0x1F_FFFF), (0xF0, 4, 0x0FFF_FFFF)):
        if first < ceiling:
            return size, mask
    return 5, 0xFFFF_FFFF


_LONGEST_WORD = 64 * 1024 * 1024


@dataclass(frozen=True, slots=True)
class _InboxItem:
    """A sentence, and the count of sentences answered when its client sent it; no words: garbage."""

    words: tuple[str, ...]
    answer_count: int


class Connection:
    """One API connection."""

    def __init__(self, host: RouterHost, service: str) -> None:
        self.tally = link.TrafficCounters(service)
        self.pipe = Pipe(host, service)
        self.pipe.end = self
        self._host = host
        self._dialogue = host.dialogue(service)
        self._decoder = Decoder(host.knobs.word_before_login)
        self._channel: ByteChannel
        self._inbox: deque[_InboxItem] = deque()
        self._news = asyncio.Event()
        self._writes: list[bool] = []
        """For each sentence received, whether it is something other than `print`."""
        self._sent = self._completed = 0
        self._listened = -1
        self._mute = False
        """The router hangs: it no longer receives or sends anything."""
        self._closed = False

    @property
    def _is_over(self) -> bool:
        return self._mute or self._closed or self.pipe.ended or self.pipe.lost

    # What the pipe reports.

    def handle_accept(self) -> None:
        """Handle the accepted connection."""
        self._channel = self._host.channel(self.pipe.service)

    def handle_chunk(self, chunk: link.Chunk) -> None:
        """Handle data from the client."""
        if chunk.end is not None:
            self.hang_up()
        elif not self._closed:
            self._decrypt(chunk)

    def handle_loss(self) -> None:
        """Handle the loss of the client, once the router detects it."""
        self._dialogue.leave()
        self._host.tell()

    def check(self) -> None:
        """Close the connection if this session was removed from `/user/active`."""
        if self._dialogue.is_evicted:
            self.hang_up()

    # Faults that concern one connection only.

    def drop(self) -> None:
        """Reset the connection at both ends; data in transit are lost."""
        self.pipe.stop(reset=True)

    def vanish(self) -> None:
        """Silence the connection permanently, without notice to either end."""
        self.pipe.vanish()

    def handle_reboot(self, *, clean: bool) -> None:
        """Handle a reboot; `clean`: sockets were closed first. A SYN in transit finds the router again later."""
        self._dialogue.forget()
        self._inbox.clear()
        if self.pipe.established and clean:
            self.pipe.farewell()
        elif self.pipe.established:
            self.pipe.forget()

    # Hearing.

    def _decrypt(self, chunk: link.Chunk) -> None:
        self.tally.counters.wire_in += len(chunk.data)
        try:
            plain = self._channel.receive(chunk.data)
        except (EOFError, ssl.SSLError):
            self.hang_up()
            return
        self._send(self._channel.flush())
        if plain:
            self._count_turn(chunk, len(plain))
            self._receive_sentences(plain, chunk.answer_count)

    def _count_turn(self, chunk: link.Chunk, size: int) -> None:
        self.tally.counters.bytes_in += size
        if chunk.heard_count > self._listened:
            self.tally.counters.turns += 1
            self._listened = chunk.heard_count

    def _receive_sentences(self, plain: bytes, answer_count: int) -> None:
        try:
            for words in self._decoder.feed(plain):
                self._writes.append(not (words and words[0].endswith("/print")))
                knobs = self._host.knobs
                waiting = self._writes[answer_count:]
                hangs = knobs.hang_at is not None and len(waiting) >= knobs.hang_at
                hangs_writing = knobs.hang_writes_at is not None and sum(waiting) >= knobs.hang_writes_at
                self._mute = self._mute or hangs or hangs_writing
                self._inbox.append(_InboxItem(words, answer_count))
        except (ReservedLength, WordTooLong):
            self._inbox.append(_InboxItem((), answer_count))
        self._news.set()

    # Working.

    async def work(self) -> None:
        """Process received sentences, burst by burst."""
        while True:
            await self._news.wait()
            self._news.clear()
            while self._inbox and not self._is_over:
                await self._answer_burst(self._next_burst())
                self._host.tell()

    def _next_burst(self) -> list[_InboxItem]:
        """Return the next sentence; with shuffling, all tagged ones at the front of the queue, in random order."""
        burst = [self._inbox.popleft()]
        chance = self._host.chance
        if chance is not None and tag_of(burst[0].words) is not None:
            while self._inbox and tag_of(self._inbox[0].words) is not None:
                burst.append(self._inbox.popleft())
            chance.shuffle(burst)
        return burst

    async def _answer_burst(self, burst: Sequence[_InboxItem]) -> None:
        answers = [await self._answer(sentence) for sentence in burst]
        chance = self._host.chance
        while chance is not None and any(answers):
            answers = [replies for replies in answers if replies]
            self.say([chance.choice(answers).pop(0)])
        for replies in answers:
            self.say(replies)

    async def _answer(self, sentence: _InboxItem) -> list[Reply]:
        """Run one sentence with its scheduled faults; return the remaining replies."""
        if self._is_over:
            return []
        if not sentence.words:
            self.hang_up()
            return []
        self._record_sentence(sentence.words)
        faults = self._host.upon(link.Faults.command(sentence.words))
        self._apply_faults(faults, "before")
        await asyncio.sleep(self._host.pace.wait_s(self._host.knobs, asyncio.get_running_loop().time()))
        if self._is_over:
            return []
        for fault in faults:
            sentence = _InboxItem(fault.shorten(sentence.words), sentence.answer_count)
        replies = self._run(sentence)
        await self._host.settle()
        self._apply_faults(faults, "after")
        return self._spoil(faults, replies)

    def _record_sentence(self, words: tuple[str, ...]) -> None:
        self.tally.counters.sentences += 1
        self.tally.sentences.append(link.mask_words(words))

    def _run(self, sentence: _InboxItem) -> list[Reply]:
        stranger = self._dialogue.caller is None
        replies = self._dialogue.answer(sentence.words, sentence.answer_count, self._host.knobs)
        if stranger and self._dialogue.caller is not None:
            self.tally.counters.logins += 1
            self._decoder.limit = _LONGEST_WORD
        return replies

    def _apply_faults(self, faults: Sequence[link.LinkFault], when: str) -> None:
        for fault in faults:
            if fault.when != when:
                continue
            if fault.do is link.FaultKind.DROP:
                self.drop()
            elif fault.do is link.FaultKind.VANISH:
                self.vanish()
            elif fault.do is link.FaultKind.HANG:
                self._mute = True
            else:
                self._host.strike(fault)

    def _spoil(self, faults: Sequence[link.LinkFault], replies: list[Reply]) -> list[Reply]:
        """Truncate or corrupt the reply if a fault requires it; return the remaining replies."""
        for fault in faults:
            if fault.do is link.FaultKind.TRUNCATE:
                whole = _encode(replies)
                self._send_plain(whole[: len(whole) // 2 if fault.offset is None else fault.offset], 0)
                self.hang_up()
                return []
            if fault.do is link.FaultKind.GARBAGE:
                whole, at = _encode(replies), fault.offset or 0
                self._send_plain(whole[:at] + bytes.fromhex(fault.data) + whole[at:], _count_completed(replies))
                return []
        return replies

    # Saying.

    def say_pending(self) -> None:
        """Send pending `/listen` replies."""
        self.say(self._dialogue.pending())

    def say(self, replies: Sequence[Reply]) -> None:
        """Send replies; `!fatal` ends the connection."""
        if replies:
            self._send_plain(_encode(replies), _count_completed(replies))
        if any(answer.kind == "!fatal" for _, answer in replies):
            self.hang_up()

    def _send_plain(self, plain: bytes, completed_count: int) -> None:
        if self._is_over or not plain:
            return
        self.tally.counters.bytes_out += len(plain)
        self._sent += 1
        self._completed += completed_count
        self._send(self._channel.send(plain))

    def _send(self, wire: bytes) -> None:
        if wire:
            self.tally.counters.wire_out += len(wire)
            self.pipe.depart(link.Chunk(wire, heard_count=self._sent, answer_count=self._completed))

    def hang_up(self) -> None:
        """Close the connection in the regular way."""
        if self._closed:
            return
        self._closed = True
        self._send(self._channel.flush() + self._channel.close())
        self.pipe.depart(link.Chunk(end=link.LineEnd.FIN))
        self.handle_loss()


def _count_completed(replies: Sequence[Reply]) -> int:
    return sum(answer.last for _, answer in replies)


def _encode(replies: Sequence[Reply]) -> bytes:
    return b"".join(encode_sentence(_words(tag, answer)) for tag, answer in replies)


def _words(tag: str | None, answer: Answer) -> tuple[str, ...]:
    """Return a reply's words, with the tag right after the reply word, as mikronode's grammar requires.

    The examples of the manual (API, "/cancel, simultaneous commands") put it last, and leave the order open.
    """
    has_tag = tag is not None and answer.kind != "!fatal"
    return (answer.kind, *((f".tag={tag}",) if has_tag else ()), *answer.words)
