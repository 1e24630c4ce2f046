"""Each figure against a link whose truth is known, within the tolerances of docs/engineers/qualify-method.md."""

from itertools import count, pairwise

import pytest
from simulated_network import KEY, SECOND, SimulatedNetwork, network, run_train
from tolerances import tolerances

from atlantis_netcfg.emulator.udp_link import LinkShape
from atlantis_netcfg.links.qualify.figures import (
    NoTrain,
    Percentiles,
    TrainFigures,
    percentile,
    percentiles,
    train_figures,
)
from atlantis_netcfg.links.qualify.reflector.clock import UNKNOWN, ClockState
from atlantis_netcfg.links.qualify.session import ReflectorPeer, TrainPlan

UP = LinkShape(rate_bps=352_000, delay_s=0.28, jitter_s=0.02)
DOWN = LinkShape(rate_bps=704_000, delay_s=0.28, jitter_s=0.02)
PLAN = TrainPlan(size=172, interval_s=0.25, duration_s=600)


def _measured(net: SimulatedNetwork, plan: TrainPlan = PLAN, peer: ReflectorPeer | None = None) -> TrainFigures:
    _, samples = run_train(net, plan, peer)
    return train_figures(samples, "train")


def _close(measured: Percentiles | None, truth: Percentiles | None, tolerance: float) -> None:
    assert measured is not None
    assert truth is not None
    assert measured.n == truth.n
    for name in ("min", "p50", "p90", "p95", "p99", "max"):
        assert getattr(measured, name) == pytest.approx(getattr(truth, name), abs=tolerance), name


def test_round_trips_without_a_common_clock() -> None:
    net = network(UP, DOWN, skew_ns=-37 * SECOND, residence_ns=50_000_000)
    figures = _measured(net)
    # The last of the truth belongs to the question for the counters.
    truth = [(up + down) / SECOND for up, down in zip(net.truth_up_ns[:-1], net.truth_down_ns[:-1], strict=True)]
    _close(figures.rtt, percentiles(truth), tolerances()["rtt_s"])
    assert figures.rtt is not None
    assert figures.rtt.n == PLAN.packets == 2400


def test_one_way_variation_without_a_common_clock() -> None:
    net = network(UP, LinkShape(delay_s=0.1, jitter_s=0.08), skew_ns=11 * SECOND)
    figures = _measured(net)
    for variation, truth in ((figures.up, net.truth_up_ns[:-1]), (figures.down, net.truth_down_ns[:-1])):
        assert variation is not None
        assert variation.delay is None, "nobody said that the clocks are synchronised"
        seconds = [delay / SECOND for delay in truth]
        _close(variation.above_min, percentiles(s - min(seconds) for s in seconds), tolerances()["variation_s"])
        ipdv = sorted(abs(b - a) for a, b in pairwise(seconds))
        assert variation.ipdv_p95_s == pytest.approx(percentile(ipdv, 0.95), abs=tolerances()["variation_s"])
        # RFC 3550, 6.4.1, written down a second time, as whole numbers are used in its appendix A.8.
        scaled, estimates = 0.0, []
        for earlier, later in pairwise(seconds):
            scaled += abs(later - earlier) - scaled / 16
            estimates.append(scaled / 16)
        assert variation.rfc3550_s == pytest.approx(estimates[-1], rel=tolerances()["jitter_share"])
        assert variation.rfc3550_mean_s == pytest.approx(
            sum(estimates) / len(estimates), rel=tolerances()["jitter_share"]
        )
    assert figures.up is not None
    assert figures.down is not None
    assert figures.down.ipdv_p95_s > 3 * figures.up.ipdv_p95_s, "the ways differ, and are told apart"


def test_one_way_delay_needs_two_synchronised_clocks() -> None:
    net = network(UP, DOWN)
    net.reflector = type(net.reflector)(KEY, clock=lambda: ClockState(is_synchronised=True, error_s=0.001))
    figures = _measured(net, peer=ReflectorPeer(KEY, is_synchronised=True))
    assert figures.up is not None
    assert figures.up.delay is not None
    truth = percentiles(delay / SECOND for delay in net.truth_up_ns[:-1])
    _close(figures.up.delay, truth, tolerances()["rtt_s"])
    alone = _measured(network(UP, DOWN), peer=ReflectorPeer(KEY, is_synchronised=True))
    assert alone.up is not None
    assert alone.up.delay is None, "only ours is"


def test_far_clock_synchronised_mid_train_gives_no_delay() -> None:
    net, asked = network(UP, DOWN), count()
    net.reflector = type(net.reflector)(KEY, clock=lambda: UNKNOWN if next(asked) < 9 else ClockState(True, 0.1))
    figures = _measured(net, peer=ReflectorPeer(KEY, is_synchronised=True))
    assert figures.down is not None
    assert figures.down.delay is None


