"""Messages from the far end: what they measure, and that nobody else gets them."""

from dataclasses import replace

import pytest
from simulated_network import KEY, SECOND, SOURCE, START, Recording, SimulatedNetwork, network, unlimited
from tolerances import tolerances

from atlantis_netcfg.emulator.udp_link import HEADERS, LinkShape
from atlantis_netcfg.links.qualify.budget import Budget, BudgetGuard
from atlantis_netcfg.links.qualify.messages import DEFAULT_PACKET, MessagePlan, MessageStream
from atlantis_netcfg.links.qualify.messages_down import DownMessageStream, requested_bytes
from atlantis_netcfg.links.qualify.reflector import stamp
from atlantis_netcfg.links.qualify.reflector.answering import Reflector
from atlantis_netcfg.links.qualify.samples import MessageDirection, MessageResult
from atlantis_netcfg.links.qualify.search import RateLimit, sustained_rate
from atlantis_netcfg.links.qualify.session import PacketStream, ReflectorPeer, run
from atlantis_netcfg.links.qualify.transfers import MessageFigures, message_figures

UP = LinkShape(rate_bps=352_000, delay_s=0.28)
DOWN = LinkShape(rate_bps=704_000, delay_s=0.28)
ROOM = DEFAULT_PACKET - 152
"""What a packet carries of a message."""


def _requested(net: SimulatedNetwork, plan: MessagePlan, guard: BudgetGuard | None = None) -> list[MessageResult]:
    recording, peer = Recording(), ReflectorPeer(KEY)
    stream = DownMessageStream("load down", plan, peer, net, recording.write)
    run(net, peer, [stream], guard or unlimited(net))
    return [sample for sample in recording.samples if isinstance(sample, MessageResult)]


def _figures(net: SimulatedNetwork, plan: MessagePlan) -> MessageFigures:
    figures = message_figures(_requested(net, plan), "load down")
    assert figures is not None
    return figures


