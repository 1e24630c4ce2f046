"""The link between a client and an emulated router: delay, loss, rate, faults, byte counters, API behaviour.

Assumption: api-tagged-order
Assumption: api-flight-24
Assumption: api-flight-100
Assumption: tls-version
"""

from __future__ import annotations

import asyncio
import re
from collections import deque
from dataclasses import asdict, dataclass, field, replace
from enum import Enum, StrEnum
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING, Literal

from pydantic import BaseModel, ConfigDict, Field

from atlantis_netcfg.core.secret import MASK
from atlantis_netcfg.emulator.tcp_link import TcpLink
from atlantis_netcfg.emulator.udp_link import LinkShape

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence


SEGMENT = 1400
"""Bytes forwarded as one unit: a TCP segment within a tunnel's MTU."""
HEADERS = 54
"""Ethernet 14, IP 20, TCP 20: bytes counted by a port for each segment in addition to the payload.

Assumption: port-counters
"""


def _ignore_count(_port: str | None, _direction: Direction, _size: int) -> None:
    """Ignore the byte count."""


class RouterLink(BaseModel):
    """Properties of the emulated link, set by the caller; all times in real seconds."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    delay_s: float = Field(default=0.0, ge=0)
    """One-way delay in seconds, half of the round trip."""
    rate_up_bps: float | None = Field(default=None, gt=0)
    """Rate from the client to the router; None: unlimited."""
    rate_down_bps: float | None = Field(default=None, gt=0)
    """Rate from the router to the client; None: unlimited."""
    up: LinkShape | None = None
    """Link behaviour from the client to the router, used instead of delay and rate; None: not used."""
    down: LinkShape | None = None
    """The same from the router to the client."""
    stall_every: int | None = Field(default=None, ge=1)
    """Every n-th segment of a direction is lost once: TCP retransmits it, and all later data wait. None: no loss."""
    stall_s: float = Field(default=1.0, ge=0)
    """Seconds until TCP has retransmitted the lost segment."""
    tcp_connect: bool = True
    """Opening the connection costs a round trip, as it would not on loopback."""
    port: str | None = None
    """Factory name of the port of this link, whose counters rise; None: the technician's port."""


class Direction(Enum):
    """Direction on a link, from the client's side."""

    UP = "up"
    DOWN = "down"


class LineEnd(Enum):
    """How a direction of a TCP connection ends."""

    FIN = "fin"
    RST = "rst"


@dataclass(frozen=True, slots=True)
class Chunk:
    """Bytes in transit; `heard_count` and `answer_count`: the sender's counters at that time (see connection.py)."""

    data: bytes = b""
    end: LineEnd | None = None
    heard_count: int = 0
    answer_count: int = 0

    def segments(self) -> Iterator[Chunk]:
        """Yield the chunk in segments that a link carries one after another."""
        if len(self.data) <= SEGMENT:
            yield self
            return
        for at in range(0, len(self.data), SEGMENT):
            yield replace(self, data=self.data[at : at + SEGMENT])


class WireLink:
    """Link state shared by all connections: when each direction is free, and the segments sent."""

    def __init__(self, link: RouterLink) -> None:
        self._link, self._tcp = link, _tcp(link)
        self._segments = dict.fromkeys(Direction, 0)
        self.count: Callable[[str | None, Direction, int], None] = _ignore_count
        """Called with the link's port and every segment's bytes, including headers; not for acknowledgements."""

    @property
    def link(self) -> RouterLink:
        """Current link properties; a new value applies to everything sent afterwards."""
        return self._link

    @link.setter
    def link(self, link: RouterLink) -> None:
        self._link, self._tcp = link, _tcp(link)

    @property
    def connect_s(self) -> float:
        """Seconds that the TCP handshake takes."""
        return self._tcp.connect_s if self._link.tcp_connect else 0.0

    def arrival(self, direction: Direction, size: int, departure: float) -> float:
        """Return when `size` bytes sent at `departure` arrive at the other end."""
        if size:
            self.count(self.link.port, direction, size + HEADERS)
        arrival = self._tcp.arrival(size, departure, up=direction is Direction.UP)
        return arrival + self._retransmission_delay_s(direction, size)

    def _retransmission_delay_s(self, direction: Direction, size: int) -> float:
        if not size or self.link.stall_every is None:
            return 0.0
        self._segments[direction] += 1
        return 0.0 if self._segments[direction] % self.link.stall_every else self.link.stall_s


def _tcp(link: RouterLink) -> TcpLink:
    return TcpLink(
        link.up or LinkShape(rate_bps=link.rate_up_bps, delay_s=link.delay_s),
        link.down or LinkShape(rate_bps=link.rate_down_bps, delay_s=link.delay_s),
    )


