"""The record of a run: figures from its samples and `run.json`, and verdicts against named thresholds.

Nothing is measured here, and `record.json` contains nothing that cannot be computed again: it is the same for the same
samples and thresholds. Its format is the JSON Schema of `QualifyRecord`; docs/engineers/qualify-method.md explains
the fields.
"""

from __future__ import annotations

import re
from collections import defaultdict
from dataclasses import asdict, dataclass, replace
from decimal import Decimal  # noqa: TC003 - dataclasses in a model
from math import isclose
from typing import TYPE_CHECKING, Final, Literal

from atlantis_netcfg.core.events import Verdict, worst
from atlantis_netcfg.core.message_models import MessageModel
from atlantis_netcfg.links.cost import bill
from atlantis_netcfg.links.qualify import grids, judgement, search
from atlantis_netcfg.links.qualify.budget import IPV4_HEADERS
from atlantis_netcfg.links.qualify.figures import Percentiles, TrainFigures, train_figures
from atlantis_netcfg.links.qualify.measured_run import MeasuredRun, Selection
from atlantis_netcfg.links.qualify.messages import MessagePlan
from atlantis_netcfg.links.qualify.samples import StreamEnd, TrainBegan
from atlantis_netcfg.links.qualify.session import EndReason, TrainPlan
from atlantis_netcfg.links.qualify.transfers import message_figures

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from atlantis_netcfg.links.qualify.samples import Sample
    from atlantis_netcfg.links.qualify.transfers import MessageFigures

VERSION: Final = 1
MB: Final = 1_000_000
_HOUR_S: Final = 3600
_TELEMETRY: Final = re.compile(r"telemetry (\d+) (\S+)")
_IMAGE: Final = re.compile(r"image (.+) (\S+)")
_RATE: Final = re.compile(r"rate (\d+) (\S+)")
_WITH_LOAD: Final = frozenset({Selection.THROUGHPUT, Selection.ALL})
_UNDER_LOAD: Final = "buffer delay"
"""Prefix of the criterion that needs a load."""
FAR_END_LIMIT: Final = "limited by the far end's sending rate: the link may carry more"
_NO_REFERENCE: Final = "no measurement without load to compare with"


@dataclass(frozen=True, slots=True)
class MeasuredRate(grids.RateRow):
    """A size at a rate, as `grids` judges it."""

    mb_per_hour: float
    """Volume on the wire in both directions, IP and UDP headers included, if nothing is lost."""
    price_per_hour: Decimal | None
    """Price of one hour as a separate session, in the currency of the run's tariff; None: no tariff is declared."""


@dataclass(frozen=True, slots=True)
class LoadRow:
    """The receiver's result for the messages that filled the link in one direction."""

    way: Literal["up", "down"]
    size: int
    sent: int
    received: int
    lost: int
    """Lost messages, including those of which the receiver reported nothing."""
    in_flight: int
    goodput_bps: float | None
    """Goodput by the receiver's count and clock."""
    latency: Percentiles | None
    offered_bps: float | None
    """Rate that the sender offered, in message octets; None: not known."""
    verdict: Verdict
    """INCONCLUSIVE: the load did not fill the link, so the goodput is not that of the link; `doubt` says why."""
    doubt: str


@dataclass(frozen=True, slots=True)
class RateStep:
    """One step of the rate search; `failed` gives the reason if the link does not sustain the rate."""

    rate_hz: float
    sent: int
    received: int
    loss: float
    p95_s: float | None
    failed: str


@dataclass(frozen=True, slots=True)
class HighestRate:
    """The highest message rate that the link sustains at one message size."""

    size: int
    label: str
    rate_hz: float | None
    """None: even the lowest rate failed, or nothing was observed."""
    limited_by: search.RateLimit
    proved: bool
    """Whether a higher rate was observed to fail."""
    reference_s: float
    """Latency without load, with which the latencies are compared."""
    mb_per_hour: float | None
    price_per_hour: Decimal | None
    steps: tuple[RateStep, ...]


class QualifyRecord(MessageModel):
    """`record.json`."""

    version: int = VERSION
    samples_sha256: str
    """SHA-256 of `samples.jsonl`."""
    run: MeasuredRun
    thresholds_name: str
    """Name of the thresholds for these verdicts; those of the run itself are in `run`."""
    thresholds: judgement.QualifyProfile
    idle: TrainFigures | None
    """Figures of the train without load; None: the run has none."""
    under_load: TrainFigures | None
    rpm_under_load: float | None
    """Latency under load as one number: round trips per minute, higher is better."""
    load: tuple[LoadRow, ...]
    telemetry: tuple[MeasuredRate, ...]
    images: tuple[MeasuredRate, ...]
    highest_rates: tuple[HighestRate, ...]
    grid_note: str = grids.SHAPE_UNKNOWN
    wire_bytes: int
    """Bytes sent and received, by this computer's count; the router's counts are in `run.counts`."""
    mb_per_hour: float | None
    """Volume per hour of the run itself; that of a size and rate is in its row."""
    judgements: tuple[judgement.Judgement, ...]
    """Judgements by the thresholds, of the figures without load, and under load if a load was planned."""
    verdict: Verdict
    """Worst of the judgements, `load` and `run.way`; INCONCLUSIVE if the run has no judgement or was cut short."""


