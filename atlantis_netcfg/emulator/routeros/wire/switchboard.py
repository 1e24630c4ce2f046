"""Layer between an emulated router's device and its sockets: connections, timers and failures."""

from __future__ import annotations

import asyncio
import random
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.wire import tls
from atlantis_netcfg.emulator.routeros.wire.connection import Connection
from atlantis_netcfg.emulator.routeros.wire.dialogue import Dialogue
from atlantis_netcfg.emulator.routeros.wire.link import (
    Direction,
    FaultKind,
    Faults,
    LinkFault,
    RouterLink,
    TrafficCounters,
    WireBehaviour,
    WireLink,
    WirePace,
)

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Mapping
    from pathlib import Path
    from random import Random

    from atlantis_netcfg.emulator.routeros.device import Device
    from atlantis_netcfg.emulator.routeros.spec import ManagementSpec
    from atlantis_netcfg.emulator.routeros.wire.host import LinkMember, MemberLine, Pipe, RouterHost


class AccessPath:
    """The router from another port than the management port; everything else is delegated to `host`."""

    def __init__(self, host: RouterHost, device: Device, path: ManagementSpec) -> None:
        self._host = host
        self._device = device
        self._path = path

    @property
    def link(self) -> WireLink:
        """The link, the same for all ports."""
        return self._host.link

    @property
    def air(self) -> asyncio.Event:
        """Cleared while the link is interrupted."""
        return self._host.air

    @property
    def knobs(self) -> WireBehaviour:
        """The current adjustable behaviour."""
        return self._host.knobs

    @property
    def pace(self) -> WirePace:
        """The router's response times."""
        return self._host.pace

    @property
    def chance(self) -> Random | None:
        """Random source for shuffling."""
        return self._host.chance

    @property
    def silent_timeout_s(self) -> float:
        """Seconds until the router's TCP drops a silent peer."""
        return self._host.silent_timeout_s

    @property
    def booting(self) -> bool:
        """Whether the router is down."""
        return self._host.booting

    def dialogue(self, service: str) -> Dialogue:
        """Return a new session without login, from this path's technician."""
        return Dialogue(self._device, via=service, address=self._path.technician)

    def channel(self, service: str) -> tls.ByteChannel:
        """Return a TLS or plain channel."""
        return self._host.channel(service)

    def admits(self, service: str, address: str | None = None) -> bool:
        """Return whether the service accepts this client."""
        return self._host.admits(service, address or self._path.technician)

    def reaches(self, service: str, *, is_established: bool) -> bool:
        """Return whether packets pass on this path."""
        path = self._path
        return not self.booting and self._device.path_open(
            path.technician, path.local, service, is_established=is_established, plug=path.port
        )

    def handle_open(self, pipe: Pipe) -> None:
        """Handle a new client."""
        self._host.handle_open(pipe)

    def handle_close(self, pipe: Pipe) -> None:
        """Handle the end of a connection at both ends."""
        self._host.handle_close(pipe)

    def watch(self, task: asyncio.Task[None]) -> None:
        """Stop the emulator with an error if `task` fails."""
        self._host.watch(task)

    def upon(self, command: str) -> list[LinkFault]:
        """Count a sentence; return the faults that apply to it."""
        return self._host.upon(command)

    def strike(self, fault: LinkFault) -> None:
        """Apply a fault that affects more than one connection."""
        self._host.strike(fault)

    async def settle(self) -> None:
        """Apply changes of the router to its connections."""
        await self._host.settle()

    def tell(self) -> None:
        """Send pending `/listen` replies of all sessions."""
        self._host.tell()