class DelayLine:
    """One direction of one connection: chunks in order, each delivered when it is due and the link is up.

    Pipelined sentences share one delay. Both ends are in the server process: data enter the line at once.
    """

    def __init__(
        self, link: WireLink, direction: Direction, air: asyncio.Event, deliver: Callable[[Chunk], None]
    ) -> None:
        self._link = link
        self._direction = direction
        self._air = air
        self._deliver = deliver
        self._queue: deque[tuple[float, Chunk]] = deque()
        self._news = asyncio.Event()
        self._last = 0.0
        self.earliest = 0.0
        """Nothing is sent before this time, because the TCP connection is not open yet."""

    def put(self, chunk: Chunk) -> None:
        """Queue a chunk at the sending end."""
        departure = max(asyncio.get_running_loop().time(), self.earliest)
        for piece in chunk.segments():
            arrival = self._link.arrival(self._direction, len(piece.data), departure)
            self._last = max(self._last, arrival)
            self._queue.append((self._last, piece))
        self._news.set()

    async def pump(self) -> None:
        """Deliver chunks at the receiving end; those due together are delivered together."""
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


class FaultKind(StrEnum):
    """Kind of fault."""

    GAP = "gap"
    """The link carries nothing for `seconds`; TCP survives it."""
    DROP = "drop"
    """The connection is reset at both ends at once; data in transit are lost."""
    VANISH = "vanish"
    """The connection goes silent for good without notice to either end, as if the cable was pulled."""
    REBOOT = "reboot"
    """The router reboots: EOF, and available again after `boot_s`."""
    POWER = "power"
    """The router loses power: no EOF, and available again after `boot_s`."""
    TRUNCATE = "truncate"
    """The response stops after `offset` bytes (half of it if not set), then EOF."""
    GARBAGE = "garbage"
    """`data` is inserted into the response at `offset`."""
    HANG = "hang"
    """The router never responds on this connection again."""


class LinkFault(BaseModel):
    """One fault, scheduled for the n-th matching sentence from now; it occurs once."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    do: FaultKind
    sentence: int = Field(default=1, ge=1)
    """Number of the matching sentence, counted over all connections of the router from arming on."""
    match: str = "*"
    """Shell pattern for the command word, e.g. `/ip/firewall/*`; `*` counts `/login`, too.

    A script that only has commands parsed is matched as `/execute :parse`; `/execute` changes something.
    """
    when: Literal["before", "after"] = "before"
    """Before the sentence is executed, or afterwards but before its response is sent."""
    seconds: float = Field(default=0.0, ge=0)
    lines: int | None = Field(default=None, ge=0)
    """With `when="after"`: number of lines of the script in `/execute` that are run before the fault; None: all."""
    offset: int | None = Field(default=None, ge=0)
    data: str = "f8ffffff"
    """Bytes in hex; the default begins with a control byte that the manual reserves."""

    def shorten(self, words: tuple[str, ...]) -> tuple[str, ...]:
        """Truncate the sentence's script; a line ending with a backslash continues in the next."""
        if self.lines is None:
            return words
        return tuple(self._first_lines(word) if word.startswith("=script=") else word for word in words)

    def _first_lines(self, word: str) -> str:
        script = word.removeprefix("=script=")
        return "=script=" + "\n".join(re.split(r"(?<!\\)\r?\n", script)[: self.lines])


class Faults:
    """Scheduled faults.

    Each occurs at a chosen sentence, so that a test can interrupt a run at every point.
    """

    def __init__(self) -> None:
        self._armed: list[tuple[LinkFault, int]] = []

    def arm(self, fault: LinkFault) -> None:
        """Schedule a fault for its sentence."""
        self._armed.append((fault, fault.sentence))

    def disarm(self) -> None:
        """Cancel all faults."""
        self._armed.clear()

    @property
    def pending(self) -> tuple[LinkFault, ...]:
        """Faults that have not occurred yet."""
        return tuple(fault for fault, _ in self._armed)

    @staticmethod
    def command(words: tuple[str, ...]) -> str:
        """Return the text that fault patterns are matched against."""
        parses = any(word.startswith("=script=:foreach ") and ":put [:parse " in word for word in words)
        return f"{words[0]} :parse" if parses else words[0]

    def upon(self, command: str) -> list[LinkFault]:
        """Count a sentence that begins with `command`; return the faults that apply to it."""
        remaining_faults = [(fault, n - fnmatchcase(command, fault.match)) for fault, n in self._armed]
        self._armed = [(fault, n) for fault, n in remaining_faults if n > 0]
        return [fault for fault, n in remaining_faults if n <= 0]


