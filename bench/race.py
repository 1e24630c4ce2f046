"""Runs contenders through scenarios and links."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from threading import Barrier
from typing import TYPE_CHECKING

from bench import measure
from bench.figures import Figure, Sample
from bench.world import World

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from bench.job import Contender, Scenario
    from bench.proxy import Shape

__all__ = ["LONG_MS", "SHORT_S", "Plan", "line", "race"]

LONG_MS = 300
"""From this delay on, peers need minutes for a run."""
SHORT_S = 10.0
"""Runs that take longer are not repeated: what a machine adds by chance is a small part of them."""


@dataclass(frozen=True, slots=True)
class Plan:
    """What is to be measured."""

    contenders: Sequence[Contender]
    scenarios: Sequence[Scenario]
    links: Sequence[Shape]
    runs: int = 3
    """How often, where a run takes less than SHORT_S."""

    def only(self, contenders: Sequence[Contender], links: Sequence[Shape]) -> Plan:
        """Return a part of the plan."""
        return replace(self, contenders=contenders, links=links)


def race(folder: Path, plan: Plan, tell: Callable[[Figure], object]) -> str | None:
    """Measure everything that the plan asks for, and `tell` each figure as soon as it is there.

    One after the other, so that none takes the processor from another; but from LONG_MS on the peers run side by side,
    and over all such links at once, each with a router and a network of its own, since there they do nothing but wait.
    Returns why routers do not stand at their declared addresses; None if they do.
    """
    world = World(_home(folder, "all"))
    short = [link for link in plan.links if link.rtt_ms < LONG_MS]
    long = [link for link in plan.links if link.rtt_ms >= LONG_MS]
    ours = [contender for contender in plan.contenders if contender.name == "ours"]
    peers = [contender for contender in plan.contenders if contender.name != "ours"]
    for part in (plan.only(plan.contenders, short), plan.only(ours, long)):
        for figure in _measured(world, part):
            tell(figure)
    if parts := [plan.only([peer], [link]) for peer in peers for link in long]:
        ready = Barrier(len(parts))
        with ThreadPoolExecutor(len(parts)) as beside:
            homes = [_home(folder, f"beside-{number}") for number in range(len(parts))]
            list(beside.map(lambda home, part: _beside(home, part, ready, tell), homes, parts))
    return world.excuse


def _beside(home: Path, plan: Plan, ready: Barrier, tell: Callable[[Figure], object]) -> None:
    """Make a world, which keeps the processor busy, and begin when all have theirs."""
    try:
        world = World(home)
    except BaseException:
        ready.abort()
        raise
    ready.wait()
    for figure in _measured(world, plan):
        tell(figure)


def _home(folder: Path, name: str) -> Path:
    home = folder / name
    home.mkdir()
    return home


def _measured(world: World, plan: Plan) -> Iterator[Figure]:
    for link in plan.links:
        for scenario in plan.scenarios:
            for contender in plan.contenders:
                yield _figure(world, plan, contender, scenario, link)


def _figure(world: World, plan: Plan, contender: Contender, scenario: Scenario, link: Shape) -> Figure:
    if (missing := contender.missing()) is not None:
        return Figure(contender.name, scenario, link, failure=missing)
    figures: list[Figure] = []
    while len(figures) < plan.runs and all(figure.samples and figure.wall_s < SHORT_S for figure in figures):
        figures.append(_once(world, contender, scenario, link))
    samples = tuple(sample for figure in figures for sample in figure.samples)
    last = figures[-1]
    failure = next((figure.failure for figure in figures if figure.failure), "")
    return Figure(contender.name, scenario, link, samples, last.notes, last.differences, failure)


def _once(world: World, contender: Contender, scenario: Scenario, link: Shape) -> Figure:
    with world.stage(scenario, link) as stage:
        try:
            command = contender.command(stage.job)
        except LookupError as cannot:
            return Figure(contender.name, scenario, link, failure=str(cannot.args[0]))
        ran = measure.run_command(command, stage.job.folder)
        sample = Sample(ran.cost, stage.proxies.count())
        failure = "" if ran.code == 0 else f"exit code {ran.code}: {_last_words(ran.output)}"
        notes = (*command.notes, *contender.notes_of(scenario, ran.output))
        return Figure(contender.name, scenario, link, (sample,), notes, stage.differences(), failure)


def _last_words(text: str) -> str:
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return lines[-1][:200] if lines else "it said nothing"


def line(figure: Figure) -> str:
    """Tell a figure in one line."""
    head = f"{figure.link!s:<23}  {figure.scenario.value:<9} {figure.contender:<18}"
    if not figure.samples:
        return f"{head} {figure.failure}"
    tail = f"  FAILED: {figure.failure}" if figure.failure else ""
    tail += f"  ({len(figure.differences)} lines differ)" if figure.differences else ""
    cost = f"{figure.wall_s:8.2f} s  {figure.round_trips:>5} round trips  {figure.bytes / 1000:7.1f} kB"
    return f"{head} {cost}{tail}"
