"""Runs contenders through scenarios and delays."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from bench import measure
from bench.figures import Figure, Sample
from bench.proxy import Shape
from bench.world import World

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from bench.job import Contender, Scenario

__all__ = ["LONG_MS", "Plan", "line", "race"]

LONG_MS = 300
"""From this delay on, peers need minutes for a run."""


@dataclass(frozen=True, slots=True)
class Plan:
    """What is to be measured."""

    contenders: Sequence[Contender]
    scenarios: Sequence[Scenario]
    rtts_ms: Sequence[int]
    runs: int = 3
    """At delays where a run is short."""
    rate_bps: Sequence[float] | None = None
    """Up and down; None is unlimited."""

    def repeat(self, contender: Contender, rtt_ms: int) -> int:
        """How often: on a delayed link peers run once, for they take minutes."""
        return self.runs if rtt_ms == 0 or contender.name == "ours" else 1

    def only(self, contenders: Sequence[Contender], rtts_ms: Sequence[int]) -> Plan:
        """Return a part of the plan."""
        return replace(self, contenders=contenders, rtts_ms=rtts_ms)


def race(folder: Path, plan: Plan, tell: Callable[[Figure], object]) -> str | None:
    """Measure everything that the plan asks for, and `tell` each figure as soon as it is there.

    One after the other, so that none takes the processor from another; but from LONG_MS on the peers run side by side,
    each with a router and a network of its own, since there they do nothing but wait. Returns why routers do not stand
    at their declared addresses; None if they do.
    """
    world = World(_home(folder, "all"))
    short = [rtt_ms for rtt_ms in plan.rtts_ms if rtt_ms < LONG_MS]
    long = [rtt_ms for rtt_ms in plan.rtts_ms if rtt_ms >= LONG_MS]
    ours = [contender for contender in plan.contenders if contender.name == "ours"]
    peers = [contender for contender in plan.contenders if contender.name != "ours"]
    for part in (plan.only(plan.contenders, short), plan.only(ours, long)):
        for figure in _measured(world, part):
            tell(figure)
    if long and peers:
        with ThreadPoolExecutor(len(peers)) as beside:
            list(beside.map(lambda peer: _beside(folder, plan.only([peer], long), tell), peers))
    return world.excuse


def _beside(folder: Path, plan: Plan, tell: Callable[[Figure], object]) -> None:
    world = World(_home(folder, plan.contenders[0].name))
    for figure in _measured(world, plan):
        tell(figure)


def _home(folder: Path, name: str) -> Path:
    home = folder / name
    home.mkdir()
    return home


def _measured(world: World, plan: Plan) -> Iterator[Figure]:
    for rtt_ms in plan.rtts_ms:
        for scenario in plan.scenarios:
            for contender in plan.contenders:
                yield _figure(world, plan, contender, scenario, rtt_ms)


def _figure(world: World, plan: Plan, contender: Contender, scenario: Scenario, rtt_ms: int) -> Figure:
    if (missing := contender.missing()) is not None:
        return Figure(contender.name, scenario, rtt_ms, failure=missing)
    up, down = plan.rate_bps or (None, None)
    shape = Shape(rtt_ms / 2000, up, down)
    figures = [_once(world, contender, scenario, rtt_ms, shape) for _ in range(plan.repeat(contender, rtt_ms))]
    samples = tuple(sample for figure in figures for sample in figure.samples)
    last = figures[-1]
    failure = next((figure.failure for figure in figures if figure.failure), "")
    return Figure(contender.name, scenario, rtt_ms, samples, last.notes, last.differences, failure)


def _once(world: World, contender: Contender, scenario: Scenario, rtt_ms: int, shape: Shape) -> Figure:
    with world.stage(scenario, shape) as stage:
        try:
            command = contender.command(stage.job)
        except LookupError as cannot:
            return Figure(contender.name, scenario, rtt_ms, failure=str(cannot.args[0]))
        ran = measure.run_command(command, stage.job.folder)
        sample = Sample(ran.cost, stage.proxies.count())
        failure = "" if ran.code == 0 else f"exit code {ran.code}: {_last_words(ran.said)}"
        notes = (*command.notes, *contender.heard(scenario, ran.said))
        return Figure(contender.name, scenario, rtt_ms, (sample,), notes, stage.differences(), failure)


def _last_words(said: str) -> str:
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    return lines[-1][:200] if lines else "it said nothing"


def line(figure: Figure) -> str:
    """Tell a figure in one line."""
    head = f"{figure.rtt_ms:>4} ms  {figure.scenario.value:<9} {figure.contender:<18}"
    if not figure.samples:
        return f"{head} {figure.failure}"
    tail = f"  FAILED: {figure.failure}" if figure.failure else ""
    tail += f"  ({len(figure.differences)} lines differ)" if figure.differences else ""
    cost = f"{figure.wall_s:8.2f} s  {figure.round_trips:>5} round trips  {figure.bytes / 1000:7.1f} kB"
    return f"{head} {cost}{tail}"
