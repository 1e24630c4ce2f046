"""What the reflector answers, and above all what it does not."""

import asyncio
import random
import tracemalloc

import pytest
from simulated_network import KEY, SECOND, SOURCE, START

from atlantis_netcfg.links.qualify.reflector import stamp
from atlantis_netcfg.links.qualify.reflector.__main__ import _end_when_idle
from atlantis_netcfg.links.qualify.reflector.answering import Reflector
from atlantis_netcfg.links.qualify.reflector.clock import ClockState

LAST = 900 * SECOND


class FarEnd:
    """A reflector and a clock."""

    def __init__(self, key: bytes | None = KEY, **limits: object) -> None:
        self.key = key
        self.reflector = Reflector(key, **limits)  # type: ignore[arg-type] # its numbers
        self.now = START

    def raw(self, datagram: bytes, source: tuple[str, int] = SOURCE) -> bytes | None:
        reply = self.reflector.answer(datagram, source, self.now, 61, lambda: self.now + 500)
        assert reply is None or len(reply) <= len(datagram), "it amplifies"
        return reply

    def ask(
        self, sequence: int, *, session: int = 5, tlvs: stamp.Tlvs = (), source: tuple[str, int] = SOURCE
    ) -> stamp.ReflectorPacket | None:
        request = stamp.SenderPacket(sequence, stamp.ntp(self.now), 1, session, tlvs).encode(self.key)
        reply = self.raw(request, source)
        return None if reply is None else stamp.decode_reflector(reply, self.key)

    def counters(self, sequence: int) -> stamp.ReflectorCounters:
        reply = self.ask(sequence, tlvs=(stamp.Tlv(stamp.COUNTERS, bytes(16)),))
        assert reply is not None
        return stamp.ReflectorCounters.decode(reply.tlvs[0].value)


@pytest.fixture
def far() -> FarEnd:
    return FarEnd()


SYNCHRONISED = ClockState(True, 0.01)


@pytest.mark.parametrize("key", [KEY, None])
@pytest.mark.parametrize("port", [862, 40862])
def test_forged_source_creates_no_loop_between_reflectors(key: bytes | None, port: int) -> None:
    """Whatever port they listen at: at most two packets follow the forged one."""
    first, second = FarEnd(key, port=port), FarEnd(key, port=port + 1)
    forged = stamp.SenderPacket(1, stamp.ntp(START), 1, 5).encode(key)
    packet, replies = first.raw(forged, ("198.51.100.2", port + 1)), 0
    while packet is not None and replies < 10:
        replies += 1
        first, second = second, first
        packet = first.raw(packet, ("198.51.100.1", 40000))
    assert replies <= 2


def test_packets_from_a_reflector_port_are_not_answered(far: FarEnd) -> None:
    own = FarEnd(port=8862)
    assert far.ask(0, source=("198.51.100.2", 862)) is None
    assert own.ask(0, source=("198.51.100.2", 8862)) is None
    assert own.ask(0, source=("198.51.100.2", 862)) is None
    assert own.ask(0, source=("198.51.100.2", 8863)) is not None


def test_packet_for_one_reflector_is_rejected_by_another() -> None:
    centre, vessel = (FarEnd(stamp.reflector_key(KEY, name)) for name in ("scc-control", "te4sea-gateway"))
    recorded = stamp.SenderPacket(1, stamp.ntp(START), 1, 5).encode(centre.key)
    assert centre.raw(recorded) is not None
    assert vessel.raw(recorded) is None


@pytest.mark.parametrize(
    ("age_s", "synchronised", "answered"),
    [
        (0, True, True),
        (50, True, True),
        (-50, True, True),
        (70, True, False),
        (-70, True, False),
        (365 * 86400, True, False),
        (3600, False, True),
        (-3600, False, True),
        (2 * 86400, False, False),
    ],
)
def test_stale_packet_is_not_answered(age_s: int, *, synchronised: bool, answered: bool) -> None:
    far, unknown = FarEnd(clock=lambda: SYNCHRONISED), FarEnd()
    error = stamp.error_estimate(0.1, is_synced=synchronised)
    recorded = stamp.SenderPacket(1, stamp.ntp(START - age_s * SECOND), error, 5).encode(KEY)
    assert (far.raw(recorded) is not None) is answered
    assert far.reflector.statistics.stale == (not answered)
    assert unknown.raw(recorded) is not None, "a clock that is not synchronised cannot judge"


def test_session_rate_is_limited_across_addresses() -> None:
    far = FarEnd(None, rate_bps=8000)
    size = stamp.padding(1000, is_authenticated=False)
    sent = [far.ask(n, tlvs=size, source=(f"198.51.100.{n}", 4000)) is not None for n in range(100)]
    assert sent.count(True) == 65
    assert far.reflector.statistics.limited == 35


