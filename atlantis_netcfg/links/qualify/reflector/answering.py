"""The reflector's responses: a stateful Session-Reflector (RFC 8762, 4.3.1) without sockets or clocks.

A response is never longer than its request, and no source gets more than its rate, so nobody can use it as an
amplifier. With a key, only authenticated packets are answered, none twice, and none that was sent too long ago. Packets
from a reflector are not answered, so no forged packet makes two of them answer each other. A session is identified by
its identifier (RFC 8972), not by its address: a 4G provider's NAT gives a session another port after each long gap.

A requested message, which measures the way down, is longer than its request. It is sent only to a holder of the key,
and only to an address that presents the token issued to it since this start of the reflector. So neither a recording
from before the start nor a request from another address obtains more than its own length.

Known limit: after a restart the reflector has forgotten every session. A recording that is not yet too old, or any
while this clock is not synchronised, is then answered once more, at most at its source's rate.
"""

from __future__ import annotations

import hmac
import secrets
from collections import OrderedDict
from dataclasses import dataclass, field
from typing import Callable, Tuple

from .clock import UNKNOWN, ClockState
from .stamp import (
    CHUNK,
    COUNTERS,
    FLAG_UNRECOGNISED,
    MISSING,
    PADDING,
    PORT,
    REQUEST,
    TOKEN_SIZE,
    Acknowledgement,
    BadPacket,
    MessageChunk,
    MessageRequest,
    ReflectorCounters,
    ReflectorPacket,
    RequestStatus,
    SenderPacket,
    Tlv,
    Tlvs,
    chunk_room,
    decode_sender,
    error_estimate,
    error_s,
    is_synchronised,
    ntp,
    unix_ns,
)

Source = Tuple[str, int]
_SESSIONS = 256
_SOURCES = 1024
_MESSAGES = 64
_CHUNKS = 1 << 18
"""Maximum number of chunks in all messages of a session; one bit is stored for each."""
_FRESH_S = 60.0
"""Maximum packet age if the sender's clock is synchronised: longer than any gap or queue of a link."""
_FRESH_UNSYNCHRONISED_S = 86_400.0
"""The same for a sender without clock synchronisation: such a laptop is off by minutes, after years by hours."""
_WINDOW = 8192
"""How many packets an older one may be behind the newest of its session and still be answered."""
_IDLE_NS = 900 * 1_000_000_000
_BURST_S = 0.25
_LEAST_BURST = 65536
_SENDINGS = 64
"""Maximum number of requested messages in transit; a further request is answered by its status only."""
_NEVER = 1 << 63
_LAG_NS = 20_000_000
"""Maximum delay of a timer that is made up for: a paced message is not sent in one burst."""


@dataclass
class Statistics:
    """Counters since the start, for the log at the end."""

    answered: int = 0
    refused: int = 0
    """Packets that are not authenticated or not STAMP."""
    stale: int = 0
    """Packets sent too long ago, or by a clock that is ahead."""
    replayed: int = 0
    limited: int = 0
    requested: int = 0
    """Chunks sent because an authenticated request asked for them."""


@dataclass
class _PartialMessage:
    count: int
    have: int = 0
    """Bit set of the received chunks."""
    chunks: int = 0
    """Number of received chunks (bits set in `have`)."""
    size: int = 0
    first: int = 0
    last: int = 0


@dataclass
class _TestSession:
    used_ns: int
    after: int = -1
    """Timestamps up to this one belong to an earlier session with the same identifier."""
    sequence: int = 0
    highest: int = -1
    seen_bits: int = 0
    """Bit set of the received packets up to the highest number, which is bit 0."""
    newest: int = 0
    """Highest timestamp of its sender."""
    received_count: int = 0
    duplicates: int = 0
    limited_count: int = 0
    answered_count: int = 0
    messages: OrderedDict[int, _PartialMessage] = field(default_factory=OrderedDict)
    chunks_by_message: OrderedDict[int, int] = field(default_factory=OrderedDict)
    """Number of chunks sent for each message that the session has requested."""

    def has_seen(self, sequence: int) -> bool:
        """Return whether a packet was received before, or is too old to decide."""
        behind = self.highest - sequence
        return behind >= _WINDOW or (behind >= 0 and bool(self.seen_bits >> behind & 1))

    def is_new(self, sequence: int) -> bool:
        """Record a packet; return False if it was received before or is too old to decide."""
        if self.has_seen(sequence):
            return False
        ahead = sequence - self.highest
        if ahead > 0:
            self.seen_bits = (self.seen_bits << ahead | 1) & (1 << _WINDOW) - 1 if ahead < _WINDOW else 1
            self.highest = sequence
        else:
            self.seen_bits |= 1 << -ahead
        return True


