"""A link for UDP whose truth is known: rate, delay, jitter, loss, copies, order, gaps, queue and MTU of each direction.

`LinkModel` is pure: it is given a packet's size and the time, and says when it arrives. `UdpRelay` puts two of them
between a client and a server of the loopback. The same seed gives the same fate to the same packets. Sizes count IPv4
and UDP headers.

The model of a direction: what is longer than the MTU, or finds no room in the queue, is dropped; the rest is sent at
the rate, lost at random after that, and arrives after the delay and a half-normal jitter, in order. A reordered packet
is delayed once more, and holds up no other. In a gap everything that was sent is lost. Not modelled: a rate that
changes, loss in bursts.
"""

from __future__ import annotations

import heapq
import random
import socket
import threading
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, Self

if TYPE_CHECKING:
    from types import TracebackType

HEADERS: Final = 28
"""IPv4 and UDP."""
_LONGEST: Final = 65536
_WAIT_S: Final = 0.05


@dataclass(frozen=True, slots=True)
class LinkShape:
    """What one direction does; the default does nothing."""

    rate_bps: float | None = None
    delay_s: float = 0.0
    jitter_s: float = 0.0
    """Standard deviation of the normal distribution whose absolute value is added to the delay."""
    loss: float = 0.0
    """Share of packets."""
    duplicates: float = 0.0
    reordered: float = 0.0
    """Share of packets that are delayed by `reorder_s` more."""
    reorder_s: float = 0.0
    queue_bytes: int = 64_000
    gaps_s: tuple[tuple[float, float], ...] = ()
    """Begin and end after the model was made: what is sent in between is lost."""
    mtu: int | None = None


@dataclass(slots=True)
class LinkModel:
    """One direction from now on; times are seconds on any clock that begins at 0."""

    shape: LinkShape
    random: random.Random
    sent: int = 0
    lost: int = 0
    """Lost at random."""
    dropped: int = 0
    """For want of room in the queue, or for their length."""
    in_gaps: int = 0
    copies: int = 0
    sent_bytes: int = 0
    delivered_bytes: int = 0
    _free_at: float = field(default=0.0, init=False)
    _latest: float = field(default=0.0, init=False)

    def offer(self, size: int, now: float) -> tuple[float, ...]:
        """Send a packet of `size` octets, headers included; when it arrives: not at all, once or twice."""
        self.sent += 1
        self.sent_bytes += size
        shape = self.shape
        # Always the same number of draws, so that the fate of one packet does not depend on that of another.
        is_lost = self.random.random() < shape.loss
        is_copied = self.random.random() < shape.duplicates
        is_reordered = self.random.random() < shape.reordered
        jitter = abs(self.random.gauss(0.0, shape.jitter_s)) if shape.jitter_s else 0.0
        leaves = self._leave(size, now)
        if leaves is None:
            self.dropped += 1
            return ()
        if any(begin <= now < end for begin, end in shape.gaps_s):
            self.in_gaps += 1
            return ()
        if is_lost:
            self.lost += 1
            return ()
        arrival = max(leaves + shape.delay_s + jitter, self._latest)
        if is_reordered:
            arrival += shape.reorder_s
        else:
            self._latest = arrival
        times = (arrival, arrival) if is_copied else (arrival,)
        self.copies += len(times) - 1
        self.delivered_bytes += size * len(times)
        return times

    def _leave(self, size: int, now: float) -> float | None:
        """When its last octet is sent; None: it is dropped."""
        shape = self.shape
        if shape.mtu is not None and size > shape.mtu:
            return None
        if shape.rate_bps is None:
            return now
        start = max(now, self._free_at)
        if (start - now) * shape.rate_bps / 8 + size > shape.queue_bytes:
            return None
        self._free_at = start + size * 8 / shape.rate_bps
        return self._free_at


class UdpRelay:
    """Listens on 127.0.0.1 and carries datagrams between whoever sends there and a server, over two models."""

    def __init__(self, server: tuple[str, int], up: LinkShape, down: LinkShape, seed: int = 0) -> None:
        self.up = LinkModel(up, random.Random(seed))  # noqa: S311 - an emulation
        self.down = LinkModel(down, random.Random(seed + 1))  # noqa: S311
        self._near = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._near.bind(("127.0.0.1", 0))
        self._far = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._far.connect(server)
        self._client: tuple[str, int] | None = None
        self._due: list[tuple[float, int, bool, bytes]] = []
        self._lock = threading.Condition()
        self._ended = False
        self._count = 0
        self._begin = time.monotonic()
        self._threads = [threading.Thread(target=self._take, args=(up_way,), daemon=True) for up_way in (True, False)]
        self._threads.append(threading.Thread(target=self._deliver, daemon=True))

    @property
    def address(self) -> tuple[str, int]:
        """Where clients send to."""
        host, port = self._near.getsockname()
        return host, port

    def __enter__(self) -> Self:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        with self._lock:
            self._ended = True
            self._lock.notify()
        for thread in self._threads:
            thread.join()
        self._near.close()
        self._far.close()

    def _take(self, up: bool) -> None:  # noqa: FBT001 - a thread's argument
        end, model = (self._near, self.up) if up else (self._far, self.down)
        end.settimeout(_WAIT_S)
        while not self._ended:
            try:
                datagram, source = end.recvfrom(_LONGEST)
            except (TimeoutError, ConnectionRefusedError):
                continue
            with self._lock:
                if up:
                    self._client = source
                for arrival in model.offer(len(datagram) + HEADERS, time.monotonic() - self._begin):
                    self._count += 1
                    heapq.heappush(self._due, (arrival, self._count, up, datagram))
                self._lock.notify()

    def _deliver(self) -> None:
        while True:
            with self._lock:
                if self._ended:
                    return
                wait = self._due[0][0] - (time.monotonic() - self._begin) if self._due else _WAIT_S
                if wait > 0:
                    self._lock.wait(wait)
                    continue
                _, _, up, datagram = heapq.heappop(self._due)
            try:
                if up:
                    self._far.send(datagram)
                elif self._client is not None:
                    self._near.sendto(datagram, self._client)
            except OSError:  # nobody listens at that end
                continue
