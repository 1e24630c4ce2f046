"""Greens that nothing earns: few answers, gaps that could not be seen, missing stages, links that were not counted."""

from dataclasses import replace
from pathlib import Path

import pytest
from example_runs import measured_run, samples_text
from simulated_network import KEY, SECOND, Recording, network, run_train, unlimited

from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.emulator.udp_link import LinkShape
from atlantis_netcfg.inventory import load
from atlantis_netcfg.inventory.model import LinkThresholds
from atlantis_netcfg.links.qualify.figures import train_figures
from atlantis_netcfg.links.qualify.grids import FEW, telemetry_plan, telemetry_row
from atlantis_netcfg.links.qualify.judgement import judge, profile
from atlantis_netcfg.links.qualify.measured_run import LinkCount, Selection
from atlantis_netcfg.links.qualify.messages import MessagePlan, MessageStream
from atlantis_netcfg.links.qualify.record import make_record
from atlantis_netcfg.links.qualify.samples import Sample, read
from atlantis_netcfg.links.qualify.search import RateLimit, sustained_rate
from atlantis_netcfg.links.qualify.session import ReflectorPeer, TrainPlan, run
from atlantis_netcfg.links.qualify.transfers import MessageFigures, message_figures
from atlantis_netcfg.operations.qualify.measure import CountedTransport, Measurement
from atlantis_netcfg.operations.qualify.plan import build_plan
from atlantis_netcfg.operations.qualify.routing import TunnelTraffic, judge_tunnel, judge_way

SHIPPED = load(Path(__file__).parents[4] / "inventory").sites["coastal"].bearers[-1]
SATELLITE = LinkShape(rate_bps=352_000, delay_s=0.28)


def test_truncated_train_makes_the_run_inconclusive() -> None:
    """Though `run.json` says that all was done."""
    kept = [line for line in samples_text().splitlines(keepends=True) if '"kind":"end","stream":"idle"' not in line]
    assert len(kept) == len(samples_text().splitlines()) - 1
    assert make_record(measured_run(), read(samples_text().splitlines(keepends=True))).verdict is Verdict.PASS
    assert make_record(measured_run(), read(kept)).verdict is Verdict.INCONCLUSIVE


def test_link_too_thin_for_every_size_measures_nothing() -> None:
    thin = SHIPPED.model_copy(update={"rate": SHIPPED.rate.model_copy(update={"up_kbps": 1, "down_kbps": 1})})
    plan = build_plan(thin, Selection.IMAGES, is_rehearsal=True)
    assert not plan.cells
    net, kept = network(SATELLITE, SATELLITE), list[Sample]()
    measured = Measurement(plan, ReflectorPeer(KEY), CountedTransport(net), unlimited(net), kept.append)
    assert measured.measure() == "nothing to try"


def test_idle_train_outlasts_the_longest_allowed_gap() -> None:
    own = SHIPPED.model_copy(update={"qualify": LinkThresholds(gap_s=120.0)})
    assert build_plan(SHIPPED, Selection.TELEMETRY).idle.duration_s == pytest.approx(120)
    assert build_plan(own, Selection.TELEMETRY).idle.duration_s == pytest.approx(144)
    many = SHIPPED.model_copy(update={"qualify": LinkThresholds(min_samples=1000)})
    assert build_plan(many, Selection.TELEMETRY, is_rehearsal=True).idle.packets == 1000


def test_tail_percentiles_of_few_replies_are_inconclusive() -> None:
    """600 packets were sent, and some tens answered: the loss fails, and their delay proves nothing."""
    loss = LinkShape(rate_bps=352_000, delay_s=0.28, loss=0.9)
    _, samples = run_train(network(loss, SATELLITE), TrainPlan(112, 0.2, 120))
    judged = {item.criterion: item for item in judge(train_figures(samples, "train"), profile("satellite"))}
    assert {item.verdict for name, item in judged.items() if name.startswith("FLR")} >= {Verdict.FAIL}
    for criterion in ("FTD, round trip, 95 %", "FDV up, 95 %", "FDV down, 95 %"):
        assert judged[criterion].verdict is Verdict.INCONCLUSIVE, criterion
        assert "responses" in judged[criterion].reason


@pytest.mark.parametrize(
    ("gap_s", "verdict"), [(90.0, Verdict.PASS), (120.0, Verdict.INCONCLUSIVE), (0.1, Verdict.FAIL)]
)
def test_gap_longer_than_the_train_can_show_is_inconclusive(gap_s: float, verdict: Verdict) -> None:
    _, samples = run_train(network(SATELLITE, SATELLITE), TrainPlan(112, 0.2, 120))
    limits = profile("satellite").model_copy(update={"gap_s": gap_s})
    judged = {item.criterion: item for item in judge(train_figures(samples, "train"), limits)}
    assert judged["longest gap"].verdict is verdict
    if verdict is Verdict.INCONCLUSIVE:
        assert judged["longest gap"].reason == "a gap of 120 s cannot be detected in 120 s"


