"""Measurement of several links of a site, one by one, within common limits.

A link that is down, or whose router has not responded, does not prevent the measurement of others. A person's stop ends
all, and so does a limit that is used up, or a router that does not confirm the removal of the rows.
"""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.core import errors
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.links.cost import bill
from atlantis_netcfg.links.qualify.budget import BudgetLimit
from atlantis_netcfg.links.qualify.measured_run import BudgetLimits
from atlantis_netcfg.links.qualify.session import EndReason

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from atlantis_netcfg.inventory.model import Link
    from atlantis_netcfg.operations.qualify.result import QualifyResult


@dataclass(frozen=True, slots=True)
class SkippedLink:
    """A requested link over which nothing was sent."""

    link: str
    why: str

    def line(self) -> str:
        """Return the report's line."""
        return msg(f"{arg(self.link)}: not measured: {arg(self.why)}")

    def as_json(self) -> dict[str, Any]:
        """Return JSON-able data."""
        return {"link": self.link, "why": self.why}


@dataclass(frozen=True, slots=True)
class SeveralResults:
    """The results of several links; each requested link is in one of the two fields."""

    results: tuple[QualifyResult, ...]
    not_measured: tuple[SkippedLink, ...] = ()

    @property
    def exit(self) -> errors.ExitCode:
        """The worst exit code of all; not green if nothing was sent over one of the links."""
        codes = [each.exit for each in self.results]
        code = errors.worst(codes)
        return code.unproven_code if self.not_measured or errors.ExitCode.NOTHING in codes else code


def measure_each(
    links: Sequence[Link], limits: BudgetLimits, measure: Callable[[Link, BudgetLimits], QualifyResult]
) -> SeveralResults:
    """Measure all links; `measure` gets the remaining limits, and its exceptions end everything."""
    results: list[QualifyResult] = []
    not_measured: list[SkippedLink] = []
    over = ""
    for link in links:
        why = over or _unpaid(link, results, limits)
        if why:
            not_measured.append(SkippedLink(link.name, why))
            continue
        result = measure(link, limits)
        results.append(result)
        over = _ends_all(result, limits)
        limits = remaining_limits(limits, result)
    return SeveralResults(tuple(results), tuple(not_measured))


def _ends_all(result: QualifyResult, limits: BudgetLimits) -> str:
    """Return why no further link is measured; empty if more are."""
    run = result.run
    if result.failure is not None and not isinstance(result.failure, errors.DeviceError):
        return msg(f"{arg(run.link)} was left in an unknown state")
    if run.reason == EndReason.STOPPED:
        return "the measurement was interrupted"
    # A link may have a cap of its own, which is no limit of the next one.
    if run.reason == BudgetLimit.BYTES and run.budget.max_bytes == limits.max_bytes:
        return "the data limit was reached before"
    return "the time limit was reached before" if run.reason == BudgetLimit.SECONDS else ""


def _unpaid(link: Link, results: Sequence[QualifyResult], limits: BudgetLimits) -> str:
    """Return why the money limit excludes a link, which must be metered; empty otherwise."""
    is_exhausted = any(result.run.reason == BudgetLimit.MONEY for result in results)
    return "the cost limit was reached before" if link.metered and is_exhausted and limits.max_price is not None else ""


def remaining_limits(limits: BudgetLimits, result: QualifyResult) -> BudgetLimits:
    """Return the limits minus what a measured link used, at least 0.

    The charged amount counts, including responses that have not arrived.
    """
    run = result.run
    seconds = 0.0 if run.ended is None else (run.ended - run.begun).total_seconds()
    price = bill(run.charged_bytes, seconds, run.tariff if run.currency is not None else None).price or Decimal(0)
    return BudgetLimits(
        max_bytes=None if limits.max_bytes is None else max(0, limits.max_bytes - run.charged_bytes),
        max_seconds=None if limits.max_seconds is None else max(0.0, limits.max_seconds - seconds),
        max_price=None if limits.max_price is None else max(Decimal(0), limits.max_price - price),
    )
