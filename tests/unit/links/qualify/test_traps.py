"""The traps of facts/devices.md, section 9, and others: each is a way to a figure that is not true.

Elsewhere: delays one way need two clocks (test_figures), `lost` of irtt is a word (test_qualify_beside), what a run
costs is known before it (test_messages, test_messages_down), no kernel's netem is needed (test_udp_link), and an image
is lost with each of its packets (test_messages). The bytes of DDS belong to `provision measure fit`.
"""

import io

import pytest
from simulated_network import KEY, SECOND, Recording, SimulatedNetwork, network, run_train, unlimited
from tolerances import tolerances

from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.emulator.udp_link import HEADERS, LinkShape
from atlantis_netcfg.links.qualify.figures import train_figures
from atlantis_netcfg.links.qualify.judgement import judge, profile
from atlantis_netcfg.links.qualify.messages import MessagePlan, MessageStream
from atlantis_netcfg.links.qualify.reflector.answering import Reflector
from atlantis_netcfg.links.qualify.reflector.stamp import ReflectorPacket, decode_sender, ntp
from atlantis_netcfg.links.qualify.samples import SamplesUnreadable, read
from atlantis_netcfg.links.qualify.session import ReflectorPeer, Train, TrainPlan, run
from atlantis_netcfg.links.qualify.transfers import MessageFigures, message_figures

SLOW_UP = LinkShape(rate_bps=352_000, delay_s=0.28, loss=0.0)
DOWN = LinkShape(rate_bps=704_000, delay_s=0.28)


def _messages(net: SimulatedNetwork, plan: MessagePlan) -> MessageFigures:
    recording = Recording()
    peer = ReflectorPeer(KEY)
    run(net, peer, [MessageStream("m", plan, peer, net, recording.write)], unlimited(net))
    figures = message_figures(recording.samples, "m")
    assert figures is not None
    return figures


def test_percentiles_come_from_raw_samples() -> None:
    """irtt gives min, mean and max: one packet in twenty that takes 3 s hides in them."""
    net = network(LinkShape(delay_s=0.3, reordering=0.06, reorder_s=2.0), LinkShape(delay_s=0.3))
    _, samples = run_train(net, TrainPlan(172, 0.25, 200))
    rtt = train_figures(samples, "train").rtt
    assert rtt is not None
    assert rtt.p50 == pytest.approx(0.6, abs=0.001)
    assert rtt.p90 == pytest.approx(0.6, abs=0.001)
    assert rtt.p99 == pytest.approx(2.6, abs=0.001)


def test_a_train_outlives_a_gap_at_its_very_beginning() -> None:
    """irtt gives up opening after 15 s; a satellite may be silent for 70."""
    net = network(LinkShape(delay_s=0.3, gaps_s=((0.0, 70.0),)), LinkShape(delay_s=0.3))
    reason, samples = run_train(net, TrainPlan(172, 0.25, 100))
    figures = train_figures(samples, "train")
    assert reason == "done"
    assert figures.gaps.longest_s == pytest.approx(70, abs=0.5)
    assert figures.loss.received == 120


def test_unfinished_gap_counts() -> None:
    net = network(LinkShape(delay_s=0.3, gaps_s=((50.0, 1000.0),)), LinkShape(delay_s=0.3))
    _, samples = run_train(net, TrainPlan(172, 0.25, 100))
    gaps = train_figures(samples, "train").gaps
    assert gaps.longest_s == pytest.approx(50, abs=0.5)
    assert gaps.open_end


@pytest.mark.parametrize("counts", [True, False])
def test_loss_in_gaps_is_unavailability_not_frame_loss(counts: bool) -> None:  # noqa: FBT001
    """ITU-T Y.1563: severely errored blocks leave the loss ratio. A gap of 70 s in 120 would be 58 % loss."""
    net = network(LinkShape(delay_s=0.3, gaps_s=((20.0, 90.0),)), LinkShape(delay_s=0.3))
    _, samples = run_train(net, TrainPlan(172, 0.2, 120), ReflectorPeer(KEY, counts=counts))
    figures = train_figures(samples, "train")
    assert figures.loss.lost == 350, "the packets are counted"
    assert figures.loss.share == pytest.approx(0.583, abs=0.001)
    assert (figures.flr.up, figures.flr.down, figures.flr.both, figures.flr.in_gaps) == (0.0, 0.0, 0.0, 350)
    judged = {
        item.criterion: item for item in judge(figures, profile("satellite").model_copy(update={"min_samples": 500}))
    }
    assert [judged[name].verdict for name in ("FLR up", "FLR down", "longest gap")] == [Verdict.PASS] * 3
    assert judged["AVAIL"].measured == pytest.approx(50 / 120, abs=0.01)
    assert judged["AVAIL"].verdict is Verdict.FAIL


