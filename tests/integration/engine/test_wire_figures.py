"""Round trips and bytes of our own run, counted by a proxy in front of the router, in a clock that jumps."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from engine_bench import run

from atlantis_netcfg.routeros import Status
from bench import wire
from bench.job import Scenario
from bench.proxy import Shape

RTT_S = 0.7
PLAIN = Shape(RTT_S / 2)
PAGE = Path(__file__).parents[3] / "docs" / "benchmarks.md"
GOALS = {Scenario.FIRST: (22, 129_000), Scenario.NOTHING: (5, 65_000), Scenario.FIREWALL: (14, 115_000)}
"""Round trips and bytes at most."""
BYTES = 0.02
"""Certificates, times and counters differ from run to run."""


@cache
def figures(shape: Shape = PLAIN) -> dict[Scenario, wire.WireFigure]:
    with TemporaryDirectory() as folder:
        return run(wire.measured(Path(folder), shape))


@pytest.mark.parametrize("scenario", Scenario)
def test_the_wire_is_used_as_well_as_promised(scenario: Scenario) -> None:
    figure = figures()[scenario]
    assert figure.result.status is (Status.UNCHANGED if scenario is Scenario.NOTHING else Status.CHANGED)
    round_trips, size = GOALS[scenario]
    assert figure.count.round_trips <= round_trips
    assert figure.count.bytes <= size


@pytest.mark.parametrize("scenario", Scenario)
def test_a_run_takes_its_round_trips_and_nothing_else(scenario: Scenario) -> None:
    """In this clock nobody needs time for anything but the link."""
    figure = figures()[scenario]
    assert figure.wall_s == pytest.approx(figure.count.round_trips * RTT_S, abs=0.01)


@pytest.mark.parametrize("scenario", Scenario)
def test_what_a_run_says_of_itself_is_what_the_wire_has_carried(scenario: Scenario) -> None:
    figure = figures()[scenario]
    result, count = figure.result, figure.count
    assert result.round_trips == pytest.approx(count.round_trips, rel=0.1)
    assert result.sent == pytest.approx(count.sent, rel=0.1)
    assert result.received == pytest.approx(count.received, rel=0.1)
    assert result.sessions == count.connections


@pytest.mark.parametrize("scenario", Scenario)
def test_the_estimate_is_what_the_wire_carries(scenario: Scenario) -> None:
    figure = figures()[scenario]
    assert figure.result.estimate is not None
    assert figure.result.estimate.round_trips == pytest.approx(figure.count.round_trips, abs=1)
    assert figure.result.estimate.bytes == pytest.approx(figure.count.bytes, rel=0.15)


def test_the_page_has_these_figures() -> None:
    """Whoever moves them writes the page anew: `python -m bench --wire docs/benchmarks.md`."""
    page = wire.published(PAGE.read_text(encoding="utf-8"))
    assert list(page) == [Scenario.FIRST, Scenario.NOTHING, Scenario.FIREWALL]
    for scenario, figure in figures(wire.SATELLITE).items():
        sessions, round_trips, size, seconds = page[scenario]
        assert (figure.count.connections, figure.count.round_trips) == (sessions, round_trips)
        assert figure.count.bytes == pytest.approx(size, rel=BYTES)
        # The page's were taken in real time, on a machine that needs some for itself.
        assert figure.wall_s <= seconds * (1 + BYTES)
        assert seconds <= figure.wall_s + 5
