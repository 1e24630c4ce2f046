"""What was measured, as data: one figure for each contender, scenario and delay; and the medians that tables show."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import median
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bench.job import Scenario
    from bench.measure import Cost
    from bench.proxy import Count, Shape

__all__ = ["Crowd", "Figure", "Onboarding", "Runs", "Sample"]


@dataclass(frozen=True, slots=True)
class Sample:
    """One run."""

    cost: Cost
    count: Count


@dataclass(frozen=True, slots=True)
class Figure:
    """All runs of one contender in one scenario over one link."""

    contender: str
    scenario: Scenario
    link: Shape
    samples: tuple[Sample, ...] = ()
    notes: tuple[str, ...] = ()
    """What it does not do, or does in another way."""
    differences: tuple[str, ...] = ()
    """Of the router's export afterwards, against the one after our own run."""
    failure: str = ""
    """Why there is no figure, or none that counts."""

    @property
    def wall_s(self) -> float:
        """Median of the wall times."""
        return median(sample.cost.wall_s for sample in self.samples)

    @property
    def spread(self) -> tuple[float, float]:
        """The fastest and the slowest."""
        walls = [sample.cost.wall_s for sample in self.samples]
        return min(walls), max(walls)

    @property
    def cpu_s(self) -> float:
        """Median processor time."""
        return median(sample.cost.cpu_s for sample in self.samples)

    @property
    def round_trips(self) -> int:
        """Median, TCP's own included."""
        return round(median(sample.count.round_trips for sample in self.samples))

    @property
    def bytes(self) -> int:
        """Median of both directions together."""
        return round(median(sample.count.bytes for sample in self.samples))


@dataclass(frozen=True, slots=True)
class Crowd:
    """One run of ours over many routers."""

    routers: int
    silent: int
    """So many of them accept a connection and say nothing."""
    cost: Cost
    engine_s: float
    """From the first session to the last result, without the start of Ansible and the loading of the inventory."""
    failure: str = ""

    @property
    def memory_each_kib(self) -> float:
        """Peak memory divided by the number of routers."""
        return self.cost.memory_kib / self.routers


@dataclass(frozen=True, slots=True)
class Runs:
    """All calls of one of our commands on a computer that has made so many runs."""

    command: str
    runs: int
    costs: tuple[Cost, ...]
    failure: str = ""

    @property
    def wall_s(self) -> float:
        """Median of the wall times."""
        return median(cost.wall_s for cost in self.costs)


@dataclass(frozen=True, slots=True)
class Onboarding:
    """All runs of one contender that brings many devices into a VPN."""

    contender: str
    devices: int
    costs: tuple[Cost, ...] = ()
    failure: str = ""
    """Why there is no figure, or none that counts."""

    @property
    def wall_s(self) -> float:
        """Median of the wall times."""
        return median(cost.wall_s for cost in self.costs)

    @property
    def cpu_s(self) -> float:
        """Median processor time."""
        return median(cost.cpu_s for cost in self.costs)

    @property
    def spread(self) -> tuple[float, float]:
        """The fastest and the slowest."""
        walls = [cost.wall_s for cost in self.costs]
        return min(walls), max(walls)
