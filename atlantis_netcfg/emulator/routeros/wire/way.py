"""One of the ways into a router, as the host of the connections that come over it (see host.py)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.wire.dialogue import Dialogue

if TYPE_CHECKING:
    import asyncio
    from random import Random

    from atlantis_netcfg.emulator.routeros.device import Device
    from atlantis_netcfg.emulator.routeros.spec import Management
    from atlantis_netcfg.emulator.routeros.wire.faults import Fault
    from atlantis_netcfg.emulator.routeros.wire.host import Host
    from atlantis_netcfg.emulator.routeros.wire.knobs import Knobs, Pace
    from atlantis_netcfg.emulator.routeros.wire.link import Bearer
    from atlantis_netcfg.emulator.routeros.wire.pipe import Pipe
    from atlantis_netcfg.emulator.routeros.wire.tls import Channel

__all__ = ["Way"]


class Way:
    """The router seen from another port than the management port; all else is `host`'s."""

    def __init__(self, host: Host, device: Device, path: Management) -> None:
        self._host = host
        self._device = device
        self._path = path

    @property
    def bearer(self) -> Bearer:
        """The same cable quality for all."""
        return self._host.bearer

    @property
    def air(self) -> asyncio.Event:
        """Cleared while the bearer has a gap."""
        return self._host.air

    @property
    def knobs(self) -> Knobs:
        """The knobs of this moment."""
        return self._host.knobs

    @property
    def pace(self) -> Pace:
        """How fast the router answers."""
        return self._host.pace

    @property
    def chance(self) -> Random | None:
        """What shuffles."""
        return self._host.chance

    @property
    def silent_timeout_s(self) -> float:
        """Until the router's TCP gives a silent peer up."""
        return self._host.silent_timeout_s

    @property
    def booting(self) -> bool:
        """The router is down."""
        return self._host.booting

    def dialogue(self, service: str) -> Dialogue:
        """A session in which nobody has logged in, from this way's technician."""
        return Dialogue(self._device, via=service, address=self._path.technician)

    def channel(self, service: str) -> Channel:
        """TLS or plain."""
        return self._host.channel(service)

    def admits(self, service: str, address: str | None = None) -> bool:
        """Does the service talk to this client."""
        return self._host.admits(service, address or self._path.technician)

    def reaches(self, service: str, *, established: bool) -> bool:
        """Do packets get through on this way."""
        path = self._path
        return not self.booting and self._device.path_open(
            path.technician, path.local, service, established=established, plug=path.port
        )

    def opened(self, pipe: Pipe) -> None:
        """A client has connected."""
        self._host.opened(pipe)

    def closed(self, pipe: Pipe) -> None:
        """Neither end will be heard of again."""
        self._host.closed(pipe)

    def watch(self, task: asyncio.Task[None]) -> None:
        """Stop the twin with an error if `task` fails."""
        self._host.watch(task)

    def upon(self, command: str) -> list[Fault]:
        """Count a sentence; the faults that strike at it."""
        return self._host.upon(command)

    def strike(self, fault: Fault) -> None:
        """Let a fault happen that concerns more than one connection."""
        self._host.strike(fault)

    async def settle(self) -> None:
        """Let what has changed in the router take effect on its wire."""
        await self._host.settle()

    def tell(self) -> None:
        """Let all sessions say what their `/listen` has seen."""
        self._host.tell()
