"""The highest rate of messages of a size that a link sustains, and what limits it.

From the first rate it is doubled until a window fails, then the step between the last good and the first bad rate is
halved three times. A window fails when more is lost than without load, when the 95th percentile of the latency leaves
its band, when the queue grows over the window, or when less arrives than was sent. The numbers are those of
docs/qualify.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Callable

    from atlantis_netcfg.qualify.transfers import MessageFigures

FIRST_HZ: Final = 0.5
HALVINGS: Final = 3
MAX_LOSS: Final = 0.01
MIN_LOST: Final = 2
"""One lost message is no rate."""
MIN_BAND_S: Final = 0.3
BAND: Final = 0.5
MIN_DELIVERED: Final = 0.97
GROWTH: Final = 0.25
"""Of the idle latency; see `MIN_GROWTH_S`."""
MIN_GROWTH_S: Final = 0.1


class RateLimit(StrEnum):
    """What keeps a link from a higher rate."""

    LOSS = "loss"
    LATENCY = "latency"
    QUEUE = "the queue grows"
    DELIVERY = "less arrives than is sent"
    SILENCE = "no answer"
    BUDGET = "the budget"
    HIGHEST = "no higher rate was tried"


@dataclass(frozen=True, slots=True)
class RateWindow:
    """What was seen at a rate; `failed`: why the link does not sustain it."""

    rate_hz: float
    figures: MessageFigures | None
    failed: RateLimit | None


@dataclass(frozen=True, slots=True)
class SustainedRate:
    """The result; `rate_hz` None: not even the first rate was sustained, or seen."""

    size: int
    rate_hz: float | None
    limited_by: RateLimit
    windows: tuple[RateWindow, ...]

    @property
    def is_proved(self) -> bool:
        """A rate was sustained, and a higher one was seen to fail."""
        return self.rate_hz is not None and self.limited_by not in {RateLimit.BUDGET, RateLimit.HIGHEST}


def failed(figures: MessageFigures, idle_latency_s: float, idle_loss: float) -> RateLimit | None:
    """Judge a window against the link without load; None: it is sustained."""
    latency = figures.latency
    if latency is None:
        return RateLimit.SILENCE
    missing = figures.lost + figures.unknown
    if missing >= MIN_LOST and figures.loss > idle_loss + MAX_LOSS:
        return RateLimit.LOSS
    if latency.p95 > idle_latency_s + max(MIN_BAND_S, BAND * idle_latency_s):
        return RateLimit.LATENCY
    if (figures.queue_growth_s or 0.0) > max(MIN_GROWTH_S, GROWTH * idle_latency_s):
        return RateLimit.QUEUE
    known = figures.sent - figures.in_flight
    if missing >= MIN_LOST and figures.received < MIN_DELIVERED * (1 - idle_loss) * known:
        return RateLimit.DELIVERY
    return None


def sustained_rate(  # noqa: PLR0913 - each has its name where it is given
    size: int,
    measure: Callable[[float], MessageFigures | None],
    *,
    idle_latency_s: float,
    idle_loss: float = 0.0,
    first_hz: float = FIRST_HZ,
    highest_hz: float = 64.0,
) -> SustainedRate:
    """Search. `measure` runs a window at a rate; None: the budget ended before it did.

    `idle_latency_s` is the median latency of single messages of this size, and `idle_loss` their loss, both without
    load.
    """
    windows: list[RateWindow] = []
    good: float | None = None
    bad: float | None = None
    limited_by, rate = RateLimit.HIGHEST, first_hz
    halvings = 0
    while rate <= highest_hz:
        figures = measure(rate)
        limit = RateLimit.BUDGET if figures is None else failed(figures, idle_latency_s, idle_loss)
        windows.append(RateWindow(rate, figures, limit))
        if limit is RateLimit.BUDGET:
            # A rate that was seen to fail is known, although the search for a better one did not end.
            return SustainedRate(size, good, limited_by if bad is not None else limit, tuple(windows))
        if limit is None:
            good = rate
        else:
            bad, limited_by = rate, limit
        if good is None:
            break
        if bad is None:
            rate *= 2
        elif halvings == HALVINGS:
            break
        else:
            halvings += 1
            rate = (good + bad) / 2
    return SustainedRate(size, good, limited_by, tuple(windows))


def loss_of_chunks(packet_loss: float, chunks: int) -> float:
    """Give the share of messages that lack a chunk, where packets are lost independently of each other."""
    return 1 - (1 - packet_loss) ** chunks
