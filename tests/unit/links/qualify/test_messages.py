"""Messages in chunks, the search for the highest rate, path MTU, tables and verdicts."""

from dataclasses import replace

import pytest
from simulated_network import KEY, SECOND, Recording, SimulatedNetwork, network, run_train, unlimited
from tolerances import tolerances

from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.emulator.udp_link import HEADERS, LinkShape
from atlantis_netcfg.links.qualify import grids
from atlantis_netcfg.links.qualify.budget import Budget, BudgetGuard
from atlantis_netcfg.links.qualify.figures import train_figures
from atlantis_netcfg.links.qualify.judgement import NoSuchProfile, judge, profile, profiles
from atlantis_netcfg.links.qualify.messages import MessagePlan, MessageStream
from atlantis_netcfg.links.qualify.path_mtu import path_mtu
from atlantis_netcfg.links.qualify.reflector.stamp import CHUNK, ReflectorPacket, Tlv
from atlantis_netcfg.links.qualify.search import RateLimit, SustainedRate, sustained_rate
from atlantis_netcfg.links.qualify.session import ReflectorPeer, TrainPlan, run
from atlantis_netcfg.links.qualify.transfers import MessageFigures, message_figures
from atlantis_netcfg.links.qualify.transport import Arrival

UP = LinkShape(rate_bps=352_000, delay_s=0.28)
DOWN = LinkShape(rate_bps=704_000, delay_s=0.28)


def _sent(net: SimulatedNetwork, plan: MessagePlan, guard: BudgetGuard | None = None) -> MessageFigures | None:
    recording, peer = Recording(), ReflectorPeer(KEY)
    stream = MessageStream("m", plan, peer, net, recording.write)
    guard = guard or unlimited(net)
    run(net, peer, [stream], guard)
    return None if guard.limited_by is not None else message_figures(recording.samples, "m")


