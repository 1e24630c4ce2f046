"""A load that did not fill the link is no figure of it: goodput and buffer delay are INCONCLUSIVE."""

from collections import deque
from dataclasses import dataclass, field, replace

import pytest
from example_runs import measured_run
from simulated_network import KEY, Recording, SimulatedNetwork, network, unlimited

from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.emulator.udp_link import HEADERS, LinkShape
from atlantis_netcfg.links.qualify.compare import compare_runs
from atlantis_netcfg.links.qualify.judgement import Judgement, profile
from atlantis_netcfg.links.qualify.messages import MessagePlan, MessageStream
from atlantis_netcfg.links.qualify.messages_down import DownMessageStream
from atlantis_netcfg.links.qualify.record import LoadRow, QualifyRecord, make_record
from atlantis_netcfg.links.qualify.samples import MessageResult
from atlantis_netcfg.links.qualify.session import PacketStream, ReflectorPeer, Train, TrainPlan, run
from atlantis_netcfg.links.qualify.transport import Arrival

RATE = 4_000_000
LINK = LinkShape(rate_bps=RATE, delay_s=0.0275)
GOODPUT = RATE * 1048 / (1200 + HEADERS)
MS = 1_000_000


@dataclass
class PausedNetwork(SimulatedNetwork):
    """The process that measures is stopped at the end of each `cycle_ms`; its kernel takes what comes meanwhile."""

    cycle_ms: int = 100
    stopped_ms: int = 60
    _waiting: deque[Arrival] = field(default_factory=deque)

    def receive(self, until_ns: int) -> Arrival | None:
        if self._waiting:
            return self._waiting.popleft()
        arrival = super().receive(until_ns)
        cycle = self.cycle_ms * MS
        if self.stopped_ms and self.now % cycle >= cycle - self.stopped_ms * MS:
            wakes = (self.now // cycle + 1) * cycle
            while (more := super().receive(wakes)) is not None:
                self._waiting.append(more)
        return arrival


def paused(net: SimulatedNetwork, cycle_ms: int, stopped_ms: int) -> SimulatedNetwork:
    return PausedNetwork(net.up, net.down, net.reflector, cycle_ms=cycle_ms, stopped_ms=stopped_ms)


def record_of_load(net: SimulatedNetwork, *, declared_bps: float = RATE, seconds: float = 10) -> QualifyRecord:
    """Measure as `provision measure link` does: 1.2 of the capacity each way, and round trips beside."""
    peer, recording = ReflectorPeer(KEY), Recording()
    pace = 1.2 * declared_bps
    load = MessagePlan(round(pace / 8 / 2), 2.0, seconds, pace_bps=pace, give_up_s=30)
    stages: list[list[PacketStream]] = [
        [Train("idle", TrainPlan(112, 0.1, 62), peer, net, recording.write)],
        [
            Train("loaded", TrainPlan(112, 0.1, seconds), peer, net, recording.write),
            MessageStream("load up", load, peer, net, recording.write),
        ],
        [DownMessageStream("load down", load, peer, net, recording.write)],
    ]
    for streams in stages:
        run(net, peer, streams, unlimited(net))
    run_ = measured_run(link="4g", kind="lte", thresholds_name="lte", thresholds=profile("lte"))
    return make_record(run_, recording.samples)


def buffer_delay(record: QualifyRecord) -> Judgement:
    return next(item for item in record.judgements if item.criterion.startswith("buffer delay"))


def rows(record: QualifyRecord) -> dict[str, LoadRow]:
    return {row.way: row for row in record.load}


def test_load_that_fills_the_link_is_conclusive() -> None:
    record = record_of_load(network(LINK, LINK))
    assert buffer_delay(record).verdict is Verdict.PASS
    assert buffer_delay(record).measured == pytest.approx(2.3, abs=0.2), "64 kB of queue in front of 55 ms"
    for way, row in rows(record).items():
        assert (row.verdict, row.doubt) == (Verdict.PASS, ""), way
        assert row.goodput_bps == pytest.approx(GOODPUT, rel=0.05)
        assert row.offered_bps == pytest.approx(1.2 * GOODPUT, rel=0.03)
    assert record.verdict is Verdict.PASS


def test_paused_sender_is_inconclusive() -> None:
    record = record_of_load(paused(network(LINK, LINK), 100, 60))
    row = rows(record)["up"]
    assert row.goodput_bps is not None
    assert row.goodput_bps < 0.8 * GOODPUT, "or the pauses do nothing here"
    assert row.verdict is Verdict.INCONCLUSIVE
    assert row.doubt.startswith("the sender fell behind: it offered ")
    judged = buffer_delay(record)
    assert judged.measured is not None
    assert judged.measured < 1, "within the limit of 4, and no figure of the link"
    assert (judged.verdict, judged.reason) == (Verdict.INCONCLUSIVE, row.doubt)
    assert record.verdict is Verdict.INCONCLUSIVE


@pytest.mark.smoke("73200")
@pytest.mark.parametrize("begins_ms", [72_800, 73_200, 73_500])
def test_pause_at_the_end_of_a_load_is_detected_or_harmless(begins_ms: int) -> None:
    """The last message up begins 73.15 s after the first packet: it takes longer, and none after it begins late."""
    row = rows(record_of_load(paused(network(LINK, LINK), begins_ms + 3_000, 3_000)))["up"]
    if row.verdict is Verdict.PASS:
        assert row.goodput_bps == pytest.approx(GOODPUT, rel=0.03)
    else:
        assert (row.verdict, row.doubt[:22]) == (Verdict.INCONCLUSIVE, "the sender fell behind")


@pytest.mark.smoke("60")
@pytest.mark.parametrize("stopped_ms", [45, 60, 100, 200])
def test_busy_computer_is_distinguished_from_a_slow_link(stopped_ms: int) -> None:
    """Pauses within each half second: where the queue ran empty, the goodput is too low, and never passes."""
    row = rows(record_of_load(paused(network(LINK, LINK), 500, stopped_ms)))["up"]
    assert row.goodput_bps is not None
    if row.goodput_bps < 0.95 * GOODPUT:
        assert row.verdict is Verdict.INCONCLUSIVE
        assert "fell behind" in row.doubt


@pytest.mark.smoke("0.03")
@pytest.mark.parametrize("loss", [0.0, 0.03])
def test_fully_carried_load_is_inconclusive(loss: float) -> None:
    faster = replace(LINK, rate_bps=2 * RATE, loss=loss)
    record = record_of_load(network(faster, faster))
    for way, row in rows(record).items():
        assert row.verdict is Verdict.INCONCLUSIVE, way
        assert row.doubt == "nothing queued: the link carried all that was offered"
    assert buffer_delay(record).verdict is Verdict.INCONCLUSIVE
    assert record.verdict is (Verdict.FAIL if loss else Verdict.INCONCLUSIVE), "1 % may be lost"


def test_far_end_that_fell_behind_is_inconclusive() -> None:
    """Requests of a computer that was stopped came late, and the far end had nothing to send meanwhile."""
    row = rows(record_of_load(paused(network(LINK, LINK), 3000, 1500)))["down"]
    assert row.goodput_bps is not None
    assert row.goodput_bps < 0.95 * GOODPUT
    assert (row.verdict, row.doubt[:22]) == (Verdict.INCONCLUSIVE, "the sender fell behind")


def test_doubtful_goodput_is_not_compared() -> None:
    good, slow = record_of_load(network(LINK, LINK)), record_of_load(paused(network(LINK, LINK), 100, 60))
    changes = {item.key: item for item in compare_runs(good, slow).figures}
    assert changes["goodput_up"].first == pytest.approx(GOODPUT, rel=0.05)
    assert changes["goodput_up"].second is None


def test_run_of_an_earlier_version_has_unknown_offered_load() -> None:
    net, peer, recording = network(LINK, LINK), ReflectorPeer(KEY), Recording()
    load = MessagePlan(300_000, 2.0, 5, pace_bps=1.2 * RATE)
    for streams in (
        [Train("idle", TrainPlan(112, 0.1, 62), peer, net, recording.write)],
        [MessageStream("load up", load, peer, net, recording.write)],
    ):
        run(net, peer, streams, unlimited(net))
    old = [replace(each, due_ns=None) if isinstance(each, MessageResult) else each for each in recording.samples]
    (row,) = make_record(measured_run(), old).load
    assert (row.verdict, row.doubt) == (Verdict.INCONCLUSIVE, "the offered rate is unknown")