@dataclass(frozen=True)
class _ReceivedPacket:
    """A received packet with its decoded parts."""

    packet: SenderPacket
    chunk: MessageChunk | None
    request: MessageRequest | None
    source: Source
    at_ns: int
    ttl: int


@dataclass
class _Sending:
    """A requested message that is being sent."""

    arrival: _ReceivedPacket
    session: _TestSession
    request: MessageRequest
    index: int
    due_ns: int


class Reflector:
    """A reflector that computes the response to each datagram; the holder of the socket calls it.

    `rate_bps` limits what is sent to one source address, and to one session. `port` is the reflector's port: packets
    from it, or from STAMP's port, were sent by a reflector. `clock` returns this computer's clock state for each
    response; an unknown state is not reported as synchronised.
    """

    def __init__(
        self,
        key: bytes | None,
        *,
        rate_bps: float = 50e6,
        port: int = PORT,
        clock: Callable[[], ClockState] = lambda: UNKNOWN,
    ) -> None:
        self.statistics = Statistics()
        self._key = key
        self._rate = rate_bps / 8
        self._burst = max(self._rate * _BURST_S, _LEAST_BURST)
        self._reflector_ports = {PORT, port}
        self._clock = clock
        self._sessions: OrderedDict[object, _TestSession] = OrderedDict()
        self._ended: dict[int, int] = {}
        """Newest sender timestamp of each authenticated session that was dropped, by identifier."""
        self._tokens: OrderedDict[str | int, tuple[float, int]] = OrderedDict()
        """Rate-limit tokens of source addresses and session identifiers."""
        self._sendings: list[_Sending] = []
        self._secret = secrets.token_bytes(32)

    def answer(
        self, datagram: bytes, source: Source, received_ns: int, ttl: int, now_ns: Callable[[], int]
    ) -> bytes | None:
        """Return the response to a datagram; None if there is none. Times are in ns since 1970."""
        try:
            arrival = self._decode(datagram, source, received_ns, ttl)
        except BadPacket:
            self.statistics.refused += 1
            return None
        packet = arrival.packet
        session = self._session(packet, source, received_ns)
        if session is None:
            return None
        # A chunk that wants no answer costs nothing of what a source may be sent.
        is_answered = arrival.chunk is None or arrival.chunk.acknowledge
        if is_answered and self._wait_ns((source[0], packet.session_id), len(datagram), received_ns):
            session.limited_count += 1
            self.statistics.limited += 1
            return None
        tlvs = self._extensions(session, arrival)
        if tlvs is None:
            return None
        reply = self._reply(session, arrival, tlvs, now_ns()).encode(self._key)
        if len(reply) > len(datagram):
            self.statistics.refused += 1
            return None
        session.sequence += 1
        session.answered_count += not _wants_counters(packet)
        self.statistics.answered += 1
        return reply

    def _is_stale(self, packet: SenderPacket, now: int) -> bool:
        """Return whether the packet was sent too long ago, as far as both clocks allow a decision."""
        clock = self._clock()
        if self._key is None or not clock.is_synchronised:
            return False
        fresh_s = clock.error_s + (
            _FRESH_S + error_s(packet.error) if is_synchronised(packet.error) else _FRESH_UNSYNCHRONISED_S
        )
        return abs(now - unix_ns(packet.timestamp, packet.error)) > min(fresh_s, _FRESH_UNSYNCHRONISED_S) * 1e9

    def _decode(self, datagram: bytes, source: Source, at_ns: int, ttl: int) -> _ReceivedPacket:
        if source[1] in self._reflector_ports:
            raise BadPacket("it comes from the port of a reflector")
        packet = decode_sender(datagram, self._key)
        chunk = next((MessageChunk.decode(tlv.value) for tlv in packet.tlvs if tlv.type == CHUNK), None)
        requests = (tlv.value for tlv in packet.tlvs if tlv.type == REQUEST and self._key is not None)
        return _ReceivedPacket(packet, chunk, next(map(MessageRequest.decode, requests), None), source, at_ns, ttl)

    def _extensions(self, session: _TestSession, arrival: _ReceivedPacket) -> Tlvs | None:
        """Return the TLVs of the response; None if no response is due now."""
        if arrival.chunk is not None:
            asks = self._record_chunk(session, arrival.chunk, arrival.at_ns)
            return (_acknowledgement(session, arrival.chunk),) if asks else None
        if arrival.request is not None:
            return self._request(session, arrival, arrival.request)
        return _answers(arrival.packet.tlvs, session)

    def _session(self, packet: SenderPacket, source: Source, now: int) -> _TestSession | None:
        """Return the session of a packet to be answered; count any other packet and return None."""
        if self._is_stale(packet, now):
            self.statistics.stale += 1
            return None
        session = self._get_or_add_session(packet, source, now)
        if session is None or not self._admit(session, packet):
            self.statistics.replayed += 1
            return None
        return session

    def _get_or_add_session(self, packet: SenderPacket, source: Source, now: int) -> _TestSession | None:
        name: object = (source, packet.session_id) if self._key is None else packet.session_id
        self._forget_idle_sessions(now)
        session = self._sessions.get(name)
        if session is None:
            session = self._sessions[name] = _TestSession(now, self._ended.get(packet.session_id, -1))
        elif self._key is not None and packet.timestamp > session.newest and session.has_seen(packet.sequence):
            # Who sends begins again, with an identifier that it happens to draw once more.
            session = self._sessions[name] = _TestSession(now, session.newest)
        if self._key is not None and packet.timestamp <= session.after:
            return None
        session.used_ns = now
        self._sessions.move_to_end(name)
        return session

    def _forget_idle_sessions(self, now: int) -> None:
        while self._sessions:
            name, oldest = next(iter(self._sessions.items()))
            if len(self._sessions) <= _SESSIONS and now - oldest.used_ns < _IDLE_NS:
                return
            del self._sessions[name]
            if isinstance(name, int):
                self._ended[name] = max(oldest.newest, oldest.after)

    def _admit(self, session: _TestSession, packet: SenderPacket) -> bool:
        """Count a packet, unless it only requests counters; return whether to answer it."""
        counts = not _wants_counters(packet)
        session.received_count += counts
        session.newest = max(session.newest, packet.timestamp)
        if session.is_new(packet.sequence):
            return True
        session.duplicates += counts
        return self._key is None

    def _wait_ns(self, owners: tuple[str | int, ...], size: int, now: int) -> int:
        """Take `size` from the rate limits of the owners; otherwise return how long they must wait."""
        available = {}
        for owner in owners:
            tokens, since = self._tokens.pop(owner, (self._burst, now))
            available[owner] = min(self._burst, tokens + (now - since) / 1e9 * self._rate), max(now, since)
        missing = size - min(tokens for tokens, _ in available.values())
        for owner, (tokens, since) in available.items():
            self._tokens[owner] = (tokens if missing > 0 else tokens - size, since)
        while len(self._tokens) > _SOURCES:
            self._tokens.popitem(last=False)
        return int(missing / self._rate * 1e9) + 1 if missing > 0 else 0

    def _token(self, session_id: int, source: Source) -> bytes:
        """Return a token that only a receiver at this address can know, valid until the next start."""
        return hmac.digest(self._secret, f"{session_id} {source[0]}".encode(), "sha256")[:TOKEN_SIZE]

    def _request(self, session: _TestSession, arrival: _ReceivedPacket, request: MessageRequest) -> Tlvs | None:
        """Start sending the requested chunks and return None, or return the message's status."""
        token = self._token(arrival.packet.session_id, arrival.source)
        is_known = hmac.compare_digest(request.token, token)
        if request.count and is_known and len(self._sendings) < _SENDINGS:
            # The messages of a session leave one after the other, so that its pace is kept.
            waits = any(sending.session is session for sending in self._sendings)
            due_ns = _NEVER if waits else arrival.at_ns
            self._sendings.append(_Sending(arrival, session, request, request.first, due_ns))
            return None
        rate_kbps = min(int(self._rate * 8 / 1000), 0xFFFFFFFF)
        sent_chunks = session.chunks_by_message.get(request.message, 0)
        return (Tlv(REQUEST, RequestStatus(request.message, sent_chunks, rate_kbps, token).encode(), 0),)

    def due_ns(self) -> int | None:
        """Return when the next chunk of a requested message is due; None if there is none."""
        return min((sending.due_ns for sending in self._sendings), default=None)

    def requested_chunk(self, now_ns: Callable[[], int]) -> tuple[bytes, Source] | None:
        """Return the next due chunk and its destination; None if none is due now."""
        now = now_ns()
        sending = min(self._sendings, key=lambda each: each.due_ns, default=None)
        if sending is None or sending.due_ns > now:
            return None
        request, session = sending.request, sending.session
        octets = request.chunk_octets(sending.index)
        size = request.packet - chunk_room(request.packet, is_authenticated=True) + octets
        arrival = sending.arrival
        wait = self._wait_ns((arrival.source[0], arrival.packet.session_id), size, now)
        if wait:
            sending.due_ns = now + wait
            return None
        data = secrets.token_bytes(octets)
        chunk = MessageChunk(request.message, request.message_size, sending.index, request.chunks, False, data)
        tlvs = (Tlv(CHUNK, chunk.encode(), 0),)
        reply = self._reply(session, arrival, tlvs, now)
        session.sequence += 1
        session.chunks_by_message[request.message] = session.chunks_by_message.get(request.message, 0) + 1
        if len(session.chunks_by_message) > _MESSAGES:
            session.chunks_by_message.popitem(last=False)
        self.statistics.requested += 1
        self._advance(sending, size, now)
        return reply.encode(self._key), arrival.source

    def _advance(self, sending: _Sending, size: int, now: int) -> None:
        """Advance to the next chunk; give the message up if it outlasts its session."""
        request = sending.request
        sending.index += 1
        step = int(size * 8 * 1_000_000 / request.pace_kbps) if request.pace_kbps else 0
        sending.due_ns = max(sending.due_ns + step, now - _LAG_NS) if step else now
        if sending.index == request.first + request.count or now - sending.arrival.at_ns > _IDLE_NS:
            self._sendings.remove(sending)
            following = next((each for each in self._sendings if each.session is sending.session), None)
            if following is not None:
                following.due_ns = max(sending.due_ns, following.arrival.at_ns)

    def _record_chunk(self, session: _TestSession, chunk: MessageChunk, received_ns: int) -> bool:
        """Record a chunk; return whether it requests a response."""
        message = session.messages.setdefault(chunk.message, _PartialMessage(chunk.count))
        chunk_count = sum(each.count for each in session.messages.values())
        while len(session.messages) > _MESSAGES or chunk_count > _CHUNKS:
            chunk_count -= session.messages.popitem(last=False)[1].count
        bit = 1 << chunk.index
        if chunk.data and not message.have & bit and chunk.count == message.count:
            message.have |= bit
            message.chunks += 1
            message.size += len(chunk.data)
            message.last = ntp(received_ns)
            message.first = message.first or message.last
        return chunk.acknowledge

    def _reply(self, session: _TestSession, arrival: _ReceivedPacket, tlvs: Tlvs, now: int) -> ReflectorPacket:
        packet, clock = arrival.packet, self._clock()
        return ReflectorPacket(
            sequence=session.sequence,
            timestamp=ntp(now),
            error=error_estimate(clock.error_s, is_synced=clock.is_synchronised),
            session_id=packet.session_id,
            receive_timestamp=ntp(arrival.at_ns),
            sender_sequence=packet.sequence,
            sender_timestamp=packet.timestamp,
            sender_error=packet.error,
            sender_ttl=arrival.ttl,
            tlvs=tlvs,
        )