def test_loss_outside_gaps_is_attributed_to_the_link() -> None:
    up = LinkShape(delay_s=0.3, loss=0.05, gaps_s=((100.0, 170.0),))
    net = network(up, LinkShape(delay_s=0.3, loss=0.02), 4)
    _, samples = run_train(net, TrainPlan(172, 0.25, 600))
    figures = train_figures(samples, "train")
    outside = 2400 - 280
    assert figures.flr.up == pytest.approx(net.up.loss_count / outside, abs=0.002)
    assert figures.flr.down == pytest.approx(net.down.loss_count / (outside - net.up.loss_count), abs=0.002)
    assert figures.flr.both == pytest.approx((net.up.loss_count + net.down.loss_count) / outside, abs=0.002)
    judged = {item.criterion: item for item in judge(figures, profile("satellite"))}
    assert judged["FLR up"].measured == figures.flr.up
    assert judged["FLR up"].verdict is Verdict.FAIL
    assert judged["FLR down"].verdict is Verdict.PASS


def test_few_packets_outside_of_gaps_do_not_pass() -> None:
    net = network(LinkShape(delay_s=0.3, gaps_s=((20.0, 90.0),)), LinkShape(delay_s=0.3))
    _, samples = run_train(net, TrainPlan(172, 0.2, 120))
    judged = {item.criterion: item for item in judge(train_figures(samples, "train"), profile("satellite"))}
    assert judged["FLR up"].verdict is Verdict.INCONCLUSIVE
    assert judged["FLR up"].reason == "only 250 packets outside of gaps, at least 300 are needed"


def test_goodput_is_measured_at_the_receiver() -> None:
    """iperf3 (a): the sender of a TCP stream says 449 kbit/s of a link of 352."""
    net = network(SLOW_UP, DOWN)
    plan = MessagePlan(size=60_000, rate_hz=0.5, duration_s=40, pace_bps=1e6, packet=1200, give_up_s=200)
    figures = _messages(net, plan)
    carries = 352_000 * 1048 / (1200 + HEADERS)
    assert figures.busy_bps == pytest.approx(carries, rel=tolerances()["goodput_share"])


def test_transfer_time_ends_at_reception() -> None:
    """iperf3 (b): 200 kB `sent` in 2.27 s, of which the receiver had 75 kB."""
    net = network(SLOW_UP, DOWN)
    plan = MessagePlan(size=50_000, rate_hz=1, duration_s=1)
    figures = _messages(net, plan)
    assert figures.latency is not None
    wire = 50_000 + figures.chunks * (1200 + HEADERS - 1048)
    assert figures.latency.p50 == pytest.approx(wire * 8 / 352_000 + 0.56, rel=tolerances()["goodput_share"])
    short = network(LinkShape(rate_bps=352_000, delay_s=0.28, queue_bytes=20_000), DOWN)
    figures = _messages(short, plan)
    assert (figures.received_count, figures.lost_count, figures.latency) == (0, 1, None), "a part is no message"


def test_packets_in_flight_at_the_end_are_not_lost() -> None:
    """iperf3 (c): 7.6 % reported where 1 % was lost: the rest was in flight, or in the queue."""
    net = network(LinkShape(rate_bps=352_000, delay_s=0.28, loss=0.01), DOWN, 5)
    recording = Recording()
    train = Train("train", TrainPlan(500, 0.0115, 60, timeout_s=3), ReflectorPeer(KEY), net, recording.write)
    net.interrupt_at_ns = 20 * SECOND
    assert run(net, ReflectorPeer(KEY), [train], unlimited(net)) == "stopped"
    figures = train_figures(recording.samples, "train")
    loss = figures.loss
    assert figures.reason == "stopped"
    assert loss.in_flight > 100, "three seconds of packets"
    assert loss.received + loss.in_flight + loss.lost == loss.sent
    assert loss.lost / (loss.sent - loss.in_flight) == pytest.approx(0.01, abs=0.007)
    assert loss.lost <= net.up.loss_count


def test_queue_drops_are_distinguished_from_link_loss() -> None:
    """iperf3 (c): 600 kbit/s into 352 lose 38 %, of which 1 % is the link's. The idle train tells that one."""
    up = LinkShape(rate_bps=352_000, delay_s=0.28, loss=0.01, queue_bytes=16_000)
    idle, full = network(up, DOWN, 6), network(up, DOWN, 7)
    _, calm = run_train(idle, TrainPlan(484, 0.05, 100))
    _, loaded = run_train(full, TrainPlan(484, 512 * 8 / 600_000, 20))
    quiet, crowded = (train_figures(samples, "train").loss for samples in (calm, loaded))
    assert quiet.lost == idle.up.loss_count > 0
    assert quiet.share == pytest.approx(0.01, abs=0.008)
    assert crowded.share == pytest.approx(1 - 352 / 600, abs=0.04)
    assert full.up.loss_count < crowded.lost / 20


