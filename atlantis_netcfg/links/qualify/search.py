"""Search for the highest rate of messages of one size that a link sustains, and for what limits it.

The rate is doubled from the first one until a window fails; then the step between the last good and the first bad rate
is halved four times, by their ratio. A window fails if more packets are lost than without load, if the 95th percentile
of the delay is out of bounds, or if the queue grows over the window. All criteria use packets, and messages that
arrived in part: on a lossy link a message of many packets is seldom complete. The numbers are those of
docs/engineers/qualify-method.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Callable

    from atlantis_netcfg.links.qualify.transfers import MessageFigures

FIRST_HZ: Final = 0.5
HALVINGS: Final = 4
MAX_LOSS: Final = 0.01
MIN_LOST: Final = 2
"""Losses that are tolerated beyond the expected ones: one lost message is not a loss rate."""
MIN_BAND_S: Final = 0.3
BAND: Final = 0.5
MAX_STRETCH: Final = 0.03
SURE: Final = 3
"""Number of standard errors above the limit from which a deviation is not attributed to chance."""


class RateLimit(StrEnum):
    """What prevents a higher rate on a link."""

    LOSS = "loss"
    LATENCY = "latency"
    QUEUE = "the queue grows"
    SILENCE = "no response"
    BUDGET = "the budget"
    HIGHEST = "no higher rate was tried"


@dataclass(frozen=True, slots=True)
class RateWindow:
    """The measurement at one rate; `find_limit` tells why the link does not sustain it."""

    rate_hz: float
    figures: MessageFigures | None
    limit: RateLimit | None


@dataclass(frozen=True, slots=True)
class SustainedRate:
    """The result of a search; `rate_hz` None: not even the first rate was sustained, or measured."""

    size: int
    rate_hz: float | None
    limited_by: RateLimit
    windows: tuple[RateWindow, ...]

    @property
    def is_proved(self) -> bool:
        """Whether a rate was sustained and a higher one measured as failing."""
        return self.rate_hz is not None and self.limited_by not in {RateLimit.BUDGET, RateLimit.HIGHEST}


def find_limit(figures: MessageFigures, idle_latency_s: float, idle_loss: float) -> RateLimit | None:
    """Return why a window fails compared with the idle link and its loss share; None if it is sustained."""
    if figures.delay_p95_s is None:
        return RateLimit.SILENCE
    expected_loss = (idle_loss + MAX_LOSS) * figures.packets
    if figures.packets_lost > expected_loss + SURE * math.sqrt(expected_loss) + MIN_LOST:
        return RateLimit.LOSS
    if (figures.stretch or 0.0) > max(MAX_STRETCH, SURE * figures.stretch_error):
        return RateLimit.QUEUE
    return RateLimit.LATENCY if figures.delay_p95_s > max(MIN_BAND_S, BAND * idle_latency_s) else None


def sustained_rate(  # noqa: PLR0913 - each has its name where it is given
    size: int,
    measure: Callable[[float], MessageFigures | None],
    *,
    idle_latency_s: float,
    idle_loss: float = 0.0,
    first_hz: float = FIRST_HZ,
    highest_hz: float = 64.0,
) -> SustainedRate:
    """Search for the highest sustained rate; `measure` runs a window, or returns None if the budget ended first.

    `idle_latency_s` is the median latency of single messages of this size, and `idle_loss` the share of packets lost,
    both without load.
    """
    windows: list[RateWindow] = []
    good: float | None = None
    bad: float | None = None
    limited_by, rate = RateLimit.HIGHEST, min(first_hz, highest_hz)
    halvings = 0
    while True:
        figures = measure(rate)
        limit = RateLimit.BUDGET if figures is None else find_limit(figures, idle_latency_s, idle_loss)
        windows.append(RateWindow(rate, figures, limit))
        if limit is RateLimit.BUDGET:
            # A rate that was seen to fail is known, although the search for a better one did not end.
            return SustainedRate(size, good, limited_by if bad is not None else limit, tuple(windows))
        if limit is None:
            good = rate
        else:
            bad, limited_by = rate, limit
        if good is None or halvings == HALVINGS or (bad is None and rate >= highest_hz):
            return SustainedRate(size, good, limited_by, tuple(windows))
        if bad is None:
            rate = min(2 * rate, highest_hz)
        else:
            halvings += 1
            rate = math.sqrt(good * bad)
