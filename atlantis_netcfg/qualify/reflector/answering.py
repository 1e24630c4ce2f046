"""What a reflector answers: a stateful Session-Reflector (RFC 8762, 4.3.1), without sockets and clocks of its own.

An answer is never longer than its request, and no source gets more than its rate, so nobody can use it as an amplifier.
With a key nothing is answered that is not authenticated, and nothing twice. A session is known by its identifier
(RFC 8972), not by its address: a 4G provider's NAT gives a session another port after each long gap.

What cannot be told apart: after a restart the reflector has forgotten every session, so a recording of an older one is
answered once more, at most at its source's rate.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, field
from typing import Callable, Tuple

from .stamp import (
    CHUNK,
    COUNTERS,
    PADDING,
    UNRECOGNISED,
    Acknowledgement,
    BadPacket,
    MessageChunk,
    ReflectorCounters,
    ReflectorPacket,
    SenderPacket,
    Tlv,
    Tlvs,
    decode_sender,
    error_estimate,
    ntp,
)

Source = Tuple[str, int]
_SESSIONS = 256
_SOURCES = 1024
_MESSAGES = 64
_WINDOW = 8192
"""How far behind the newest packet of a session an older one is still answered."""
_IDLE_NS = 900 * 1_000_000_000
_BURST_S = 0.25
_LEAST_BURST = 65536


@dataclass
class Statistics:
    """What came since the start, for the log at the end."""

    answered: int = 0
    refused: int = 0
    """Not authenticated, or no packet of STAMP."""
    replayed: int = 0
    limited: int = 0


@dataclass
class _PartialMessage:
    count: int
    have: int = 0
    """A bit for each chunk."""
    size: int = 0
    first: int = 0
    last: int = 0


@dataclass
class _TestSession:
    used_ns: int
    sequence: int = 0
    highest: int = -1
    seen: int = 0
    """A bit for each of the packets up to the highest; bit 0 is that."""
    newest: int = 0
    """The greatest timestamp of its sender."""
    received: int = 0
    duplicates: int = 0
    limited: int = 0
    answered: int = 0
    messages: OrderedDict[int, _PartialMessage] = field(default_factory=OrderedDict)

    def is_new(self, sequence: int) -> bool:
        """Note a packet; False: it was here before, or is too old to tell."""
        ahead = sequence - self.highest
        if ahead > 0:
            self.seen = (self.seen << ahead | 1) & (1 << _WINDOW) - 1 if ahead < _WINDOW else 1
            self.highest = sequence
            return True
        bit = 1 << -ahead
        if -ahead >= _WINDOW or self.seen & bit:
            return False
        self.seen |= bit
        return True


class Reflector:
    """Answers datagrams; whoever holds the socket asks it for each.

    `rate_bps` bounds what one source address is sent. `error_s` is the error of this computer's clock, and
    `synchronised` whether an external source disciplines it: what is not known is not said to be so.
    """

    def __init__(
        self,
        key: bytes | None,
        *,
        rate_bps: float = 50e6,
        synchronised: bool = False,
        error_s: float = 1.0,
    ) -> None:
        self.statistics = Statistics()
        self._key = key
        self._rate = rate_bps / 8
        self._burst = max(self._rate * _BURST_S, _LEAST_BURST)
        self._error = error_estimate(error_s, synchronised=synchronised)
        self._sessions: OrderedDict[object, _TestSession] = OrderedDict()
        self._ended: dict[int, int] = {}
        """For each identifier of an authenticated session that is forgotten: its sender's newest timestamp."""
        self._tokens: OrderedDict[str, tuple[float, int]] = OrderedDict()

    def answer(
        self, datagram: bytes, source: Source, received_ns: int, ttl: int, now_ns: Callable[[], int]
    ) -> bytes | None:
        """Give what goes back to the source; None: nothing does. Times are since 1970."""
        try:
            packet = decode_sender(datagram, self._key)
            chunk = _chunk(packet)
        except BadPacket:
            self.statistics.refused += 1
            return None
        session = self._session(packet, source, received_ns)
        if session is None or not self._admitted(session, packet):
            self.statistics.replayed += 1
            return None
        if not self._within_rate(source[0], len(datagram), received_ns):
            session.limited += 1
            self.statistics.limited += 1
            return None
        if chunk is not None and not self._keep(session, chunk, received_ns):
            return None
        reply = self._reply(session, packet, chunk, received_ns, ttl, now_ns).encode(self._key)
        if len(reply) > len(datagram):
            self.statistics.refused += 1
            return None
        session.sequence += 1
        session.answered += not _wants_counters(packet)
        self.statistics.answered += 1
        return reply

    def _session(self, packet: SenderPacket, source: Source, now: int) -> _TestSession | None:
        name: object = (source, packet.session_id) if self._key is None else packet.session_id
        self._forget(now)
        session = self._sessions.get(name)
        if session is None:
            if self._key is not None and packet.timestamp <= self._ended.get(packet.session_id, -1):
                return None
            session = self._sessions[name] = _TestSession(now)
        session.used_ns = now
        self._sessions.move_to_end(name)
        return session

    def _forget(self, now: int) -> None:
        while self._sessions:
            name, oldest = next(iter(self._sessions.items()))
            if len(self._sessions) <= _SESSIONS and now - oldest.used_ns < _IDLE_NS:
                return
            del self._sessions[name]
            if isinstance(name, int):
                self._ended[name] = max(oldest.newest, self._ended.get(name, -1))

    def _admitted(self, session: _TestSession, packet: SenderPacket) -> bool:
        """Count it, unless it only wants to see the counters; whether it is to be answered."""
        counts = not _wants_counters(packet)
        session.received += counts
        session.newest = max(session.newest, packet.timestamp)
        if session.is_new(packet.sequence):
            return True
        session.duplicates += counts
        return self._key is None

    def _within_rate(self, address: str, size: int, now: int) -> bool:
        tokens, since = self._tokens.pop(address, (self._burst, now))
        tokens = min(self._burst, tokens + (now - since) / 1e9 * self._rate)
        passes = tokens >= size
        self._tokens[address] = (tokens - size if passes else tokens, max(now, since))
        if len(self._tokens) > _SOURCES:
            self._tokens.popitem(last=False)
        return passes

    def _keep(self, session: _TestSession, chunk: MessageChunk, received_ns: int) -> bool:
        """Note a chunk; whether it wants an answer."""
        message = session.messages.setdefault(chunk.message, _PartialMessage(chunk.count))
        if len(session.messages) > _MESSAGES:
            session.messages.popitem(last=False)
        bit = 1 << chunk.index
        if chunk.data and not message.have & bit and chunk.count == message.count:
            message.have |= bit
            message.size += len(chunk.data)
            message.last = ntp(received_ns)
            message.first = message.first or message.last
        return chunk.acknowledge

    def _reply(  # noqa: PLR0913, PLR0917 - what the packet holds
        self,
        session: _TestSession,
        packet: SenderPacket,
        chunk: MessageChunk | None,
        received_ns: int,
        ttl: int,
        now_ns: Callable[[], int],
    ) -> ReflectorPacket:
        tlvs = _answers(packet.tlvs, session) if chunk is None else (_acknowledgement(session, chunk),)
        return ReflectorPacket(
            sequence=session.sequence,
            timestamp=ntp(now_ns()),
            error=self._error,
            session_id=packet.session_id,
            received=ntp(received_ns),
            sender_sequence=packet.sequence,
            sender_timestamp=packet.timestamp,
            sender_error=packet.error,
            sender_ttl=ttl,
            tlvs=tlvs,
        )


