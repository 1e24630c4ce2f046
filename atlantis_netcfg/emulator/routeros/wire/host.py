"""The connections of a router twin: the client's socket, the bearer, and the router's firewall and services."""

from __future__ import annotations

import asyncio
import socket
import struct
from typing import TYPE_CHECKING, Protocol, cast

from atlantis_netcfg.emulator.routeros.wire import link

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from random import Random

    from atlantis_netcfg.emulator.routeros.core import Service
    from atlantis_netcfg.emulator.routeros.wire.dialogue import Dialogue
    from atlantis_netcfg.emulator.routeros.wire.tls import ByteChannel


class LinkMember(Protocol):
    """A connection as its router sees it."""

    tally: link.TrafficCounters
    pipe: Pipe

    def drop(self) -> None:
        """Reset under both ends at once; what was under way is lost."""

    def vanish(self) -> None:
        """Silence for good, and neither end is told."""

    def handle_reboot(self, *, clean: bool) -> None:
        """The router has lost its memory; `clean` if it closed its sockets first."""

    def check(self) -> None:
        """Close if somebody has removed this session from `/user/active`."""

    def say_pending(self) -> None:
        """Say what the router has to say unasked."""


class RouterHost(Protocol):
    """What a connection needs of its router."""

    @property
    def bearer(self) -> link.WireBearer:
        """What carries the bytes."""

    @property
    def air(self) -> asyncio.Event:
        """Cleared while the bearer has a gap."""

    @property
    def knobs(self) -> link.WireBehaviour:
        """The knobs of this moment."""

    @property
    def pace(self) -> link.WirePace:
        """How fast the router answers."""

    @property
    def chance(self) -> Random | None:
        """What shuffles, or None for the order of arrival."""

    @property
    def booting(self) -> bool:
        """The router is down."""

    @property
    def silent_timeout_s(self) -> float:
        """Until the router's TCP gives a silent peer up."""

    def dialogue(self, service: str) -> Dialogue:
        """A session in which nobody has logged in."""

    def channel(self, service: str) -> ByteChannel:
        """TLS with the certificate of this moment, or plain."""

    def admits(self, service: str, address: str | None = None) -> bool:
        """Does the service, which has seen a packet, talk to this client; `address` is his, if not the technician's."""

    def reaches(self, service: str, *, is_established: bool) -> bool:
        """Do packets get through the router's own configuration, both ways."""

    def handle_open(self, pipe: Pipe) -> None:
        """A client has connected."""

    def handle_close(self, pipe: Pipe) -> None:
        """Neither end will be heard of again."""

    def watch(self, task: asyncio.Task[None]) -> None:
        """Stop the twin with an error if `task` fails."""

    def upon(self, command: str) -> list[link.LinkFault]:
        """Count a sentence; the faults that strike at it."""

    def strike(self, fault: link.LinkFault) -> None:
        """Let a fault happen that concerns more than one connection."""

    async def settle(self) -> None:
        """Let what has changed in the router take effect on its wire: path, listeners, flash, reboot."""

    def tell(self) -> None:
        """Let all sessions say what their `/listen` has seen, and look at the clock again."""


HOST = "127.0.0.1"
SERVICES = ("api", "api-ssl", "ssh")


class Listeners:
    """`ports` wishes a loopback port for a service's port (8728, 8729, ...); without a wish the kernel chooses one.

    A service's port that comes back finds the loopback port it had before.
    """

    def __init__(self, visitor: Callable[[str], asyncio.Protocol], ports: Mapping[int, int]) -> None:
        self._visitor = visitor
        self._loopback = dict(ports)
        self._open: dict[tuple[str, int], asyncio.Server] = {}

    async def align(self, services: Mapping[str, Service]) -> None:
        """Open and close sockets until they are as `services` says."""
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
        """Loopback port of each service that listens."""
        return {name: self._loopback[port] for name, port in sorted(self._open)}

    @property
    def port_map(self) -> dict[int, int]:
        """Loopback port by the port that `/ip/service` shows."""
        return {port: self._loopback[port] for _, port in sorted(self._open)}

    def close(self) -> None:
        """Stop listening; connections live on."""
        for server in self._open.values():
            server.close()
        self._open.clear()


class MemberLine(Protocol):
    """A way to the router that is no connection: its serial line."""

    def down(self, *, clean: bool) -> None:
        """The router goes down."""

    def up(self) -> None:
        """The router is back."""

    def check(self) -> None:
        """Log out if somebody has removed this session from `/user/active`."""

    def say_pending(self) -> None:
        """Say what the router has to say unasked."""


_RESET_ON_CLOSE = struct.pack("ii", 1, 0)


