"""The sender: streams of test packets to one reflector, each packet on schedule and within the budget.

A train is a series of equal packets that measures delay, loss, order and gaps per direction. For tests under load,
streams of messages (`messages`) run beside it on the same socket. Every stream has its own session identifier.
"""

from __future__ import annotations

import secrets
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Final, Protocol

from atlantis_netcfg.links.qualify import samples
from atlantis_netcfg.links.qualify.reflector.stamp import (
    COUNTERS,
    BadPacket,
    ReflectorCounters,
    ReflectorPacket,
    SenderPacket,
    Tlv,
    Tlvs,
    decode_reflector,
    error_estimate,
    ntp,
    padding,
    unix_ns,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from atlantis_netcfg.links.qualify.budget import BudgetGuard
    from atlantis_netcfg.links.qualify.transport import Arrival, DatagramTransport

SECOND: Final = 1_000_000_000
_COUNTER_REQUESTS: Final = 3
_SLICE_S: Final = 0.2
"""Interval in seconds at which the budget is checked while nothing is due."""


class EndReason(StrEnum):
    """Why a run ended; each limit of the budget has a separate value."""

    DONE = "done"
    STOPPED = "stopped"
    SILENT = "no answer"
    """No response to any packet; the remaining stages need responses."""
    LEFT_OUT = "nothing to try"
    """By its declared rate the link carries none of the sizes and rates."""


@dataclass(frozen=True, slots=True)
class Outgoing:
    """A packet that a stream wants to send, and the responses that it may cause."""

    tlvs: Tlvs
    size: int
    answer: int
    """Maximum UDP payload of all its responses together; 0: no response."""
    sequence: int
    answers: int = 1
    """Number of datagrams in the response."""
    answer_s: float = 0.0
    """Seconds during which the far end sends the responses."""


@dataclass(frozen=True, slots=True)
class ReflectorPeer:
    """The reflector, and how packets for it are made."""

    key: bytes | None
    """None: unauthenticated, for reflectors other than this project's."""
    is_synchronised: bool = False
    """Whether this computer's clock is synchronised; absolute one-way delays need both clocks synchronised."""
    clock_error_s: float = 1.0
    counts: bool = True
    """Whether it is this project's reflector, which reports its counters."""


class PacketStream(Protocol):
    """A source of packets: `run` asks it when to send, and passes it the responses."""

    name: str
    session_id: int

    def begin(self, origin_ns: int) -> None:
        """Start the stream now; `origin_ns` is the zero of the run's sample times."""

    def due_ns(self) -> int | None:
        """Return when the stream next wants to send or be asked; None if it has ended."""

    def next_packet(self, now_ns: int) -> Outgoing | None:
        """Return the packet to send now; None if there is none yet."""

    def mark_sent(self, outgoing: Outgoing, now_ns: int, error: str) -> None:
        """Record that the packet was sent or, with `error`, was not."""

    def accept(self, packet: ReflectorPacket, arrival: Arrival) -> int:
        """Accept a response; return the size that was charged for it, 0 for a duplicate."""

    def end(self, now_ns: int, reason: str) -> None:
        """End the stream: nothing more is sent or received."""


@dataclass(frozen=True, slots=True)
class TrainPlan:
    """A plan of equal packets at equal intervals; `size` is the UDP payload of request and response."""

    size: int
    interval_s: float
    duration_s: float
    timeout_s: float = 5.0
    """Seconds to wait for the last responses; a later response counts as late."""

    @property
    def packets(self) -> int:
        """The number of packets, if no limit ends the train earlier."""
        return max(1, round(self.duration_s / self.interval_s))


@dataclass(slots=True)
class Train:
    """A packet train that is being sent."""

    name: str
    plan: TrainPlan
    peer: ReflectorPeer
    transport: DatagramTransport
    write: Callable[[samples.Sample], None]
    session_id: int = field(default_factory=lambda: secrets.randbelow(65535) + 1)
    _origin: int = 0
    _begin: int | None = None
    _number: int = 0
    _answered_sequences: set[int] = field(default_factory=set)
    _requests: int = 0
    _has_counters: bool = False
    _next: int = 0
    _has_ended: bool = False

    def begin(self, origin_ns: int) -> None:
        """See `PacketStream`."""
        now = self.transport.now_ns()
        self._origin, self._begin, self._next = origin_ns, now, now
        plan, peer = self.plan, self.peer
        self.write(
            samples.TrainBegan(
                self.name,
                now - origin_ns,
                self.transport.unix_ns(),
                plan.size,
                plan.interval_s,
                plan.duration_s,
                plan.timeout_s,
                self.transport.headers,
                authenticated=peer.key is not None,
                synchronised=peer.is_synchronised,
            )
        )

    def due_ns(self) -> int | None:
        """See `PacketStream`."""
        return None if self._has_ended else self._next

    def next_packet(self, now_ns: int) -> Outgoing | None:
        """Return the next packet; after the last one and its timeout, a request for the reflector's counters."""
        plan = self.plan
        if self._number < plan.packets:
            size = plan.size
            return Outgoing(padding(size, is_authenticated=self.peer.key is not None), size, size, self._number)
        asks = self.peer.counts and not self._has_counters and self._requests < _COUNTER_REQUESTS
        if now_ns < self._next or not asks:
            self._has_ended = now_ns >= self._next
            return None
        tlvs = (Tlv(COUNTERS, bytes(16)),)
        size = len(SenderPacket(0, 0, 1, 1, tlvs).encode(self.peer.key))
        return Outgoing(tlvs, size, size, plan.packets + self._requests)

    def mark_sent(self, outgoing: Outgoing, now_ns: int, error: str) -> None:
        """See `PacketStream`."""
        plan = self.plan
        if self._number < plan.packets:
            self.write(samples.PacketSent(self.name, outgoing.sequence, now_ns - self._origin, error))
            self._number += 1
            step = round(plan.interval_s * SECOND)
            # A computer that was busy for longer than a step does not send what it missed in one burst.
            self._next = max(self._next + step, now_ns - step)
            if self._number == plan.packets:
                self._next = now_ns + round(plan.timeout_s * SECOND)
        else:
            self._requests += 1
            self._next = now_ns + round(plan.timeout_s * SECOND)

    def accept(self, packet: ReflectorPacket, arrival: Arrival) -> int:
        """See `PacketStream`."""
        sequence = packet.sender_sequence
        is_copy = sequence in self._answered_sequences
        self._answered_sequences.add(sequence)
        if self._number == len(self._answered_sequences) == self.plan.packets:
            self._next = min(self._next, arrival.at_ns)  # no answer is awaited any more
        if sequence >= self.plan.packets:
            self._accept_counters(packet)
            return 0 if is_copy else len(arrival.datagram)
        self.write(
            samples.ReplySample(
                self.name,
                sequence,
                arrival.at_ns - self._origin,
                packet.sequence,
                unix_ns(packet.receive_timestamp, packet.error),
                unix_ns(packet.timestamp, packet.error),
                len(arrival.datagram),
                arrival.ttl,
                packet.error,
            )
        )
        return 0 if is_copy else self.plan.size

    def _accept_counters(self, packet: ReflectorPacket) -> None:
        for tlv in packet.tlvs:
            if tlv.type == COUNTERS and not tlv.flags and not self._has_counters:
                self._has_counters, self._has_ended = True, True
                counters = ReflectorCounters.decode(tlv.value)
                self.write(
                    samples.CounterSample(
                        self.name,
                        counters.received_count,
                        counters.duplicates,
                        counters.limited_count,
                        counters.answered_count,
                    )
                )

    def end(self, now_ns: int, reason: str) -> None:
        """See `PacketStream`."""
        self.write(samples.StreamEnd(self.name, now_ns - self._origin, reason))


def run(
    transport: DatagramTransport,
    peer: ReflectorPeer,
    streams: Sequence[PacketStream],
    guard: BudgetGuard,
    *,
    stop: Callable[[], bool] = lambda: False,
) -> str:
    """Send all streams until each has ended, the budget is used up, or `stop` is true; return the reason.

    KeyboardInterrupt stops it as well: measured samples are kept, and packets in transit count neither as received nor
    as lost.
    """
    origin = transport.now_ns()
    used_ids: set[int] = set()
    for stream in streams:
        while stream.session_id in used_ids:
            stream.session_id = secrets.randbelow(65535) + 1
        used_ids.add(stream.session_id)
        stream.begin(origin)
    under_way = _RunningStreams(transport, peer, streams, guard)
    try:
        reason = under_way.until_ended(stop)
    except KeyboardInterrupt:
        reason = EndReason.STOPPED
    for stream in streams:
        stream.end(transport.now_ns(), reason)
    return reason


@dataclass(slots=True)
class _RunningStreams:
    """The streams of a run while they are sent."""

    transport: DatagramTransport
    peer: ReflectorPeer
    streams: Sequence[PacketStream]
    guard: BudgetGuard
    stamps: dict[tuple[int, int], int] = field(default_factory=dict)
    """Timestamp of each packet that expects a response, by session identifier and sequence number."""

    def until_ended(self, stop: Callable[[], bool]) -> str:
        while dues := [due for stream in self.streams if (due := stream.due_ns()) is not None]:
            if stop():
                return EndReason.STOPPED
            self._step(min(dues))
            if self.guard.limited_by is not None:
                end = self.transport.now_ns() + round(self.guard.closing_left_s * SECOND)
                while self._receive(end):
                    pass
                return self.guard.limited_by
        return EndReason.DONE

    def _step(self, due: int) -> None:
        now = self.transport.now_ns()
        if now < due:
            if not self.guard.expires(_SLICE_S):
                self._receive(min(due, now + round(_SLICE_S * SECOND)))
            return
        # What has come up to now is looked at first: it may end a stream.
        while self._receive(now):
            pass
        for stream in self.streams:
            self._send(stream)

    def _send(self, stream: PacketStream) -> None:
        """Send a stream's next packet if it is due and the budget admits it."""
        now = self.transport.now_ns()
        due = stream.due_ns()
        if due is None or due > now or (outgoing := stream.next_packet(now)) is None:
            return
        if not self.guard.admit(outgoing.size, outgoing.answer, outgoing.answers, outgoing.answer_s):
            return
        error = error_estimate(self.peer.clock_error_s, is_synced=self.peer.is_synchronised)
        stamp = ntp(self.transport.unix_ns())
        packet = SenderPacket(outgoing.sequence, stamp, error, stream.session_id, outgoing.tlvs)
        if outgoing.answer:
            self.stamps[stream.session_id, outgoing.sequence] = stamp
        stream.mark_sent(outgoing, now, self.transport.send(packet.encode(self.peer.key)))

    def _receive(self, until_ns: int) -> bool:
        """Receive one datagram, or return False at the deadline; one that is no response of this run only costs."""
        arrival = self.transport.receive(until_ns)
        if arrival is None:
            return False
        self.guard.count(len(arrival.datagram), self._accept(arrival))
        return True

    def _accept(self, arrival: Arrival) -> int:
        """Pass a response to its stream; return the size that was charged for it."""
        try:
            packet = decode_reflector(arrival.datagram, self.peer.key)
            for stream in self.streams:
                # A reflector of RFC 8762 alone answers with 0 where a session's identifier would stand.
                is_ours = packet.session_id == stream.session_id or not (packet.session_id or self.peer.counts)
                # Both directions have one key: our own packet that comes back is no answer, and lacks the stamp.
                stamp = self.stamps.get((stream.session_id, packet.sender_sequence))
                if is_ours and stamp == packet.sender_timestamp:
                    return stream.accept(packet, arrival)
        except BadPacket:
            pass
        return 0
