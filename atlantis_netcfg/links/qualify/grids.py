"""Test grids assumed for Tables 33 and 34 of the report: small telemetry and images, each size at each rate.

Their form is unknown: only their titles survive, so every page that shows a grid shows `SHAPE_UNKNOWN` with it.
Contents do not matter on the wire. A telemetry message of a given size is a test packet with the octets that RTPS would
add; images are random octets of a nominal JPEG size, labelled with the picture that they represent, sent in chunks and
not resent.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.links.qualify import search
from atlantis_netcfg.links.qualify.messages import DEFAULT_PACKET, MessagePlan
from atlantis_netcfg.links.qualify.reflector import stamp
from atlantis_netcfg.links.qualify.session import TrainPlan

if TYPE_CHECKING:
    from collections.abc import Sequence

    from atlantis_netcfg.links.qualify.figures import TrainFigures
    from atlantis_netcfg.links.qualify.transfers import MessageFigures

SHAPE_UNKNOWN: Final = (
    "Only the titles of Tables 33 and 34 of the report are known; these sizes and rates are a proposal."
)
RTPS_OCTETS: Final = 72
"""Octets that RTPS adds to a small sample: 60 to 80 were measured."""
FEW: Final = "few messages"
"""Reason: messages exceed the loss limit, but too few to decide; neither a failure nor proof."""
GAP: Final = "a gap of the link"
"""Reason: a gap of the link caused loss, independent of size and rate."""
LEAST_PACKETS: Final = 10
"""Minimum number of packets of a train for a judgement; fewer prove no sustained rate."""
TELEMETRY_SIZES: Final = (32, 128, 512)
TELEMETRY_RATES_HZ: Final = (1.0, 2.0, 4.0, 10.0)
IMAGE_RATES_HZ: Final = (0.2, 1.0, 2.0, 5.0)


@dataclass(frozen=True, slots=True)
class NominalImage:
    """A picture by pixels and JPEG quality; its size in octets is nominal, from typical bits per pixel."""

    width: int
    height: int
    quality: int

    @property
    def octets(self) -> int:
        """Nominal size: 0.6 bits a pixel at quality 30, and 1 at 60."""
        return round(self.width * self.height * {30: 0.6, 60: 1.0}[self.quality] / 8)

    @property
    def label(self) -> str:
        """The picture's label in a table."""
        return f"{self.width}x{self.height} q{self.quality}"


IMAGES: Final = tuple(
    NominalImage(width, height, quality)
    for width, height in ((160, 120), (320, 240), (640, 480))
    for quality in (30, 60)
)


@dataclass(frozen=True, slots=True)
class RateRow:
    """The result of one size at one rate; losses are shares, None if not known per direction."""

    label: str
    octets: int
    rate_hz: float
    sent: int
    received: int
    loss_up: float | None
    loss_down: float | None
    p50_s: float | None
    p95_s: float | None
    verdict: Verdict
    reason: str


def telemetry_plan(octets: int, rate_hz: float, duration_s: float) -> TrainPlan:
    """Return a train of test packets as long as a sample of this size with RTPS, but at least an empty test packet."""
    return TrainPlan(max(stamp.AUTHENTICATED_SIZE, octets + RTPS_OCTETS), 1 / rate_hz, duration_s)


def image_plan(image: NominalImage, rate_hz: float, duration_s: float) -> MessagePlan:
    """Return a best-effort stream of images."""
    return MessagePlan(image.octets, rate_hz, duration_s)


def train_bytes(plan: TrainPlan, headers: int) -> int:
    """Return the bytes of a train on the wire, both ways together, without its request for counters."""
    return 2 * plan.packets * (plan.size + headers)