class RouterEnd(Protocol):
    """What stands at the router's end of a pipe."""

    async def work(self) -> None:
        """Answer for ever."""

    def handle_accept(self) -> None:
        """The connection is there."""

    def handle_chunk(self, chunk: link.Chunk) -> None:
        """The client is heard."""

    def handle_loss(self) -> None:
        """The router has learnt that the client is gone."""


class Pipe(asyncio.Protocol):
    """From connect until neither end exists any more.

    The tallies `_heard` and `_answered` belong to the client's end and travel with what it says, so that round trips
    are counted where they are paid for.

    What the path does not let through is held as TCP would send it again, until it is open or the router gives up.
    """

    def __init__(self, host: RouterHost, service: str) -> None:
        self.service = service
        self.end: RouterEnd
        self.established = False
        self.lost = False
        """The router has forgotten this connection: whatever still comes is answered by RST."""
        self.ended = False
        self._host = host
        self._path = False
        self._vanished = False
        self._held_up: list[link.Chunk] = []
        self._held_down: list[link.Chunk] = []
        self._received = self._answered = 0
        self._tasks: list[asyncio.Task[None]] = []
        self._silence: asyncio.TimerHandle | None = None

    # The client's end.

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """A client's SYN is on its way."""
        self._transport = cast("asyncio.Transport", transport)
        bearer, air = self._host.bearer, self._host.air
        self._up = link.DelayLine(bearer, link.Direction.UP, air, self._arrive)
        self._down = link.DelayLine(bearer, link.Direction.DOWN, air, self._leave)
        self._up.earliest = asyncio.get_running_loop().time() + bearer.connect_s
        self._tasks = [asyncio.create_task(work) for work in (self._up.pump(), self._down.pump(), self.end.work())]
        for task in self._tasks:
            self._host.watch(task)
        self._host.handle_open(self)
        self.regate()

    def data_received(self, data: bytes) -> None:
        """The client speaks."""
        self._up.put(link.Chunk(data, heard_count=self._received, answer_count=self._answered))

    def eof_received(self) -> bool:
        """The client will say no more, the router may still answer."""
        self._up.put(link.Chunk(end=link.LineEnd.FIN))
        return True

    def connection_lost(self, exc: Exception | None) -> None:
        """The client's socket is gone; the router learns it if the path lets it."""
        del exc
        if not self.ended:
            self._up.put(link.Chunk(end=link.LineEnd.RST))

    def _leave(self, chunk: link.Chunk) -> None:
        """The router is heard."""
        if chunk.end is not None:
            self.stop(reset=chunk.end is link.LineEnd.RST)
        elif not self._transport.is_closing():
            self._transport.write(chunk.data)
            self._received, self._answered = chunk.heard_count, chunk.answer_count

    # The router's end.

    def _arrive(self, chunk: link.Chunk) -> None:
        if self.ended:
            return
        if not self._path:
            self._held_up.append(chunk)
        elif self.lost:
            self._down.put(link.Chunk(end=link.LineEnd.RST))
        else:
            self.end.handle_chunk(chunk)

    def depart(self, chunk: link.Chunk) -> None:
        """The router speaks; its own firewall sees that first."""
        if self.ended or self.lost:
            return
        if self._path:
            self._down.put(chunk)
        else:
            self._held_down.append(chunk)

    def regate(self) -> None:
        """Look again whether packets get through, and let go what was held if they do."""
        self._path = self._host.reaches(self.service, is_established=self.established)
        if self._path and not self.established:
            self._accept()
        if self._path:
            down, self._held_down = self._held_down, []
            up, self._held_up = self._held_up, []
            for chunk in down:
                self.depart(chunk)
            for chunk in up:
                self._arrive(chunk)
        self.note_silence()

    def _accept(self) -> None:
        """The SYN has come through: a service that does not want this client says so only now."""
        self.established = True
        self.lost = not self._host.admits(self.service)
        if self.lost:
            self._down.put(link.Chunk(end=link.LineEnd.RST))
        else:
            self.end.handle_accept()

    def note_silence(self) -> None:
        """Start or stop the clock of the router's TCP time-out."""
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
        """The router knows nothing of this connection any more, and the client is not told."""
        self.lost = True
        self._held_down.clear()

    def farewell(self) -> None:
        """The router closes its sockets before it goes down: EOF where the path lets it."""
        if self._path:
            self._down.put(link.Chunk(end=link.LineEnd.FIN))
        self.forget()

    def vanish(self) -> None:
        """Silence for good, and neither end is told."""
        self._vanished = True
        for task in self._tasks[:2]:
            task.cancel()
        self.note_silence()

    def stop(self, *, reset: bool) -> None:
        """Both ends are gone."""
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