@pytest.mark.parametrize("size", [1, ROOM, ROOM + 1, 6200, 100_000])
def test_message_of_any_size_arrives(size: int) -> None:
    net = network(UP, DOWN, skew_ns=-50 * SECOND)
    ended = _requested(net, MessagePlan(size, 0.1, 20, pace_bps=700_000))
    assert [(m.received_size, m.chunks, m.direction) for m in ended] == [(size, -(-size // ROOM), "down")] * 2
    for message in ended:
        assert message.first_ns is not None
        assert START < message.first_ns <= START + net.now, "by this computer's clock, not by the reflector's"


@pytest.mark.parametrize("rate_bps", [352_000, 704_000])
def test_goodput_down_is_what_the_link_carries(rate_bps: int) -> None:
    net = network(UP, replace(DOWN, rate_bps=rate_bps))
    figures = _figures(net, MessagePlan(60_000, 0.2, 40, pace_bps=2e6))
    carries = rate_bps * ROOM / (DEFAULT_PACKET + HEADERS)
    assert figures.busy_bps == pytest.approx(carries, rel=tolerances()["goodput_share"])
    assert (figures.received_count, figures.lost_count) == (8, 0)


def test_goodput_of_a_link_that_is_never_idle() -> None:
    net = network(UP, DOWN)
    figures = _figures(net, MessagePlan(20_000, 5, 20, pace_bps=2e6, give_up_s=300))
    carries = 704_000 * ROOM / (DEFAULT_PACKET + HEADERS)
    assert figures.lost_count > 10, "more was requested than the link carries"
    assert figures.receiver_bps == pytest.approx(carries, rel=tolerances()["goodput_share"])


def test_goodput_per_direction() -> None:
    """Both loads in one run, on one socket: the ways differ by two, and are told apart."""
    net = network(UP, DOWN)
    recording, peer = Recording(), ReflectorPeer(KEY)
    plan = MessagePlan(40_000, 0.2, 20, pace_bps=1e6)
    streams: list[PacketStream] = [
        MessageStream("load up", plan, peer, net, recording.write),
        DownMessageStream("load down", plan, peer, net, recording.write),
    ]
    assert run(net, peer, streams, unlimited(net)) == "done"
    for name, rate_bps in (("load up", 352_000), ("load down", 704_000)):
        figures = message_figures(recording.samples, name)
        assert figures is not None
        carries = rate_bps * ROOM / (DEFAULT_PACKET + HEADERS)
        assert figures.busy_bps == pytest.approx(carries, rel=tolerances()["goodput_share"]), name


def test_far_end_keeps_the_pace() -> None:
    net = network(UP, LinkShape(delay_s=0.28))
    figures = _figures(net, MessagePlan(60_000, 0.2, 20, pace_bps=200_000))
    assert figures.busy_bps == pytest.approx(200_000 * ROOM / (DEFAULT_PACKET + HEADERS), rel=0.02)


def test_messages_are_sent_one_after_another() -> None:
    """Each takes 0.6 s at its pace and the next is requested after 0.5 s: together they would be twice as fast."""
    net = network(UP, LinkShape(delay_s=0.28))
    figures = _figures(net, MessagePlan(30_000, 2, 10, pace_bps=500_000))
    offered = 500_000 * ROOM / (DEFAULT_PACKET + HEADERS)
    assert figures.received_count == 20
    assert figures.receiver_bps == pytest.approx(offered, rel=0.02)
    assert figures.busy_bps == pytest.approx(offered, rel=0.02)


def test_the_latency_is_from_the_request_to_the_last_octet() -> None:
    figures = _figures(network(UP, DOWN), MessagePlan(50_000, 0.1, 30))
    assert figures.latency is not None
    wire = 50_000 + figures.chunks * (DEFAULT_PACKET - ROOM + HEADERS)
    assert figures.latency.p50 == pytest.approx(wire * 8 / 704_000 + 0.56, rel=tolerances()["goodput_share"])


def test_lost_request_is_not_downward_loss() -> None:
    net = network(replace(UP, loss=0.2), DOWN, 3)
    figures = _figures(net, MessagePlan(3_000, 0.5, 100, timeout_s=2))
    assert net.up.loss_count > 5
    assert (figures.received_count, figures.lost_count, figures.unknown) == (50, 0, 0)


def test_lost_single_packet_message_counts_as_lost() -> None:
    """It is not simply requested again, which would hide the loss."""
    net = network(UP, replace(DOWN, loss=0.1), 4)
    figures = _figures(net, MessagePlan(500, 1, 300, timeout_s=2))
    assert figures.sent_count == 300
    assert figures.lost_count == pytest.approx(30, abs=20)
    assert figures.received_count + figures.lost_count + figures.unknown == 300
    # Lost on the way down, and not an answer to a question, of which there is one a lost message and a few more.
    assert 0 <= net.down.loss_count - figures.lost_count <= 10


def test_missing_parts_are_requested_again_with_resend() -> None:
    shape = replace(DOWN, loss=0.1, gaps_s=((3.0, 40.0),))
    net = network(replace(UP, loss=0.1), shape, 5)
    figures = _figures(net, MessagePlan(40_000, 0.1, 20, resend=True, pace_bps=300_000, give_up_s=300))
    assert (figures.sent_count, figures.received_count) == (2, 2)


def test_duplicates_do_not_count_towards_the_message() -> None:
    net = network(UP, replace(DOWN, duplicates=1.0))
    ended = _requested(net, MessagePlan(5_000, 0.5, 20))
    assert {message.received_size for message in ended} == {5_000}


def test_silence_is_unknown_and_not_lost() -> None:
    figures = _figures(network(UP, LinkShape(loss=1.0)), MessagePlan(5_000, 1, 20, give_up_s=20))
    assert (figures.sent_count, figures.received_count, figures.lost_count, figures.unknown) == (1, 0, 0, 1)
    assert figures.latency is None


def test_gap_at_the_beginning_is_survived() -> None:
    gap = ((0.0, 70.0),)
    net = network(replace(UP, gaps_s=gap), replace(DOWN, gaps_s=gap))
    figures = _figures(net, MessagePlan(5_000, 1, 20))
    assert (figures.sent_count, figures.received_count) == (20, 20)


def test_restarted_reflector_gives_a_new_token() -> None:
    net = network(UP, DOWN)
    plan = MessagePlan(5_000, 0.5, 40)
    recording, peer = Recording(), ReflectorPeer(KEY)
    stream = DownMessageStream("load down", plan, peer, net, recording.write)

    def replaced() -> bool:
        if net.now > 20 * SECOND and net.reflector is first:
            net.reflector = Reflector(KEY)
        return False

    first = net.reflector
    assert run(net, peer, [stream], unlimited(net), stop=replaced) == "done"
    figures = message_figures(recording.samples, "load down")
    assert figures is not None
    assert net.reflector is not first
    assert figures.received_count >= 19


def test_messages_under_way_at_a_stop_count_as_in_flight() -> None:
    net = network(UP, DOWN)
    net.interrupt_at_ns = 10 * SECOND
    ended = _requested(net, MessagePlan(50_000, 1, 100))
    assert ended[-1].in_flight
    figures = message_figures(ended, "load down")
    assert figures is not None
    assert figures.in_flight >= 1
    assert figures.lost_count == 0


def test_the_highest_rate_down() -> None:
    size = 6_000
    net = network(UP, DOWN)
    idle = _figures(net, MessagePlan(size, 0.2, 30)).latency
    assert idle is not None
    found = sustained_rate(size, lambda hz: _figures(net, MessagePlan(size, hz, 12)), idle_latency_s=idle.p50)
    carries = 704_000 / 8 / (size + -(-size // ROOM) * (DEFAULT_PACKET - ROOM + HEADERS))
    below, above = tolerances()["rate_below_share"], tolerances()["rate_above_share"]
    assert found.rate_hz is not None
    assert carries * (1 - below) <= found.rate_hz <= carries * (1 + above)
    assert found.limited_by in {RateLimit.LATENCY, RateLimit.QUEUE, RateLimit.LOSS}


def test_far_end_reports_its_maximum_rate() -> None:
    net = network()
    net.reflector = Reflector(KEY, rate_bps=1e6)
    figures = _figures(net, MessagePlan(200_000, 0.1, 60))
    assert figures.far_rate_bps == 1e6
    assert figures.receiver_bps is not None
    assert figures.receiver_bps < 1e6
    assert figures.is_bounded
    assert (figures.received_count, figures.lost_count) == (6, 0), "it waits, and drops nothing"


def test_request_is_charged_with_the_whole_reply() -> None:
    size = 50_000
    chunks = -(-size // ROOM)
    brings = size + chunks * (DEFAULT_PACKET - ROOM + HEADERS)
    for spare, expected in ((-1, 0), (2 * brings, 1)):
        net = network(UP, DOWN)
        # The question for the token and its answer, the request, and the message.
        guard = BudgetGuard(Budget(3 * 200 + brings + spare), lambda net=net: net.now / SECOND)  # type: ignore[misc]
        _requested(net, MessagePlan(size, 1, 1), guard)
        assert net.reflector.statistics.requested == expected * chunks
        assert guard.limited_by == (None if expected else "bytes")


def test_byte_count_is_known_before_requesting() -> None:
    net = network(UP, DOWN)
    plan = MessagePlan(6_000, 1, 10)
    _requested(net, plan)
    assert net.up.sent_bytes + net.delivered_bytes == requested_bytes(plan, HEADERS)


@pytest.mark.parametrize(("key", "packet"), [(None, 1200), (KEY, 140)])
def test_invalid_request_is_refused_locally(key: bytes | None, packet: int) -> None:
    with pytest.raises(ValueError, match=r"our own reflector, with its key|packets of 140 octets carry nothing"):
        DownMessageStream("d", MessagePlan(10, 1, 1, packet=packet), ReflectorPeer(key), network(), Recording().write)


class FarEnd:
    """A reflector by hand; whoever asks it gets what it sends within a minute."""

    def __init__(self, key: bytes | None = KEY, **limits: float) -> None:
        self.key = key
        self.reflector = Reflector(key, **limits)  # type: ignore[arg-type] # its numbers
        self.now = START

    def raw(self, datagram: bytes, source: tuple[str, int] = SOURCE) -> list[bytes]:
        reply = self.reflector.answer(datagram, source, self.now, 64, lambda: self.now)
        sent = [] if reply is None else [reply]
        end = self.now + 60 * SECOND
        while (due := self.reflector.due_ns()) is not None and due <= end:
            self.now = max(self.now, due)
            requested = self.reflector.requested_chunk(lambda: self.now)
            if requested is not None:
                assert requested[1] == source
                sent.append(requested[0])
        return sent

    def request(self, sequence: int, token: bytes | None = None, *, session: int = 5, **changes: int) -> bytes:
        wanted = {"message": 0, "message_size": 9000, "first": 0, "count": 9, "packet": 1200, "pace_kbps": 0} | changes
        value = stamp.MessageRequest(**wanted, token=token or bytes(16))
        tlvs = (stamp.Tlv(stamp.REQUEST, value.encode()),)
        return stamp.SenderPacket(sequence, stamp.ntp(self.now), 1, session, tlvs).encode(self.key)

    def token(self, sequence: int = 1000) -> bytes:
        (answer,) = self.raw(self.request(sequence, count=0))
        return self.status(answer).token

    def status(self, answer: bytes) -> stamp.RequestStatus:
        (tlv,) = self.packet(answer).tlvs
        assert tlv.type == stamp.REQUEST
        return stamp.RequestStatus.decode(tlv.value)

    def packet(self, answer: bytes) -> stamp.ReflectorPacket:
        return stamp.decode_reflector(answer, self.key)


def test_every_chunk_is_authenticated_and_answers_its_request() -> None:
    far = FarEnd()
    sent = far.raw(far.request(1001, far.token()))
    packets = [far.packet(answer) for answer in sent]
    chunks = [stamp.MessageChunk.decode(packet.tlvs[0].value) for packet in packets]
    assert {packet.tlvs[0].type for packet in packets} == {stamp.CHUNK}
    assert [chunk.index for chunk in chunks] == [*range(9)]
    assert sum(len(chunk.data) for chunk in chunks) == 9000
    assert {packet.sender_sequence for packet in packets} == {1001}
    assert max(map(len, sent)) == 1200
    assert len({chunk.data for chunk in chunks}) == 9, "nothing compresses them"


def test_partial_request_and_its_status() -> None:
    far = FarEnd()
    token = far.token()
    chunks = [far.packet(answer) for answer in far.raw(far.request(1001, token, first=7, count=2))]
    assert [stamp.MessageChunk.decode(packet.tlvs[0].value).index for packet in chunks] == [7, 8]
    (answer,) = far.raw(far.request(1002, token, count=0))
    assert far.status(answer) == stamp.RequestStatus(0, 2, 50_000, token)


def test_unauthenticated_request_gets_no_longer_reply() -> None:
    far, stranger = FarEnd(), FarEnd(b"another key, also 32 octets long")
    token = far.token()
    assert far.raw(stranger.request(1, token)) == []
    assert far.raw(far.request(1, token)[:-1] + b"!") == []
    anybody = FarEnd(None)
    request = anybody.request(1)
    (answer,) = anybody.raw(request)
    assert len(answer) <= len(request), "an unauthenticated reflector does not know this extension"
    assert anybody.packet(answer).tlvs[0].flags == 0x80


def test_replayed_request_is_ignored() -> None:
    far = FarEnd()
    recorded = far.request(1001, far.token())
    assert len(far.raw(recorded)) == 9
    assert far.raw(recorded) == []
    far.now += 901 * SECOND
    assert far.raw(far.request(0, count=0, session=6))
    assert far.raw(recorded) == [], "nor when its session is forgotten"


def test_replayed_request_after_a_restart_brings_no_data() -> None:
    far = FarEnd()
    recorded = far.request(1001, far.token())
    far.raw(recorded)
    again = FarEnd()
    (answer,) = again.raw(recorded)
    assert len(answer) <= len(recorded)
    assert again.status(answer).sent_chunks == 0
    assert again.reflector.statistics.requested == 0


def test_request_from_another_address_brings_no_data() -> None:
    """Whoever is on the way and changes the address of a fresh request: the victim gets no more than was sent."""
    far = FarEnd()
    request = far.request(1001, far.token())
    (answer,) = far.raw(request, ("198.51.100.7", 1))
    assert len(answer) <= len(request)
    assert far.reflector.statistics.requested == 0


def test_another_port_of_the_address_is_served() -> None:
    far = FarEnd()
    request = far.request(1001, far.token())
    assert len(far.raw(request, (SOURCE[0], SOURCE[1] + 1))) == 9, "a provider's NAT gives another port after a gap"


def test_rate_per_address_is_limited() -> None:
    far = FarEnd(rate_bps=800_000)
    token = far.token()
    begin = far.now
    sent = far.raw(far.request(1001, token, message_size=1_000_000, count=955))
    octets = sum(map(len, sent))
    assert octets > 1_000_000
    assert octets <= 65_536 + 100_000 * (far.now - begin) / SECOND


@pytest.mark.parametrize(
    "changes",
    [{"count": 10}, {"first": 9, "count": 1}, {"packet": 152}, {"message_size": 0}, {"message_size": 70_000 * ROOM}],
)
def test_a_request_that_contradicts_itself_is_refused(changes: dict[str, int]) -> None:
    far = FarEnd()
    assert far.raw(far.request(1001, far.token(), **changes)) == []
    assert far.reflector.statistics.refused == 1


def test_number_of_concurrent_messages_is_limited() -> None:
    far = FarEnd()
    token = far.token()
    for number in range(100):
        reply = far.reflector.answer(far.request(number, token, pace_kbps=1), SOURCE, far.now, 64, lambda: far.now)
        assert (reply is None) is (number < 64)


def test_old_samples_without_direction_count_as_up() -> None:
    old = MessageResult("m", 0, 5, 1, 1, 0, 9, 5, 1, 2, in_flight=False)
    assert old.direction == MessageDirection.UP
