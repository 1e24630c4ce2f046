"""Messages of any size to the far end, sent in chunks; complete when the receiver confirms the last octet.

A transfer is never timed by the sender's last `send`: the data may wait in a queue for long, or be lost. The receiver
measures with its own clock, and its acknowledgement ends the message. Contents are random, so that nothing compresses
them. With `resend`, missing chunks are sent again until the receiver has everything; without it, the receiver is only
asked what arrived. `messages_down` handles the other direction.
"""

from __future__ import annotations

import heapq
import secrets
from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.links.qualify import samples, session
from atlantis_netcfg.links.qualify.reflector import stamp

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from atlantis_netcfg.links.qualify.transport import Arrival, DatagramTransport

QUESTIONS: Final = 3
"""How often a receiver that does not respond is asked for the status of a message."""
_WAIT_STEP: Final = 20_000_000
_LAG_NS: Final = 20_000_000
"""Maximum delay of this computer that is made up for: a paced message is not sent in one burst."""
DEFAULT_PACKET: Final = 1200
"""UDP payload that fits most tunnels; `path_mtu` measures what this path accepts."""


@dataclass(frozen=True, slots=True)
class MessagePlan:
    """Messages of `size` octets, `rate_hz` a second for `duration_s`."""

    size: int
    rate_hz: float
    duration_s: float
    resend: bool = False
    pace_bps: float | None = None
    """Rate at which the chunks of a message are sent; None: at once, as DDS sends fragments."""
    packet: int = DEFAULT_PACKET
    timeout_s: float = 5.0
    """Seconds to wait for a response before the receiver is asked and missing chunks are resent."""
    give_up_s: float = 90.0
    """Seconds without a response after which a message counts as lost; a satellite's gaps last up to 70 s."""

    def __post_init__(self) -> None:
        if self.size < 1:
            raise ValueError("a message has at least one octet")

    @property
    def messages(self) -> int:
        """The number of messages, if no limit ends the stream earlier."""
        return max(1, round(self.duration_s * self.rate_hz))

    def due_ns(self, headers: int, *, is_authenticated: bool) -> int:
        """Return the time from one message's start to the next one's, at least the sending time at the given pace."""
        room = stamp.chunk_room(self.packet, is_authenticated=is_authenticated)
        wire = self.size + -(-self.size // room) * (self.packet - room + headers)
        return round(session.SECOND * max(1 / self.rate_hz, 0.0 if self.pace_bps is None else wire * 8 / self.pace_bps))


@dataclass(slots=True)
class _OpenMessage:
    number: int
    count: int
    sent_at: int = -1
    last_sent: int = 0
    chunks_sent: int = 0
    questions: int = 0
    word: stamp.Acknowledgement | None = None
    error: int = 1
    queue_length: int = 0
    """Number of its packets that are still to be sent."""


@dataclass(slots=True)
class MessageStream:
    """Messages in transit to this project's reflector."""

    name: str
    plan: MessagePlan
    peer: session.ReflectorPeer
    transport: DatagramTransport
    write: Callable[[samples.Sample], None]
    session_id: int = field(default_factory=lambda: secrets.randbelow(65535) + 1)
    _origin: int = 0
    _begin: int = 0
    _sequence: int = 0
    _started_count: int = 0
    _free_at: int = 0
    _queue: deque[tuple[_OpenMessage, int | None]] = field(default_factory=deque)
    """Chunks to send; None: only a status request."""
    _open: dict[int, _OpenMessage] = field(default_factory=dict)
    _waits: list[tuple[int, int]] = field(default_factory=list)
    """Heap of times and message numbers to check; a time that has changed is corrected when it is reached."""
    _charge_by_sequence: dict[int, int] = field(default_factory=dict)
    """Sequence numbers of packets that expect a response, with the octets charged for it."""

    @property
    def chunk_size(self) -> int:
        """Octets of a message per packet; raises ValueError if the packets are too short for any."""
        room = stamp.chunk_room(self.plan.packet, is_authenticated=self.peer.key is not None)
        if room < 1:
            raise ValueError(f"packets of {self.plan.packet} octets carry nothing")
        return room

    @property
    def answer_size(self) -> int:
        """The size of the longest response; a packet that requests one is at least as long."""
        return self._base_size + stamp.ACKNOWLEDGEMENT_SIZE

    @property
    def _base_size(self) -> int:
        return stamp.extended_size(is_authenticated=self.peer.key is not None)

    def begin(self, origin_ns: int) -> None:
        """See `PacketStream`."""
        self._origin, self._begin = origin_ns, self.transport.now_ns()
        self._free_at = self._begin

    def due_ns(self) -> int | None:
        """See `PacketStream`."""
        if self._queue:
            return self._free_at
        dues = [self._scheduled_ns(self._started_count)] if self._started_count < self.plan.messages else []
        while self._waits:
            due, number = self._waits[0]
            message = self._open.get(number)
            if message is not None and due >= message.last_sent + self._timeout_ns(message):
                dues.append(due)
                break
            heapq.heappop(self._waits)
            if message is not None:
                heapq.heappush(self._waits, (message.last_sent + self._timeout_ns(message), number))
        return min(dues, default=None)

    def _scheduled_ns(self, number: int) -> int:
        return self._begin + round(number * session.SECOND / self.plan.rate_hz)

    def _timeout_ns(self, message: _OpenMessage) -> int:
        return round(self.plan.timeout_s * session.SECOND) * max(1, min(message.questions, 4))

    def next_packet(self, now_ns: int) -> session.Outgoing | None:
        """See `PacketStream`."""
        self._start_due_messages(now_ns)
        self._handle_timeouts(now_ns)
        if not self._queue or now_ns < self._free_at:
            return None
        message, index = self._queue[0]
        asks = len(self._queue) == 1 or self._queue[1][0] is not message
        chunk = self._chunk(message, index, asks=asks)
        value = chunk.encode()
        tlv = stamp.Tlv(stamp.CHUNK, value.ljust(stamp.ACKNOWLEDGEMENT_SIZE - stamp.TLV_SIZE, b"\0") if asks else value)
        size = self._base_size + len(tlv.encode())
        return session.Outgoing((tlv,), size, self.answer_size if asks else 0, self._sequence)

    def _chunk(self, message: _OpenMessage, index: int | None, *, asks: bool) -> stamp.MessageChunk:
        room, size = self.chunk_size, self.plan.size
        length = 0 if index is None else min(room, size - index * room)
        data = secrets.token_bytes(length)
        return stamp.MessageChunk(message.number, size, index or 0, message.count, asks, data)

    def _start_due_messages(self, now_ns: int) -> None:
        while self._started_count < self.plan.messages and self._scheduled_ns(self._started_count) <= now_ns:
            message = _OpenMessage(self._started_count, -(-self.plan.size // self.chunk_size), last_sent=now_ns)
            self._open[self._started_count] = message
            self._started_count += 1
            if not self._queue:
                self._free_at = max(self._free_at, now_ns)
            self._enqueue(message, range(message.count))
            heapq.heappush(self._waits, (now_ns + self._timeout_ns(message), message.number))

    def _handle_timeouts(self, now_ns: int) -> None:
        """Request the status of messages without response, and give up those past their timeout."""
        while self._waits and self._waits[0][0] <= now_ns:
            _, number = heapq.heappop(self._waits)
            message = self._open.get(number)
            if message is None:
                continue
            if now_ns >= message.last_sent + self._timeout_ns(message) and not message.queue_length:
                self._ask_for_acknowledgement(message, now_ns)
            if number in self._open:
                due = max(now_ns + _WAIT_STEP, message.last_sent + self._timeout_ns(message))
                heapq.heappush(self._waits, (due, number))

    def _ask_for_acknowledgement(self, message: _OpenMessage, now_ns: int) -> None:
        age_s = (now_ns - message.sent_at) / session.SECOND
        if age_s >= self.plan.give_up_s or (not self.plan.resend and message.questions >= QUESTIONS):
            self._finish(message)
        else:
            message.questions += 1
            message.last_sent = now_ns
            self._enqueue(message, [None])

    def _enqueue(self, message: _OpenMessage, indexes: Iterable[int | None]) -> None:
        for index in indexes:
            self._queue.append((message, index))
            message.queue_length += 1

    def mark_sent(self, outgoing: session.Outgoing, now_ns: int, error: str) -> None:
        """See `PacketStream`; a packet that this computer did not send counts as missing, like a lost one."""
        message, _ = self._queue.popleft()
        message.queue_length -= 1
        del error
        if message.sent_at < 0:
            message.sent_at = now_ns
        message.last_sent = now_ns
        message.chunks_sent += 1
        self._sequence += 1
        if outgoing.answer:
            self._charge_by_sequence[outgoing.sequence] = outgoing.answer
        pace = self.plan.pace_bps
        wire = (outgoing.size + self.transport.headers) * 8
        step = 0 if pace is None else round(wire / pace * session.SECOND)
        self._free_at = max(self._free_at + step, now_ns - _LAG_NS) if step else now_ns

    def accept(self, packet: stamp.ReflectorPacket, arrival: Arrival) -> int:
        """See `PacketStream`."""
        charge = self._charge_by_sequence.pop(packet.sender_sequence, 0)
        for tlv in packet.tlvs:
            if tlv.type == stamp.CHUNK and not tlv.flags:
                word = stamp.Acknowledgement.decode(tlv.value)
                message = self._open.get(word.message)
                if message is not None:
                    message.word, message.error = word, packet.error
                    self._process_acknowledgement(message, word, arrival.at_ns)
        return charge

    def _process_acknowledgement(self, message: _OpenMessage, word: stamp.Acknowledgement, at_ns: int) -> None:
        if not word.missing:
            self._finish(message, at_ns)
        elif self.plan.resend and not message.queue_length:
            message.questions = 0
            self._enqueue(message, word.indexes)
        elif message.questions and not message.queue_length:
            self._finish(message)  # the question left after every packet: what is missing now is lost

    def _finish(self, message: _OpenMessage, at_ns: int | None = None, *, in_flight: bool = False) -> None:
        word = message.word
        has_arrived = word is not None and word.first != 0
        del self._open[message.number]
        if message.sent_at < 0:
            return
        self.write(
            samples.MessageResult(
                self.name,
                message.number,
                self.plan.size,
                message.count,
                message.chunks_sent,
                message.sent_at - self._origin,
                None if at_ns is None else at_ns - self._origin,
                None if word is None else word.size,
                stamp.unix_ns(word.first, message.error) if word is not None and has_arrived else None,
                stamp.unix_ns(word.last, message.error) if word is not None and has_arrived else None,
                in_flight=in_flight,
                chunk_size=self.chunk_size,
                due_ns=self.plan.due_ns(self.transport.headers, is_authenticated=self.peer.key is not None),
            )
        )

    def end(self, now_ns: int, reason: str) -> None:
        """See `PacketStream`."""
        for message in [*self._open.values()]:
            self._finish(message, in_flight=True)
        self.write(samples.StreamEnd(self.name, now_ns - self._origin, reason))