def _chunk(packet: SenderPacket) -> MessageChunk | None:
    return next((MessageChunk.decode(tlv.value) for tlv in packet.tlvs if tlv.type == CHUNK), None)


def _wants_counters(packet: SenderPacket) -> bool:
    return any(tlv.type == COUNTERS for tlv in packet.tlvs)


def _acknowledgement(session: _TestSession, chunk: MessageChunk) -> Tlv:
    message = session.messages.get(chunk.message, _PartialMessage(chunk.count))
    missing = [index for index in range(message.count) if not message.have >> index & 1]
    value = Acknowledgement(chunk.message, message.size, len(missing), message.first, message.last, tuple(missing[:16]))
    return Tlv(CHUNK, value.encode(), 0)


def _answers(tlvs: Tlvs, session: _TestSession) -> Tlvs:
    """Give them back: those that it knows with their answer, others with the flag that says so (RFC 8972, 4)."""
    return tuple(
        Tlv(COUNTERS, _counted(session).encode(), 0)
        if tlv.type == COUNTERS
        else Tlv(tlv.type, tlv.value, 0 if tlv.type == PADDING else UNRECOGNISED)
        for tlv in tlvs
    )


def _counted(session: _TestSession) -> ReflectorCounters:
    return ReflectorCounters(session.received, session.duplicates, session.limited, session.answered)
