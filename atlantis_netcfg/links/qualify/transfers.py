"""Figures of messages: what was received, how long it took, and the resulting rate."""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import fmean, linear_regression, median
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.links.qualify import figures
from atlantis_netcfg.links.qualify.samples import MessageDirection, MessageResult

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from atlantis_netcfg.links.qualify.samples import Sample

_SECOND: Final = 1_000_000_000
_FEWEST: Final = 3
"""Minimum number of messages for a standard error of queue growth."""
_FULL_SHARE: Final = 0.97
"""Offering less than this share of the plan does not fill the link; receiving more of the offer means no queue."""
_NEAR: Final = 0.75
"""Goodput above this share of a rate limit (which includes headers) means that the limit was reached."""


@dataclass(frozen=True, slots=True)
class MessageFigures:
    """The results of one stream's messages."""

    size: int
    chunks: int
    sent_count: int
    received_count: int
    """Number of messages that the receiver has reported as complete."""
    in_flight: int
    unknown: int
    """Number of messages without any response from the receiver: they may have arrived."""
    lost_count: int
    latency: figures.Percentiles | None
    """From the first `send` to the receiver's report of the last octet; down: from the request to that octet."""
    receiver_bps: float | None
    """Goodput by the receiver's count and clock, from first to last octet of all messages. None: too little data."""
    busy_bps: float | None
    """Goodput while a message arrives: median of the messages with more than one chunk."""
    packets: int
    """Number of packets of messages that are not in flight; `packets_lost` of them did not reach the receiver."""
    packets_lost: int
    delay_p95_s: float | None
    """95th percentile of the delay of a message's last received octet, minus the minimum. None: none arrived."""
    stretch: float | None
    """Relative excess of arrival time over sending time: above 0 if a queue grows. None: too few arrived."""
    stretch_error: float
    """Standard error of `stretch`."""
    far_rate_bps: float | None = None
    """Down: maximum rate of the far end. Goodput close to it does not describe the link."""

    offered_bps: float | None = None
    """Message octets that the sender began to send, as a rate; the last message is not included."""
    planned_bps: float | None = None
    """Planned rate; both this and `offered_bps` are None if not known."""

    def doubt(self, loss: float) -> str:
        """Return why the goodput does not describe the link, given its loss share without load; empty if it does."""
        offered_bps, planned_bps = self.offered_bps, self.planned_bps
        if offered_bps is None or planned_bps is None:
            return "the offered rate is unknown"
        if offered_bps < _FULL_SHARE * planned_bps:
            return msg(
                f"the sender fell behind: it offered {arg(offered_bps / 1000):.0f} of {arg(planned_bps / 1000):.0f} "
                "kbit/s"
            )
        if (self.receiver_bps or 0.0) > _FULL_SHARE * (1 - loss) * offered_bps:
            return "nothing queued: the link carried all that was offered"
        return ""

    @property
    def is_bounded(self) -> bool:
        """Whether the goodput is limited by the far end's sending rate rather than by the link."""
        limit, goodput = self.far_rate_bps, self.busy_bps
        return limit is not None and goodput is not None and goodput > _NEAR * limit

    @property
    def loss(self) -> float:
        """The share of lost and unknown messages among those not in flight."""
        known_count = self.sent_count - self.in_flight
        return (self.lost_count + self.unknown) / known_count if known_count else 0.0


def message_figures(samples: Iterable[Sample], stream: str) -> MessageFigures | None:
    """Compute the figures of one stream; None if it has sent no message."""
    results = sorted(
        (sample for sample in samples if isinstance(sample, MessageResult) and sample.stream == stream),
        key=lambda sample: sample.message,
    )
    if not results:
        return None
    ended_ones = [message for message in results if not message.in_flight]
    whole = [message for message in results if message.acknowledged_at_ns is not None]
    in_flight = sum(1 for message in results if message.in_flight)
    unknown = sum(1 for message in results if not message.in_flight and message.received_size is None)
    delays = [(m.sent_at_ns / _SECOND, (m.last_ns - m.sent_at_ns) / _SECOND) for m in ended_ones if m.last_ns]
    least = min((delay for _, delay in delays), default=0.0)
    above = figures.percentiles(delay - least for _, delay in delays)
    stretch, stretch_error = _delay_growth(delays)
    offered_bps, planned_bps = _offered_bps(results)
    return MessageFigures(
        size=results[0].size,
        chunks=results[0].chunks,
        sent_count=len(results),
        received_count=len(whole),
        in_flight=in_flight,
        unknown=unknown,
        lost_count=len(results) - len(whole) - in_flight - unknown,
        latency=figures.percentiles(_latencies(whole)),
        receiver_bps=_receiver_bps(results),
        busy_bps=_busy_bps(results),
        packets=sum(message.chunks for message in ended_ones),
        packets_lost=sum(message.chunks - _arrived_packets(message) for message in ended_ones),
        delay_p95_s=None if above is None else above.p95,
        stretch=stretch,
        stretch_error=stretch_error,
        far_rate_bps=next((message.far_rate_bps for message in results if message.far_rate_bps is not None), None),
        offered_bps=offered_bps,
        planned_bps=planned_bps,
    )


