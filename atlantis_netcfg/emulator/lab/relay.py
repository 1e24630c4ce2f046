"""Link from this computer to a machine's sshd: a loopback port, with emulated delay and outages."""

from __future__ import annotations

import asyncio
import socket
import threading
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.tcp_link import TcpLink
from atlantis_netcfg.emulator.udp_link import LinkShape

if TYPE_CHECKING:
    from collections.abc import Callable

_PIECE = 1400
"""Bytes forwarded as one unit: a TCP segment within a tunnel's MTU."""
_PIECES = 256
"""Queue length of each direction of a connection; beyond it the sender has to wait."""
_CONNECT_S = 10.0
_RESET = b"\1\0\0\0\0\0\0\0"
"""struct linger {1, 0}: close() sends a reset."""


@dataclass(frozen=True)
class RelayLink:
    """Properties of the emulated link from now on; the default has no delay and no limits."""

    delay_s: float = 0.0
    """One-way delay in seconds, half of the round trip. Opening a connection costs a round trip."""
    rate_up_bps: float | None = None
    """Rate from this computer to the machine; None: unlimited."""
    rate_down_bps: float | None = None
    """Rate from the machine to this computer; None: unlimited."""
    up: bool = True
    """False: nothing arrives on either side, not even the end of a connection; data in transit are kept."""
    shapes: tuple[LinkShape, LinkShape] | None = None
    """Link behaviour from this computer to the machine and back, used instead of delay and rates; None: not used."""

    @property
    def tcp(self) -> TcpLink:
        """The link's effect on TCP connections."""
        up, down = self.shapes or (
            LinkShape(rate_bps=rate, delay_s=self.delay_s) for rate in (self.rate_up_bps, self.rate_down_bps)
        )
        return TcpLink(up, down)


@dataclass
class RelayTraffic:
    """Bytes sent to the link since the machine was started, without headers."""

    connections: int = 0
    up_bytes: int = 0
    down_bytes: int = 0


_Line = asyncio.Queue[tuple[float, bytes | None]]
"""Arrival time and data; empty data ends the sender's stream, None is a reset."""


class _Direction(Enum):
    UP = "up"
    DOWN = "down"


class Relay:
    """Listens on 127.0.0.1 and forwards each connection to an address in a namespace, in its own thread.

    `buffer`: bytes that the kernel queues before a sender blocks; None: the kernel's default, megabytes.
    """

    def __init__(
        self, make: Callable[[], socket.socket], target: tuple[str, int], *, buffer: int | None = None
    ) -> None:
        self._bearer = _RelayCarrier()
        self._make = make
        self._target = target
        self._door = socket.create_server(("127.0.0.1", 0))
        self._door.setblocking(False)
        if buffer is not None:
            self._door.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer)
        self.port: int = self._door.getsockname()[1]
        self._loop = asyncio.new_event_loop()
        self._end = asyncio.Event()
        self._thread = threading.Thread(target=self._run, name=f"relay-{target[0]}", daemon=True)
        self._thread.start()

    @property
    def traffic(self) -> RelayTraffic:
        """Traffic so far."""
        return self._bearer.traffic

    def lead(self, make: Callable[[], socket.socket]) -> None:
        """Open new connections by other sockets, as after a move of the machine's cable."""
        self._make = make

    def set(self, way: RelayLink) -> None:
        """Change the link; bytes in transit keep their arrival time."""
        asyncio.run_coroutine_threadsafe(self._bearer.set(way), self._loop).result()

    def close(self) -> None:
        """Stop listening and drop every connection."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._end.set)
            self._thread.join()

    def _run(self) -> None:
        with asyncio.Runner(loop_factory=lambda: self._loop) as runner, self._door:
            runner.run(self._serve())

    async def _serve(self) -> None:
        listening = self._loop.create_task(self._listen())
        await self._end.wait()
        listening.cancel()
        # The runner cancels the connections and waits for them.

    async def _listen(self) -> None:
        connections = set()
        while True:
            client, _ = await self._loop.sock_accept(self._door)
            task = self._loop.create_task(self._connection(client))
            connections.add(task)
            task.add_done_callback(connections.discard)

    async def _connection(self, client: socket.socket) -> None:
        """Forward both directions until both end; if one fails, both ends are reset."""
        with client:
            await self._bearer.connect()
            with self._make() as machine:
                try:
                    machine.setblocking(False)
                    async with asyncio.timeout(_CONNECT_S):
                        await self._loop.sock_connect(machine, self._target)
                    await _relay_both_ways(self._bearer, client, machine)
                except* OSError:
                    for end in (client, machine):
                        end.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _RESET)


class _RelayCarrier:
    """State shared by all connections: the link, and whether it is up."""

    def __init__(self) -> None:
        self._tcp = RelayLink().tcp
        self._air = asyncio.Event()
        self._air.set()
        self.traffic = RelayTraffic()

    async def set(self, way: RelayLink) -> None:
        self._tcp = way.tcp
        if way.up:
            self._air.set()
        else:
            self._air.clear()

    async def connect(self) -> None:
        """Wait for the handshake time of a TCP connection."""
        self.traffic.connections += 1
        await asyncio.sleep(self._tcp.connect_s)
        await self._air.wait()

    def arrival(self, direction: _Direction, size: int) -> float:
        """Return when bytes sent now arrive; all connections share a direction's rate."""
        up = direction is _Direction.UP
        self.traffic.up_bytes += size if up else 0
        self.traffic.down_bytes += 0 if up else size
        return self._tcp.arrival(size, asyncio.get_running_loop().time(), up=up)

    async def until(self, arrival: float) -> None:
        await asyncio.sleep(arrival - asyncio.get_running_loop().time())
        await self._air.wait()


async def _relay_both_ways(link: _RelayCarrier, client: socket.socket, machine: socket.socket) -> None:
    async with asyncio.TaskGroup() as tasks:
        for direction, source, sink in ((_Direction.UP, client, machine), (_Direction.DOWN, machine, client)):
            source.setblocking(False)
            source.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            line: _Line = asyncio.Queue(_PIECES)
            tasks.create_task(_take(link, direction, source, line))
            tasks.create_task(_deliver(link, sink, line))


async def _take(link: _RelayCarrier, direction: _Direction, source: socket.socket, line: _Line) -> None:
    """Read from the source and queue all data, the end of the connection included."""
    loop = asyncio.get_running_loop()
    data: bytes | None = b"more"
    while data:
        try:
            data = await loop.sock_recv(source, _PIECE)
        except ConnectionError:
            data = None
        await line.put((link.arrival(direction, len(data or b"")), data))


async def _deliver(link: _RelayCarrier, sink: socket.socket, line: _Line) -> None:
    """Deliver queued data in order, each piece at its arrival time."""
    loop = asyncio.get_running_loop()
    last = 0.0
    while True:
        arrival, data = await line.get()
        last = max(last, arrival)
        await link.until(last)
        if data is None:
            raise ConnectionResetError
        if not data:
            sink.shutdown(socket.SHUT_WR)
            return
        await loop.sock_sendall(sink, data)
