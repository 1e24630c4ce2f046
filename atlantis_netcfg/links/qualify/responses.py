"""Packets with and without a response: direction of loss, consecutive losses, and losses within gaps.

A gap is silence of at least three packets and a second. Its losses count as unavailability, not as loss of the working
link, as ITU-T Y.1563 treats severely errored blocks.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.links.qualify.samples import PacketSent, ReplySample, StreamEnd

if TYPE_CHECKING:
    from collections.abc import Sequence

    from atlantis_netcfg.links.qualify.samples import CounterSample, Sample, TrainBegan

LEAST_GAP_PACKETS: Final = 3
_LEAST_GAP_S: Final = 1.0
_SECOND: Final = 1_000_000_000


@dataclass(frozen=True, slots=True)
class AnsweredPacket:
    """A packet and its first response."""

    sequence: int
    sent_at_ns: int
    arrived_at_ns: int
    reflector_sequence: int
    received_ns: int
    replied_ns: int
    error: int

    @property
    def rtt(self) -> int:
        """Round-trip time in nanoseconds, less the time at the reflector."""
        return self.arrived_at_ns - self.sent_at_ns - (self.replied_ns - self.received_ns)


@dataclass(frozen=True, slots=True)
class Silence:
    """A series of consecutive packets without a response."""

    packets: int
    down: int | None
    """Number of these packets that the reflector had answered; None: not known."""


def answered_packets(packets: Sequence[PacketSent], replies: Sequence[ReplySample]) -> list[AnsweredPacket]:
    """Pair packets with their first responses, in the order of sending."""
    first: dict[int, ReplySample] = {}
    for reply in replies:
        first.setdefault(reply.sequence, reply)
    return [
        AnsweredPacket(
            packet.sequence,
            packet.sent_at_ns,
            answer.arrived_at_ns,
            answer.reflector_sequence,
            answer.received_ns,
            answer.replied_ns,
            answer.reflector_error,
        )
        for packet in packets
        if (answer := first.get(packet.sequence)) is not None
    ]


def packets_of_known_fate(samples: Sequence[Sample], begin: TrainBegan) -> list[PacketSent]:
    """Return the packets with a known result: not in transit at the end of the run, and actually sent."""
    end = next((sample.ended_at_ns for sample in samples if isinstance(sample, StreamEnd)), None)
    last_reply = max((s.arrived_at_ns for s in samples if isinstance(s, ReplySample)), default=0)
    fate_known = (last_reply if end is None else end) - round(begin.timeout_s * _SECOND)
    answered_sequences = {sample.sequence for sample in samples if isinstance(sample, ReplySample)}
    return [
        sample
        for sample in samples
        if isinstance(sample, PacketSent)
        and not sample.error
        and (sample.sequence in answered_sequences or sample.sent_at_ns <= fate_known)
    ]


def find_silences(
    packets: Sequence[PacketSent], pairs: Sequence[AnsweredPacket], counters: CounterSample | None
) -> list[Silence]:
    """Return unanswered series and the direction of loss, by the reflector's own numbers (RFC 8762, 4.3.1)."""
    by_sequence = {pair.sequence: pair for pair in pairs}
    lost_count = len(packets) - len(pairs)
    numbers = [pair.reflector_sequence for pair in pairs]
    copies = lost_count > 0 and all(pair.sequence == pair.reflector_sequence for pair in pairs)
    counts = len(set(numbers)) == len(numbers) and not copies
    arrived_count = counters.received - counters.duplicates if counters is not None else None
    result: list[Silence] = []
    before, length = -1, 0
    for packet in packets:
        pair = by_sequence.get(packet.sequence)
        if pair is None:
            length += 1
            continue
        if length:
            down = min(length, max(0, pair.reflector_sequence - before - 1))
            result.append(Silence(length, down if counts else None))
        before, length = pair.reflector_sequence, 0
    if length:
        down_at_end = None if arrived_count is None or not counts else min(length, max(0, arrived_count - before - 1))
        result.append(Silence(length, down_at_end))
    return result


def is_gap(silence: Silence, begin: TrainBegan) -> bool:
    """Return whether the silence is long enough to be a gap rather than loss."""
    return silence.packets >= LEAST_GAP_PACKETS and silence.packets * begin.interval_s >= _LEAST_GAP_S