def make_record(
    run: MeasuredRun,
    samples: Iterable[Sample],
    digest: str = "",
    thresholds: tuple[str, judgement.QualifyProfile] | None = None,
) -> QualifyRecord:
    """Compute the record of a run; `digest`: SHA-256 of the samples; `thresholds`: replace the run's, with a name."""
    streams: dict[str, list[Sample]] = defaultdict(list)
    for sample in samples:
        streams[sample.stream].append(sample)
    trains = {name: train_figures(mine, name) for name, mine in streams.items() if isinstance(mine[0], TrainBegan)}
    messages = {name: figures for name, mine in streams.items() if (figures := message_figures(mine, name)) is not None}
    run_streams = _RunStreams(
        run, trains, messages, {name: _reason(mine) for name, mine in streams.items()}, _header_size(streams)
    )
    idle, under_load = trains.get("idle"), trains.get("loaded")
    name, limits = thresholds or (run.thresholds_name, run.thresholds)
    judgements = tuple(judgement.judge(idle, limits, under_load, messages.get("load up"))) if idle is not None else ()
    load = tuple(run_streams.load())
    if run.selection not in _WITH_LOAD:
        judgements = tuple(item for item in judgements if not item.criterion.startswith(_UNDER_LOAD))
    has_ended = run.reason == EndReason.DONE and idle is not None and idle.reason == EndReason.DONE
    whole = Verdict.PASS if has_ended else Verdict.INCONCLUSIVE
    seconds = (run.ended - run.begun).total_seconds() if run.ended is not None else 0.0
    wire = run.sent_bytes + run.received_bytes
    return QualifyRecord(
        samples_sha256=digest,
        run=run,
        thresholds_name=name,
        thresholds=limits,
        idle=idle,
        under_load=under_load,
        rpm_under_load=under_load.rpm if under_load is not None else None,
        load=load,
        telemetry=tuple(run_streams.telemetry()),
        images=tuple(run_streams.images()),
        highest_rates=tuple(run_streams.highest_rates()),
        wire_bytes=wire,
        mb_per_hour=wire / MB / seconds * _HOUR_S if seconds > 0 else None,
        judgements=judgements,
        verdict=worst([whole, run.way, *(item.verdict for item in judgements), *(row.verdict for row in load)])
        if judgements
        else Verdict.INCONCLUSIVE,
    )


def _reason(samples: Sequence[Sample]) -> str:
    """Return why a stream ended."""
    return next((sample.reason for sample in samples if isinstance(sample, StreamEnd)), "cut off")


def _header_size(streams: Mapping[str, Sequence[Sample]]) -> int:
    trains = (mine[0] for mine in streams.values())
    return next((train.headers for train in trains if isinstance(train, TrainBegan)), IPV4_HEADERS)