def test_goodput_is_independent_of_congestion_control() -> None:
    """iperf3 (e): what a TCP reports depends on its algorithm, and on what loss means to it. Messages have none."""
    for loss in (0.0, 0.1):
        net = network(LinkShape(rate_bps=352_000, delay_s=0.28, loss=loss), DOWN, 8)
        figures = _messages(net, MessagePlan(200_000, 0.05, 100, pace_bps=350_000, give_up_s=200))
        carries = 350_000 * 1048 / (1200 + HEADERS)
        assert figures.busy_bps == pytest.approx(carries * (1 - loss), rel=tolerances()["goodput_share"])


def test_late_is_not_lost() -> None:
    net = network(LinkShape(delay_s=0.1, reordering=0.1, reorder_s=4.0), LinkShape(delay_s=0.1))
    _, samples = run_train(net, TrainPlan(172, 0.25, 100, timeout_s=3))
    loss = train_figures(samples, "train").loss
    assert loss.late == pytest.approx(40, abs=20)
    assert loss.lost <= 2, "those that the run did not wait for"
    assert loss.received + loss.lost == loss.sent


def test_latency_under_load_is_reported_separately() -> None:
    """iperf3 (d): the mean round trip rose from 0.63 to 0.98 s under load."""
    net = network(LinkShape(rate_bps=352_000, delay_s=0.28, queue_bytes=16_000), DOWN)
    peer, recording = ReflectorPeer(KEY), Recording()
    plan = TrainPlan(112, 0.25, 30)
    run(net, peer, [Train("idle", plan, peer, net, recording.write)], unlimited(net))
    load = MessageStream("load", MessagePlan(30_000, 2, 30, pace_bps=700_000), peer, net, recording.write)
    run(net, peer, [Train("loaded", plan, peer, net, recording.write), load], unlimited(net))
    idle, loaded = (train_figures(recording.samples, name) for name in ("idle", "loaded"))
    assert idle.rtt is not None
    assert loaded.rtt is not None
    assert idle.rtt.p50 == pytest.approx(0.566, abs=0.01)
    assert 0.56 + 0.2 < loaded.rtt.p50 <= 0.57 + 16_000 * 8 / 352_000
    assert idle.rpm is not None
    assert loaded.rpm is not None
    assert idle.rpm == pytest.approx(60 / 0.566, rel=0.02)
    assert loaded.rpm < 0.75 * idle.rpm
    words = judge(idle, profile("satellite"), loaded)[-1]
    assert words.criterion == "buffer delay (RFC 6349)"
    assert words.measured == pytest.approx((loaded.rtt.p50 - idle.rtt.p50) / idle.rtt.p50)


def _copying(datagram: bytes, received_ns: int) -> bytes:
    """A stateless reflector (RFC 8762, 4.3.1): it answers with the sender's own number."""
    asked = decode_sender(datagram, KEY)
    stamp = ntp(received_ns)
    return ReflectorPacket(
        asked.sequence, stamp, 1, asked.session_id, stamp, asked.sequence, asked.timestamp, asked.error, 64, asked.tlvs
    ).encode(KEY)


def test_reflector_copying_sequence_numbers_gives_no_one_way_loss() -> None:
    net = network(LinkShape(delay_s=0.1, loss=0.05), LinkShape(delay_s=0.1), answers=_copying)
    _, samples = run_train(net, TrainPlan(172, 0.25, 100), ReflectorPeer(KEY, counts=False))
    loss = train_figures(samples, "train").loss
    assert loss.lost > 5
    assert (loss.up, loss.down) == (None, None)
    assert loss.why == "the reflector may merely copy the sender's numbers"


def test_restarted_reflector_gives_no_one_way_loss() -> None:
    net = network(LinkShape(delay_s=0.1, loss=0.05), LinkShape(delay_s=0.1))
    second = Reflector(KEY)

    def answers(datagram: bytes, received_ns: int) -> bytes | None:
        reflector = net.reflector if net.now < 50 * SECOND else second
        return reflector.answer(datagram, ("192.0.2.1", 1), received_ns, 64, lambda: received_ns)

    net.answers = answers
    _, samples = run_train(net, TrainPlan(172, 0.25, 100))
    loss = train_figures(samples, "train").loss
    assert (loss.up, loss.down) == (None, None)
    assert loss.why == "the reflector restarted its count during this packet train"


