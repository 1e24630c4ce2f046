"""Figures of a packet train, computed from its raw samples alone, so other limits can be applied later.

A percentile is the smallest sample that the given share of the samples does not exceed (RFC 2330, 11.3). The round trip
is measured by the sender's clock, less the packet's time at the reflector, so it needs no common clock. If the clocks
are not synchronised a one-way delay is known only up to a constant: then its variation above its minimum is given. The
drift between the two clocks in a run is not corrected; 50 parts in a million are 30 ms in ten minutes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.links.qualify import responses
from atlantis_netcfg.links.qualify.reflector.stamp import is_synchronised
from atlantis_netcfg.links.qualify.samples import CounterSample, PacketSent, ReplySample, StreamEnd, TrainBegan

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from atlantis_netcfg.links.qualify.responses import AnsweredPacket, Silence
    from atlantis_netcfg.links.qualify.samples import Sample

GAPS_S: Final = (1, 5, 20, 60)
_SECOND: Final = 1_000_000_000
_TRIM_SHARE: Final = 0.95


@dataclass(frozen=True, slots=True)
class Percentiles:
    """Percentiles of `n` samples, in seconds; with few samples the upper ones all equal the maximum."""

    n: int
    min: float
    p50: float
    p90: float
    p95: float
    p99: float
    max: float


@dataclass(frozen=True, slots=True)
class DelayVariation:
    """The variation of the delay in one direction; it needs no common clock."""

    above_min: Percentiles
    """Delay minus the minimum delay: the share added by queues and radio."""
    rfc3550_s: float
    """The jitter of RFC 3550, 6.4.1, at the end of the train."""
    rfc3550_mean_s: float
    """Mean of the RFC 3550 jitter over the train, because the estimator itself does not converge."""
    ipdv_p95_s: float
    """95th percentile of the absolute difference in delay between consecutive packets (RFC 3393)."""
    delay: Percentiles | None
    """The delay itself; None unless both clocks report that they are synchronised."""


@dataclass(frozen=True, slots=True)
class TrainLoss:
    """Where packets were lost; `up` and `down` are None if that is not known, and `why` gives the reason."""

    sent: int
    received: int
    """Packets with a response, including late responses."""
    late: int
    unsent: int
    """Packets that this computer did not send because of an error; not included in `sent`."""
    in_flight: int
    """Packets neither answered nor overdue when the run ended; not counted as lost."""
    lost: int
    up: int | None
    down: int | None
    why: str
    limited: int
    """Packets that the reflector refused because of its rate limit; included in `up`, but not lost by the link."""
    copies_up: int | None
    copies_down: int

    @property
    def share(self) -> float:
        """The share of lost packets among those with a known result."""
        known_count = self.sent - self.in_flight
        return self.lost / known_count if known_count else 0.0


@dataclass(frozen=True, slots=True)
class FrameLoss:
    """Shares of packets lost outside of gaps (ITU-T Y.1563); None if not known per direction."""

    up: float | None
    down: float | None
    both: float
    packets: int
    """Packets outside of gaps whose result is known."""
    in_gaps: int
    """Packets lost in gaps: they count towards the availability."""

    @property
    def share_up(self) -> float:
        """The loss share upwards; the share of both ways if not known per direction, which is an upper bound."""
        return self.both if self.up is None else self.up


@dataclass(frozen=True, slots=True)
class ArrivalGaps:
    """Periods without arrivals, including the beginning and the end of the train."""

    longest_s: float
    above: tuple[tuple[int, int], ...]
    """Pairs of a duration in seconds and the number of gaps longer than it."""
    beyond_1_s: float
    """Total duration in seconds of all gaps longer than 1 s."""
    open_end: bool
    """The longest gap had not ended when the train ended: it may be longer."""
    at_most_s: float | None
    """Upper bound of all gaps; None: a gap at the beginning or the end of the train may have any length."""


@dataclass(frozen=True, slots=True)
class TrainFigures:
    """The figures of one packet train."""

    size: int
    interval_s: float
    reason: str
    loss: TrainLoss
    flr: FrameLoss
    rtt: Percentiles | None
    up: DelayVariation | None
    down: DelayVariation | None
    reordered_up: float | None
    """Share of reordered packets among those that arrived (RFC 4737, 3.4)."""
    reordered_down: float | None
    gaps: ArrivalGaps
    rpm: float | None
    """60 s divided by the mean of the round trips up to the 95th percentile. Under load: round trips per minute."""


class NoTrain(LookupError):
    """The samples hold no train of this name."""


def percentile(sorted_values: Sequence[float], share: float) -> float:
    """Return a percentile of sorted samples (RFC 2330, 11.3)."""
    return sorted_values[max(0, math.ceil(share * len(sorted_values)) - 1)]


def percentiles(values: Iterable[float]) -> Percentiles | None:
    """Return the percentiles of samples in any order; None if there are none."""
    sorted_values = sorted(values)
    if not sorted_values:
        return None
    p50, p90, p95, p99 = (percentile(sorted_values, share) for share in (0.5, 0.9, 0.95, 0.99))
    return Percentiles(len(sorted_values), sorted_values[0], p50, p90, p95, p99, sorted_values[-1])


def round_trips_per_minute(rtts: Iterable[float]) -> float | None:
    """Return the responsiveness as one number: the trimmed mean of draft-ietf-ippm-responsiveness-08, 4.3.

    Higher is better. The draft uses TCP, TLS and HTTP exchanges; these are test packets over UDP beside the load, so
    the number is not that of its tools.
    """
    sorted_rtts = sorted(rtts)
    lowest_rtts = sorted_rtts[: max(1, math.ceil(_TRIM_SHARE * len(sorted_rtts)))]
    return 60.0 * len(lowest_rtts) / sum(lowest_rtts) if sorted_rtts and sum(lowest_rtts) > 0 else None


def train_figures(samples: Iterable[Sample], stream: str) -> TrainFigures:
    """Compute the figures of one train; raise NoTrain if the samples do not contain it."""
    mine = [sample for sample in samples if sample.stream == stream]
    begin = next((sample for sample in mine if isinstance(sample, TrainBegan)), None)
    if begin is None:
        raise NoTrain(stream)
    packets = [sample for sample in mine if isinstance(sample, PacketSent)]
    replies = [sample for sample in mine if isinstance(sample, ReplySample)]
    counters = next((sample for sample in mine if isinstance(sample, CounterSample)), None)
    end = next((sample for sample in mine if isinstance(sample, StreamEnd)), None)
    ended_at = end.ended_at_ns if end is not None else max((s.arrived_at_ns for s in replies), default=0)
    pairs = responses.answered_packets(packets, replies)
    rtts = [pair.rtt / _SECOND for pair in pairs]
    both_synchronised = begin.synchronised and bool(pairs) and all(is_synchronised(pair.error) for pair in pairs)
    up = [
        (pair.received_ns, pair.received_ns - begin.begin_ns - (pair.sent_at_ns - begin.begin_at_ns)) for pair in pairs
    ]
    down = [
        (pair.arrived_at_ns, pair.arrived_at_ns - begin.begin_at_ns - (pair.replied_ns - begin.begin_ns))
        for pair in pairs
    ]
    loss = _loss(begin, packets, replies, pairs, counters, ended_at)
    silences = responses.find_silences(responses.packets_of_known_fate(mine, begin), pairs, counters)
    return TrainFigures(
        size=begin.size,
        interval_s=begin.interval_s,
        reason="cut off" if end is None else end.reason,
        loss=loss,
        flr=_frame_loss(loss, [silence for silence in silences if responses.is_gap(silence, begin)]),
        rtt=percentiles(rtts),
        up=_variation(pairs, up, absolute=both_synchronised),
        down=_variation(pairs, down, absolute=both_synchronised),
        reordered_up=_reorder_share(
            [pair.sequence for pair in sorted(pairs, key=lambda pair: pair.reflector_sequence)]
        ),
        reordered_down=_reorder_share(
            [pair.reflector_sequence for pair in sorted(pairs, key=lambda pair: pair.arrived_at_ns)]
        ),
        gaps=_gaps(packets, pairs, ended_at, counters),
        rpm=round_trips_per_minute(rtts),
    )


def round_trips(samples: Iterable[Sample], stream: str) -> list[tuple[float, float | None]]:
    """Return each packet's send time in seconds since the first, and its round trip (None: not answered)."""
    mine = [sample for sample in samples if sample.stream == stream]
    packets = [sample for sample in mine if isinstance(sample, PacketSent) and not sample.error]
    pairs = responses.answered_packets(packets, [sample for sample in mine if isinstance(sample, ReplySample)])
    rtts = {pair.sequence: pair.rtt / _SECOND for pair in pairs}
    return [((packet.sent_at_ns - packets[0].sent_at_ns) / _SECOND, rtts.get(packet.sequence)) for packet in packets]