@pytest.mark.smoke("1")
@pytest.mark.parametrize("seed", range(4))
def test_loss_per_direction(seed: int) -> None:
    net = network(LinkShape(delay_s=0.28, loss=0.03), LinkShape(delay_s=0.28, loss=0.01), seed, skew_ns=SECOND)
    loss = _measured(net).loss
    assert loss.sent == 2400
    assert loss.why == "by the reflector's count"
    # Its questions for the counters may be lost as well; they are not packets of the train.
    up = loss.sent - len(net.truth_up_ns) + _questions(net)
    assert loss.up is not None
    assert loss.down is not None
    assert abs(loss.up - up) <= tolerances()["loss_packets"]
    assert loss.up + loss.down == loss.lost == loss.sent - loss.received
    assert loss.up > loss.down > 0


def _questions(net: SimulatedNetwork) -> int:
    """How many questions for counters have arrived at the far end."""
    return net.reflector.statistics.answered - next(iter(net.reflector._sessions.values())).answered_count


def test_loss_by_sequence_numbers_without_reflector_counters() -> None:
    net = network(LinkShape(delay_s=0.2, loss=0.03), LinkShape(delay_s=0.2, loss=0.01), 3)
    loss = _measured(net, peer=ReflectorPeer(KEY, counts=False)).loss
    assert loss.why == "by the reflector's sequence numbers"
    assert (loss.up, loss.down) == (2400 - len(net.truth_up_ns), len(net.truth_up_ns) - len(net.truth_down_ns))


def test_duplicates_per_direction() -> None:
    net = network(LinkShape(duplicates=0.02), LinkShape(duplicates=0.05))
    loss = _measured(net).loss
    assert loss.copies_up == net.up.copies > 10
    assert 0 <= net.down.copies - loss.copies_down <= 1, "the answer to the question for counters may be copied"
    assert (loss.lost, loss.up, loss.down) == (0, 0, 0)


def test_reordering_per_direction() -> None:
    net = network(
        LinkShape(delay_s=0.1, reordering=0.04, reorder_s=0.6), LinkShape(delay_s=0.1, reordering=0.01, reorder_s=0.6)
    )
    figures = _measured(net)
    # RFC 4737: each packet that arrives behind a later one; these are delayed by more than two intervals.
    ways = (
        (figures.reordered_up, [n * SECOND // 4 + delay for n, delay in enumerate(net.truth_up_ns[:-1])]),
        (
            figures.reordered_down,
            [sum(each) for each in zip(net.truth_replied_ns, net.truth_down_ns, strict=True)][:-1],
        ),
    )
    for measured, arrivals in ways:
        assert measured is not None
        assert measured == pytest.approx(_overtaken(arrivals), abs=tolerances()["reordered_share"])
        assert measured > 0
    assert figures.reordered_up is not None
    assert figures.reordered_down is not None
    assert figures.reordered_up > 2 * figures.reordered_down, "the ways differ, and are told apart"


def _overtaken(arrivals: list[int]) -> float:
    """Written down another way than RFC 4737 has it: some packet that was sent later has arrived before."""
    late = sum(1 for n, at in enumerate(arrivals) if any(other < at for other in arrivals[n + 1 : n + 50]))
    return late / len(arrivals)


@pytest.mark.smoke("12")
@pytest.mark.parametrize("gap_s", [3, 12, 30, 70])
def test_longest_gap_and_gap_counts(gap_s: int) -> None:
    gaps = ((100.0, 100.0 + gap_s), (300.0, 302.0))
    net = network(LinkShape(delay_s=0.28, jitter_s=0.02, gaps_s=gaps), DOWN)
    figures = _measured(net)
    assert figures.rtt is not None
    spread = figures.rtt.max - figures.rtt.min
    tolerance = tolerances()["gap_intervals"] * PLAN.interval_s + spread
    assert figures.gaps.longest_s == pytest.approx(gap_s, abs=tolerance)
    assert dict(figures.gaps.above) == {1: 2, 5: int(gap_s > 5), 20: int(gap_s > 20), 60: int(gap_s > 60)}
    assert not figures.gaps.open_end


def test_percentiles_are_samples() -> None:
    assert percentiles([]) is None
    assert percentiles([3.0]) == Percentiles(1, 3.0, 3.0, 3.0, 3.0, 3.0, 3.0)
    hundred = percentiles(map(float, range(100, 0, -1)))
    assert hundred == Percentiles(100, 1.0, 50.0, 90.0, 95.0, 99.0, 100.0)


def test_samples_without_a_train_are_an_error() -> None:
    with pytest.raises(NoTrain):
        train_figures([], "train")


def test_all_tolerances_are_read() -> None:
    assert len(tolerances()) == 14
