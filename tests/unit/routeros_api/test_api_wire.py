from __future__ import annotations

import asyncio
import selectors
import socket
from typing import TYPE_CHECKING, Any

import pytest
from scripted_device import Device, frame

from atlantis_netcfg.routeros.api import WINDOW, Command, SessionLost, Traffic
from atlantis_netcfg.routeros.api._sentences import Decoder
from atlantis_netcfg.routeros.api._session import Session
from atlantis_netcfg.routeros.api._wire import Wire

if TYPE_CHECKING:
    from collections.abc import Coroutine

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


def test_a_batch_is_one_write_and_the_next_waits_for_every_answer() -> None:
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


def test_silence_counts_from_the_last_byte_and_outlives_a_gap_of_70_s() -> None:
    async def main() -> None:
        wire, transport = connected()
        loop = asyncio.get_running_loop()
        exchange = loop.create_task(wire.exchange([PRINT], 180))
        answer = frame("!re", ".tag=1", "=comment=x")
        for byte in answer:
            await asyncio.sleep(70)
            wire.data_received(bytes([byte]))
        heard = loop.time()
        assert heard == 70 * len(answer)
        with pytest.raises(SessionLost, match=r"^router:8729 has not answered for 180 s$"):
            await exchange
        assert loop.time() == heard + 180
        assert transport.aborted

    run(main())