def _offered_bps(results: Sequence[MessageResult]) -> tuple[float | None, float | None]:
    """Return the offered and the planned rate between the first and the last message start."""
    is_down = results[0].direction == MessageDirection.DOWN
    starts = [
        (message.message, start)
        for message in results
        if (start := message.far_sent_ns if is_down else message.sent_at_ns) is not None
    ]
    if results[0].due_ns is None or len(starts) < 2:  # noqa: PLR2004 - a beginning and an end
        return None, None
    (first, begin), (last, end) = starts[0], starts[-1]
    bits, due_ns = (last - first) * results[0].size * 8 * _SECOND, (last - first) * results[0].due_ns
    return (bits / (end - begin), bits / due_ns) if end > begin else (None, None)


def _receiver_bps(results: Sequence[MessageResult]) -> float | None:
    """Return the receiving rate; time starts when the first packet is complete, so its octets do not count.

    The last of several messages is left out: it is not known whether a stopped sender ended it late.
    """
    counted_results = results[:-1] or results
    arrived_results = [
        message for message in counted_results if message.first_ns is not None and message.last_ns is not None
    ]
    if not arrived_results:
        return None
    first = min(message.first_ns or 0 for message in arrived_results)
    last = max(message.last_ns or 0 for message in arrived_results)
    octets = sum(message.received_size or 0 for message in arrived_results) - _first_chunk(arrived_results[0])
    return octets * 8 * _SECOND / (last - first) if last > first and octets > 0 else None


def _busy_bps(results: Sequence[MessageResult]) -> float | None:
    rates = sorted(
        (message.received_size - _first_chunk(message)) * 8 * _SECOND / (message.last_ns - message.first_ns)
        for message in results
        if message.first_ns and message.last_ns and message.received_size and message.last_ns > message.first_ns
    )
    return figures.percentile(rates, 0.5) if rates else None


def _first_chunk(message: MessageResult) -> int:
    """Return the octets of the first chunk: a message's time begins when they have arrived."""
    octets = message.chunk_size if message.chunk_size is not None else -(-message.size // message.chunks)
    return min(octets, message.size)


def _arrived_packets(message: MessageResult) -> int:
    return -(-(message.received_size or 0) // (message.chunk_size or -(-message.size // message.chunks)))


def _latencies(whole: Sequence[MessageResult]) -> list[float]:
    """Return the latencies without the wait for a lost acknowledgement: other messages give the return delay."""
    times = [(m, (m.acknowledged_at_ns or 0) - m.sent_at_ns, (m.last_ns or 0) - m.sent_at_ns) for m in whole]
    back = median(duration - there for _, duration, there in times) if times else 0
    return [
        (duration if message.chunks_sent <= message.chunks else min(duration, there + back)) / _SECOND
        for message, duration, there in times
    ]


def _delay_growth(delays: Sequence[tuple[float, float]]) -> tuple[float | None, float]:
    """Return the growth of the delay per second (least squares) and its standard error."""
    if len(delays) < _FEWEST or delays[0][0] == delays[-1][0]:
        return None, 0.0
    slope, first = linear_regression(*zip(*delays, strict=True))
    centre = fmean(start for start, _ in delays)
    squares = sum((delay - first - slope * start) ** 2 for start, delay in delays)
    spread = sum((start - centre) ** 2 for start, _ in delays)
    return slope, math.sqrt(squares / (len(delays) - 2) / spread)
