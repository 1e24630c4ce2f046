"""Figures of messages: what the receiver had, how long it took, and how much that is a second."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.qualify.figures import percentile, percentiles
from atlantis_netcfg.qualify.samples import MessageDirection, MessageEnded

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from atlantis_netcfg.qualify.figures import Percentiles
    from atlantis_netcfg.qualify.samples import Sample

_SECOND: Final = 1_000_000_000
_QUARTER: Final = 4
_KEPT: Final = 0.97
"""Of what was to be offered: less does not fill a link that carries as much. Of what was offered: more is all of it."""
_NEAR: Final = 0.75
"""Of a limit with headers: so much of it is goodput at least where the limit is reached."""


@dataclass(frozen=True, slots=True)
class MessageFigures:
    """What became of the messages of one stream."""

    size: int
    chunks: int
    sent: int
    received: int
    """The receiver said that it has all of them."""
    in_flight: int
    unknown: int
    """Not one word of the receiver came: they may have arrived."""
    lost: int
    latency: Percentiles | None
    """From the first `send` to the receiver's word that it has the last octet; down: from the request to that octet."""
    receiver_bps: float | None
    """Goodput by the receiver's count and clock, from the first octet of all messages to the last. None: too little."""
    busy_bps: float | None
    """Goodput while a message arrives: the median over the messages of more than one chunk."""
    queue_growth_s: float | None
    """How much longer the last quarter of the messages took than the first, by their medians."""
    far_rate_bps: float | None = None
    """Down: what the far end sends at most. Goodput that comes near it is no figure of the link."""

    offered_bps: float | None = None
    """Octets of messages that the sender began to send a second, those of the last one left out."""
    planned_bps: float | None = None
    """What it was to offer; both are None where that is not known."""

    def doubt(self, loss: float) -> str:
        """Why the goodput is no figure of a link that loses this share without load; empty: the load filled it."""
        offered, planned = self.offered_bps, self.planned_bps
        if offered is None or planned is None:
            return "what was offered is not known"
        if offered < _KEPT * planned:
            return f"the sender fell behind: it offered {offered / 1000:.0f} of {planned / 1000:.0f} kbit/s"
        if (self.receiver_bps or 0.0) > _KEPT * (1 - loss) * offered:
            return "nothing queued: the link carried all that was offered"
        return ""

    @property
    def is_bounded(self) -> bool:
        """Whether the goodput says what the far end sends at most, and nothing of the link."""
        limit, goodput = self.far_rate_bps, self.busy_bps
        return limit is not None and goodput is not None and goodput > _NEAR * limit

    @property
    def loss(self) -> float:
        """Lost and unknown ones of those that are not in flight."""
        known = self.sent - self.in_flight
        return (self.lost + self.unknown) / known if known else 0.0


def message_figures(samples: Iterable[Sample], stream: str) -> MessageFigures | None:
    """Make the figures of one stream; None: it has sent no message."""
    ended = sorted(
        (sample for sample in samples if isinstance(sample, MessageEnded) and sample.stream == stream),
        key=lambda sample: sample.message,
    )
    if not ended:
        return None
    whole = [message for message in ended if message.acknowledged_at_ns is not None]
    in_flight = sum(1 for message in ended if message.in_flight)
    unknown = sum(1 for message in ended if not message.in_flight and message.received_size is None)
    latencies = [
        (message.acknowledged_at_ns - message.sent_at_ns) / _SECOND
        for message in whole
        if message.acknowledged_at_ns is not None
    ]
    offered_bps, planned_bps = _offered_bps(ended)
    return MessageFigures(
        size=ended[0].size,
        chunks=ended[0].chunks,
        sent=len(ended),
        received=len(whole),
        in_flight=in_flight,
        unknown=unknown,
        lost=len(ended) - len(whole) - in_flight - unknown,
        latency=percentiles(latencies),
        receiver_bps=_receiver_bps(ended),
        busy_bps=_busy_bps(ended),
        queue_growth_s=_growth(latencies),
        far_rate_bps=next((message.far_rate_bps for message in ended if message.far_rate_bps is not None), None),
        offered_bps=offered_bps,
        planned_bps=planned_bps,
    )


def _offered_bps(ended: Sequence[MessageEnded]) -> tuple[float | None, float | None]:
    """From the first beginning of a message to the last one: what the sender offered, and what it was to."""
    is_down = ended[0].direction == MessageDirection.DOWN
    starts = [
        (message.message, start)
        for message in ended
        if (start := message.far_sent_ns if is_down else message.sent_at_ns) is not None
    ]
    if ended[0].due_ns is None or len(starts) < 2:  # noqa: PLR2004 - a beginning and an end
        return None, None
    (first, begin), (last, end) = starts[0], starts[-1]
    bits, due_ns = (last - first) * ended[0].size * 8 * _SECOND, (last - first) * ended[0].due_ns
    return (bits / (end - begin), bits / due_ns) if end > begin else (None, None)


def _receiver_bps(ended: Sequence[MessageEnded]) -> float | None:
    """The first message's octets are the fence post: the time begins when they begin to arrive."""
    arrived = [message for message in ended if message.first_ns is not None and message.last_ns is not None]
    if not arrived:
        return None
    first = min(message.first_ns or 0 for message in arrived)
    last = max(message.last_ns or 0 for message in arrived)
    octets = sum(message.received_size or 0 for message in arrived) - _first_chunk(arrived[0])
    return octets * 8 * _SECOND / (last - first) if last > first and octets > 0 else None


def _busy_bps(ended: Sequence[MessageEnded]) -> float | None:
    rates = sorted(
        (message.received_size - _first_chunk(message)) * 8 * _SECOND / (message.last_ns - message.first_ns)
        for message in ended
        if message.first_ns and message.last_ns and message.received_size and message.last_ns > message.first_ns
    )
    return percentile(rates, 0.5) if rates else None


def _first_chunk(message: MessageEnded) -> int:
    """Its octets: the clock of a message begins when they are there."""
    octets = message.chunk_size if message.chunk_size is not None else -(-message.size // message.chunks)
    return min(octets, message.size)


def _growth(latencies: Sequence[float]) -> float | None:
    quarter = len(latencies) // _QUARTER
    if not quarter:
        return None
    first, last = sorted(latencies[:quarter]), sorted(latencies[-quarter:])
    return percentile(last, 0.5) - percentile(first, 0.5)
