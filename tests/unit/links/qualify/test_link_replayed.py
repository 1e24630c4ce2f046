"""The link that a profile shapes: delays as they were measured, even shares, gaps that are drawn, stalls of TCP."""

import random
from itertools import pairwise

import pytest

from atlantis_netcfg.emulator.tcp_link import TcpLink, retransmission_s
from atlantis_netcfg.emulator.udp_link import DrawnGap, LinkModel, LinkShape, gaps_of_cycle


def _model(shape: LinkShape, seed: int = 1) -> LinkModel:
    return LinkModel(shape, random.Random(seed))  # noqa: S311 - an emulation


def test_every_delay_is_drawn_before_any_comes_again() -> None:
    delays = (0.1, 0.1, 0.2, 0.9)
    model = _model(LinkShape(delays_s=delays))
    drawn = [round(model.offer(100, n * 10.0)[0] - n * 10.0, 6) for n in range(8)]
    assert sorted(drawn[:4]) == sorted(drawn[4:]) == [*delays]


def test_a_delay_holds_for_what_is_sent_meanwhile() -> None:
    model = _model(LinkShape(delays_s=(0.1, 0.5, 0.9), hold_s=1.0))
    drawn = [round(model.offer(100, 10 * n + within)[0] - 10 * n - within, 6) for n in range(3) for within in (0, 0.9)]
    assert drawn[::2] == drawn[1::2]
    assert sorted(drawn[::2]) == [0.1, 0.5, 0.9]


@pytest.mark.parametrize("share", [0.01, 0.3])
def test_even_loss_is_constant_in_every_interval(share: float) -> None:
    model = _model(LinkShape(loss=share, even=True))
    lost = [not model.offer(100, n / 10) for n in range(3000)]
    per_stretch = [sum(lost[begin : begin + 300]) for begin in range(0, 3000, 300)]
    assert all(abs(count - 300 * share) <= 1 for count in per_stretch)
    places = [n for n, gone in enumerate(lost) if gone]
    assert len({later - earlier for earlier, later in pairwise(places)}) > 1, "at random places"


def test_gaps_occur_once_per_cycle_and_together_in_both_directions() -> None:
    gaps = (DrawnGap(70.0), DrawnGap(5.0), DrawnGap(1.5))
    up = LinkShape(gaps=gaps, gap_cycle_s=300.0, gap_seed=4)
    down = LinkShape(gaps=(DrawnGap(70.0), DrawnGap(5.0, carries=True), DrawnGap(1.5)), gap_cycle_s=300.0, gap_seed=4)
    for number in range(5):
        drawn = gaps_of_cycle(up, number)
        assert sorted(round(end - begin, 6) for begin, end in drawn) == [1.5, 5.0, 70.0]
        assert number * 300 <= drawn[0][0]
        assert drawn[-1][1] <= (number + 1) * 300
        assert all(later[0] - earlier[1] >= 2.0 for earlier, later in pairwise(drawn))
        assert set(gaps_of_cycle(down, number)) == {gap for gap in drawn if round(gap[1] - gap[0], 6) != 5.0}
    assert gaps_of_cycle(up, 0) != gaps_of_cycle(LinkShape(gaps=gaps, gap_cycle_s=300.0, gap_seed=5), 0)
    model = _model(up)
    lost = sum(not model.offer(100, n / 10) for n in range(30_000))
    assert lost == pytest.approx(10 * 10 * 76.5, abs=60)


def test_gaps_longer_than_the_cycle_leave_no_time_between() -> None:
    drawn = gaps_of_cycle(LinkShape(gaps=(DrawnGap(40.0), DrawnGap(40.0)), gap_cycle_s=60.0), 0)
    assert [round(end - begin, 6) for begin, end in drawn] == [40.0, 40.0]


def test_tcp_stalls_where_a_segment_is_lost() -> None:
    link = TcpLink(LinkShape(delay_s=0.3, gaps_s=((10.0, 12.0),)), LinkShape(delay_s=0.3))
    start = 1000.0  # of any clock; the gaps count from here
    assert link.arrival(1000, start, up=True) == pytest.approx(start + 0.3)
    # sent again after 1.2 s, still in the gap, then after 2.4 s more
    assert link.arrival(1000, start + 10, up=True) == pytest.approx(start + 10 + 1.2 + 2.4 + 0.3)
    assert link.arrival(1000, start + 10.1, up=False) == pytest.approx(start + 10.4), "a gap of the other way"
    assert link.arrival(1000, start + 12.1, up=True) == pytest.approx(start + 12.4), "another connection goes on"
    assert (link.up.in_gaps, link.up.loss_count, link.up.delivered_bytes) == (2, 0, 3000)
    assert link.connect_s == pytest.approx(0.6)
    assert retransmission_s(0.001) == pytest.approx(0.2)


def test_tcp_loses_nothing_and_its_rate_is_shared() -> None:
    lossy = _model(LinkShape(loss=0.1))
    late = [lossy.carry(100, n * 100.0, 0.2) > n * 100.0 for n in range(2000)]
    assert sum(late) / 2000 == pytest.approx(0.1, abs=0.02)
    assert _model(LinkShape(loss=1.0)).carry(100, 0.0, 0.2) > 60, "it arrives when TCP would have given up"
    slow = _model(LinkShape(rate_bps=8000, queue_bytes=10))
    assert [slow.carry(1000, 0.0, 0.2) for _ in range(3)] == pytest.approx([1.0, 2.0, 3.0]), "its sender waits"
