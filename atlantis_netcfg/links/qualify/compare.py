"""Comparison of measurement runs: the differences between two runs, and a link's figures over time.

A difference counts only beyond 5 %, or beyond the resolution of the figure: two runs of one link are never the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, msg

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from atlantis_netcfg.links.qualify.figures import TrainFigures
    from atlantis_netcfg.links.qualify.measured_run import MeasuredRun
    from atlantis_netcfg.links.qualify.record import QualifyRecord

ALIKE: Final = 0.05


class FigureTrend(StrEnum):
    """How a figure of the second run compares with that of the first."""

    BETTER = "better"
    WORSE = "worse"
    ALIKE = "same"
    UNKNOWN = "unknown"
    """At least one of the runs does not have this figure."""


@dataclass(frozen=True, slots=True)
class Headline:
    """A figure by which runs are compared."""

    key: str
    title: str
    unit: str
    """`s`, `bit/s`, `octets`, `1/min`, or empty for a share."""
    value: Callable[[QualifyRecord], float | None]
    higher_is_better: bool = False
    resolution: float = 0.0
    """Differences up to this value are not significant."""


def _idle_figure(record: QualifyRecord, take: Callable[[TrainFigures], float | None]) -> float | None:
    return None if record.idle is None else take(record.idle)


def loss_shares(figures: TrainFigures) -> tuple[float | None, float | None, float]:
    """Return the loss shares up (of sent), down (of arrived) and both ways together; None if not known."""
    loss = figures.loss
    known_count = loss.sent - loss.in_flight
    if loss.up is None or loss.down is None or not known_count:
        return None, None, loss.share
    reached_count = known_count - loss.up
    return loss.up / known_count, loss.down / reached_count if reached_count else None, loss.share


def _goodput(record: QualifyRecord, way: str) -> float | None:
    return next((row.goodput_bps for row in record.load if row.way == way and row.verdict is Verdict.PASS), None)


HEADLINES: Final = (
    Headline("rtt_p50", "round trip, median", "s", lambda r: _idle_figure(r, lambda t: t.rtt.p50 if t.rtt else None)),
    Headline("rtt_p95", "round trip, 95 %", "s", lambda r: _idle_figure(r, lambda t: t.rtt.p95 if t.rtt else None)),
    Headline("rpm_under_load", "RPM under load", "1/min", lambda r: r.rpm_under_load, higher_is_better=True),
    Headline("loss_up", "loss up", "", lambda r: _idle_figure(r, lambda t: loss_shares(t)[0]), resolution=0.002),
    Headline("loss_down", "loss down", "", lambda r: _idle_figure(r, lambda t: loss_shares(t)[1]), resolution=0.002),
    Headline(
        "loss",
        "loss, both directions together",
        "",
        lambda r: _idle_figure(r, lambda t: t.loss.share),
        resolution=0.002,
    ),
    Headline(
        "jitter_up",
        "jitter up (RFC 3550)",
        "s",
        lambda r: _idle_figure(r, lambda t: t.up.rfc3550_mean_s if t.up else None),
    ),
    Headline(
        "jitter_down",
        "jitter down (RFC 3550)",
        "s",
        lambda r: _idle_figure(r, lambda t: t.down.rfc3550_mean_s if t.down else None),
    ),
    Headline("longest_gap", "longest gap", "s", lambda r: _idle_figure(r, lambda t: t.gaps.longest_s), resolution=0.5),
    Headline("goodput_up", "goodput up", "bit/s", lambda r: _goodput(r, "up"), higher_is_better=True),
    Headline("goodput_down", "goodput down", "bit/s", lambda r: _goodput(r, "down"), higher_is_better=True),
    Headline("path_mtu_up", "path MTU up", "octets", lambda r: r.run.path_mtu_up, higher_is_better=True),
    Headline(
        "path_mtu_both", "path MTU, both directions", "octets", lambda r: r.run.path_mtu_both, higher_is_better=True
    ),
)


@dataclass(frozen=True, slots=True)
class FigureChange:
    """A figure of two runs."""

    key: str
    title: str
    unit: str
    first: float | None
    second: float | None
    difference: float | None
    """Relative difference: second minus first, divided by the first; None if that is not meaningful."""
    change: FigureTrend


@dataclass(frozen=True, slots=True)
class FactChange:
    """A circumstance of two runs; None if it was not recorded."""

    title: str
    first: str | None
    second: str | None


@dataclass(frozen=True, slots=True)
class RunComparison:
    """A comparison of two runs; `remarks` tell why they may not be comparable."""

    remarks: tuple[str, ...]
    figures: tuple[FigureChange, ...]
    facts: tuple[FactChange, ...] = ()
    """Facts that the devices reported at the time of each run, and the version of this program."""


def compare_runs(first: QualifyRecord, second: QualifyRecord) -> RunComparison:
    """Compare the figures of two runs."""
    return RunComparison(
        tuple(_remarks(first, second)),
        tuple(_change(item, item.value(first), item.value(second)) for item in HEADLINES),
        tuple(_facts(first.run, second.run)),
    )


def _facts(first: MeasuredRun, second: MeasuredRun) -> Iterator[FactChange]:
    facts = [{"tool": run.tool, "this computer's clock": clock_words(run), **run.facts} for run in (first, second)]
    for title in dict.fromkeys((*facts[0], *facts[1])):
        yield FactChange(title, facts[0].get(title), facts[1].get(title))


def clock_words(run: MeasuredRun) -> str:
    """Return the clock's synchronisation as text."""
    return "synchronised" if run.clock_synchronised else "unknown whether it is synchronised"


def _change(item: Headline, first: float | None, second: float | None) -> FigureChange:
    change, difference = FigureTrend.UNKNOWN, None
    if first is not None and second is not None:
        difference = (second - first) / first if first else None
        if abs(second - first) <= max(item.resolution, ALIKE * max(abs(first), abs(second))):
            change = FigureTrend.ALIKE
        else:
            change = FigureTrend.BETTER if (second > first) is item.higher_is_better else FigureTrend.WORSE
    return FigureChange(item.key, item.title, item.unit, first, second, difference, change)


def _remarks(first: QualifyRecord, second: QualifyRecord) -> Iterator[str]:
    earlier, later = first.run, second.run
    if earlier.link != later.link:
        yield msg(f"the links differ: {arg(earlier.link)} and {arg(later.link)}")
    if earlier.emulated != later.emulated:
        yield "one of them was measured over an emulated link: it does not apply to a real link"
    elif earlier.emulated:
        yield "both were measured over an emulated link: they do not apply to a real link"
    if earlier.far_end.over_vpn != later.far_end.over_vpn:
        yield "one of them went through the VPN, and the other did not"
    if (earlier.far_end.address, earlier.far_end.port) != (later.far_end.address, later.far_end.port):
        yield msg(f"the far ends differ: {arg(earlier.far_end.name)} and {arg(later.far_end.name)}")
    trains = [train for record in (first, second) if (train := record.idle) is not None]
    if len({(train.size, train.interval_s) for train in trains}) > 1:
        yield "the packet trains without load differ in size or interval"
    least = 0 if len(trains) < 2 else min(train.loss.sent for train in trains)  # noqa: PLR2004 - two runs
    if least < max(first.thresholds.min_samples, second.thresholds.min_samples):
        yield msg(f"one of them has only {arg(least)} packets without load")
