"""Both ends of the wire hear the same, however a stream is cut: recorded conversations, and words at every length."""

import asyncio
import socket
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.emulator.routeros import EmulatedRouter, RouterSpec, User
from atlantis_netcfg.emulator.routeros.wire.connection import Decoder as TwinDecoder
from atlantis_netcfg.emulator.routeros.wire.connection import encode_sentence as twin_encode
from atlantis_netcfg.routeros.api import Command, Endpoint, Reply, Session, Traffic
from atlantis_netcfg.routeros.api._wire import Decoder as ClientDecoder
from atlantis_netcfg.routeros.api._wire import Wire
from atlantis_netcfg.routeros.api._wire import encode as client_encode

LIMIT = 1 << 33
CONVERSATION = (
    Command("/system/resource/print", ((".proplist", "version,board-name"),)),
    Command("/ip/address/print"),
    Command("/ip/address/add", (("address", "192.0.2.1/24"), ("interface", "ether2"), ("comment", "Mu\u00f1oz = a"))),
    Command("/ip/firewall/raw/print"),
    Command("/ip/address/add", (("address", "192.0.2.1/24"), ("interface", "nowhere"))),
    Command("/file/add", (("name", "long.txt"), ("contents", "x" * 0x4001))),
    Command("/file/read", (("file", "long.txt"), ("chunk-size", "32768"), ("offset", "0"))),
    Command("/no/such/menu/print"),
    Command("/system/history/print", (("count-only", ""),)),
)
"""Rows, a value, nothing at all, refusals, and a word of each length form that a sane sentence has."""

sentences = st.lists(
    st.lists(
        st.one_of(
            st.binary(min_size=1, max_size=200),
            st.sampled_from([0x7E, 0x7F, 0x80, 0x81, 0x3FFE, 0x3FFF, 0x4000, 0x4001]).map(lambda size: b"=" * size),
        ).map(lambda raw: raw.decode("utf-8", "surrogateescape")),
        min_size=1,
        max_size=4,
    ).map(tuple),
    max_size=4,
)


class Tap:
    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.up = bytearray()
        self.down = bytearray()
        send, hear = Wire._send, Wire.data_received

        def sent(wire: Wire, data: bytes) -> None:
            self.up += data
            send(wire, data)

        def heard(wire: Wire, data: bytes) -> None:
            self.down += data
            hear(wire, data)

        monkeypatch.setattr(Wire, "_send", sent)
        monkeypatch.setattr(Wire, "data_received", heard)


class Deaf(asyncio.Transport):
    """Takes what is written and says nothing."""

    def __init__(self) -> None:
        super().__init__({"socket": socket.socket()})

    def write(self, data: bytes | bytearray | memoryview) -> None:
        """Forget it."""

    def abort(self) -> None:
        """Let go of the socket, which was never connected."""
        self.get_extra_info("socket").close()