def _loss(  # noqa: PLR0913, PLR0917 - all that is known of a train
    begin: TrainBegan,
    packets: Sequence[PacketSent],
    replies: Sequence[ReplySample],
    pairs: Sequence[AnsweredPacket],
    counters: CounterSample | None,
    ended_at: int,
) -> TrainLoss:
    sent_packets = [packet for packet in packets if not packet.error]
    timeout = round(begin.timeout_s * _SECOND)
    answered_sequences = {pair.sequence for pair in pairs}
    silent = [packet for packet in sent_packets if packet.sequence not in answered_sequences]
    in_flight = sum(1 for packet in silent if ended_at - packet.sent_at_ns < timeout)
    lost_count = len(silent) - in_flight
    up, down, why = _direction(len(sent_packets), lost_count, in_flight, pairs, counters)
    return TrainLoss(
        sent=len(sent_packets),
        received=len(pairs),
        late=sum(1 for pair in pairs if pair.arrived_at_ns - pair.sent_at_ns > timeout),
        unsent=len(packets) - len(sent_packets),
        in_flight=in_flight,
        lost=lost_count,
        up=up,
        down=down,
        why=why,
        limited=counters.limited if counters is not None else 0,
        copies_up=counters.duplicates if counters is not None else None,
        copies_down=len(replies) - len({reply.sequence for reply in replies}),
    )


