"""An emulated link with known rate, delay, jitter, loss, duplicates, order, gaps, queue and MTU per direction.

`LinkModel` is pure: it takes a packet's size and time, and returns its arrival. `UdpRelay` puts two of them between a
client and a server on the loopback; `tcp_link` is for the relays of emulated devices. The same seed gives the same
result for the same packets. Sizes include IPv4 and UDP headers.

The model of a direction: packets longer than the MTU, or without room in the queue, are dropped; the rest is sent at
the rate, then lost at random, and arrives in order after the delay and a half-normal jitter. A reordered packet is
delayed once more, and delays no other. In a gap everything is lost. Delays may be measured ones (`delays_s`), and gaps
drawn from measured lengths (`gaps`). Not modelled: a changing rate, loss in bursts shorter than a gap.
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
"""Bytes of the IPv4 and UDP headers."""
_LONGEST: Final = 65536
_WAIT_S: Final = 0.05
_RETRIES: Final = 15
"""Retransmissions after which TCP gives up (Linux: tcp_retries2); here the segment then arrives."""
_LONGEST_TIMEOUT_S: Final = 60.0
_APART_S: Final = 2.0
"""Minimum time between two random gaps, if there is room: adjacent gaps would merge into one."""


@dataclass(frozen=True, slots=True)
class DrawnGap:
    """A period in which the link carries nothing, at a random time."""

    seconds: float
    carries: bool = False
    """True: only the other direction has the gap."""


@dataclass(frozen=True, slots=True)
class LinkShape:
    """Properties of one direction; the default has no effect."""

    rate_bps: float | None = None
    delay_s: float = 0.0
    jitter_s: float = 0.0
    """Standard deviation of the normal distribution whose absolute value is added to the delay."""
    loss: float = 0.0
    """Share of packets lost."""
    duplicates: float = 0.0
    reordering: float = 0.0
    """Share of packets with an extra delay of `reorder_s`."""
    reorder_s: float = 0.0
    queue_bytes: int = 64_000
    gaps_s: tuple[tuple[float, float], ...] = ()
    """Start and end of each gap, in seconds after the model was created; packets sent in between are lost."""
    mtu: int | None = None
    delays_s: tuple[float, ...] = ()
    """Delays used instead of `delay_s` and `jitter_s`, equally likely; none is repeated before all were used."""
    hold_s: float = 0.0
    """Seconds for which each drawn delay applies to all packets."""
    gaps: tuple[DrawnGap, ...] = ()
    """Gaps, each once in every `gap_cycle_s`; both directions have the same times if they have the same gaps."""
    gap_cycle_s: float = 3600.0
    gap_seed: int = 0
    even: bool = False
    """Loss, copies and reordering are spread evenly: a share of 1 % is exactly one of each hundred packets."""


@dataclass(slots=True)
class LinkModel:
    """One direction from now on; times are seconds on any clock that begins at 0."""

    shape: LinkShape
    random: random.Random
    sent_count: int = 0
    loss_count: int = 0
    """Number of packets lost at random."""
    drop_count: int = 0
    """Number of packets dropped because the queue was full or they exceeded the MTU."""
    in_gaps: int = 0
    copies: int = 0
    sent_bytes: int = 0
    delivered_bytes: int = 0
    _free_at: float = field(default=0.0, init=False)
    _latest: float = field(default=0.0, init=False)
    _spread: dict[str, _EvenSampler] = field(default_factory=dict, init=False)
    _deck: list[float] = field(default_factory=list, init=False)
    _last_draw: tuple[float, float] | None = field(default=None, init=False)
    """Latest random delay, and the time when it was drawn; None: none yet."""
    _cycle: tuple[int, tuple[tuple[float, float], ...]] = field(default=(-1, ()), init=False)

    def offer(self, size: int, now: float) -> tuple[float, ...]:
        """Send a packet of `size` octets, headers included; return its arrival times: none, one or two."""
        self.sent_count += 1
        self.sent_bytes += size
        shape = self.shape
        in_gap = self._in_gap(now)
        # Always the same number of draws, so that the fate of one packet does not depend on that of another.
        is_lost = self._happens("loss", shape.loss, in_gap=in_gap)
        is_copied = self._happens("copy", shape.duplicates, in_gap=in_gap)
        is_reordered = self._happens("order", shape.reordering, in_gap=in_gap)
        delay = self._delay(now)
        leaves = self._leave(size, now)
        if leaves is None:
            self.drop_count += 1
            return ()
        if in_gap:
            self.in_gaps += 1
            return ()
        if is_lost:
            self.loss_count += 1
            return ()
        arrival = max(leaves + delay, self._latest)
        if is_reordered:
            arrival += shape.reorder_s
        else:
            self._latest = arrival
        times = (arrival, arrival) if is_copied else (arrival,)
        self.copies += len(times) - 1
        self.delivered_bytes += size * len(times)
        return times

    def carry(self, size: int, now: float, timeout_s: float) -> float:
        """Return when a TCP segment arrives; lost ones are repeated after a timeout that doubles each time."""
        self.sent_count += 1
        self.sent_bytes += size
        leaves = self._serialise(size, now)
        for _ in range(_RETRIES):
            in_gap = self._in_gap(leaves)
            if not self._happens("loss", self.shape.loss, in_gap=in_gap) and not in_gap:
                break
            self.in_gaps, self.loss_count = self.in_gaps + in_gap, self.loss_count + (not in_gap)
            leaves += timeout_s
            timeout_s = min(2 * timeout_s, _LONGEST_TIMEOUT_S)
        self.delivered_bytes += size
        return leaves + self._delay(leaves)

    def _happens(self, what: str, share: float, *, in_gap: bool) -> bool:
        if not self.shape.even:
            return self.random.random() < share
        if in_gap or not share:
            return False
        return self._spread.setdefault(what, _EvenSampler(share, self.random)).next()

    def _delay(self, now: float) -> float:
        shape = self.shape
        if not shape.delays_s:
            return shape.delay_s + (abs(self.random.gauss(0.0, shape.jitter_s)) if shape.jitter_s else 0.0)
        if self._last_draw is None or now - self._last_draw[1] >= shape.hold_s:
            if not self._deck:
                self._deck = list(shape.delays_s)
                self.random.shuffle(self._deck)
            self._last_draw = self._deck.pop(), now
        return self._last_draw[0]

    def _in_gap(self, now: float) -> bool:
        shape = self.shape
        if shape.gaps:
            number = int(now // shape.gap_cycle_s)
            if self._cycle[0] != number:
                self._cycle = number, gaps_of_cycle(shape, number)
            if any(begin <= now < end for begin, end in self._cycle[1]):
                return True
        return any(begin <= now < end for begin, end in shape.gaps_s)

    def _leave(self, size: int, now: float) -> float | None:
        """Return when the packet's last octet is sent; None: dropped."""
        shape = self.shape
        if shape.mtu is not None and size > shape.mtu:
            return None
        if shape.rate_bps is None:
            return now
        waits = max(now, self._free_at) - now
        return None if waits * shape.rate_bps / 8 + size > shape.queue_bytes else self._serialise(size, now)

    def _serialise(self, size: int, now: float) -> float:
        if self.shape.rate_bps is None:
            return now
        self._free_at = max(now, self._free_at) + size * 8 / self.shape.rate_bps
        return self._free_at