@pytest.mark.parametrize("size", [1, 1048, 1049, 6200, 100_000])
def test_a_message_of_any_size_arrives(size: int) -> None:
    figures = _sent(network(UP, DOWN), MessagePlan(size, 0.1, 20, pace_bps=350_000))
    assert figures is not None
    assert (figures.sent_count, figures.received_count, figures.lost_count) == (2, 2, 0)
    assert figures.chunks == -(-size // 1048)


def test_empty_message_and_too_small_packet_are_refused() -> None:
    with pytest.raises(ValueError, match="at least one octet"):
        MessagePlan(0, 1, 1)
    with pytest.raises(ValueError, match="packets of 140 octets carry nothing"):
        _sent(network(), MessagePlan(10, 1, 1, packet=140))


def test_unrecognised_reflector_data_is_ignored() -> None:
    net = network()
    stream = MessageStream("m", MessagePlan(10, 1, 1), ReflectorPeer(KEY), net, Recording().write)
    tlvs = (Tlv(CHUNK, b"?"), Tlv(CHUNK + 1, b"?", 0))
    assert stream.accept(ReflectorPacket(0, 0, 0, 0, 0, 0, 0, 0, 0, tlvs), Arrival(b"", 0)) == 0


@pytest.mark.parametrize("seed", range(3))
def test_lost_chunks_are_resent_until_all_arrive(seed: int) -> None:
    shape = replace(UP, loss=0.1, gaps_s=((3.0, 40.0),))
    net = network(shape, replace(DOWN, loss=0.1), seed)
    figures = _sent(net, MessagePlan(40_000, 0.1, 20, resend=True, pace_bps=300_000, give_up_s=300))
    assert figures is not None
    assert (figures.sent_count, figures.received_count) == (2, 2)


def test_best_effort_loses_a_message_with_each_chunk() -> None:
    net = network(replace(UP, rate_bps=None, loss=0.01), DOWN, 3)
    figures = _sent(net, MessagePlan(6_000, 5, 200))
    assert figures is not None
    assert figures.chunks == 6
    assert figures.received_count + figures.lost_count + figures.unknown == figures.sent_count == 1000
    # Section 9: about 1 - (1 - p)^n; four standard deviations of 1,000 messages.
    assert figures.loss == pytest.approx(1 - (1 - 0.01) ** 6, abs=4 * (0.0585 * 0.94 / 1000) ** 0.5)


def test_silent_receiver_leaves_the_message_unknown() -> None:
    net = network(UP, LinkShape(loss=1.0))
    figures = _sent(net, MessagePlan(5_000, 1, 2, timeout_s=1))
    assert figures is not None
    assert (figures.received_count, figures.lost_count, figures.unknown) == (0, 0, 2)


def test_incomplete_message_ends_when_the_receiver_reports_it() -> None:
    """The question leaves after all packets: nothing of the message is awaited once it is answered."""
    net = network(replace(UP, mtu=1_000), DOWN)
    figures = _sent(net, MessagePlan(5_000, 1, 2, timeout_s=5))
    assert figures is not None
    assert (figures.received_count, figures.lost_count, figures.unknown) == (0, 2, 0)
    assert net.now < (1 + 5 + 1) * SECOND, "the last begins after 1 s and is asked for after 5 s"


def _search(net: SimulatedNetwork, size: int, **more: float) -> SustainedRate:
    idle = _sent(net, MessagePlan(size, 0.2, 30))
    assert idle is not None
    assert idle.latency is not None

    def measure(rate_hz: float) -> MessageFigures | None:
        return _sent(net, MessagePlan(size, rate_hz, 12))

    return sustained_rate(size, measure, idle_latency_s=idle.latency.p50, **more)


@pytest.mark.parametrize("size", [1_000, 6_000, 20_000])
@pytest.mark.slow
def test_the_highest_rate_is_what_the_link_carries(size: int) -> None:
    chunks = -(-size // 1048)
    carries = 352_000 / 8 / (size + chunks * (1200 - 1048 + HEADERS))
    found = _search(network(UP, DOWN), size)
    assert found.is_proved
    assert found.rate_hz is not None
    below, above = tolerances()["rate_below_share"], tolerances()["rate_above_share"]
    assert carries * (1 - below) <= found.rate_hz <= carries * (1 + above)
    assert found.limited_by in {RateLimit.LATENCY, RateLimit.QUEUE, RateLimit.LOSS}


def test_a_short_queue_limits_by_loss() -> None:
    found = _search(network(replace(UP, queue_bytes=9_000), DOWN), 6_000)
    assert found.limited_by is RateLimit.LOSS
    assert found.is_proved


def test_random_loss_does_not_limit_the_rate() -> None:
    net = network(replace(UP, loss=0.01), DOWN, 2)
    found = _search(net, 6_000, idle_loss=0.01)
    assert found.rate_hz is not None
    assert found.rate_hz >= 4


def test_a_search_that_the_budget_ends_proves_no_rate() -> None:
    net = network(UP, DOWN)
    guard = BudgetGuard(Budget(max_bytes=200_000), lambda: net.now / SECOND)

    def measure(rate_hz: float) -> MessageFigures | None:
        return _sent(net, MessagePlan(1_000, rate_hz, 30), guard)

    found = sustained_rate(1_000, measure, idle_latency_s=0.6)
    assert found.limited_by is RateLimit.BUDGET
    assert not found.is_proved
    assert found.rate_hz is not None


def test_a_link_that_sustains_nothing_has_no_rate() -> None:
    found = _search(network(replace(UP, rate_bps=20_000, queue_bytes=500_000), DOWN), 20_000, first_hz=0.5)
    assert (found.rate_hz, found.is_proved) == (None, False)
    assert found.limited_by is RateLimit.LOSS


def test_link_faster_than_the_tried_rates_is_not_called_limited() -> None:
    found = _search(network(), 1_000, highest_hz=4)
    assert (found.rate_hz, found.limited_by, found.is_proved) == (4, RateLimit.HIGHEST, False)


@pytest.mark.parametrize(
    ("up", "down", "expected"),
    [
        (1500, 1500, (1500, 1500, None)),
        (1380, 1500, (1380, 1380, None)),
        (1420, 1301, (1420, 1301, 1301)),
        (577, 576, (577, 576, 576)),
    ],
)
def test_path_mtu_per_direction(up: int, down: int, expected: tuple[int, int, int | None]) -> None:
    net = network(LinkShape(delay_s=0.3, mtu=up, loss=0.05), LinkShape(delay_s=0.3, mtu=down, loss=0.05))
    found = path_mtu(net, ReflectorPeer(KEY), unlimited(net), timeout_s=1)
    assert found.up is not None
    assert abs(found.up - expected[0]) <= tolerances()["mtu_octets"]
    assert (found.up, found.both, found.down) == expected


@pytest.mark.parametrize(("delay_s", "mtu", "most_s"), [(0.0275, 1400, 20), (0.0275, 1380, 20), (0.35, 1400, 80)])
def test_path_mtu_timeouts_follow_the_round_trip(delay_s: float, mtu: int, most_s: float) -> None:
    """It waited 3 s six or seven times for each size that is too long: 210 of 377 s on a link of 55 ms."""
    net = network(LinkShape(delay_s=delay_s, mtu=mtu, jitter_s=0.005), LinkShape(delay_s=delay_s, mtu=mtu))
    found = path_mtu(net, ReflectorPeer(KEY), unlimited(net))
    assert (found.up, found.both) == (mtu, mtu)
    assert net.now / SECOND < most_s


@pytest.mark.parametrize("seed", range(8))
def test_path_mtu_tolerates_jitter_and_slow_links(seed: int) -> None:
    """A link of 700 ms whose packets take up to a second more, and 20 kbit/s, which long packets take seconds for."""
    slow = LinkShape(delay_s=0.35, jitter_s=0.4, mtu=1412, rate_bps=352_000, loss=0.02)
    net = network(slow, slow, seed)
    assert path_mtu(net, ReflectorPeer(KEY), unlimited(net)).up == 1412
    thin = LinkShape(delay_s=0.05, mtu=1412, rate_bps=20_000)
    net = network(thin, thin, seed)
    assert path_mtu(net, ReflectorPeer(KEY), unlimited(net)).both == 1412


def test_gap_costs_the_path_mtu_search_few_bytes() -> None:
    """A gap of 70 s in which waits are short would cost hundreds of long packets."""
    down = LinkShape(delay_s=0.0275)
    plain, broken = (
        network(replace(down, mtu=1400), down),
        network(replace(down, mtu=1400, gaps_s=((0.5, 70.5),)), down),
    )
    for net in (plain, broken):
        assert path_mtu(net, ReflectorPeer(KEY), unlimited(net)).up == 1400
    assert broken.up.sent_bytes - plain.up.sent_bytes < 15_000


def test_gap_does_not_reduce_the_path_mtu() -> None:
    net = network(LinkShape(delay_s=0.3, mtu=1400, gaps_s=((4.0, 74.0),)), LinkShape(delay_s=0.3))
    assert path_mtu(net, ReflectorPeer(KEY), unlimited(net), timeout_s=1).up == 1400


def test_a_far_end_that_is_silent_has_no_mtu() -> None:
    net = network(LinkShape(loss=1.0))
    found = path_mtu(net, ReflectorPeer(KEY), unlimited(net), timeout_s=1)
    assert (found.up, found.both, found.why) == (None, None, "nothing was answered for 90 s")


def test_grids_pass_sustained_rates_and_state_the_unknown_shape() -> None:
    idle = 0.57
    rows = []
    for octets in grids.TELEMETRY_SIZES:
        for rate in grids.TELEMETRY_RATES_HZ:
            _, samples = run_train(network(UP, DOWN), grids.telemetry_plan(octets, rate, 20))
            rows.append(grids.telemetry_row(octets, rate, train_figures(samples, "train"), idle))
    for image in grids.IMAGES[1:4:2]:
        for rate in grids.IMAGE_RATES_HZ[:3]:
            figures = _sent(network(UP, DOWN), grids.image_plan(image, rate, 20))
            assert figures is not None
            rows.append(grids.image_row(image, rate, figures, 0.8))
    lines = grids.table(rows)
    assert lines[0] == grids.SHAPE_UNKNOWN
    assert max(map(len, lines[1:])) <= 80
    verdicts = {(row.label, row.rate_hz): row.verdict for row in rows}
    assert verdicts["32 B", 10.0] is Verdict.PASS
    assert verdicts["160x120 q60", 1.0] is Verdict.PASS
    assert verdicts["320x240 q60", 2.0] is Verdict.PASS
    assert {row.reason for row in rows if row.verdict is Verdict.PASS} == {"sustained"}


def test_grid_cell_beyond_the_link_fails() -> None:
    _, samples = run_train(network(replace(UP, rate_bps=30_000), DOWN), grids.telemetry_plan(512, 10, 30))
    row = grids.telemetry_row(512, 10, train_figures(samples, "train"), 0.6)
    assert row.verdict is Verdict.FAIL


def test_gap_makes_a_grid_cell_inconclusive() -> None:
    _, samples = run_train(network(replace(UP, gaps_s=((5.0, 10.0),)), DOWN), grids.telemetry_plan(32, 4, 20))
    row = grids.telemetry_row(32, 4, train_figures(samples, "train"), 0.6)
    assert (row.sent - row.received, row.verdict, row.reason) == (20, Verdict.INCONCLUSIVE, "a gap of the link")


def test_one_loss_among_few_packets_is_inconclusive() -> None:
    early = network(replace(UP, gaps_s=((0.0, 0.1),)), DOWN)
    _, samples = run_train(early, grids.telemetry_plan(32, 1, 20))
    row = grids.telemetry_row(32, 1, train_figures(samples, "train"), 0.6)
    assert (row.sent - row.received, row.verdict, row.reason) == (1, Verdict.INCONCLUSIVE, grids.FEW)
    figures = _sent(network(replace(UP, gaps_s=((0.0, 0.1),)), DOWN), MessagePlan(grids.IMAGES[0].octets, 1, 20))
    assert figures is not None
    row = grids.image_row(grids.IMAGES[0], 1, figures, 0.8)
    assert (row.sent - row.received, row.verdict, row.reason) == (1, Verdict.INCONCLUSIVE, grids.FEW)


def test_byte_count_is_known_before_sending() -> None:
    net = network(UP, DOWN)
    plan = TrainPlan(172, 0.25, 20)
    run_train(net, plan, ReflectorPeer(KEY, counts=False))
    assert net.up.sent_bytes + net.delivered_bytes == grids.train_bytes(plan, HEADERS)
    net = network(UP, DOWN)
    images = MessagePlan(6_000, 1, 10)
    _sent(net, images)
    counted = net.up.sent_bytes + net.delivered_bytes
    assert grids.message_bytes(images, HEADERS) == pytest.approx(counted, rel=0.01)


def test_criteria_are_named_after_the_recommendations() -> None:
    good = LinkShape(delay_s=0.02)
    _, samples = run_train(network(good, good), TrainPlan(172, 0.1, 100))
    judged = judge(train_figures(samples, "train"), profile("lte"))
    assert [(j.criterion, j.verdict) for j in judged] == [
        ("FTD, round trip, 95 %", Verdict.PASS),
        ("FDV up, 95 %", Verdict.PASS),
        ("FDV down, 95 %", Verdict.PASS),
        ("FLR up", Verdict.PASS),
        ("FLR down", Verdict.PASS),
        ("longest gap", Verdict.PASS),
        ("AVAIL", Verdict.PASS),
        ("buffer delay (RFC 6349)", Verdict.INCONCLUSIVE),
    ]
    bad = LinkShape(delay_s=0.2, jitter_s=0.3, loss=0.1, gaps_s=((20.0, 40.0),))
    _, samples = run_train(network(bad, bad), TrainPlan(172, 0.1, 100))
    assert {j.verdict for j in judge(train_figures(samples, "train"), profile("lte"))[:-1]} == {Verdict.FAIL}


def test_sparse_packets_cannot_show_availability() -> None:
    _, samples = run_train(network(), TrainPlan(172, 2, 1400))
    judged = {j.criterion: j for j in judge(train_figures(samples, "train"), profile("satellite"))}
    assert (judged["AVAIL"].measured, judged["AVAIL"].verdict) == (None, Verdict.INCONCLUSIVE)


def test_unknown_profile_is_reported_with_the_known_ones() -> None:
    with pytest.raises(NoSuchProfile, match="unknown threshold profile `5g`") as error:
        profile("5g")
    assert error.value.hint == "choose one of: satellite, lte, wifi"
    assert all(p.min_samples for p in profiles().values())