@pytest.fixture(params=["7.16", "7.18.2", "7.21.5"])
def recorded(
    request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> tuple[bytes, bytes, list[Reply]]:
    """Hold the conversation once, with a twin of each tree; return both streams and what the client made of it."""
    tap = Tap(monkeypatch)
    spec = RouterSpec(name="router", version=request.param, users=(User(name="provision", password="open sesame"),))

    async def main() -> list[Reply]:
        router = EmulatedRouter(spec, state_dir=tmp_path)
        await router.start()
        try:
            session = await Session.open(
                Endpoint(router.host, router.ports["api-ssl"], "provision", Secret("open sesame"), router.pin)
            )
            replies = await session.flight(list(CONVERSATION))
            await session.close()
        finally:
            await router.stop()
        return replies

    replies = asyncio.run(main())
    monkeypatch.undo()
    return bytes(tap.up), bytes(tap.down), replies


def whole(stream: bytes) -> Iterator[bytes]:
    yield stream


def bytewise(stream: bytes) -> Iterator[bytes]:
    for byte in stream:
        yield bytes([byte])


def by_primes(stream: bytes) -> Iterator[bytes]:
    """Cut at places that agree with no boundary of words."""
    sizes = (1, 2, 3, 5, 7, 11, 13, 1009)
    place = turn = 0
    while place < len(stream):
        yield stream[place : place + sizes[turn % len(sizes)]]
        place += sizes[turn % len(sizes)]
        turn += 1


CUTS = (whole, bytewise, by_primes)


def client_hears(chunks: Iterator[bytes]) -> list[tuple[str, ...]]:
    decoder = ClientDecoder()
    return [words for chunk in chunks for words in decoder.feed(chunk)]


def twin_hears(chunks: Iterator[bytes]) -> list[tuple[str, ...]]:
    decoder = TwinDecoder(LIMIT)
    return [words for chunk in chunks for words in decoder.feed(chunk)]


@pytest.mark.parametrize("cut", CUTS)
def test_recorded_conversation_is_decoded_alike_however_split(
    recorded: tuple[bytes, bytes, list[Reply]], cut: Callable[[bytes], Iterator[bytes]]
) -> None:
    up, down, _ = recorded
    asked, answered = twin_hears(whole(up)), client_hears(whole(down))
    assert twin_hears(cut(up)) == client_hears(cut(up)) == asked
    assert client_hears(cut(down)) == twin_hears(cut(down)) == answered
    assert b"".join(map(client_encode, asked)) == b"".join(map(twin_encode, asked)) == up
    assert b"".join(map(twin_encode, answered)) == down
    assert len(asked) == len(CONVERSATION) + 1
    assert {words[0] for words in answered} >= {"!re", "!done", "!trap"}


@pytest.mark.parametrize("cut", CUTS)
def test_client_result_does_not_depend_on_how_replies_are_split(
    recorded: tuple[bytes, bytes, list[Reply]], cut: Callable[[bytes], Iterator[bytes]]
) -> None:
    _, down, replies = recorded

    login = next(size for size in range(1, len(down)) if client_hears(whole(down[:size])))

    async def exchange(wire: Wire, commands: Sequence[Command], stream: bytes) -> list[Reply]:
        talk = asyncio.ensure_future(wire.exchange(commands, 60))
        await asyncio.sleep(0)
        for chunk in cut(stream):
            wire.data_received(chunk)
        return await talk

    async def main() -> list[Reply]:
        wire = Wire("router:8729", Traffic())
        wire.connection_made(Deaf())
        await exchange(wire, [Command("/login")], down[:login])
        heard = await exchange(wire, CONVERSATION, down[login:])
        wire.abort()
        return heard

    assert asyncio.run(main()) == replies


@given(sentences, st.lists(st.integers(1, 5000), max_size=30))
@settings(max_examples=60)
def test_client_and_emulator_encode_and_decode_alike(said: list[tuple[str, ...]], sizes: Sequence[int]) -> None:
    stream = b"".join(map(client_encode, said))
    assert stream == b"".join(map(twin_encode, said))
    chunks: list[bytes] = []
    rest = stream
    for size in [*sizes, len(stream) + 1]:
        chunks.append(rest[:size])
        rest = rest[size:]
    assert client_hears(iter(chunks)) == twin_hears(iter(chunks)) == said


@pytest.mark.parametrize("length", [0x7F, 0x80, 0x3FFF, 0x4000, 0x1F_FFFF, 0x20_0000])
def test_words_at_length_boundaries_survive_both_ways(length: int) -> None:
    said = ("!re", "=" + "x" * (length - 1))
    assert client_encode(said) == twin_encode(said)
    for cut in (whole, by_primes):
        assert client_hears(cut(twin_encode(said))) == twin_hears(cut(client_encode(said))) == [said]


@pytest.mark.parametrize("cut", [whole, bytewise])
def test_five_byte_lengths_are_read_by_both_ends(cut: Callable[[bytes], Iterator[bytes]]) -> None:
    stream = b"\xf0\x00\x00\x00\x03!re\xf0\x00\x00\x00\x04=a=b\x00"
    assert client_hears(cut(stream)) == twin_hears(cut(stream)) == [("!re", "=a=b")]