class _EvenSampler:
    """Random choice of a fixed share, with one hit at a random place in each interval."""

    def __init__(self, share: float, generator: random.Random) -> None:
        self._share, self._random = share, generator
        self._questions, self._stretch = 0, 0
        self._place = generator.random() / share

    def next(self) -> bool:
        """Return whether the next event is chosen."""
        yes = self._place < self._questions + 1
        self._questions += 1
        if yes:
            self._stretch += 1
            self._place = max(self._questions, (self._stretch + self._random.random()) / self._share)
        return yes


def gaps_of_cycle(shape: LinkShape, number: int) -> tuple[tuple[float, float], ...]:
    """Return begin and end of this direction's gaps in one cycle; they do not overlap."""
    draw = random.Random(f"{shape.gap_seed} {number}")  # noqa: S311 - an emulation
    gaps = list(shape.gaps)
    draw.shuffle(gaps)
    free = max(0.0, shape.gap_cycle_s - sum(gap.seconds for gap in gaps))
    apart = min(_APART_S, free / 2 / (len(gaps) + 1))
    places = sorted(draw.uniform(0.0, free - apart * (len(gaps) + 1)) for _ in gaps)
    at, spans = number * shape.gap_cycle_s, []
    for count, (place, gap) in enumerate(zip(places, gaps, strict=True), start=1):
        begin = at + place + apart * count
        at += gap.seconds
        if not gap.carries:
            spans.append((begin, begin + gap.seconds))
    return tuple(spans)


class UdpRelay:
    """Relay on 127.0.0.1 for datagrams between clients and a server, through two link models.

    `headers`: octets of each datagram on the link beside its payload.
    """

    def __init__(
        self, server: tuple[str, int], up: LinkShape, down: LinkShape, seed: int = 0, *, headers: int = HEADERS
    ) -> None:
        self._headers = headers
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
        self._threads = [
            threading.Thread(target=self._relay_datagrams, args=(up_way,), daemon=True) for up_way in (True, False)
        ]
        self._threads.append(threading.Thread(target=self._deliver, daemon=True))

    @property
    def address(self) -> tuple[str, int]:
        """Address for clients."""
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

    def _relay_datagrams(self, up: bool) -> None:  # noqa: FBT001 - a thread's argument
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
                for arrival in model.offer(len(datagram) + self._headers, time.monotonic() - self._begin):
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
