"""The bench's own link: what it delays, and what it counts."""

import asyncio
from collections.abc import AsyncIterator

import pytest

from bench.proxy import Proxy, Shape


async def _echo(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    while data := await reader.read(65536):
        writer.write(data)
    writer.close()


async def talk(shape: Shape, *words: bytes) -> AsyncIterator[tuple[float, Proxy]]:
    """Say each word when the one before was echoed; give the time of each echo."""
    server = await asyncio.start_server(_echo, "127.0.0.1", 0)
    clock = asyncio.get_running_loop().time
    async with server, Proxy("127.0.0.1", 0, server.sockets[0].getsockname()[:2], shape) as proxy:
        begun = clock()
        reader, writer = await asyncio.open_connection(*proxy.address)
        for word in words:
            writer.write(word)
            assert await reader.readexactly(len(word)) == word
            yield clock() - begun, proxy
        writer.close()
        await writer.wait_closed()


@pytest.mark.parametrize("words", [(b"a",), (b"a", b"bc", b"def")])
async def test_each_response_costs_a_round_trip(words: tuple[bytes, ...]) -> None:
    number = 0
    async for took_s, proxy in talk(Shape(delay_s=0.05), *words):
        number += 1
        assert 0.1 * (number + 1) <= took_s
        assert proxy.count.round_trips == number + 1
    assert proxy.count.sent == proxy.count.received == sum(map(len, words))
    assert proxy.count.connections == 1


async def test_a_rate_holds_for_all_bytes_of_a_direction() -> None:
    async for took_s, _ in talk(Shape(up_bps=400_000), b"x" * 10_000):
        assert took_s >= 0.2


async def test_unreachable_target_ends_the_connection() -> None:
    async with Proxy("127.0.0.1", 0, ("127.0.0.1", 1), Shape()) as proxy:
        reader, writer = await asyncio.open_connection(*proxy.address)
        with pytest.raises((ConnectionError, asyncio.IncompleteReadError)):
            await reader.readexactly(1)
        writer.close()
        assert proxy.count.received == 0