def _direction(
    sent_count: int, lost_count: int, in_flight: int, pairs: Sequence[AnsweredPacket], counters: CounterSample | None
) -> tuple[int | None, int | None, str]:
    """Split the loss by direction, from the reflector's counters or its sequence numbers (RFC 8762, 4.3.1)."""
    numbers = [pair.reflector_sequence for pair in pairs]
    if len(set(numbers)) != len(numbers):
        return None, None, "the reflector restarted its count during this packet train"
    if counters is not None and not in_flight:
        arrived_count = counters.received - counters.duplicates
        if len(pairs) <= arrived_count <= sent_count:
            return sent_count - arrived_count, lost_count - (sent_count - arrived_count), "by the reflector's count"
        return None, None, "the reflector's count does not match what was sent"
    return (0, 0, "nothing lost") if not lost_count else _split_by_sequence(lost_count, pairs)


def _split_by_sequence(lost_count: int, pairs: Sequence[AnsweredPacket]) -> tuple[int | None, int | None, str]:
    """Split the loss by the reflector's sequence numbers, if it reported no counters."""
    if not pairs:
        return None, None, "no responses"
    if all(pair.sequence == pair.reflector_sequence for pair in pairs):
        return None, None, "the reflector may merely copy the sender's numbers"
    last = max(pair.reflector_sequence for pair in pairs)
    down = last + 1 - len(pairs)
    up = max(0, max(pair.sequence for pair in pairs) - last)
    if up + down != lost_count:
        return None, None, msg(f"{arg(lost_count - up - down)} packets at the end were lost in an unknown direction")
    return up, down, "by the reflector's sequence numbers"