class Switchboard:
    """Host of all connections of one router (see host.py), from power-on to power-off.

    `changed` is awaited after each change of the configuration; `certificate` returns a PEM file by name; `others`
    creates the router's end of non-API services, for a client at an address.
    """

    def __init__(
        self,
        device: Device,
        *,
        on_change: Callable[[], Awaitable[None]],
        certificate: Callable[[str], Path | None],
        tallies: list[TrafficCounters],
        others: Mapping[str, Callable[[RouterHost, str], LinkMember]],
    ) -> None:
        self.link = WireLink(RouterLink())
        self.air = asyncio.Event()
        self.air.set()
        self.pace = WirePace()
        self.faults = Faults()
        self.knobs = WireBehaviour()
        self.chance: random.Random | None = None
        self.booting = False
        self.radio: Callable[[], None] | None = None
        """Called when the configuration changes, and when the router goes down or comes back."""
        self.carried: Callable[[], bool] | None = None
        """Whether the path in front of the router carries packets; None: a cable, which always does."""
        self.failure: BaseException | None = None
        self._device = device
        self.link.count = self._count
        self._path = device.spec.management
        self._on_change = on_change
        self._certificate = certificate
        self._tallies = tallies
        self._others = others
        self._connections: dict[Pipe, LinkMember] = {}
        self._revision: int | None = None
        self._alarm = asyncio.Event()
        self._settling = asyncio.Lock()
        self._timers: list[asyncio.TimerHandle] = []
        self.ahead_s = 0.0
        """Seconds by which the device's time is ahead of the event loop's."""
        self.line: MemberLine | None = None
        """Serial line, in addition to the network; None: there is none."""
        self._gap_until = 0.0
        self._clock: asyncio.Task[None] | None = None

    async def start(self) -> None:
        """Start the router."""
        await self.settle()
        self._clock = asyncio.create_task(self._run_clock())
        self.watch(self._clock)

    def stop(self) -> None:
        """Power off."""
        for timer in self._timers:
            timer.cancel()
        if self._clock is not None:
            self._clock.cancel()
        for connection in self.connections:
            connection.handle_reboot(clean=False)
            connection.pipe.stop(reset=False)

    @property
    def connections(self) -> tuple[LinkMember, ...]:
        """The current connections."""
        return tuple(self._connections.values())

    def visitor(self, service: str, way: ManagementSpec | None = None) -> Pipe:
        """Create the server side for a new client of `service`, on the inventory's management path or on `way`."""
        host: RouterHost = self if way is None else AccessPath(self, self._device, way)
        other = self._others.get(service)
        connection = Connection(host, service) if other is None else other(host, (way or self._path).technician)
        self._connections[connection.pipe] = connection
        return connection.pipe

    def turn(self, knobs: WireBehaviour) -> None:
        """Set the adjustable behaviour and restart the shuffling."""
        self.chance = None if knobs.shuffle is None else random.Random(knobs.shuffle)  # noqa: S311 (repeatable, no secret)
        self.knobs = knobs

    def _count(self, port: str | None, direction: Direction, size: int) -> None:
        """Count bytes; the device resets the counters at restart, as a router does."""
        self._device.core.count(port or self._path.port, is_received=direction is Direction.UP, size=size)

    # Faults.

    def gap(self, seconds: float) -> None:
        """Interrupt the link for some seconds."""
        loop = asyncio.get_running_loop()
        self._gap_until = max(self._gap_until, loop.time() + seconds)
        self.air.clear()
        self._timers.append(loop.call_at(self._gap_until, self._end_gap))
        for pipe in tuple(self._connections):
            pipe.note_silence()

    def _end_gap(self) -> None:
        if asyncio.get_running_loop().time() < self._gap_until:
            return
        self.air.set()
        for pipe in tuple(self._connections):
            pipe.note_silence()

    def reboot(self, *, clean: bool) -> None:
        """Go down, closing sockets first if `clean`; up again after `boot_s`."""
        self.booting = True
        for connection in self.connections:
            connection.handle_reboot(clean=clean)
        if self.line is not None:
            self.line.down(clean=clean)
        self._device.reboot(clean=clean)
        self._notify_radio()
        self.regate()
        self._timers.append(asyncio.get_running_loop().call_later(self.knobs.boot_s, self._end_boot))
        self._alarm.set()

    def _end_boot(self) -> None:
        self.booting = False
        if self.line is not None:
            self.line.up()
        self._notify_radio()
        self.regate()
        self._alarm.set()

    # What the connections ask.

    @property
    def silent_timeout_s(self) -> float:
        """Seconds until the router's TCP drops a silent peer."""
        return self._device.spec.silent_timeout_s

    def dialogue(self, service: str) -> Dialogue:
        """Return a new session without login."""
        return Dialogue(self._device, via=service, address=self._path.technician)

    def channel(self, service: str) -> tls.ByteChannel:
        """Return a channel: TLS with the current certificate, or plain."""
        if service != "api-ssl":
            return tls.Plain()
        row = self._device.services()[service]
        pem = None if row.certificate is None else self._certificate(row.certificate)
        return tls.Tls(tls.context(pem, newest="1.2" if row.tls_version == "only-1.2" else self.knobs.tls))

    def admits(self, service: str, address: str | None = None) -> bool:
        """Return whether the service accepts this client; `address`: if not the technician's."""
        row = self._device.services().get(service)
        busy = sum(pipe.service == service and pipe.established and not pipe.lost for pipe in self._connections)
        caller = address or self._path.technician
        return row is not None and row.is_enabled and row.admits(caller) and busy <= row.max_sessions

    def reaches(self, service: str, *, is_established: bool) -> bool:
        """Return whether packets pass through the router's configuration in both directions."""
        path = self._path
        here = not self.booting and (self.carried is None or self.carried())
        return here and self._device.path_open(path.technician, path.local, service, is_established=is_established)

    def handle_open(self, pipe: Pipe) -> None:
        """Handle a new client."""
        self._tallies.append(self._connections[pipe].tally)

    def handle_close(self, pipe: Pipe) -> None:
        """Handle the end of a connection at both ends."""
        self._connections.pop(pipe, None)

    def upon(self, command: str) -> list[LinkFault]:
        """Count a sentence; return the faults that apply to it."""
        return self.faults.upon(command)

    def strike(self, fault: LinkFault) -> None:
        """Apply a fault that affects more than one connection."""
        if fault.do is FaultKind.GAP:
            self.gap(fault.seconds)
        elif fault.do in (FaultKind.REBOOT, FaultKind.POWER):
            self.reboot(clean=fault.do is FaultKind.REBOOT)

    async def settle(self) -> None:
        """Apply changes of the router to its connections: reboot, listeners, flash, path."""
        async with self._settling:
            if self._device.wants_reboot:
                self.reboot(clean=True)
            if self._device.core.live is not None:
                self._device.core.live.follow()
            for connection in self.connections:
                connection.check()
            if self.line is not None:
                self.line.check()
            if self._revision == self._device.revision:
                return
            self._revision = self._device.revision
            await self._on_change()
            self._notify_radio()
            self.regate()

    def tell(self) -> None:
        """Send pending `/listen` replies of all sessions, and recompute the next due time."""
        for connection in self.connections:
            connection.say_pending()
        if self.line is not None:
            self.line.say_pending()
        self._alarm.set()

    def watch(self, task: asyncio.Task[None]) -> None:
        """Reset all connections if `task` fails, and store the error."""
        task.add_done_callback(self._handle_finish)

    def _handle_finish(self, task: asyncio.Task[None]) -> None:
        if not task.cancelled() and (failure := task.exception()) is not None:
            self.failure = self.failure or failure
            for connection in self.connections:
                connection.drop()

    def _notify_radio(self) -> None:
        if self.radio is not None:
            self.radio()

    def regate(self) -> None:
        """Re-evaluate the paths of all connections, and process what the new state makes due."""
        self._alarm.set()
        for pipe in tuple(self._connections):
            pipe.regate()

    async def _run_clock(self) -> None:
        """Run the device's due work while it is up."""
        while True:
            due = None if self.booting else self._device.due()
            try:
                # Not wait_for: in Python 3.11 it forgets that it was cancelled if the alarm comes in the same moment.
                async with asyncio.timeout_at(None if due is None else due - self.ahead_s):
                    await self._alarm.wait()
            except TimeoutError:
                self._device.tick()
                for connection in self.connections:
                    connection.say_pending()
            self._alarm.clear()
            await self.settle()
