"""The connections of an emulated router: client sockets, link, and the router's firewall and services."""

from __future__ import annotations

import asyncio
import socket
import struct
from typing import TYPE_CHECKING, Protocol, cast

from atlantis_netcfg.emulator.routeros.wire.link import (
    Chunk,
    DelayLine,
    Direction,
    LineEnd,
    LinkFault,
    TrafficCounters,
    WireBehaviour,
    WireLink,
    WirePace,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from random import Random

    from atlantis_netcfg.emulator.routeros.core import Service
    from atlantis_netcfg.emulator.routeros.wire.dialogue import Dialogue
    from atlantis_netcfg.emulator.routeros.wire.tls import ByteChannel


class LinkMember(Protocol):
    """A connection from the router's side."""

    tally: TrafficCounters
    pipe: Pipe

    def drop(self) -> None:
        """Reset the connection at both ends; data in transit are lost."""

    def vanish(self) -> None:
        """Silence the connection permanently, without notice to either end."""

    def handle_reboot(self, *, clean: bool) -> None:
        """Handle a reboot; `clean`: sockets were closed first."""

    def check(self) -> None:
        """Close the connection if this session was removed from `/user/active`."""

    def say_pending(self) -> None:
        """Send pending messages of the router."""


class RouterHost(Protocol):
    """Interface of the router for its connections."""

    @property
    def link(self) -> WireLink:
        """The link that carries the bytes."""

    @property
    def air(self) -> asyncio.Event:
        """Cleared while the link is interrupted."""

    @property
    def knobs(self) -> WireBehaviour:
        """The current adjustable behaviour."""

    @property
    def pace(self) -> WirePace:
        """The router's response times."""

    @property
    def chance(self) -> Random | None:
        """Random source for shuffling, or None for the order of arrival."""

    @property
    def booting(self) -> bool:
        """Whether the router is down."""

    @property
    def silent_timeout_s(self) -> float:
        """Seconds until the router's TCP drops a silent peer."""

    def dialogue(self, service: str) -> Dialogue:
        """Return a new session without login."""

    def channel(self, service: str) -> ByteChannel:
        """Return a channel: TLS with the current certificate, or plain."""

    def admits(self, service: str, address: str | None = None) -> bool:
        """Return whether the service accepts this client; `address`: if not the technician's."""

    def reaches(self, service: str, *, is_established: bool) -> bool:
        """Return whether packets pass through the router's configuration in both directions."""

    def handle_open(self, pipe: Pipe) -> None:
        """Handle a new client."""

    def handle_close(self, pipe: Pipe) -> None:
        """Handle the end of a connection at both ends."""

    def watch(self, task: asyncio.Task[None]) -> None:
        """Stop the emulator with an error if `task` fails."""

    def upon(self, command: str) -> list[LinkFault]:
        """Count a sentence; return the faults that apply to it."""

    def strike(self, fault: LinkFault) -> None:
        """Apply a fault that affects more than one connection."""

    async def settle(self) -> None:
        """Apply changes of the router to its connections: path, listeners, flash, reboot."""

    def tell(self) -> None:
        """Send pending `/listen` replies of all sessions, and recompute the next due time."""


HOST = "127.0.0.1"
SERVICES = ("api", "api-ssl", "ssh")


class Listeners:
    """Listening sockets; `ports`: requested loopback port for a service's port (8728, 8729, ...), else any free one.

    A service's port that is enabled again gets the same loopback port.
    """

    def __init__(self, visitor: Callable[[str], asyncio.Protocol], ports: Mapping[int, int]) -> None:
        self._visitor = visitor
        self._loopback = dict(ports)
        self._open: dict[tuple[str, int], asyncio.Server] = {}

    async def align(self, services: Mapping[str, Service]) -> None:
        """Open and close sockets to match `services`."""
        desired_keys = {
            (name, services[name].port) for name in SERVICES if name in services and services[name].is_enabled
        }
        for key in set(self._open) - desired_keys:
            self._open.pop(key).close()
        for key in sorted(desired_keys - set(self._open)):
            await self._listen(key)

    async def _listen(self, key: tuple[str, int]) -> None:
        name, port = key
        loop = asyncio.get_running_loop()
        server = await loop.create_server(lambda: self._visitor(name), HOST, self._loopback.get(port, 0))
        self._loopback[port] = server.sockets[0].getsockname()[1]
        self._open[key] = server

    @property
    def ports(self) -> dict[str, int]:
        """Loopback port of each listening service."""
        return {name: self._loopback[port] for name, port in sorted(self._open)}

    @property
    def port_map(self) -> dict[int, int]:
        """Loopback port for each port in `/ip/service`."""
        return {port: self._loopback[port] for _, port in sorted(self._open)}

    def close(self) -> None:
        """Stop listening; connections stay open."""
        for server in self._open.values():
            server.close()
        self._open.clear()


class MemberLine(Protocol):
    """Access to the router without a network connection: its serial line."""

    def down(self, *, clean: bool) -> None:
        """Handle the shutdown of the router."""

    def up(self) -> None:
        """Handle the start of the router."""

    def check(self) -> None:
        """Log out if this session was removed from `/user/active`."""

    def say_pending(self) -> None:
        """Show pending messages of the router."""


_RESET_ON_CLOSE = struct.pack("ii", 1, 0)


class RouterEnd(Protocol):
    """The router's end of a pipe."""

    async def work(self) -> None:
        """Serve the connection until it ends."""

    def handle_accept(self) -> None:
        """Handle the accepted connection."""

    def handle_chunk(self, chunk: Chunk) -> None:
        """Handle data from the client."""

    def handle_loss(self) -> None:
        """Handle the loss of the client, once the router detects it."""


class Pipe(asyncio.Protocol):
    """A connection from connect until both ends are gone.

    The counters `_heard` and `_answered` belong to the client's end and travel with its data, so that round trips are
    counted by the side that waits for them.

    Packets blocked by the path are held, as TCP would retransmit them, until the path opens or the router gives up.
    """

    def __init__(self, host: RouterHost, service: str) -> None:
        self.service = service
        self.end: RouterEnd
        self.established = False
        self.lost = False
        """The router has dropped this connection: further data are answered with RST."""
        self.ended = False
        self._host = host
        self._path = False
        self._vanished = False
        self._held_up: list[Chunk] = []
        self._held_down: list[Chunk] = []
        self._received = self._answered = 0
        self._tasks: list[asyncio.Task[None]] = []
        self._silence: asyncio.TimerHandle | None = None

    # The client's end.

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Handle a new client's SYN."""
        self._transport = cast("asyncio.Transport", transport)
        site_link, air = self._host.link, self._host.air
        self._up = DelayLine(site_link, Direction.UP, air, self._receive_chunk)
        self._down = DelayLine(site_link, Direction.DOWN, air, self._leave)
        self._up.earliest = asyncio.get_running_loop().time() + site_link.connect_s
        self._tasks = [asyncio.create_task(work) for work in (self._up.pump(), self._down.pump(), self.end.work())]
        for task in self._tasks:
            self._host.watch(task)
        self._host.handle_open(self)
        self.regate()

    def data_received(self, data: bytes) -> None:
        """Handle data from the client."""
        self._up.put(Chunk(data, heard_count=self._received, answer_count=self._answered))

    def eof_received(self) -> bool:
        """Handle the client's EOF; the router may still respond."""
        self._up.put(Chunk(end=LineEnd.FIN))
        return True

    def connection_lost(self, exc: Exception | None) -> None:
        """Handle the client's closed socket; the router learns it if the path is open."""
        del exc
        if not self.ended:
            self._up.put(Chunk(end=LineEnd.RST))

    def _leave(self, chunk: Chunk) -> None:
        """Deliver the router's data to the client."""
        if chunk.end is not None:
            self.stop(reset=chunk.end is LineEnd.RST)
        elif not self._transport.is_closing():
            self._transport.write(chunk.data)
            self._received, self._answered = chunk.heard_count, chunk.answer_count

    # The router's end.

    def _receive_chunk(self, chunk: Chunk) -> None:
        if self.ended:
            return
        if not self._path:
            self._held_up.append(chunk)
        elif self.lost:
            self._down.put(Chunk(end=LineEnd.RST))
        else:
            self.end.handle_chunk(chunk)

    def depart(self, chunk: Chunk) -> None:
        """Send the router's data, or hold them while its own configuration blocks the path."""
        if self.ended or self.lost:
            return
        if self._path:
            self._down.put(chunk)
        else:
            self._held_down.append(chunk)

    def regate(self) -> None:
        """Re-evaluate the path, and release held packets if it is open."""
        self._path = self._host.reaches(self.service, is_established=self.established)
        if self._path and not self.established:
            self._accept()
        if self._path:
            down, self._held_down = self._held_down, []
            up, self._held_up = self._held_up, []
            for chunk in down:
                self.depart(chunk)
            for chunk in up:
                self._receive_chunk(chunk)
        self.note_silence()

    def _accept(self) -> None:
        """Accept the connection; a service that refuses this client resets it only now."""
        self.established = True
        self.lost = not self._host.admits(self.service)
        if self.lost:
            self._down.put(Chunk(end=LineEnd.RST))
        else:
            self.end.handle_accept()

    def note_silence(self) -> None:
        """Start or stop the router's TCP timeout."""
        silent = self._vanished or not self._path or not self._host.air.is_set()
        if silent and self._silence is None:
            loop = asyncio.get_running_loop()
            self._silence = loop.call_later(self._host.silent_timeout_s, self._time_out)
        elif not silent and self._silence is not None:
            self._silence.cancel()
            self._silence = None

    def _time_out(self) -> None:
        if self.established:
            self.forget()
            self.end.handle_loss()

    # Ends.

    def forget(self) -> None:
        """Make the router forget the connection without notifying the client."""
        self.lost = True
        self._held_down.clear()

    def farewell(self) -> None:
        """Close the connection before a shutdown: EOF if the path is open."""
        if self._path:
            self._down.put(Chunk(end=LineEnd.FIN))
        self.forget()

    def vanish(self) -> None:
        """Silence the connection permanently, without notice to either end."""
        self._vanished = True
        for task in self._tasks[:2]:
            task.cancel()
        self.note_silence()

    def stop(self, *, reset: bool) -> None:
        """End the connection at both ends."""
        if self.ended:
            return
        self.ended = True
        if self._silence is not None:
            self._silence.cancel()
        if reset:
            self._reset()
        else:
            self._transport.close()
        for task in self._tasks:
            task.cancel()
        self._host.handle_close(self)
        self.end.handle_loss()

    def _reset(self) -> None:
        raw = cast("socket.socket | None", self._transport.get_extra_info("socket"))
        if raw is not None and raw.fileno() >= 0:
            raw.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _RESET_ON_CLOSE)
        self._transport.abort()