def _wants_counters(packet: SenderPacket) -> bool:
    return any(tlv.type == COUNTERS for tlv in packet.tlvs)


def _acknowledgement(session: _TestSession, chunk: MessageChunk) -> Tlv:
    message = session.messages.get(chunk.message, _PartialMessage(chunk.count))
    missing = (1 << message.count) - 1 & ~message.have
    indexes: list[int] = []
    while missing and len(indexes) < MISSING:
        indexes.append((missing & -missing).bit_length() - 1)
        missing &= missing - 1
    lacking = message.count - message.chunks
    value = Acknowledgement(chunk.message, message.size, lacking, message.first, message.last, tuple(indexes))
    return Tlv(CHUNK, value.encode(), 0)


def _answers(tlvs: Tlvs, session: _TestSession) -> Tlvs:
    """Return the TLVs of the response: known ones with their values, others flagged unrecognised (RFC 8972, 4)."""
    return tuple(
        Tlv(COUNTERS, _build_counters(session).encode(), 0)
        if tlv.type == COUNTERS
        else Tlv(tlv.type, tlv.value, 0 if tlv.type == PADDING else FLAG_UNRECOGNISED)
        for tlv in tlvs
    )


def _build_counters(session: _TestSession) -> ReflectorCounters:
    return ReflectorCounters(session.received_count, session.duplicates, session.limited_count, session.answered_count)