def test_rate_limited_replies_are_not_link_loss() -> None:
    net = network(LinkShape(delay_s=0.1), LinkShape(delay_s=0.1))
    net.reflector = Reflector(KEY, rate_bps=50_000)
    _, samples = run_train(net, TrainPlan(1200, 0.05, 60))
    figures = train_figures(samples, "train")
    assert figures.loss.limited > 100
    words = {j.criterion: j for j in judge(figures, profile("lte"))}
    assert words["FLR up"].verdict is Verdict.INCONCLUSIVE
    assert "the reflector refused" in words["FLR up"].reason


def test_duplicate_session_ids_are_not_mixed_up() -> None:
    net, recording, peer = network(LinkShape(delay_s=0.1), LinkShape(delay_s=0.1)), Recording(), ReflectorPeer(KEY)
    plan = TrainPlan(172, 0.25, 20)
    for names in (("a", "b"), ("c",)):
        streams = [Train(name, plan, peer, net, recording.write, session_id=7) for name in names]
        assert run(net, peer, streams, unlimited(net)) == "done"
    losses = [train_figures(recording.samples, name).loss for name in "abc"]
    assert [(loss.received, loss.up, loss.down, loss.why) for loss in losses] == [
        (80, 0, 0, "by the reflector's count")
    ] * 3


def test_reply_rate_limit_does_not_limit_reception() -> None:
    """Chunks that want no answer are not refused for a rate of answers: they would look like a slow link, and loss."""
    net = network(SLOW_UP, DOWN)
    net.reflector = Reflector(KEY, rate_bps=50_000)
    figures = _messages(net, MessagePlan(60_000, 0.2, 100, pace_bps=1e6))
    assert (figures.received_count, figures.lost_count) == (20, 0)
    assert figures.busy_bps == pytest.approx(352_000 * 1048 / (1200 + HEADERS), rel=tolerances()["goodput_share"])


@pytest.mark.parametrize(("seconds", "verdict"), [(60, Verdict.INCONCLUSIVE), (120, Verdict.FAIL)])
def test_silence_is_inconclusive_until_a_gap_would_have_ended(seconds: int, verdict: Verdict) -> None:
    net = network(LinkShape(loss=1.0))
    _, samples = run_train(net, TrainPlan(172, 0.25, seconds))
    figures = train_figures(samples, "train")
    assert (figures.rtt, figures.rpm, figures.up) == (None, None, None)
    assert figures.loss.why == "no responses"
    assert [j.verdict for j in judge(figures, profile("satellite"))] == [verdict]


def test_too_few_packets_pass_nothing() -> None:
    _, samples = run_train(network(LinkShape(delay_s=0.02)), TrainPlan(172, 0.25, 10))
    judged = judge(train_figures(samples, "train"), profile("wifi"))
    by_packets = [j for j in judged if j.criterion.startswith(("FTD", "FDV", "FLR", "AVAIL"))]
    assert len(by_packets) == 6
    assert {j.verdict for j in by_packets} == {Verdict.INCONCLUSIVE}


def test_echoed_request_is_not_accepted_as_a_reply() -> None:
    net = network(LinkShape(delay_s=0.1), answers=lambda datagram, _: datagram)
    _, samples = run_train(net, TrainPlan(172, 0.25, 10))
    assert train_figures(samples, "train").loss.received == 0


def test_stop_keeps_samples_and_truncated_line_is_skipped() -> None:
    net = network(LinkShape(delay_s=0.3), LinkShape(delay_s=0.3))
    recording = Recording()
    train = Train("train", TrainPlan(172, 0.25, 100), ReflectorPeer(KEY), net, recording.write)
    net.interrupt_at_ns = 30 * SECOND
    run(net, ReflectorPeer(KEY), [train], unlimited(net))
    text = recording.text.getvalue()
    assert train_figures(read(io.StringIO(text)), "train").loss.received == 118
    cut = text[: text.rindex('{"kind":"reply"') + 40]
    figures = train_figures(read(io.StringIO(cut)), "train")
    assert (figures.reason, figures.loss.received) == ("cut off", 117)


def test_edited_line_is_reported() -> None:
    lines = ['{"kind":"end","stream":"a","ended_at_ns":5,"reason":"done"}\n', '{"kind":"end","stream":"a"}\n']
    with pytest.raises(SamplesUnreadable, match=r"run\.jsonl:2: this line is not a measurement sample"):
        list(read(lines, "run.jsonl"))