def test_largest_message_costs_little_work_and_memory() -> None:
    """As a count of work and not of time: 65,535 chunks were looked at one by one, and kept for each of 16,384."""
    far = FarEnd()
    tracemalloc.start()
    for number in range(20_000):
        chunk = stamp.MessageChunk(number, 0xFFFFFFFF, 0xFFFE, 0xFFFF, acknowledge=number % 100 == 0, data=b"x")
        far.ask(number // 256, session=number % 256 + 1, tlvs=(stamp.Tlv(stamp.CHUNK, chunk.encode()),))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 32 << 20
    reply = far.ask(5000, tlvs=(stamp.Tlv(stamp.CHUNK, stamp.MessageChunk(7, 9, 2, 4, True, bytes(60)).encode()),))
    assert reply is not None
    told = stamp.Acknowledgement.decode(reply.tlvs[0].value)
    assert (told.missing, told.indexes) == (3, (0, 1, 3))


def test_a_packet_of_many_extensions_is_refused(far: FarEnd) -> None:
    few, many = ((stamp.Tlv(77, b""),) * count for count in (64, 65))
    assert far.ask(0, tlvs=few) is not None
    assert far.ask(1, tlvs=many) is None


async def test_program_runs_until_idle(monkeypatch: pytest.MonkeyPatch, far: FarEnd) -> None:
    waits: list[float] = []

    async def sleep(seconds: float) -> None:
        waits.append(seconds)
        far.reflector.statistics.answered += len(waits) < 5

    end = asyncio.Event()
    monkeypatch.setattr("asyncio.sleep", sleep)
    await _end_when_idle(far.reflector, end, 900)
    assert end.is_set()
    assert waits == [900] * 5


def test_reply_echoes_the_request_and_is_numbered(far: FarEnd) -> None:
    answers = [far.ask(sequence) for sequence in (0, 3, 9)]
    assert [(a.sequence, a.sender_sequence, a.sender_ttl) for a in answers if a] == [(0, 0, 61), (1, 3, 61), (2, 9, 61)]
    last = answers[-1]
    assert last is not None
    assert (last.sender_timestamp, last.sender_error, last.session_id) == (stamp.ntp(START), 1, 5)
    assert abs(stamp.unix_ns(last.timestamp) - stamp.unix_ns(last.receive_timestamp) - 500) <= 2


def test_reply_is_as_long_as_its_request(far: FarEnd) -> None:
    for number, size in enumerate((112, 116, 584, 1200)):
        request = stamp.SenderPacket(number, stamp.ntp(START), 1, 5, stamp.padding(size, is_authenticated=True)).encode(
            KEY
        )
        reply = far.raw(request)
        assert reply is not None
        assert len(reply) == len(request) == size


def test_unauthenticated_packets_get_no_reply(far: FarEnd) -> None:
    strangers = [
        stamp.SenderPacket(0, stamp.ntp(START), 1, 5).encode(),
        stamp.SenderPacket(0, stamp.ntp(START), 1, 5, stamp.padding(500, is_authenticated=False)).encode(),
        stamp.SenderPacket(0, stamp.ntp(START), 1, 5).encode(b"another key, also 32 octets long"),
        b"",
        bytes(2000),
    ]
    assert [far.raw(packet) for packet in strangers] == [None] * 5
    assert far.reflector.statistics.refused == 5


def test_garbage_gets_no_reply_from_a_keyed_reflector() -> None:
    draw = random.Random(8)  # noqa: S311 - a test
    for key in (KEY, None):
        far = FarEnd(key)
        for _ in range(2000):
            reply = far.raw(draw.randbytes(draw.randrange(300)))
            assert key is None or reply is None


def test_replayed_packet_is_answered_once(far: FarEnd) -> None:
    recorded = stamp.SenderPacket(1, stamp.ntp(START), 1, 5).encode(KEY)
    assert far.raw(recorded) is not None
    assert far.raw(recorded) is None
    assert far.raw(recorded, ("198.51.100.7", 1)) is None, "nor for another address"
    assert far.reflector.statistics.replayed == 2


def test_replay_of_a_forgotten_session_is_rejected(far: FarEnd) -> None:
    recorded = [stamp.SenderPacket(n, stamp.ntp(START + n), 1, 5).encode(KEY) for n in range(3)]
    assert all(far.raw(packet) for packet in recorded)
    far.now += LAST + SECOND
    assert far.ask(0, session=6) is not None, "another session is, and lets the first be forgotten"
    assert [far.raw(packet) for packet in recorded] == [None] * 3
    assert far.ask(0, session=5) is not None, "a new session may bear its name"


def test_another_session_may_draw_the_same_identifier(far: FarEnd) -> None:
    """Of 65,535 identifiers a run of 60 streams draws one twice in 37 runs: a whole stream would be silent."""
    recorded = [stamp.SenderPacket(n, stamp.ntp(START + n), 1, 5).encode(KEY) for n in range(9)]
    assert all(far.raw(packet) for packet in recorded)
    far.now += 5 * SECOND
    again = [far.ask(n, session=5) for n in range(3)]
    assert [reply.sequence for reply in again if reply is not None] == [0, 1, 2], "it counts from the beginning"
    assert far.counters(3).received_count == 3
    assert [far.raw(packet) for packet in recorded] == [None] * 9, "what was answered before is not once more"


def test_replay_into_a_new_session_with_the_same_id_is_rejected(far: FarEnd) -> None:
    recorded = [stamp.SenderPacket(n, stamp.ntp(START + n), 1, 5).encode(KEY) for n in range(9)]
    assert all(far.raw(packet) for packet in recorded)
    far.now += LAST + SECOND
    assert far.ask(0, session=6) is not None, "the first is forgotten"
    assert far.ask(0, session=5) is not None
    assert [far.raw(packet) for packet in recorded] == [None] * 9, "also those with a number that is new"


def test_reordered_packets_are_answered(far: FarEnd) -> None:
    assert all(far.ask(sequence) for sequence in (0, 5, 3, 1, 4, 2))


def test_session_continues_from_another_port(far: FarEnd) -> None:
    first, second = far.ask(0), far.ask(1, source=("192.0.2.1", 50000))
    assert first is not None
    assert second is not None
    assert second.sequence == 1, "a provider's NAT gave it another port after a gap"


def test_counters_include_duplicates(far: FarEnd) -> None:
    far.ask(0)
    far.ask(1)
    far.ask(1)
    assert far.counters(2) == stamp.ReflectorCounters(received_count=3, duplicates=1, limited_count=0, answered_count=2)
    assert far.counters(3).received_count == 3, "questions for counters do not count"


def test_rate_per_source_is_limited() -> None:
    far = FarEnd(rate_bps=80_000)
    size, burst = 1000, 65536
    sent = 0
    for number in range(400):
        far.now += SECOND // 100
        reply = far.ask(number, tlvs=stamp.padding(size, is_authenticated=True))
        sent += size if reply is not None else 0
    assert sent <= burst + 10_000 * 4 + size
    assert sent >= 10_000 * 4
    assert far.reflector.statistics.limited == far.counters(1000).limited_count > 0
    other = stamp.SenderPacket(0, stamp.ntp(far.now), 1, 9).encode(KEY)
    assert far.raw(other, ("198.51.100.7", 1)) is not None, "another source has its own"


def test_unknown_extensions_are_returned_marked() -> None:
    far = FarEnd(None)
    reply = far.ask(0, tlvs=(stamp.Tlv(stamp.PADDING, bytes(8)), stamp.Tlv(77, b"what?")))
    assert reply is not None
    assert [(tlv.type, tlv.value, tlv.flags) for tlv in reply.tlvs] == [
        (stamp.PADDING, bytes(8), 0),
        (77, b"what?", 0x80),
    ]


def test_without_a_key_duplicates_are_answered() -> None:
    far = FarEnd(None)
    assert far.ask(1) is not None
    assert far.ask(1) is not None, "RFC 8762 has no memory of packets"


def test_number_of_sessions_is_limited(far: FarEnd) -> None:
    for session in range(1, 2000):
        assert far.ask(0, session=session) is not None
    assert len(far.reflector._sessions) <= 257


def _chunk(index: int, data: bytes, *, asks: bool, count: int = 3) -> stamp.Tlvs:
    return (stamp.Tlv(stamp.CHUNK, stamp.MessageChunk(4, 30, index, count, asks, data).encode().ljust(80, b"\0")),)


def test_message_is_acknowledged_on_request(far: FarEnd) -> None:
    assert far.ask(0, tlvs=_chunk(0, b"0123456789", asks=False)) is None
    far.now += SECOND
    reply = far.ask(1, tlvs=_chunk(2, b"0123456789", asks=True))
    assert reply is not None
    word = stamp.Acknowledgement.decode(reply.tlvs[0].value)
    assert (word.size, word.missing, word.indexes) == (20, 1, (1,))
    assert stamp.unix_ns(word.last) - stamp.unix_ns(word.first) == SECOND
    reply = far.ask(2, tlvs=_chunk(1, b"0123456789", asks=True))
    assert reply is not None
    assert stamp.Acknowledgement.decode(reply.tlvs[0].value).missing == 0


def test_a_chunk_counts_once(far: FarEnd) -> None:
    for number in range(3):
        reply = far.ask(number, tlvs=_chunk(0, b"0123456789", asks=True))
    assert reply is not None
    assert stamp.Acknowledgement.decode(reply.tlvs[0].value).size == 10


def test_request_shorter_than_its_reply_is_not_answered(far: FarEnd) -> None:
    tlvs = (stamp.Tlv(stamp.CHUNK, stamp.MessageChunk(4, 30, 0, 200, acknowledge=True).encode()),)
    assert far.ask(0, tlvs=tlvs) is None