@dataclass(frozen=True, slots=True)
class _RunStreams:
    """The streams of a run by their names."""

    run: MeasuredRun
    trains: Mapping[str, TrainFigures]
    messages: Mapping[str, MessageFigures]
    reasons: Mapping[str, str]
    headers: int

    def load(self) -> Iterable[LoadRow]:
        ways: tuple[Literal["up", "down"], ...] = ("up", "down")
        for way in ways:
            figures, idle = self.messages.get(f"load {way}"), self.trains.get("idle")
            if figures is not None:
                loss = 0.0 if idle is None else idle.flr.share_up if way == "up" else idle.flr.down or idle.flr.both
                doubt = FAR_END_LIMIT if figures.is_bounded else figures.doubt(loss)
                yield LoadRow(
                    way,
                    figures.size,
                    figures.sent_count,
                    figures.received_count,
                    figures.lost_count + figures.unknown,
                    figures.in_flight,
                    figures.receiver_bps,
                    figures.latency,
                    figures.offered_bps,
                    Verdict.INCONCLUSIVE if doubt or figures.receiver_bps is None else Verdict.PASS,
                    doubt,
                )

    def telemetry(self) -> Iterable[MeasuredRate]:
        idle = self.trains.get("idle")
        reference = None if idle is None or idle.rtt is None else idle.rtt.p50
        for name, figures in self.trains.items():
            if (match := _TELEMETRY.fullmatch(name)) is not None:
                octets, rate_hz = int(match[1]), float(match[2])
                row = grids.telemetry_row(octets, rate_hz, figures, reference or 0.0)
                plan = TrainPlan(figures.size, 1 / rate_hz, _HOUR_S)
                yield self._grid_row(name, row, reference, grids.train_bytes(plan, self.headers))

    def images(self) -> Iterable[MeasuredRate]:
        image_by_label = {image.label: image for image in grids.IMAGES}
        for name, figures in self.messages.items():
            if (match := _IMAGE.fullmatch(name)) is not None and match[1] in image_by_label:
                rate_hz, reference = float(match[2]), self._reference(figures.size)
                row = grids.image_row(image_by_label[match[1]], rate_hz, figures, reference or 0.0)
                yield self._grid_row(name, row, reference, self._message_bytes(figures.size, rate_hz))

    def _grid_row(self, name: str, row: grids.RateRow, reference: float | None, hour_bytes: int) -> MeasuredRate:
        """Return a grid row; its verdict is INCONCLUSIVE without a reference or if the stream ended early."""
        reason = self.reasons[name]
        if row.verdict is not Verdict.INCONCLUSIVE and reference is None:
            row = replace(row, verdict=Verdict.INCONCLUSIVE, reason=_NO_REFERENCE)
        elif row.verdict is Verdict.PASS and reason != EndReason.DONE:
            row = replace(row, verdict=Verdict.INCONCLUSIVE, reason=f"ended early: {reason}")
        return MeasuredRate(**asdict(row), mb_per_hour=hour_bytes / MB, price_per_hour=self._price(hour_bytes))

    def _price(self, hour_bytes: int) -> Decimal | None:
        tariff = self.run.tariff
        return None if tariff is None else bill(hour_bytes, _HOUR_S, tariff).price

    def _message_bytes(self, size: int, rate_hz: float) -> int:
        return grids.message_bytes(MessagePlan(size, rate_hz, _HOUR_S), self.headers)

    def _reference(self, size: int) -> float | None:
        """Return the median latency without load: of single messages, else the lowest median of this size's rates."""
        single = self.messages.get(f"rate {size} 0")
        if single is not None and single.latency is not None:
            return single.latency.p50
        medians = [
            figures.latency.p50
            for name, figures in self.messages.items()
            if name.startswith(("image ", "rate ")) and figures.size == size and figures.latency is not None
        ]
        return min(medians, default=None)

    def highest_rates(self) -> Iterable[HighestRate]:
        idle = self.trains.get("idle")
        rates: dict[int, dict[float, MessageFigures]] = defaultdict(dict)
        for name, figures in self.messages.items():
            match = _RATE.fullmatch(name)
            if match is not None and float(match[2]) > 0 and self.reasons[name] == EndReason.DONE:
                rates[int(match[1])][float(match[2])] = figures
        for size, windows in sorted(rates.items()):
            single, reference = self.messages.get(f"rate {size} 0"), self._reference(size)
            if single is not None and single.latency is None:
                reference = 0.0  # as the search had it: no single message was whole
            if reference is not None:
                idle_loss = 0.0 if idle is None else idle.flr.share_up
                yield self._highest_rate(windows, reference, idle_loss)

    def _highest_rate(self, windows: Mapping[float, MessageFigures], reference: float, idle_loss: float) -> HighestRate:
        """Repeat the search over its measured windows: each is judged again by the same rules."""
        first = next(iter(windows.values()))

        def find_window(rate_hz: float) -> MessageFigures | None:
            # The names of streams have six digits of a rate.
            return next((figures for rate, figures in windows.items() if isclose(rate, rate_hz, rel_tol=1e-4)), None)

        search_result = search.sustained_rate(
            first.size,
            find_window,
            idle_latency_s=reference,
            idle_loss=idle_loss,
            first_hz=min(windows),
        )
        limited_by = search_result.limited_by
        if limited_by is search.RateLimit.BUDGET and self.run.reason == EndReason.DONE:
            limited_by = search.RateLimit.HIGHEST
        hour_bytes = None if search_result.rate_hz is None else self._message_bytes(first.size, search_result.rate_hz)
        label = next((image.label for image in grids.IMAGES if image.octets == first.size), f"{first.size} B")
        return HighestRate(
            first.size,
            label,
            search_result.rate_hz,
            limited_by,
            search_result.is_proved,
            reference,
            None if hour_bytes is None else hour_bytes / MB,
            None if hour_bytes is None else self._price(hour_bytes),
            tuple(_steps(search_result)),
        )


def _steps(result: search.SustainedRate) -> Iterable[RateStep]:
    for window in result.windows:
        figures = window.figures
        if figures is not None:
            latency = figures.latency
            yield RateStep(
                window.rate_hz,
                figures.sent_count - figures.in_flight,
                figures.received_count,
                figures.loss,
                None if latency is None else latency.p95,
                "" if window.limit is None else window.limit.value,
            )
