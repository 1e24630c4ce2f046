"""The bearer between client and router: a delay line, so that pipelined sentences share one delay.

Both ends of a `Line` live in the server: what the client's socket hands over enters at once and leaves later.
"""

from __future__ import annotations

import asyncio
from collections import deque
from dataclasses import dataclass, replace
from enum import Enum
from typing import TYPE_CHECKING

from pydantic import BaseModel, ConfigDict, Field

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

SEGMENT = 1400
"""Bytes that travel together: a TCP segment within a tunnel's MTU."""
HEADERS = 54
"""Ethernet 14, IP 20, TCP 20: what a port's byte counter has for a segment besides its payload.

Assumption: port-counters
"""


def _uncounted(_port: str | None, _direction: Direction, _size: int) -> None:
    """Nobody counts."""


class Link(BaseModel):
    """What the bearer does to every byte; given by the caller, all times in seconds as he wants to wait for them."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    delay_s: float = Field(default=0.0, ge=0)
    """One way: half of the round trip."""
    rate_up_bps: float | None = Field(default=None, gt=0)
    """From the client to the router; None is unlimited."""
    rate_down_bps: float | None = Field(default=None, gt=0)
    """From the router to the client."""
    stall_every: int | None = Field(default=None, ge=1)
    """Every n-th segment of a direction is lost once: TCP sends it again, and all behind it waits."""
    stall_s: float = Field(default=1.0, ge=0)
    """Until TCP has sent the lost segment again."""
    tcp_connect: bool = True
    """The connection itself costs a round trip, which loopback would give away."""
    port: str | None = None
    """Factory name of the port that the bearer hangs on, whose counters rise; None: the technician's."""


class Direction(Enum):
    """Of a bearer, as the client sees it."""

    UP = "up"
    DOWN = "down"


class End(Enum):
    """How a direction of a TCP connection ends."""

    FIN = "fin"
    RST = "rst"


@dataclass(frozen=True, slots=True)
class Chunk:
    """Bytes under way; `heard` and `answered` are the sender's tally at that moment (see connection.py)."""

    data: bytes = b""
    end: End | None = None
    heard: int = 0
    answered: int = 0

    def segments(self) -> Iterator[Chunk]:
        """The same in pieces that a link carries one after another."""
        if len(self.data) <= SEGMENT:
            yield self
            return
        for at in range(0, len(self.data), SEGMENT):
            yield replace(self, data=self.data[at : at + SEGMENT])


class Bearer:
    """The link's state that all connections share: when each direction is free again, and how many segments it took."""

    def __init__(self, link: Link) -> None:
        self.link = link
        self._free_at = dict.fromkeys(Direction, 0.0)
        self._segments = dict.fromkeys(Direction, 0)
        self.count: Callable[[str | None, Direction, int], None] = _uncounted
        """Told the link's port and every segment's bytes, its headers included; acknowledgements are not."""

    def arrival(self, direction: Direction, size: int, departure: float) -> float:
        """When `size` bytes that are handed over at `departure` have arrived at the other end."""
        rate = self.link.rate_up_bps if direction is Direction.UP else self.link.rate_down_bps
        start = max(departure, self._free_at[direction])
        sent = start if rate is None else start + size * 8 / rate
        self._free_at[direction] = sent
        if size:
            self.count(self.link.port, direction, size + HEADERS)
        return sent + self.link.delay_s + self._retransmission(direction, size)

    def _retransmission(self, direction: Direction, size: int) -> float:
        if not size or self.link.stall_every is None:
            return 0.0
        self._segments[direction] += 1
        return 0.0 if self._segments[direction] % self.link.stall_every else self.link.stall_s


class Line:
    """One direction of one connection: first in, first out, each chunk when it is due and the air is free."""

    def __init__(
        self, bearer: Bearer, direction: Direction, air: asyncio.Event, deliver: Callable[[Chunk], None]
    ) -> None:
        self._bearer = bearer
        self._direction = direction
        self._air = air
        self._deliver = deliver
        self._queue: deque[tuple[float, Chunk]] = deque()
        self._news = asyncio.Event()
        self._last = 0.0
        self.earliest = 0.0
        """Nothing departs before: the TCP connection is not yet there."""

    def put(self, chunk: Chunk) -> None:
        """Hand over at this end."""
        departure = max(asyncio.get_running_loop().time(), self.earliest)
        for piece in chunk.segments():
            arrival = self._bearer.arrival(self._direction, len(piece.data), departure)
            self._last = max(self._last, arrival)
            self._queue.append((self._last, piece))
        self._news.set()

    async def pump(self) -> None:
        """Deliver at the other end for ever; what is due together is delivered together."""
        loop = asyncio.get_running_loop()
        while True:
            await self._news.wait()
            self._news.clear()
            while self._queue:
                await asyncio.sleep(max(0.0, self._queue[0][0] - loop.time()))
                await self._air.wait()
                now = loop.time()
                while self._queue and self._queue[0][0] <= now:
                    self._deliver(self._queue.popleft()[1])
