"""What came of a measured link: verdicts, the tables of the grids, and the exit code, all made of samples and run."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from decimal import ROUND_CEILING, Decimal
from typing import TYPE_CHECKING, Any, Final

from atlantis_netcfg.bearers.cost import size
from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.paths import from_home
from atlantis_netcfg.operations.qualify.measure import IDLE, LOADED
from atlantis_netcfg.qualify.figures import NoTrain, TrainFigures, train_figures
from atlantis_netcfg.qualify.grids import image_row, table, telemetry_row
from atlantis_netcfg.qualify.judgement import judge
from atlantis_netcfg.qualify.measured_run import Selection
from atlantis_netcfg.qualify.session import EndReason
from atlantis_netcfg.qualify.transfers import message_figures

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from atlantis_netcfg.operations.qualify.plan import RateCell
    from atlantis_netcfg.qualify.grids import RateRow
    from atlantis_netcfg.qualify.judgement import Judgement
    from atlantis_netcfg.qualify.measured_run import MeasuredRun
    from atlantis_netcfg.qualify.samples import Sample
    from atlantis_netcfg.qualify.search import SustainedRate

_UNDER_LOAD: Final = "buffer delay"
_CENT: Final = Decimal("0.01")


@dataclass(frozen=True, slots=True)
class QualifyResult:
    """One link."""

    run: MeasuredRun
    judged: tuple[Judgement, ...]
    rows: tuple[RateRow, ...]
    rates: tuple[SustainedRate, ...]
    folder: Path

    @property
    def exit(self) -> ExitCode:
        """0: all was measured, every criterion passed, and the way is proved. 7: nothing was sent. Else 6."""
        if not self.run.sent_bytes:
            return ExitCode.NOTHING
        passed = bool(self.judged) and all(each.verdict is Verdict.PASS for each in self.judged)
        whole = self.run.reason == EndReason.DONE and self.run.way is Verdict.PASS
        return ExitCode.DONE if passed and whole else ExitCode.CHECKS_FAILED

    def as_json(self) -> dict[str, Any]:
        """For `--json`."""
        return {
            "exit": int(self.exit),
            "folder": str(self.folder),
            "run": self.run.model_dump(mode="json"),
            "judged": [asdict(each) for each in self.judged],
            "rows": [asdict(row) for row in self.rows],
            "rates": [
                {
                    "size": each.size,
                    "rate_hz": each.rate_hz,
                    "limited_by": each.limited_by.value,
                    "proved": each.is_proved,
                }
                for each in self.rates
            ],
        }

    def lines(self) -> Iterator[str]:
        """What a person reads, within 80 columns but for reasons."""
        run = self.run
        yield f"{run.site}, {run.link}, against `{run.thresholds_name}`:"
        if run.emulated:
            yield "  emulated: these figures say nothing of a real link"
        for each in self.judged:
            measured = f"{_value(each.measured, each.unit):>9} {_limit(each):>12}"
            yield f"  {each.verdict.value:<12} {each.criterion:<38} {measured}"
            if each.verdict is not Verdict.PASS and each.reason != "beyond the limit":
                yield f"  {'':<12} {each.reason}"
        if not self.judged:
            yield f"  {Verdict.INCONCLUSIVE.value:<12} nothing was measured without load"
        yield f"  {run.way.value:<12} by the link that was meant"
        yield f"  {'':<12} {run.way_reason}"
        mtu = run.path_mtu_reason or f"{run.path_mtu_up} octets up, {run.path_mtu_both} both ways"
        yield f"  path MTU: {mtu}"
        for rate in self.rates:
            yield f"  {_rate(rate)}"
        if self.rows:
            yield from table(self.rows)
        for remark in run.remarks:
            yield f"  {remark}"
        yield f"  {_ended(run)}"
        yield f"  kept in {from_home(self.folder)}"


def result(
    run: MeasuredRun,
    samples: Sequence[Sample],
    cells: Sequence[RateCell],
    rates: Sequence[SustainedRate],
    folder: Path,
) -> QualifyResult:
    """Pure. What has no samples has no row."""
    idle, loaded = _train(samples, IDLE), _train(samples, LOADED)
    judged = () if idle is None else tuple(judge(idle, run.thresholds, loaded))
    if run.selection not in {Selection.THROUGHPUT, Selection.ALL}:
        judged = tuple(each for each in judged if not each.criterion.startswith(_UNDER_LOAD))
    return QualifyResult(run, judged, tuple(_rows(samples, cells, idle)), tuple(rates), folder)


def _train(samples: Sequence[Sample], stream: str) -> TrainFigures | None:
    try:
        return train_figures(samples, stream)
    except NoTrain:
        return None


def _rows(samples: Sequence[Sample], cells: Sequence[RateCell], idle: TrainFigures | None) -> Iterator[RateRow]:
    """Judge the cells that were sent; images of a size against the quickest median of their rates."""
    images = {
        cell.stream: found
        for cell in cells
        if cell.image is not None and (found := message_figures(samples, cell.stream)) is not None
    }
    for cell in cells:
        if cell.image is not None:
            if (figures := images.get(cell.stream)) is None:
                continue
            same = [images[each.stream].latency for each in cells if each.image == cell.image and each.stream in images]
            least = min((latency.p50 for latency in same if latency is not None), default=0.0)
            yield image_row(cell.image, cell.rate_hz, figures, least)
        elif (train := _train(samples, cell.stream)) is not None:
            yield telemetry_row(
                cell.octets, cell.rate_hz, train, 0.0 if idle is None or idle.rtt is None else idle.rtt.p50
            )


def _value(value: float | None, unit: str) -> str:
    return "?" if value is None else f"{value:.3g}{f' {unit}' if unit else ''}"


def _limit(judgement: Judgement) -> str:
    word = "at least" if judgement.criterion == "AVAIL" else "at most"
    return f"({word} {judgement.limit:g})"


def _rate(rate: SustainedRate) -> str:
    if rate.rate_hz is None:
        return f"highest rate of {rate.size} octets: none was sustained ({rate.limited_by})"
    least = "" if rate.is_proved else "at least "
    return f"highest rate of {rate.size} octets: {least}{rate.rate_hz:.3g} a second ({rate.limited_by})"


def _ended(run: MeasuredRun) -> str:
    seconds = 0.0 if run.ended is None else (run.ended - run.begun).total_seconds()
    why = {"done": "all was measured", "stopped": "stopped; what was measured is kept"}
    words = why.get(run.reason, f"the limit of {run.reason} was reached; what was measured is kept")
    cost = "" if run.price is None else f", {run.price.quantize(_CENT, ROUND_CEILING)} {run.currency}"
    return f"{words}: {size(run.sent_bytes)} up and {size(run.received_bytes)} down in {seconds:.0f} s{cost}"
