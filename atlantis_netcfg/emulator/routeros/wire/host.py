"""The seam between the connections of a router twin and the router itself."""

from __future__ import annotations

import asyncio
import os
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path
    from random import Random

    from atlantis_netcfg.emulator.routeros.device import Service
    from atlantis_netcfg.emulator.routeros.wire.dialogue import Dialogue
    from atlantis_netcfg.emulator.routeros.wire.faults import Fault
    from atlantis_netcfg.emulator.routeros.wire.knobs import Pace, WireBehaviour
    from atlantis_netcfg.emulator.routeros.wire.link import Bearer
    from atlantis_netcfg.emulator.routeros.wire.pipe import Pipe
    from atlantis_netcfg.emulator.routeros.wire.tally import TrafficCounters
    from atlantis_netcfg.emulator.routeros.wire.tls import Channel


class Line(Protocol):
    """A way to the router that is no connection: its serial line."""

    def down(self, *, clean: bool) -> None:
        """The router goes down."""

    def up(self) -> None:
        """The router is back."""

    def check(self) -> None:
        """Log out if somebody has removed this session from `/user/active`."""

    def say_pending(self) -> None:
        """Say what the router has to say unasked."""


class Member(Protocol):
    """A connection as its router sees it."""

    tally: TrafficCounters
    pipe: Pipe

    def drop(self) -> None:
        """Reset under both ends at once; what was under way is lost."""

    def vanish(self) -> None:
        """Silence for good, and neither end is told."""

    def rebooted(self, *, clean: bool) -> None:
        """The router has lost its memory; `clean` if it closed its sockets first."""

    def check(self) -> None:
        """Close if somebody has removed this session from `/user/active`."""

    def say_pending(self) -> None:
        """Say what the router has to say unasked."""


class Host(Protocol):
    """What a connection needs of its router."""

    @property
    def bearer(self) -> Bearer:
        """What carries the bytes."""

    @property
    def air(self) -> asyncio.Event:
        """Cleared while the bearer has a gap."""

    @property
    def knobs(self) -> WireBehaviour:
        """The knobs of this moment."""

    @property
    def pace(self) -> Pace:
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

    def channel(self, service: str) -> Channel:
        """TLS with the certificate of this moment, or plain."""

    def admits(self, service: str, address: str | None = None) -> bool:
        """Does the service, which has seen a packet, talk to this client; `address` is his, if not the technician's."""

    def reaches(self, service: str, *, established: bool) -> bool:
        """Do packets get through the router's own configuration, both ways."""

    def opened(self, pipe: Pipe) -> None:
        """A client has connected."""

    def closed(self, pipe: Pipe) -> None:
        """Neither end will be heard of again."""

    def watch(self, task: asyncio.Task[None]) -> None:
        """Stop the twin with an error if `task` fails."""

    def upon(self, command: str) -> list[Fault]:
        """Count a sentence; the faults that strike at it."""

    def strike(self, fault: Fault) -> None:
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
        desired = {(name, services[name].port) for name in SERVICES if name in services and services[name].enabled}
        for key in set(self._open) - desired:
            self._open.pop(key).close()
        for key in sorted(desired - set(self._open)):
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


def write(path: Path, data: bytes) -> None:
    """Write `data` to `path` atomically, in a folder that is made if need be."""
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    draft = path.with_name(f".{path.name}.new")
    with os.fdopen(os.open(draft, os.O_CREAT | os.O_WRONLY | os.O_TRUNC, 0o600), "wb") as file:
        file.write(data)
    draft.replace(path)
