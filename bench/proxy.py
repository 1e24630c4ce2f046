"""A link between a client and a twin: delays and limits every byte, and counts what crosses it.

Loopback connects in no time, so the round trip of TCP's own handshake is added to what the client says before it has
heard anything. Counted are bytes of TCP's payload (headers of TCP and IP come on top, for everybody alike) and round
trips: TCP's own, and each time that the far side answers what the client has said since it last heard something.
"""

from __future__ import annotations

import asyncio
from collections import deque
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

if TYPE_CHECKING:
    from collections.abc import Callable

    Arrival = Callable[[int], float]
    """Told how many bytes were read (0: the end), says when they arrive."""

__all__ = ["Count", "Proxy", "Shape"]

_PIECE = 1400
"""Bytes that travel together: about a TCP segment, so that a limited rate is felt within a large answer."""


@dataclass(frozen=True, slots=True)
class Shape:
    """What the link does to every byte."""

    delay_s: float = 0.0
    """One way: half of the round trip."""
    up_bps: float | None = None
    """From the client to the device; None is unlimited."""
    down_bps: float | None = None

    @classmethod
    def read(cls, text: str) -> Self:
        """Read `RTT` or `RTT/UP/DOWN`, in ms and kbit/s. Raises ValueError."""
        rtt_ms, *rates = map(float, text.split("/"))
        up, down = (1000 * rate for rate in rates) if rates else (None, None)
        return cls(rtt_ms / 2000, up, down)

    @property
    def rtt_ms(self) -> int:
        """The round trip."""
        return round(2000 * self.delay_s)

    def __str__(self) -> str:
        rates = [rate for rate in (self.up_bps, self.down_bps) if rate is not None]
        limit = f", {'/'.join(f'{rate / 1000:g}' for rate in rates)} kbit/s" if rates else ""
        return f"{self.rtt_ms} ms{limit}"


@dataclass(slots=True)
class Count:
    """What has crossed the link."""

    connections: int = 0
    round_trips: int = 0
    sent: int = 0
    """Bytes of the client."""
    received: int = 0

    @property
    def bytes(self) -> int:
        """Both directions together."""
        return self.sent + self.received

    def add(self, other: Count) -> None:
        """Add what another link has carried."""
        self.connections += other.connections
        self.round_trips += other.round_trips
        self.sent += other.sent
        self.received += other.received


@dataclass(slots=True)
class _Lane:
    """One direction of the link, shared by all connections: when it is free again."""

    rate_bps: float | None
    free_at: float = 0.0

    def depart(self, size: int, ready: float) -> float:
        """Take `size` bytes that are ready at a moment; return when the last of them has left."""
        start = max(ready, self.free_at)
        self.free_at = start if self.rate_bps is None else start + size * 8 / self.rate_bps
        return self.free_at


@dataclass(slots=True)
class _Talk:
    """One connection: who spoke last."""

    waiting: bool = False
    """The client has said something that nobody has answered."""
    ended: bool = False
    """The client has hung up: what still comes is not waited for."""


class Proxy:
    """Listens at `host`, `port` and leads to `target`; `async with` starts and stops it. `count` may be replaced."""

    def __init__(self, host: str, port: int, target: tuple[str, int], shape: Shape) -> None:
        self.count = Count()
        self.shape = shape
        self._listen_at = (host, port)
        self._target = target
        self._up, self._down = _Lane(shape.up_bps), _Lane(shape.down_bps)
        self._talks: set[asyncio.Task[None]] = set()
        self._server: asyncio.Server | None = None

    @property
    def address(self) -> tuple[str, int]:
        """Where it listens."""
        if self._server is None:
            raise RuntimeError("the proxy is not started")
        host, port = self._server.sockets[0].getsockname()[:2]
        return str(host), int(port)

    async def __aenter__(self) -> Self:
        self._server = await asyncio.start_server(self._accept, *self._listen_at)
        return self

    async def __aexit__(self, *_: object) -> None:
        if self._server is not None:
            self._server.close()
        for talk in tuple(self._talks):
            talk.cancel()
        await asyncio.gather(*self._talks, return_exceptions=True)

    async def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        if task is None:
            raise RuntimeError("a connection outside of any task")
        self._talks.add(task)
        try:
            await self._carry(reader, writer)
        except (OSError, asyncio.CancelledError):
            writer.transport.abort()
        finally:
            self._talks.discard(task)

    async def _carry(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        accepted = asyncio.get_running_loop().time()
        self.count.connections += 1
        self.count.round_trips += 1
        # The client is connected after one round trip. Loopback told it so at once: what it has said since waits here.
        await asyncio.sleep(2 * self.shape.delay_s)
        back, forth = await asyncio.open_connection(*self._target)
        talk = _Talk()
        try:
            async with asyncio.TaskGroup() as both:
                both.create_task(self._upwards(reader, forth, talk))
                both.create_task(self._downwards(back, writer, talk, accepted))
        except* OSError:
            pass
        finally:
            forth.transport.abort()
            writer.transport.abort()

    async def _upwards(self, source: asyncio.StreamReader, sink: asyncio.StreamWriter, talk: _Talk) -> None:
        loop = asyncio.get_running_loop()

        def delay_of(size: int) -> float:
            if size:
                talk.waiting = True
                self.count.sent += size
            else:
                talk.ended = True
            return self._up.depart(size, loop.time()) + self.shape.delay_s

        await _pump(source, sink, delay_of)

    async def _downwards(
        self, source: asyncio.StreamReader, sink: asyncio.StreamWriter, talk: _Talk, accepted: float
    ) -> None:
        loop = asyncio.get_running_loop()
        # The far side accepts when the third packet of the handshake has come, and cannot speak before.
        earliest = accepted + 3 * self.shape.delay_s

        def delay_of(size: int) -> float:
            self.count.received += size
            if talk.waiting and not talk.ended and size:
                talk.waiting = False
                self.count.round_trips += 1
            return self._down.depart(size, max(loop.time(), earliest)) + self.shape.delay_s

        await _pump(source, sink, delay_of)


async def _pump(source: asyncio.StreamReader, sink: asyncio.StreamWriter, reply: Arrival) -> None:
    """Carry one direction of one connection to its end: read at once, deliver when it is due."""
    queue: deque[tuple[float, bytes]] = deque()
    news = asyncio.Event()
    async with asyncio.TaskGroup() as both:
        both.create_task(_fill(source, queue, news, reply))
        both.create_task(_drain(sink, queue, news))


async def _fill(
    source: asyncio.StreamReader, queue: deque[tuple[float, bytes]], news: asyncio.Event, reply: Arrival
) -> None:
    while True:
        data = b""
        with suppress(ConnectionError):
            data = await source.read(_PIECE)
        queue.append((reply(len(data)), data))
        news.set()
        if not data:
            return


async def _drain(sink: asyncio.StreamWriter, queue: deque[tuple[float, bytes]], news: asyncio.Event) -> None:
    """Deliver; no data is the end of the stream."""
    loop = asyncio.get_running_loop()
    while True:
        await news.wait()
        news.clear()
        while queue:
            due, data = queue.popleft()
            if (pause := due - loop.time()) > 0:
                await asyncio.sleep(pause)
            if not data:
                if sink.can_write_eof():
                    sink.write_eof()
                return
            sink.write(data)