_SECRET = r"(?:[\w.-]*(?:password|passphrase|secret|pre-?shared-key|private-key)|response|pin)"  # noqa: S105 (a pattern)
_WORD = re.compile(rf"^(=!?{_SECRET}=).+$", re.DOTALL)
_SCRIPT = re.compile(rf'\b({_SECRET}=)("(?:\\.|[^"\\])*"|[^\s;\]]+)', re.DOTALL)


@dataclass(slots=True)
class WireCounters:
    """Totals of one connection, or of a router."""

    connections: int = 0
    logins: int = 0
    turns: int = 0
    """Round trips: how often the client began to send, at first or after it had received something.

    TLS is not counted; SSH is, including the key exchange.
    """
    sentences: int = 0
    """API sentences; over SSH: lines, command keys, and files."""
    bytes_in: int = 0
    """Bytes from the client, above TLS."""
    bytes_out: int = 0
    wire_in: int = 0
    """Bytes from the client, as carried by TCP."""
    wire_out: int = 0

    def plus(self, other: WireCounters) -> WireCounters:
        """Return the sum, field by field."""
        theirs = asdict(other)
        return WireCounters(**{name: value + theirs[name] for name, value in asdict(self).items()})


@dataclass(slots=True)
class TrafficCounters:
    """One connection: its counters and the sentences it sent, secrets masked."""

    service: str
    counters: WireCounters = field(default_factory=lambda: WireCounters(connections=1))
    sentences: list[tuple[str, ...]] = field(default_factory=list)


def mask_words(words: Sequence[str]) -> tuple[str, ...]:
    """Mask the secrets in a sentence, also inside a script."""
    return tuple(_SCRIPT.sub(rf"\1{MASK}", _WORD.sub(rf"\1{MASK}", word)) for word in words)


class WireBehaviour(BaseModel):
    """Behaviour of the router's API service; all times in real seconds."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    shuffle: int | None = None
    """Seed: tagged sentences of one burst run in random order and their responses interleave.

    None: in order of arrival.
    """
    hang_at: int | None = Field(default=None, ge=1)
    """Number of unanswered sentences at which the connection falls silent for good; None: never.

    A CHR 7.22.1 hung at 25 concurrent `/console/inspect`
    (`tikoci/restraml docs/mikrotik-bug-native-api-inspect.md`).
    """
    hang_writes_at: int | None = Field(default=None, ge=1)
    """The same for unanswered sentences other than `print`."""
    knee_after: int | None = Field(default=None, ge=0)
    """Number of sentences of all connections without delay; later ones take `knee_s` until the router was idle.

    Seen on a CHR 7.23.2 after 120 to 220 (`danikf/tik4net Docs/findings-router-throughput-ceiling.md`).
    """
    knee_s: float = Field(default=0.020, ge=0)
    idle_s: float = Field(default=1.0, ge=0)
    stall_every: int | None = Field(default=None, ge=1)
    """Every n-th sentence finds the router busy for `stall_s` (the same source saw 7 s and 30 s)."""
    stall_s: float = Field(default=7.0, ge=0)
    probe_s: float = Field(default=5.0, ge=0)
    """Seconds for which a console waits for the terminal's identification. Assumption: console-first-login"""
    boot_s: float = Field(default=60.0, ge=0)
    """Seconds from a reboot or power cut until the API responds again."""
    old_login: bool = False
    """Login method from before 6.43: the new form also gets a challenge."""
    sentences_before_login: int = Field(default=8, ge=1)
    """Maximum number of sentences before login; more end the connection. The manual gives no number.

    Assumption: api-limit-words
    """
    word_before_login: int = Field(default=1024, ge=1)
    """Longest word before login, in bytes."""
    pipelined_login: bool = False
    """Sentences sent before the response to `/login` arrived are accepted. Assumption: api-login-pipelined"""
    tls: Literal["1.2", "1.3"] = "1.2"
    """Newest TLS version of the router; `/ip/service tls-version` can only lower it."""


class WirePace:
    """Delay before the router runs a sentence, shared by all connections."""

    def __init__(self) -> None:
        self._since_idle = 0
        self._total = 0
        self._free_at = 0.0

    def wait_s(self, knobs: WireBehaviour, now: float) -> float:
        """Return the seconds until the current sentence may run."""
        self._total += 1
        if now - self._free_at > knobs.idle_s:
            self._since_idle = 0
        self._since_idle += 1
        self._free_at = max(now, self._free_at) + self._cost_s(knobs)
        return self._free_at - now

    def _cost_s(self, knobs: WireBehaviour) -> float:
        knee = knobs.knee_after is not None and self._since_idle > knobs.knee_after
        stall = knobs.stall_every is not None and self._total % knobs.stall_every == 0
        return (knobs.knee_s if knee else 0.0) + (knobs.stall_s if stall else 0.0)
