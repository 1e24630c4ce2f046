import asyncio
import selectors
import socket
from collections.abc import Coroutine
from typing import Any

import pytest
from scripted_device import Device, frame

from atlantis_netcfg.routeros.api import WINDOW, Command, ProtocolError, SessionLost, Traffic
from atlantis_netcfg.routeros.api._session import Session
from atlantis_netcfg.routeros.api._wire import Decoder, Wire

PRINT = Command("/ip/address/print")
ADD = Command("/ip/address/add")


class Clock(selectors.SelectSelector):
    """Time that passes only when everybody waits for it."""

    now = 0.0

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        self.now += timeout or 0.0
        return super().select(0)


class ClockLoop(asyncio.SelectorEventLoop):
    def __init__(self) -> None:
        self.clock = Clock()
        super().__init__(self.clock)

    def time(self) -> float:
        return self.clock.now


class Transport(asyncio.Transport):
    """Keeps what is written."""

    def __init__(self) -> None:
        super().__init__({"socket": socket.socket()})
        self.writes: list[bytes] = []
        self.aborted = False

    def write(self, data: bytes | bytearray | memoryview) -> None:
        self.writes.append(bytes(data))

    def abort(self) -> None:
        self.aborted = True
        self.get_extra_info("socket").close()


def run(main: Coroutine[Any, Any, None]) -> None:
    with asyncio.Runner(loop_factory=ClockLoop) as runner:
        runner.run(main)


def connected() -> tuple[Wire, Transport]:
    wire, transport = Wire("router:8729", Traffic()), Transport()
    wire.connection_made(transport)
    return wire, transport


async def turn() -> None:
    """Let every task run until it waits."""
    for _ in range(5):
        await asyncio.sleep(0)


def test_batch_is_one_write_and_the_next_waits_for_all_replies() -> None:
    async def main() -> None:
        wire, transport = connected()
        session = Session(Device(8729, "").endpoint(), wire, "")
        flight = asyncio.get_running_loop().create_task(session.flight([ADD] * (WINDOW + 1)))
        await turn()
        (write,) = transport.writes
        sentences = Decoder().feed(write)
        tags = [words[-1] for words in sentences]
        assert len(set(tags)) == WINDOW
        for tag in tags[:-1]:
            wire.data_received(frame("!done", tag))
        await turn()
        assert len(transport.writes) == 1
        wire.data_received(frame("!done", tags[-1]))
        await turn()
        assert len(transport.writes) == 2
        wire.data_received(frame("!done", f".tag={WINDOW + 1}"))
        assert len(await flight) == WINDOW + 1
        wire.abort()

    run(main())


ROW = frame("!re", ".tag=1", "=comment=x")


def test_silence_counts_from_the_last_reply_and_tolerates_a_70_s_gap() -> None:
    async def main() -> None:
        wire, transport = connected()
        loop = asyncio.get_running_loop()
        exchange = loop.create_task(wire.exchange([PRINT], 180))
        for part in (ROW[:5], ROW[5:], ROW[:5], ROW[5:], ROW):
            await asyncio.sleep(70)
            wire.data_received(part)
        heard = loop.time()
        assert heard == 350
        with pytest.raises(SessionLost, match=r"^router:8729 has not answered for 180 s$"):
            await exchange
        assert loop.time() == heard + 180
        assert transport.aborted

    run(main())


@pytest.mark.parametrize(
    ("part", "every_s", "words", "over_s"),
    [
        (b"\0", 0.5, "has not answered for 180 s", 180.0),
        (ROW, 100.0, "has gone on answering for 900 s without an end", 900.0),
    ],
)
def test_slow_device_cannot_hold_a_command_forever(part: bytes, every_s: float, words: str, over_s: float) -> None:
    """A byte each half second is no answer, and one row after the other has no end."""

    async def main() -> None:
        wire, transport = connected()
        loop = asyncio.get_running_loop()
        exchange = loop.create_task(wire.exchange([PRINT], 180))
        while not exchange.done():
            await asyncio.sleep(every_s)
            wire.data_received(part)
        with pytest.raises(SessionLost, match=f"^router:8729 {words}$"):
            await exchange
        assert loop.time() == pytest.approx(over_s, abs=every_s)
        assert transport.aborted

    run(main())


