"""Messages from the far end to this computer: requested one by one, and measured by this computer's clock.

Only this project's reflector sends them, and only to a sender that has its key and presents the token given to this
address: the first request obtains it. A request is charged with all its possible responses before it is sent. If
nothing of a message arrives, the reflector is asked how much it has sent: chunks of a request that never reached it
are requested again and do not count as loss in this direction.
"""

from __future__ import annotations

import secrets
from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.links.qualify import samples, session
from atlantis_netcfg.links.qualify.messages import QUESTIONS
from atlantis_netcfg.links.qualify.reflector import stamp

if TYPE_CHECKING:
    from collections.abc import Callable

    from atlantis_netcfg.links.qualify.messages import MessagePlan
    from atlantis_netcfg.links.qualify.transport import Arrival, DatagramTransport

_BASE: Final = stamp.extended_size(is_authenticated=True)
_STATUS_SIZE: Final = _BASE + stamp.REQUEST_SIZE
"""Size of a request and of the status that answers it."""


def requested_bytes(plan: MessagePlan, headers: int) -> int:
    """Return the bytes of requested messages on the wire without loss, both ways together, for a cost preview."""
    chunks = -(-plan.size // stamp.chunk_room(plan.packet, is_authenticated=True))
    message = plan.size + chunks * (plan.packet - stamp.chunk_room(plan.packet, is_authenticated=True) + headers)
    question = _STATUS_SIZE + headers
    return 2 * question + plan.messages * (question + message)


@dataclass(slots=True)
class _AwaitedMessage:
    number: int
    asked_at: int
    """Time of the first request for the message, sent or planned."""
    sent_at: int = -1
    """Time at which the request was sent that delivered the message, as far as known."""
    until: int = 0
    """Time at which the message is requested again or given up."""
    questions: int = 0
    requests: int = 0
    requested_chunks: int = 0
    """Number of requested chunks; a chunk counts each time that it is requested."""
    status: stamp.RequestStatus | None = None
    have: set[int] = field(default_factory=set)
    size: int = 0
    first_at: int = 0
    last_at: int = 0
    far_sent_ns: int = 0


@dataclass(frozen=True, slots=True)
class _ChunkRequest:
    message: _AwaitedMessage
    first: int = 0
    count: int = 0
    """Number of requested chunks; 0: only a status request."""


@dataclass(slots=True)
class DownMessageStream:
    """Requested messages in transit from the reflector; raises ValueError without key or if packets are too short."""

    name: str
    plan: MessagePlan
    peer: session.ReflectorPeer
    transport: DatagramTransport
    write: Callable[[samples.Sample], None]
    session_id: int = field(default_factory=lambda: secrets.randbelow(65535) + 1)
    far_rate_bps: float | None = None
    """Maximum rate of the reflector to this address; None: not reported yet."""
    _origin: int = 0
    _begin: int = 0
    _sequence: int = 0
    _far_free_at: int = 0
    """Time at which the far end, by its pace, has sent all that was requested; it sends one message after the other."""
    _started_count: int = 0
    _token: bytes | None = None
    _queue: deque[_ChunkRequest] = field(default_factory=deque)
    _open: dict[int, _AwaitedMessage] = field(default_factory=dict)
    _requests: dict[int, _ChunkRequest] = field(default_factory=dict)
    """Open requests by their sequence number."""
    _accepted_chunks: set[tuple[int, int]] = field(default_factory=set)
    """Sequence number of the request, and chunk (-1: the status); the same pair again is a duplicate."""

    def __post_init__(self) -> None:
        if self.peer.key is None:
            raise ValueError("messages are requested from our own reflector, with its key")
        if self._room < 1:
            raise ValueError(f"packets of {self.plan.packet} octets carry nothing")

    @property
    def _room(self) -> int:
        return stamp.chunk_room(self.plan.packet, is_authenticated=True)

    @property
    def _chunk_count(self) -> int:
        return -(-self.plan.size // self._room)

    @property
    def _pace_kbps(self) -> int:
        """The pace in kbit/s for the reflector, which does not count headers as the plan does."""
        pace, packet = self.plan.pace_bps, self.plan.packet
        return 0 if pace is None else max(1, round(pace * packet / (packet + self.transport.headers) / 1000))

    @property
    def _due_ns(self) -> int:
        return self.plan.due_ns(self.transport.headers, is_authenticated=True)

    def _chunk_size(self, index: int) -> int:
        """Return the size of the UDP payload that carries this chunk."""
        return self.plan.packet - self._room + min(self._room, self.plan.size - index * self._room)

    def begin(self, origin_ns: int) -> None:
        """See `PacketStream`; the first message begins when the reflector has issued its token."""
        self._origin, self._begin = origin_ns, self.transport.now_ns()
        self._open[0] = first = _AwaitedMessage(0, self._begin)
        self._started_count = 1
        self._enqueue(_ChunkRequest(first))

    def due_ns(self) -> int | None:
        """See `PacketStream`."""
        if self._queue:
            return self._begin
        dues = [message.until for message in self._open.values()]
        if self._token is not None and self._started_count < self.plan.messages:
            dues.append(self._scheduled_ns(self._started_count))
        return min(dues, default=None)

    def _scheduled_ns(self, number: int) -> int:
        return self._begin + round(number * session.SECOND / self.plan.rate_hz)

    def next_packet(self, now_ns: int) -> session.Outgoing | None:
        """See `PacketStream`."""
        while (
            self._token is not None
            and self._started_count < self.plan.messages
            and self._scheduled_ns(self._started_count) <= now_ns
        ):
            self._open[self._started_count] = message = _AwaitedMessage(self._started_count, now_ns)
            self._started_count += 1
            self._enqueue(_ChunkRequest(message, 0, self._chunk_count))
        for message in [*self._open.values()]:
            if message.until <= now_ns:
                self._handle_timeout(message, now_ns)
        while self._queue and self._queue[0].message.number not in self._open:
            self._queue.popleft()
        return self._outgoing(self._queue[0], now_ns) if self._queue else None

    def _outgoing(self, request: _ChunkRequest, now_ns: int) -> session.Outgoing:
        token = self._token or bytes(stamp.TOKEN_SIZE)
        plan, number = self.plan, request.message.number
        value = stamp.MessageRequest(
            number, plan.size, request.first, request.count, plan.packet, self._pace_kbps, token
        )
        tlvs = (stamp.Tlv(stamp.REQUEST, value.encode()),)
        brings = sum(map(self._chunk_size, range(request.first, request.first + request.count)))
        answers = max(1, request.count)
        lasts_s = (self._sends_until(request, now_ns) - now_ns) / session.SECOND
        return session.Outgoing(tlvs, _STATUS_SIZE, max(_STATUS_SIZE, brings), self._sequence, answers, lasts_s)

    def _sends_until(self, request: _ChunkRequest, now_ns: int) -> int:
        """Return when the reflector will have sent the requested chunks, without delays of the link."""
        octets = request.count * self.plan.packet
        pace = self._pace_kbps * 1000 or self.far_rate_bps
        if self.far_rate_bps is not None and pace is not None:
            pace = min(pace, self.far_rate_bps)
        lasts = round(octets * 8 / pace * session.SECOND) if pace else 0
        return max(self._far_free_at, now_ns) + lasts if request.count else now_ns

    def _enqueue(self, request: _ChunkRequest) -> None:
        self._queue.append(request)
        request.message.until = 1 << 62

    def _handle_timeout(self, message: _AwaitedMessage, now_ns: int) -> None:
        """Handle a message's timeout: request its status or its missing chunks, or give it up."""
        age_s = (now_ns - message.asked_at) / session.SECOND
        if self._token is None or self.plan.resend:
            ends = age_s >= self.plan.give_up_s
        else:
            status = message.status
            is_sent = message.size > 0 or (status is not None and status.sent_chunks >= self._chunk_count)
            ends = is_sent or message.questions >= QUESTIONS or message.requests > QUESTIONS
        if ends:
            self._finish(message)
        elif message.size and self.plan.resend:
            for first, count in _ranges(sorted(set(range(self._chunk_count)) - message.have)):
                self._enqueue(_ChunkRequest(message, first, count))
        else:
            message.questions += 1
            self._enqueue(_ChunkRequest(message))

    def mark_sent(self, outgoing: session.Outgoing, now_ns: int, error: str) -> None:
        """See `PacketStream`; a request that this computer did not send brings no response, like a lost one."""
        del error
        request = self._queue.popleft()
        message = request.message
        until = self._sends_until(request, now_ns)
        self._far_free_at = max(self._far_free_at, until)
        if request.count:
            message.requests += 1
            message.requested_chunks += request.count
            if not message.size:
                message.sent_at = now_ns
        self._requests[outgoing.sequence] = request
        self._sequence += 1
        if not any(waiting.message is message for waiting in self._queue):
            patience = round(self.plan.timeout_s * session.SECOND) * max(1, min(message.questions, 4))
            message.until = until + patience

    def accept(self, packet: stamp.ReflectorPacket, arrival: Arrival) -> int:
        """See `PacketStream`."""
        charge = 0
        request = self._requests[packet.sender_sequence]
        for tlv in packet.tlvs:
            if tlv.type == stamp.CHUNK and not tlv.flags:
                chunk = stamp.MessageChunk.decode(tlv.value)
                is_asked = request.first <= chunk.index < request.first + request.count
                if is_asked and self._is_first(packet.sender_sequence, chunk.index):
                    charge = self._chunk_size(chunk.index)
                    self._accept_chunk(
                        request.message, chunk, arrival.at_ns, stamp.unix_ns(packet.timestamp, packet.error)
                    )
            elif tlv.type == stamp.REQUEST and not tlv.flags and self._is_first(packet.sender_sequence, -1):
                charge = _STATUS_SIZE
                self._accept_status(request, stamp.RequestStatus.decode(tlv.value))
        return charge

    def _is_first(self, sequence: int, index: int) -> bool:
        is_first = (sequence, index) not in self._accepted_chunks
        self._accepted_chunks.add((sequence, index))
        return is_first

    def _accept_status(self, request: _ChunkRequest, status: stamp.RequestStatus) -> None:
        self.far_rate_bps = status.rate_kbps * 1000.0
        now = self.transport.now_ns()
        message = request.message
        if self._token is None:
            # The zero of the schedule: before it, nothing could be requested.
            self._begin = message.asked_at = now
            message.questions = 0
        self._token = status.token
        if message.number not in self._open:
            return
        message.status = status
        # A reflector that refuses requests is not asked for ever; a question waits for its time.
        is_patient = not request.count or message.requests <= QUESTIONS
        was_lost = self.plan.resend and status.sent_chunks >= self._chunk_count
        if not message.size and is_patient and (was_lost or not status.sent_chunks):
            self._enqueue(_ChunkRequest(message, 0, self._chunk_count))

    def _accept_chunk(self, message: _AwaitedMessage, chunk: stamp.MessageChunk, at_ns: int, far_sent_ns: int) -> None:
        if message.number not in self._open or chunk.index in message.have:
            return
        if not message.size:
            message.first_at = at_ns
            message.far_sent_ns = far_sent_ns - chunk.index * self._due_ns // self._chunk_count
        message.have.add(chunk.index)
        message.size += len(chunk.data)
        message.last_at = at_ns
        if len(message.have) == self._chunk_count:
            self._finish(message)
        elif message.until < 1 << 62:
            message.until = max(message.until, at_ns + round(self.plan.timeout_s * session.SECOND))

    def _finish(self, message: _AwaitedMessage, *, in_flight: bool = False) -> None:
        del self._open[message.number]
        if self._token is None and not in_flight:
            message.sent_at = message.asked_at
        if message.sent_at < 0:
            return
        whole = len(message.have) == self._chunk_count
        # The sample has times since 1970, on the clock of whoever counted: here that is this computer.
        to_unix = self.transport.unix_ns() - self.transport.now_ns()
        is_known = message.size > 0 or (message.status is not None and message.status.sent_chunks > 0)
        self.write(
            samples.MessageResult(
                self.name,
                message.number,
                self.plan.size,
                self._chunk_count,
                message.requested_chunks,
                message.sent_at - self._origin,
                message.last_at - self._origin if whole else None,
                message.size if is_known else None,
                message.first_at + to_unix if message.size else None,
                message.last_at + to_unix if message.size else None,
                in_flight=in_flight,
                direction=samples.MessageDirection.DOWN,
                chunk_size=self._room,
                far_rate_bps=self.far_rate_bps,
                due_ns=self._due_ns,
                far_sent_ns=message.far_sent_ns if message.size else None,
            )
        )

    def end(self, now_ns: int, reason: str) -> None:
        """See `PacketStream`; requested chunks still arrive but are no longer counted."""
        for message in [*self._open.values()]:
            self._finish(message, in_flight=True)
        self.write(samples.StreamEnd(self.name, now_ns - self._origin, reason))


def _ranges(indexes: list[int]) -> list[tuple[int, int]]:
    """Group consecutive indexes as pairs of first index and count."""
    runs: list[tuple[int, int]] = []
    for index in indexes:
        if runs and sum(runs[-1]) == index:
            runs[-1] = (runs[-1][0], runs[-1][1] + 1)
        else:
            runs.append((index, 1))
    return runs