def message_bytes(plan: MessagePlan, headers: int) -> int:
    """Return the bytes of authenticated messages on the wire without loss, both ways together."""
    packet = min(plan.packet, DEFAULT_PACKET)
    room = stamp.chunk_room(packet, is_authenticated=True)
    answer = stamp.extended_size(is_authenticated=True) + stamp.ACKNOWLEDGEMENT_SIZE
    chunks = -(-plan.size // room)
    return plan.messages * (plan.size + chunks * (packet - room + headers) + answer + headers)


def telemetry_row(octets: int, rate_hz: float, figures: TrainFigures, idle_p50_s: float) -> RateRow:
    """Judge a train of the grid: at most 1 % loss each way outside of gaps, and the round trip within limits."""
    loss, flr, rtt = figures.loss, figures.flr, figures.rtt
    known_count = loss.sent - loss.in_flight
    up = None if loss.up is None or not known_count else loss.up / known_count
    reached_count = known_count - (loss.up or 0)
    down = None if loss.down is None or not reached_count else loss.down / reached_count
    verdict, reason = Verdict.PASS, "sustained"
    if rtt is None or not known_count:
        verdict, reason = Verdict.INCONCLUSIVE, "no responses"
    elif loss.limited:
        verdict, reason = Verdict.INCONCLUSIVE, "the reflector refused packets above its rate limit"
    elif (lossy := max(flr.both if flr.up is None else flr.up, flr.down or 0.0) > search.MAX_LOSS) and (
        loss.lost - flr.in_gaps >= search.MIN_LOST
    ):
        verdict, reason = Verdict.FAIL, "loss"
    elif rtt.p95 > idle_p50_s + max(search.MIN_BAND_S, search.BAND * idle_p50_s):
        verdict, reason = Verdict.FAIL, "latency"
    elif flr.in_gaps:
        verdict, reason = Verdict.INCONCLUSIVE, GAP
    elif lossy or known_count < LEAST_PACKETS:
        verdict, reason = Verdict.INCONCLUSIVE, FEW
    return RateRow(
        f"{octets} B",
        octets,
        rate_hz,
        known_count,
        loss.received,
        up,
        down,
        rtt.p50 if rtt is not None else None,
        rtt.p95 if rtt is not None else None,
        verdict,
        reason,
    )


def image_row(image: NominalImage, rate_hz: float, figures: MessageFigures, idle_latency_s: float) -> RateRow:
    """Judge a stream of the grid by the criteria of the rate search and by its incomplete messages."""
    has_loss = figures.lost_count + figures.unknown >= search.MIN_LOST and figures.loss > search.MAX_LOSS
    limit = search.RateLimit.LOSS if has_loss else search.find_limit(figures, idle_latency_s, 0.0)
    latency = figures.latency
    verdict, reason = Verdict.PASS, "sustained"
    if limit is not None:
        verdict, reason = Verdict.INCONCLUSIVE if latency is None else Verdict.FAIL, limit.value
    elif figures.loss > search.MAX_LOSS:
        verdict, reason = Verdict.INCONCLUSIVE, FEW
    return RateRow(
        image.label,
        figures.size,
        rate_hz,
        figures.sent_count - figures.in_flight,
        figures.received_count,
        figures.loss,
        None,
        None if latency is None else latency.p50,
        None if latency is None else latency.p95,
        verdict,
        reason,
    )


def table(rows: Sequence[RateRow]) -> list[str]:
    """Render the rows as text within 80 columns."""
    lines = [SHAPE_UNKNOWN, "size          octets    Hz  sent  recv   up% down%  p50 s  p95 s  verdict"]
    lines += [
        msg(
            f"{arg(row.label):<13}{arg(row.octets):>7}{arg(row.rate_hz):>6g}{arg(row.sent):>6}{arg(row.received):>6}"
            f"{arg(_percent(row.loss_up)):>6}{arg(_percent(row.loss_down)):>6}{arg(_seconds(row.p50_s)):>7}"
            f"{arg(_seconds(row.p95_s)):>7}  {arg(row.verdict.value)}"
        )
        for row in rows
    ]
    return lines


def _percent(share: float | None) -> str:
    return "?" if share is None else f"{100 * share:.1f}"


def _seconds(value: float | None) -> str:
    return "?" if value is None else f"{value:.2f}"