@pytest.mark.parametrize(
    ("gaps", "verdict"),
    [
        (((50.1, 1000.0),), Verdict.INCONCLUSIVE),  # 69.9 s were seen, and nobody knows how many followed
        (((0.0, 70.0),), Verdict.INCONCLUSIVE),  # nor how many came before
        (((10.0, 81.0), (100.0, 1000.0)), Verdict.INCONCLUSIVE),  # the longest one ended, another did not
        (((50.1, 122.0),), Verdict.PASS),  # the answer to the question for the counters shows that it ended
        (((119.5, 119.9),), Verdict.PASS),  # fewer than three packets are loss
        (((20.0, 120.0),), Verdict.FAIL),  # longer than allowed, whatever its end
    ],
)
def test_gap_cut_off_by_the_train_is_inconclusive(gaps: tuple[tuple[float, float], ...], verdict: Verdict) -> None:
    _, samples = run_train(network(replace(SATELLITE, gaps_s=gaps), SATELLITE), TrainPlan(112, 0.2, 120))
    judged = {item.criterion: item for item in judge(train_figures(samples, "train"), profile("satellite"))}
    assert judged["longest gap"].verdict is verdict
    if verdict is Verdict.INCONCLUSIVE:
        assert judged["longest gap"].reason == "a gap at the beginning or end of the packet train may have been longer"


def test_gap_at_the_end_is_inconclusive_without_counters() -> None:
    gap = replace(SATELLITE, gaps_s=((60.0, 122.0),))
    _, samples = run_train(network(gap, SATELLITE), TrainPlan(112, 0.2, 120), ReflectorPeer(KEY, counts=False))
    judged = {item.criterion: item for item in judge(train_figures(samples, "train"), profile("satellite"))}
    assert judged["longest gap"].verdict is Verdict.INCONCLUSIVE


@pytest.mark.parametrize(
    ("seconds", "verdict"), [(4, Verdict.INCONCLUSIVE), (9, Verdict.INCONCLUSIVE), (10, Verdict.PASS)]
)
def test_few_packets_do_not_prove_a_rate(seconds: int, verdict: Verdict) -> None:
    _, samples = run_train(network(SATELLITE, SATELLITE), telemetry_plan(32, 1, seconds))
    row = telemetry_row(32, 1, train_figures(samples, "train"), 0.6)
    assert (row.verdict, row.reason) == (verdict, "sustained" if verdict is Verdict.PASS else FEW)


def test_links_without_counters_are_inconclusive() -> None:
    meant = LinkCount(
        link="4g", test_packets_up=100, test_bytes_up=14_000, test_packets_down=100, test_bytes_down=14_000
    )
    counts, traffic = [meant, LinkCount(link="satellite")], TunnelTraffic(100, 14_000)
    verdict, reason = judge_way("4g", counts, 100, 100, 0)
    assert (verdict, reason) == (Verdict.INCONCLUSIVE, "the router did not report its counters on satellite")
    assert judge_tunnel("4g", counts, traffic, traffic)[0] is Verdict.INCONCLUSIVE


@pytest.mark.parametrize("first_hz", [7.76836158, 1.9421, 0.5, 3.3333333])
def test_highest_rate_survives_rounded_stream_names(first_hz: float) -> None:
    """Streams are named `%g`, with six digits: twice a rounded rate is no name of a stream."""
    net, peer, recording = network(SATELLITE, replace(SATELLITE, rate_bps=704_000)), ReflectorPeer(KEY), Recording()

    def messages(name: str, plan: MessagePlan) -> MessageFigures | None:
        run(net, peer, [MessageStream(name, plan, peer, net, recording.write)], unlimited(net))
        return message_figures(recording.samples, name)

    messages("rate 6000 0", MessagePlan(6000, 0.2, 20))
    found = sustained_rate(
        6000,
        lambda rate: messages(f"rate 6000 {rate:g}", MessagePlan(6000, rate, max(8, 4 / rate), give_up_s=30)),
        idle_latency_s=0.8,
        first_hz=first_hz,
    )
    assert net.now / SECOND > 20
    (again,) = make_record(measured_run(), recording.samples).highest_rates
    assert again.limited_by is found.limited_by
    assert again.limited_by is not RateLimit.HIGHEST
    assert len(again.steps) == len(found.windows)
    assert again.rate_hz == (None if found.rate_hz is None else pytest.approx(found.rate_hz, rel=1e-4))