def test_trickled_bytes_of_one_reply_count_as_silence() -> None:
    async def main() -> None:
        wire, _ = connected()
        loop = asyncio.get_running_loop()
        exchange = loop.create_task(wire.exchange([PRINT], 180))
        wire.data_received(b"\x03!re\xc0\xff\xff")
        while not exchange.done():
            await asyncio.sleep(0.5)
            wire.data_received(b"x")
        with pytest.raises(SessionLost, match="has not answered for 180 s"):
            await exchange

    run(main())


@pytest.mark.parametrize(
    "flood",
    [ROW * 5_000, frame("!re", ".tag=1", *("=a=" for _ in range(5_000))), frame("!re", ".tag=1", "=a=" + "x" * 16_000)],
    ids=["rows", "attributes", "bytes"],
)
def test_endless_replies_do_not_fill_memory(flood: bytes) -> None:
    async def main() -> None:
        wire, transport = connected()
        exchange = asyncio.get_running_loop().create_task(wire.exchange([PRINT], 180))
        await turn()
        sent = 0
        while not transport.aborted:
            wire.data_received(flood)
            sent += len(flood)
        assert sent < 20_000_000
        with pytest.raises(ProtocolError, match="router:8729 sent answers without end"):
            await exchange

    run(main())


@pytest.mark.parametrize(
    ("sentence", "words"),
    [
        (frame("!re", ".tag=1", *("=a=" for _ in range(20_000))), "an answer of more than 10000 words"),
        (frame("!re", ".tag=1", "=rx-byte=" + "9" * 5_000), "a number of more than 1000 digits as `rx-byte`"),
        (frame("!re", ".tag=1", "=" + "\x1b" * 30 + "=" + "9" * 5_000), "as a name of 30 characters"),
    ],
)
def test_impossible_reply_is_a_protocol_error(sentence: bytes, words: str) -> None:
    async def main() -> None:
        wire, _ = connected()
        exchange = asyncio.get_running_loop().create_task(wire.exchange([PRINT], 180))
        await turn()
        wire.data_received(sentence)
        with pytest.raises(ProtocolError, match=words):
            await exchange

    run(main())


def test_missing_attribute_is_reported_as_device_error() -> None:
    async def main() -> None:
        wire, _ = connected()
        exchange = asyncio.get_running_loop().create_task(wire.exchange([PRINT], 180))
        await turn()
        wire.data_received(ROW + frame("!done", ".tag=1"))
        (reply,) = await exchange
        assert reply.rows == ({"comment": "x"},)
        assert (reply.rows[0]["comment"], reply.rows[0].get("name")) == ("x", None)
        with pytest.raises(ProtocolError, match="the device has sent an answer without `name`"):
            _ = reply.rows[0]["name"]
        wire.abort()

    run(main())


@pytest.mark.parametrize("category", ["2", "٣", "9" * 900])
def test_hostile_trap_message_is_escaped_to_one_line(category: str) -> None:
    async def main() -> None:
        wire, _ = connected()
        exchange = asyncio.get_running_loop().create_task(wire.exchange([PRINT], 180))
        await turn()
        said = frame("!trap", ".tag=1", f"=category={category}", "=message=no\x1b[2J\n\u202ex\t")
        wire.data_received(said + frame("!done", ".tag=1"))
        (reply,) = await exchange
        assert reply.trap is not None
        assert reply.trap.message == r"no\u001b[2J\u000a\u202ex\u0009"
        assert reply.trap.category == (2 if category == "2" else None)
        wire.abort()

    run(main())
