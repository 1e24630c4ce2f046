import asyncio

import pytest
from wire_helpers import run

from atlantis_netcfg.emulator.routeros.wire.link import SEGMENT, Chunk, DelayLine, Direction, RouterLink, WireLink
from atlantis_netcfg.emulator.udp_link import LinkShape


def test_delay_is_one_way_and_does_not_add_up() -> None:
    bearer = WireLink(RouterLink(delay_s=0.35))
    assert [bearer.arrival(Direction.UP, 500, 10.0) for _ in range(16)] == [pytest.approx(10.35)] * 16


def test_rate_limits_bytes_and_idle_time_gives_no_credit() -> None:
    bearer = WireLink(RouterLink(rate_up_bps=8000))
    assert bearer.arrival(Direction.UP, 1000, 0.0) == pytest.approx(1.0)
    assert bearer.arrival(Direction.UP, 1000, 0.0) == pytest.approx(2.0)
    assert bearer.arrival(Direction.UP, 1000, 100.0) == pytest.approx(101.0)


def test_each_direction_has_its_rate() -> None:
    bearer = WireLink(RouterLink(rate_up_bps=8000, rate_down_bps=16000))
    assert bearer.arrival(Direction.UP, 1000, 0.0) == pytest.approx(1.0)
    assert bearer.arrival(Direction.DOWN, 1000, 0.0) == pytest.approx(0.5)


def test_every_nth_segment_is_lost_once() -> None:
    bearer = WireLink(RouterLink(stall_every=3, stall_s=2.0))
    assert [bearer.arrival(Direction.UP, 10, 0.0) for _ in range(6)] == [0, 0, 2, 0, 0, 2]


def test_long_write_is_split_into_segments() -> None:
    pieces = list(Chunk(b"x" * (SEGMENT * 2 + 1), heard_count=3, answer_count=2).segments())
    assert [len(piece.data) for piece in pieces] == [SEGMENT, SEGMENT, 1]
    assert {(piece.heard_count, piece.answer_count) for piece in pieces} == {(3, 2)}


async def _arrivals(link: RouterLink, chunks: list[bytes], *, gap: tuple[float, float] | None = None) -> list[float]:
    """Seconds after the start at which chunks arrive, put all at once; `gap` is from and to."""
    loop = asyncio.get_running_loop()
    start, seen, air = loop.time(), list[float](), asyncio.Event()
    air.set()
    line = DelayLine(WireLink(link), Direction.UP, air, lambda _: seen.append(round(loop.time() - start, 3)))
    if gap is not None:
        loop.call_later(gap[0], air.clear)
        loop.call_later(gap[1], air.set)
    pump = asyncio.create_task(line.pump())
    for chunk in chunks:
        line.put(Chunk(chunk))
    await asyncio.sleep(1000)
    pump.cancel()
    return seen


def test_data_sent_together_arrives_together() -> None:
    assert run(_arrivals(RouterLink(delay_s=0.7), [b"a", b"b", b"c"])) == [0.7, 0.7, 0.7]


def test_data_behind_a_lost_segment_arrives_after_it() -> None:
    assert run(_arrivals(RouterLink(stall_every=2, stall_s=5), [b"a", b"b", b"c"])) == [0, 5, 5]


def test_shape_overrides_delay_and_rate() -> None:
    bearer = WireLink(RouterLink(delay_s=9, up=LinkShape(rate_bps=8000, delay_s=0.3), down=LinkShape(delay_s=0.2)))
    assert bearer.arrival(Direction.UP, 1000, 5.0) == pytest.approx(6.3)
    assert bearer.arrival(Direction.DOWN, 1000, 5.0) == pytest.approx(5.2)
    assert bearer.connect_s == pytest.approx(0.5)
    bearer.link = RouterLink(delay_s=1, tcp_connect=False)
    assert bearer.arrival(Direction.UP, 1000, 5.0) == pytest.approx(6.0)
    assert bearer.connect_s == 0


def test_gap_in_a_shape_stalls_the_link() -> None:
    gapped = RouterLink(up=LinkShape(delay_s=0.5, gaps_s=((0.0, 30.0),)), down=LinkShape(delay_s=0.5))
    assert run(_arrivals(gapped, [b"a", b"b"])) == [30.5, 30.5], "sent again after 2, 4, 8 and 16 s"


def test_gap_delays_data_that_would_arrive_in_it() -> None:
    assert run(_arrivals(RouterLink(delay_s=1), [b"a"], gap=(0.5, 70))) == [70]
    assert run(_arrivals(RouterLink(delay_s=1), [b"a"], gap=(2, 70))) == [1]
