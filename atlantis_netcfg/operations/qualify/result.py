"""Text, JSON and exit code of a measured link, all computed from its record."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from decimal import ROUND_CEILING, Decimal
from typing import TYPE_CHECKING, Any, Final

from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.core.paths import shorten_home
from atlantis_netcfg.links.cost import size
from atlantis_netcfg.links.qualify.grids import table
from atlantis_netcfg.links.qualify.session import EndReason
from atlantis_netcfg.operations.qualify.measure import CUT_OFF

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from atlantis_netcfg.core.errors import NetcfgError
    from atlantis_netcfg.links.qualify.judgement import Judgement
    from atlantis_netcfg.links.qualify.measured_run import MeasuredRun
    from atlantis_netcfg.links.qualify.record import HighestRate, QualifyRecord

_CENT: Final = Decimal("0.01")


@dataclass(frozen=True, slots=True)
class QualifyResult:
    """The result of measuring one link."""

    record: QualifyRecord
    folder: Path
    failure: NetcfgError | None = None
    """Error that ended the measurement early; None: no error."""

    @property
    def run(self) -> MeasuredRun:
        """The metadata of the run."""
        return self.record.run

    @property
    def exit(self) -> ExitCode:
        """The exit code: 0 if all criteria passed and the route is proved, 7 if nothing was sent, else 6.

        If an error ended the run, the error's code.
        """
        if self.failure is not None:
            return self.failure.exit
        if not self.run.sent_bytes:
            return ExitCode.NOTHING
        return ExitCode.DONE if self.record.verdict is Verdict.PASS else ExitCode.CHECKS_FAILED

    def as_json(self) -> dict[str, Any]:
        """Return JSON-able data."""
        return {
            "exit": int(self.exit),
            "folder": str(self.folder),
            "error": None if self.failure is None else str(self.failure),
            "run": self.run.model_dump(mode="json"),
            "judged": [asdict(each) for each in self.record.judgements],
            "load": [asdict(row) for row in self.record.load],
            "rows": [asdict(row) for row in (*self.record.telemetry, *self.record.images)],
            "rates": [
                {
                    "size": each.size,
                    "rate_hz": each.rate_hz,
                    "limited_by": each.limited_by.value,
                    "proved": each.proved,
                }
                for each in self.record.highest_rates
            ],
        }

    def lines(self) -> Iterator[str]:
        """Yield the report's lines, within 80 columns except for reasons."""
        run = self.run
        yield msg(f"{arg(run.site)}, {arg(run.link)}, against `{arg(run.thresholds_name)}`:")
        if run.emulated:
            yield "  emulated: these figures prove nothing about a real link"
        for each in self.record.judgements:
            yield msg(
                f"  {arg(each.verdict.value):<12} {arg(each.criterion):<38} "
                f"{arg(_value(each.measured, each.unit)):>9} {arg(_limit(each)):>12}"
            )
            if each.verdict is not Verdict.PASS and each.reason != "beyond the limit":
                yield msg(f"  {'':<12} {arg(each.reason)}")
        if not self.record.judgements:
            yield msg(f"  {arg(Verdict.INCONCLUSIVE.value):<12} nothing was measured without load")
        yield msg(f"  {arg(run.way.value):<12} over the intended link")
        yield msg(f"  {'':<12} {arg(run.way_reason)}")
        mtu = run.path_mtu_reason or msg(
            f"{arg(run.path_mtu_up)} octets up, {arg(run.path_mtu_both)} in both directions"
        )
        yield msg(f"  path MTU: {arg(mtu)}")
        for row in self.record.load:
            had = msg("nothing received" if row.goodput_bps is None else f"{arg(row.goodput_bps / 1000):.0f} kbit/s")
            yield msg(f"  {arg(row.verdict.value):<12} goodput {arg(row.way)}, at the receiver: {arg(had)}")
            if row.doubt:
                yield msg(f"  {'':<12} {arg(row.doubt)}")
        for rate in self.record.highest_rates:
            yield msg(f"  {arg(_rate(rate))}")
        if rows := (*self.record.telemetry, *self.record.images):
            yield from table(rows)
        for remark in run.remarks:
            yield msg(f"  {'error: ' if self.failure is not None and remark == str(self.failure) else ''}{arg(remark)}")
        yield msg(f"  {arg(_end_line(run))}")
        yield msg(f"  saved in {arg(shorten_home(self.folder))}")


def _value(value: float | None, unit: str) -> str:
    return "?" if value is None else f"{value:.3g}{f' {unit}' if unit else ''}"


def _limit(judgement: Judgement) -> str:
    word = "at least" if judgement.criterion == "AVAIL" else "at most"
    return msg(f"({arg(word)} {arg(judgement.limit):g})")


def _rate(rate: HighestRate) -> str:
    if rate.rate_hz is None:
        return msg(f"maximum rate of {arg(rate.size)} octets: none was sustained ({arg(rate.limited_by)})")
    least = "" if rate.proved else "at least "
    return msg(
        f"maximum rate of {arg(rate.size)} octets: {arg(least)}{arg(rate.rate_hz):.3g} per second "
        f"({arg(rate.limited_by)})"
    )


def _end_line(run: MeasuredRun) -> str:
    seconds = 0.0 if run.ended is None else (run.ended - run.begun).total_seconds()
    why = {
        EndReason.DONE: "measurement complete",
        EndReason.STOPPED: "stopped; results so far are saved",
        EndReason.LEFT_OUT: "at its rate in the inventory the link supports none of the sizes and rates",
        EndReason.SILENT: "no response, so the rest was skipped",
        CUT_OFF: "ended early",
    }
    words = why.get(run.reason, msg(f"the limit of {arg(run.reason)} was reached; what was measured is kept"))
    cost = ""
    if run.price is not None:
        would = "a real link would have cost " if run.emulated else ""
        cost = msg(f", {arg(would)}{arg(run.price.quantize(_CENT, ROUND_CEILING))} {arg(run.currency)}")
    return msg(
        f"{arg(words)}: {arg(size(run.sent_bytes))} up and {arg(size(run.received_bytes))} down in {arg(seconds):.0f} "
        f"s{arg(cost)}"
    )
