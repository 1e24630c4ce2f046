"""What the page of the benchmarks says in words, from figures that are made up."""

import pytest

from bench.figures import Crowd, Figure, Runs, Sample
from bench.job import Scenario
from bench.measure import Cost
from bench.page import page
from bench.proxy import Count, Shape

PLAIN, SATELLITE = Shape(0.35), Shape(0.35, 352_000, 704_000)


def cost(wall_s: float) -> Cost:
    return Cost(wall_s, 0.1, 1024)


def figure(name: str, link: Shape, wall_s: float, size: int, failure: str = "") -> Figure:
    sample = Sample(cost(wall_s), Count(1, 5, size, 0))
    return Figure(name, Scenario.NOTHING, link, (sample,), failure=failure)


def written(*figures: Figure, crowds: tuple[Crowd, ...] = (), kept: tuple[Runs, ...] = ()) -> list[str]:
    return page(figures, crowds, kept, (), (), {}, ()).splitlines()


def test_peer_that_is_ahead_is_listed() -> None:
    lines = written(
        figure("ours", PLAIN, 5.0, 64_000),
        figure("napalm-ros", PLAIN, 4.0, 19_000),
        figure("netmiko", PLAIN, 6.0, 90_000),
        figure("ours", SATELLITE, 6.5, 64_000),
        figure("napalm-ros", SATELLITE, 5.5, 19_000),
        figure("netmiko", SATELLITE, 9.0, 90_000),
    )
    assert [line for line in lines if "quicker" in line] == [
        "* **napalm-ros is quicker than we are** at 700 ms (4.0 s, we 5.0 s); 700 ms, 352/704 kbit/s (5.5 s, we 6.5 s)."
    ]
    assert [line for line in lines if "Fewer bytes" in line] == [
        "* Fewer bytes than ours: napalm-ros (19 kB, we 64 kB)."
    ]
    assert "| 700 ms, 352/704 kbit/s | netmiko | 9.0 | 0.1 | 5 | 90 | 1.4 | as ours |" in lines


def test_failed_peer_is_not_ahead() -> None:
    failed = figure("netmiko", PLAIN, 1.0, 100, "exit code 1")
    lines = written(figure("ours", PLAIN, 5.0, 64_000), failed, figure("librouteros", PLAIN, 7.0, 64_000))
    assert "* Nobody is quicker than we are." in lines
    assert not [line for line in lines if "Fewer bytes" in line]


def test_our_failure_is_no_benchmark() -> None:
    lines = written(figure("ours", PLAIN, 5.0, 64_000, "exit code 4"), figure("netmiko", PLAIN, 9.0, 100))
    assert not [line for line in lines if "quicker" in line]
    assert "| 700 ms | netmiko | 9.0 | 0.1 | 5 | 0 |  | as ours |" in lines


@pytest.mark.parametrize(("wall_s", "verdict"), [(30.0, "reached"), (31.0, "**missed**")])
def test_silent_routers_have_a_target(wall_s: float, verdict: str) -> None:
    crowd = Crowd(50, 2, cost(wall_s), 16.0)
    mark = f"* 50 routers, 2 of them silent, take {wall_s:.0f} s, a quarter of 121 s at most (mark: {verdict})."
    assert mark in written(crowds=(crowd,))
    assert not [line for line in written(crowds=(Crowd(50, 2, cost(wall_s), 0.0, "none"),)) if "(mark: " in line]


@pytest.mark.parametrize(("wall_s", "verdict"), [(0.75, "reached"), (0.8, "**missed**")])
def test_thousand_runs_have_a_target(wall_s: float, verdict: str) -> None:
    kept = Runs("runs", 10, (cost(0.5),)), Runs("runs", 1000, (cost(wall_s),))
    lines = written(kept=kept)
    times = f"{wall_s / 0.5:.1f}"
    assert f"* `runs` with 1000 runs takes {times} times as long as with 10 (mark: {verdict})." in lines
    assert f"| runs | 1000 | {wall_s:.2f} | {times} |" in lines


@pytest.mark.parametrize("text", ["0", "100", "700/352/704", "600/1000/2000.5"])
def test_link_text_round_trips(text: str) -> None:
    rtt, *rates = text.split("/")
    assert str(Shape.read(text)) == f"{rtt} ms" + (f", {'/'.join(rates)} kbit/s" if rates else "")


@pytest.mark.parametrize("text", ["", "x", "700/352", "700/352/704/1"])
def test_malformed_link_text_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"could not convert|values to unpack"):
        Shape.read(text)
