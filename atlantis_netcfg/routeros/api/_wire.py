"""The tagged multiplexer: many commands in one write, answers in any order, one failure for all who wait."""

from __future__ import annotations

import asyncio
import itertools
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, cast

from atlantis_netcfg.core import printable
from atlantis_netcfg.routeros.api._errors import FellSilent, ProtocolError, SessionLost
from atlantis_netcfg.routeros.api._sentences import Answer, Decoder, GarbageError, encode, parse
from atlantis_netcfg.routeros.api._values import Command, Reply, Traffic, Trap

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from atlantis_netcfg.routeros._types import Row
    from atlantis_netcfg.routeros.api._tls import TlsTransport

__all__ = ["LONGEST_S", "Wire"]

_CATEGORIES = frozenset("01234567")
"""Of a refusal (manual, API, "Possible responses")."""
LONGEST_S = 900.0
"""For the answers to one batch, however busily they come: some MB over a satellite, with its gaps."""
_MOST_BYTES = 16 * 1024 * 1024
"""Of the answers to one batch; the largest text that is read, a whole export, has some hundred thousand."""
_MOST_ROWS = 100_000
_MOST_ATTRIBUTES = 300_000
_PROGRESS_BYTES = 4096
"""Whoever has sent neither a whole answer nor so many bytes has been silent."""


@dataclass(slots=True)
class _Pending:
    """What was answered so far to one command."""

    command: Command
    rows: list[Row] = field(default_factory=list)
    trap: Trap | None = None
    reply: Reply | None = None

    def take(self, answer: Answer) -> None:
        if answer.reply == "!re":
            self.rows.append(answer.attributes)
        elif answer.reply == "!trap" and self.trap is None:
            category = answer.attributes.get("category", "")
            message = printable.line(answer.attributes.get("message", ""))
            self.trap = Trap(message, int(category) if category in _CATEGORIES else None)
        elif answer.reply == "!done":
            self.reply = Reply(tuple(self.rows), answer.attributes.get("ret"), self.trap, self.command.path)


class Wire(asyncio.Protocol):
    """One connection: sentences out, answers sorted by tag; fails once for good."""

    def __init__(self, name: str, traffic: Traffic) -> None:
        self.name = name
        self.traffic = traffic
        """Counted by the transport below."""
        self.closed = asyncio.Event()
        self._transport: TlsTransport | None = None
        self._decoder = Decoder()
        self._tags: Iterator[int] = itertools.count(1)
        self._pending: dict[str, _Pending] = {}
        self._settled: asyncio.Future[None] | None = None
        self._failure: SessionLost | None = None
        self._heard = 0.0
        self._partial = self._bytes = self._rows = self._attributes = 0
        """What came since something whole did; what the answers to this batch came to."""

    @property
    def transport(self) -> TlsTransport:
        """The transport below; there is one from `connection_made` on."""
        if self._transport is None:
            raise RuntimeError("asyncio connects a protocol before it hands it out")
        return self._transport

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """The transport's call: the TLS handshake is done."""
        self._transport = cast("TlsTransport", transport)

    def data_received(self, data: bytes) -> None:
        """The transport's call: bytes came."""
        self._bytes += len(data)
        self._partial += len(data)
        try:
            sentences = self._decoder.feed(data)
            if sentences or self._partial >= _PROGRESS_BYTES:
                self._heard, self._partial = asyncio.get_running_loop().time(), 0
            for words in sentences:
                self._dispatch(parse(words))
            self._bound(sentences)
        except GarbageError as error:
            self._fail(f"sent {error}", kind=ProtocolError)

    def _bound(self, sentences: Sequence[Sequence[str]]) -> None:
        """Raise GarbageError for answers without end: no question of ours has so much to be told."""
        self._rows += len(sentences)
        self._attributes += sum(map(len, sentences))
        if self._bytes > _MOST_BYTES or self._rows > _MOST_ROWS or self._attributes > _MOST_ATTRIBUTES:
            raise GarbageError(f"answers without end: {self._bytes} bytes, {self._rows} rows")

    def connection_lost(self, exc: Exception | None) -> None:
        """The transport's call: the connection is gone; `exc` is None if the device closed it."""
        if not self._decoder.is_between:
            self._fail("fell silent in the middle of an answer: the connection is lost", kind=ProtocolError)
        self._fail("lost the connection" if exc else "closed the connection")
        self.closed.set()

    async def exchange(
        self, commands: Sequence[Command], silence_s: float, longest_s: float = LONGEST_S
    ) -> list[Reply]:
        """Send all commands in one write and wait for all answers. Raises SessionLost, also after so much silence.

        A device that goes on answering is left after `longest_s`, or after `silence_s` if that is longer. One batch at
        a time: who calls it for several tasks takes turns.
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
        """End the connection in good order, with `wait` after the device has; `closed` is set when that is done."""
        self._fail("was left: this session is closed", abort=False)
        self.transport.close(wait=wait)

    def abort(self) -> None:
        """Drop the connection at once: what was asked cannot be waited for any more."""
        self._fail("was dropped by us")
        self.transport.abort()

    def _send(self, data: bytes) -> None:
        self.transport.write(data)
        self._heard = asyncio.get_running_loop().time()

    async def _wait(self, settled: asyncio.Future[None], silence_s: float, longest_s: float) -> None:
        loop = asyncio.get_running_loop()
        longest_s = max(longest_s, silence_s)
        end = loop.time() + longest_s
        while not settled.done():
            now = loop.time()
            if now >= self._heard + silence_s:
                self._fail(f"has not answered for {silence_s:g} s", kind=FellSilent)
            elif now >= end:
                self._fail(f"has gone on answering for {longest_s:g} s without an end", kind=ProtocolError)
            else:
                await asyncio.wait([settled], timeout=min(self._heard + silence_s, end) - now)
        settled.result()

    def _dispatch(self, answer: Answer) -> None:
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

    def _fail(self, how: str, *, kind: type[SessionLost] = SessionLost, abort: bool = True) -> None:
        """Fail for good, unless that already happened: who waits is told, and so is whoever sends later."""
        if self._failure is not None:
            return
        self._failure = kind(f"{self.name} {how}", in_flight=bool(self._pending))
        self._pending.clear()
        if self._settled is not None and not self._settled.done():
            self._settled.set_exception(self._failure)
        if abort:
            self.transport.abort()