def _frame_loss(loss: TrainLoss, gaps: Sequence[Silence]) -> FrameLoss:
    known_count, in_gaps = loss.sent - loss.in_flight, sum(gap.packets for gap in gaps)
    outside = known_count - in_gaps
    both = (loss.lost - in_gaps) / outside if outside else 0.0
    down_in_gaps = [gap.down for gap in gaps if gap.down is not None]
    if loss.up is None or loss.down is None or len(down_in_gaps) < len(gaps) or not outside:
        return FrameLoss(None, None, both, outside, in_gaps)
    # A packet that was overtaken may make a gap's share of one way too large by one.
    lost_down = max(0, loss.down - sum(down_in_gaps))
    lost_up = max(0, loss.lost - in_gaps - lost_down)
    reached_count = outside - lost_up
    return FrameLoss(lost_up / outside, lost_down / reached_count if reached_count else None, both, outside, in_gaps)


def _variation(
    pairs: Sequence[AnsweredPacket], delays: Sequence[tuple[int, int]], *, absolute: bool
) -> DelayVariation | None:
    """Return the delay variation; `delays` holds arrival time and relative delay per packet, in sending order."""
    if not delays:
        return None
    values = [delay / _SECOND for _, delay in delays]
    least = min(values)
    above = percentiles(value - least for value in values)
    if above is None:
        return None
    ipdv = sorted(
        abs(later - earlier)
        for (before, earlier), (after, later) in pairwise(zip(pairs, values, strict=True))
        if after.sequence == before.sequence + 1
    )
    jitters = _rfc3550([delay / _SECOND for _, delay in sorted(delays)])
    return DelayVariation(
        above_min=above,
        rfc3550_s=jitters[-1] if jitters else 0.0,
        rfc3550_mean_s=sum(jitters) / len(jitters) if jitters else 0.0,
        ipdv_p95_s=percentile(ipdv, 0.95) if ipdv else 0.0,
        delay=percentiles(values) if absolute else None,
    )


def _rfc3550(transits: Sequence[float]) -> list[float]:
    """Return the jitter estimate of RFC 3550 after each packet, in the order of arrival."""
    estimates, jitter = [], 0.0
    for earlier, later in pairwise(transits):
        jitter += (abs(later - earlier) - jitter) / 16
        estimates.append(jitter)
    return estimates


def _reorder_share(sequences: Sequence[int]) -> float | None:
    """Return the share of packets that arrived after one that was sent later."""
    if not sequences:
        return None
    next_sequence, reorder_count = 0, 0
    for sequence in sequences:
        if sequence < next_sequence:
            reorder_count += 1
        else:
            next_sequence = sequence + 1
    return reorder_count / len(sequences)


def _gaps(
    packets: Sequence[PacketSent], pairs: Sequence[AnsweredPacket], ended_at: int, counters: CounterSample | None
) -> ArrivalGaps:
    """Return the gaps between arrivals; first and last packet are assumed to arrive after the minimum round trip."""
    if not packets:
        return ArrivalGaps(0.0, tuple((limit, 0) for limit in GAPS_S), 0.0, open_end=False, at_most_s=None)
    least = min((pair.rtt for pair in pairs), default=0)
    arrivals = sorted(pair.arrived_at_ns for pair in pairs)
    first = packets[0].sent_at_ns + least
    last = min(packets[-1].sent_at_ns + least, ended_at)
    times = [
        first,
        *(arrival for arrival in arrivals if arrival >= first),
        max(last, arrivals[-1] if arrivals else last),
    ]
    gaps = [(later - earlier) / _SECOND for earlier, later in pairwise(times)]
    longest = max(gaps)
    ends = (pairs[0].sequence - packets[0].sequence, packets[-1].sequence - pairs[-1].sequence) if pairs else None
    at_most: float | None = None
    if ends is not None and ends[0] < responses.LEAST_GAP_PACKETS:
        if ends[1] < responses.LEAST_GAP_PACKETS:
            at_most = longest
        elif counters is not None:  # its answer was the first sign of life, and ended the stream
            at_most = max(longest, (ended_at - arrivals[-1]) / _SECOND)
    return ArrivalGaps(
        longest,
        tuple((limit, sum(1 for gap in gaps if gap > limit)) for limit in GAPS_S),
        sum(gap for gap in gaps if gap > 1),
        open_end=gaps[-1] >= longest > 0,
        at_most_s=at_most,
    )
