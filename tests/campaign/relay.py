"""Stands at the declared addresses and carries every byte to the twins, as badly as it is told to."""

import asyncio
import socket
import struct
import threading
from collections.abc import Callable, Coroutine, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Self

Visitor = Callable[[asyncio.StreamReader, asyncio.StreamWriter], Coroutine[object, object, None]]

HOST = "127.0.0.1"
_RESET = struct.pack("ii", 1, 0)
"""SO_LINGER: on, 0 s; then close() sends RST."""


@dataclass
class Way:
    host: str
    address: str
    ports: dict[int, int] = field(default_factory=dict)
    """The twin's port on loopback for each port of the device."""
    trips: int = 0
    """Requests seen: how often the client has begun to speak."""
    carried: int = 0
    """Bytes, both directions."""
    refuses: bool = False
    """A new connection is reset."""
    holds: asyncio.Event = field(default_factory=asyncio.Event)
    """Cleared: nothing passes, and nobody is told."""
    mute: bool = False
    """What the device answers is lost."""
    pause_s: float = 0.0
    """Before each piece is passed on."""
    open: set[asyncio.StreamWriter] = field(default_factory=set)
    """Towards the client."""


class Relay:
    """All ways of a site, in a thread with an event loop; `on_request` is called before a request goes on."""

    def __init__(self, addresses: Mapping[str, str], ports: Sequence[int]) -> None:
        self.ways = {host: Way(host, address) for host, address in addresses.items()}
        self.on_request: Callable[[Way], None] = lambda _way: None
        self._ports = ports
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._servers: list[asyncio.Server] = []
        self._delayed: dict[object, tuple[asyncio.TimerHandle, Callable[[], object]]] = {}

    def __enter__(self) -> Self:
        self._thread.start()
        self._call(self._listen())
        return self

    def __exit__(self, *_: object) -> None:
        self._call(self._close())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    @property
    def trips(self) -> int:
        return sum(way.trips for way in self.ways.values())

    def lead(self, ports: Mapping[str, dict[int, int]]) -> None:
        """Lead to the twins of another round; everything is counted anew, and all is well."""
        for host, way in self.ways.items():
            way.ports, way.trips, way.carried = ports[host], 0, 0
        self.heal()

    def heal(self) -> None:
        self.soon(self._heal)

    def soon(self, act: Callable[[], object]) -> None:
        """Do something in the relay's thread, at once if we are there."""
        if threading.current_thread() is self._thread:
            act()
        else:
            self._loop.call_soon_threadsafe(act)

    def later(self, seconds: float, act: Callable[[], object]) -> None:
        """Do something after a while, in the relay's thread, or when all is healed."""
        self.soon(lambda: self._delay(seconds, act))

    def _delay(self, seconds: float, act: Callable[[], object]) -> None:
        key = object()
        self._delayed[key] = self._loop.call_later(seconds, lambda: self._delayed.pop(key) and act()), act

    def reset(self, way: Way) -> None:
        """End all connections of a way with RST at the client's end; the device sees the end of its own."""
        for writer in set(way.open):
            writer.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _RESET)
            writer.transport.abort()

    def half_close(self, way: Way) -> None:
        """Tell the client that the device has ended, and go on listening to the client; answers are lost."""
        way.mute = True
        for writer in set(way.open):
            if writer.can_write_eof():
                writer.write_eof()

    def _heal(self) -> None:
        while self._delayed:
            timer, act = self._delayed.popitem()[1]
            timer.cancel()
            act()
        for way in self.ways.values():
            way.refuses = way.mute = False
            way.pause_s = 0.0
            way.holds.set()

    def _call(self, work: Coroutine[object, object, None]) -> None:
        asyncio.run_coroutine_threadsafe(work, self._loop).result(10)

    async def _listen(self) -> None:
        for way in self.ways.values():
            way.holds.set()
            for port in self._ports:
                self._servers.append(await asyncio.start_server(self._visitor(way, port), way.address, port))

    async def _close(self) -> None:
        for server in self._servers:
            server.close()
        for task in asyncio.all_tasks() - {asyncio.current_task()}:
            task.cancel()
        await asyncio.sleep(0)

    def _visitor(self, way: Way, port: int) -> Visitor:
        async def visit(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            way.open.add(writer)
            try:
                await self._visit(way, port, reader, writer)
            except OSError:
                pass
            finally:
                way.open.discard(writer)
                writer.transport.abort()

        return visit

    async def _visit(self, way: Way, port: int, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if way.refuses:
            self.reset(way)
            return
        await way.holds.wait()
        back, forth = await asyncio.open_connection(HOST, way.ports[port])
        turn = _Turn()
        try:
            await asyncio.gather(self._up(way, reader, forth, turn), self._down(way, back, writer, turn))
        finally:
            forth.transport.abort() if writer.transport.is_closing() and way.mute else forth.close()

    async def _up(self, way: Way, source: asyncio.StreamReader, sink: asyncio.StreamWriter, turn: "_Turn") -> None:
        while data := await source.read(65536):
            if not turn.client:
                turn.client = True
                way.trips += 1
                self.on_request(way)
            await self._pass(way, data, sink)
        sink.write_eof()

    async def _down(self, way: Way, source: asyncio.StreamReader, sink: asyncio.StreamWriter, turn: "_Turn") -> None:
        while data := await source.read(65536):
            turn.client = False
            await way.holds.wait()
            if not way.mute:
                await self._pass(way, data, sink)
        if not way.mute:
            sink.write_eof()

    @staticmethod
    async def _pass(way: Way, data: bytes, sink: asyncio.StreamWriter) -> None:
        await way.holds.wait()
        if way.pause_s:
            await asyncio.sleep(way.pause_s)
        way.carried += len(data)
        sink.write(data)
        await sink.drain()


@dataclass
class _Turn:
    """Who of a connection speaks."""

    client: bool = False
