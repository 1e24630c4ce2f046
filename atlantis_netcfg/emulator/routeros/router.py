"""One emulated router on sockets.

Not emulated: traffic (nothing is forwarded), radio, PoE power, CPU load, the time that real hardware needs to apply a
change, and behaviour that no RouterOS document describes; the last is adjustable (`WireBehaviour`, `Deviation`).
"""

from __future__ import annotations

import asyncio
from contextlib import suppress
from typing import TYPE_CHECKING, Self

from atlantis_netcfg.emulator.routeros.certificates import read_certificate
from atlantis_netcfg.emulator.routeros.dataplane.live import LiveNetwork
from atlantis_netcfg.emulator.routeros.device import Device
from atlantis_netcfg.emulator.routeros.shell import ssh
from atlantis_netcfg.emulator.routeros.shell.serial import SerialLine
from atlantis_netcfg.emulator.routeros.storage import Flash
from atlantis_netcfg.emulator.routeros.wire.host import HOST, LinkMember, Listeners, Pipe, RouterHost
from atlantis_netcfg.emulator.routeros.wire.link import (
    LinkFault,
    RouterLink,
    TrafficCounters,
    WireBehaviour,
    WireCounters,
)
from atlantis_netcfg.emulator.routeros.wire.switchboard import Switchboard

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path
    from types import TracebackType

    from atlantis_netcfg.emulator.routeros.answers import Answer, Caller
    from atlantis_netcfg.emulator.routeros.spec import RouterSpec


class EmulatedRouter:
    """An emulated router between `start()` and `stop()`, or inside `async with`; bound to its event loop.

    `ports`: requested loopback port for a service port, e.g. `{8729: 18729}`.
    """

    device: Device
    _board: Switchboard

    def __init__(
        self,
        spec: RouterSpec,
        *,
        state_dir: Path,
        link: RouterLink | None = None,
        knobs: WireBehaviour | None = None,
        ports: Mapping[int, int] | None = None,
    ) -> None:
        self.spec = spec
        self._link = link or RouterLink()
        self._knobs = knobs or WireBehaviour()
        self._flash = Flash(state_dir)
        self._doors = Listeners(self._visitor, ports or {})
        self._side_doors = Listeners(self._side_visitor, {})
        self._tallies: list[TrafficCounters] = []
        self._consoles: dict[str, Caller] = {}
        self._serial: SerialLine | None = None
        self._ahead_s = 0.0
        """Seconds by which the router's time is ahead of this computer's."""
        self._radio: Callable[[], None] | None = None
        self._carried: Callable[[], bool] | None = None

        self._namespace: str | None = None

    async def start(self) -> None:
        """Boot from the state directory and listen. Raises SeedError, or OSError if a port is taken."""
        loop = asyncio.get_running_loop()
        self.device = Device(self.spec, lambda: loop.time() + self._ahead_s)
        flash = self._flash.load()
        if flash is not None:
            self.device.restore(flash)
        self.attach(self._namespace)
        self._issue()
        self._board = Switchboard(
            self.device,
            on_change=self._handle_change,
            certificate=self._certificate,
            tallies=self._tallies,
            others={"ssh": self._shell},
        )
        self._board.ahead_s = self._ahead_s
        self.set_link(self._link)
        self.set_behaviour(self._knobs)
        self.on_radio(self._radio, self._carried)
        self._consoles.clear()
        if self.spec.serial:
            self._serial = self._board.line = SerialLine(self._board, self.device)
            self._serial.start()
        try:
            await self._board.start()
        except OSError:
            await self.stop()
            raise

    async def stop(self) -> None:
        """Cut the power: sockets close, the flash stays; raises errors that occurred inside the emulator."""
        self._doors.close()
        self._side_doors.close()
        self.device.save_to(self._flash)
        if self._serial is not None:
            self._serial.close()
            self._serial = None
        if self.device.core.live is not None:
            self.device.core.live.close()
            self.device.core.live = None
        self._board.stop()
        await asyncio.sleep(0)
        if self._board.failure is not None:
            raise self._board.failure

    async def restart(self) -> None:
        """Stop, and start again from the flash on the same loopback ports."""
        await self.stop()
        await self.start()

    async def __aenter__(self) -> Self:
        await self.start()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.stop()

    # What a test or a rehearsal reads.

    @property
    def host(self) -> str:
        """Address on which it listens."""
        return HOST

    @property
    def ports(self) -> dict[str, int]:
        """Loopback port of each emulated service that is enabled: `api`, `api-ssl`, `ssh`."""
        return self._doors.ports

    @property
    def port_map(self) -> dict[int, int]:
        """Loopback port for each port of `/ip/service`: maps inventory ports to emulator ports."""
        return self._doors.port_map

    @property
    def first_contact_ports(self) -> dict[int, int]:
        """Loopback port for each port of `/ip/service`, for a laptop at the spec's `first_contact`."""
        return self._side_doors.port_map

    @property
    def pin(self) -> str | None:
        """SHA-256 of the api-ssl certificate in hex, or None if there is none."""
        service = self.device.services().get("api-ssl")
        pem = None if service is None or service.certificate is None else self.device.certificate(service.certificate)
        return None if pem is None else read_certificate(pem).fingerprint

    @property
    def serial(self) -> str | None:
        """Path of the pty of its serial line, or None; it changes with every start."""
        return None if self._serial is None else self._serial.path

    @property
    def host_key(self) -> str:
        """Fingerprint of the SSH host key, `SHA256:...`."""
        return ssh.fingerprint(self._flash.host_key)

    def export(
        self,
        *,
        verbose: bool = False,
        terse: bool = False,
        show_sensitive: bool = False,
        menu: str = "/",
        header: bool = True,
    ) -> str:
        """Return the output of `/export` without a session; no `header` (with the clock) for comparisons."""
        return self.device.export(verbose=verbose, terse=terse, show_sensitive=show_sensitive, menu=menu, header=header)

    def counters(self) -> WireCounters:
        """Totals over all connections since the last reset."""
        total = WireCounters()
        for tally in self._tallies:
            total = total.plus(tally.counters)
        return total

    def connections(self) -> tuple[TrafficCounters, ...]:
        """Return counters and sentences of each connection, in order of connection."""
        return tuple(self._tallies)

    def reset_counters(self) -> None:
        """Reset the counters; open connections continue to count."""
        self._tallies[:] = [connection.tally for connection in self._board.connections]
        for tally in self._tallies:
            tally.counters = WireCounters()
            tally.sentences = []

    # What it does to the router.

    async def console(self, words: Sequence[str], *, user: str | None = None) -> list[Answer]:
        """Run a sentence as another administrator, whose session is kept and needs no network path.

        `user`: a user of the spec, by default the first. Raises LookupError, or Trap if the login is refused.
        """
        account = next((item for item in self.spec.users if user in (None, item.name)), None)
        if account is None:
            raise LookupError(f"{self.spec.name} has no user {user!r}")
        if account.name not in self._consoles:
            self._consoles[account.name] = self.device.login(
                account.name, account.password, via="api", address=self.spec.management.technician
            )
        answers = self.device.run(self._consoles[account.name], words)
        await self._board.settle()
        self._board.tell()
        return answers

    def set_link(self, link: RouterLink) -> None:
        """Change the link for all data sent from now on."""
        self._link = self._board.link.link = link

    def set_behaviour(self, knobs: WireBehaviour) -> None:
        """Change the adjustable behaviour."""
        self._knobs = knobs
        self._board.turn(knobs)

    def arm(self, fault: LinkFault) -> None:
        """Schedule a fault for a later sentence."""
        self._board.faults.arm(fault)

    def disarm(self) -> None:
        """Cancel scheduled faults."""
        self._board.faults.disarm()

    def gap(self, seconds: float) -> None:
        """Interrupt the link for some seconds."""
        self._board.gap(seconds)

    def silence(self, addresses: Sequence[str]) -> None:
        """Make these addresses stop responding to the router, and all others respond again."""
        self.device.silence(addresses)
        self._board.tell()

    async def wait(self, seconds: float) -> float:
        """Advance only the router's time and process what becomes due; its connections are paused.

        Return the router's time in seconds.
        """
        end = asyncio.get_running_loop().time() + self._ahead_s + seconds
        while (due := self.device.due()) is not None and due <= end:
            self._move_clock(due)
            self.device.tick()
        self._move_clock(end)
        self.device.tick()
        await self._board.settle()
        self._board.tell()
        return asyncio.get_running_loop().time() + self._ahead_s

    def _move_clock(self, moment: float) -> None:
        """Let the router's time be at least `moment`; packets of its probes may have taken longer."""
        self._ahead_s = max(self._ahead_s, moment - asyncio.get_running_loop().time())
        self._board.ahead_s = self._ahead_s

    def attach(self, namespace: str | None) -> tuple[str, ...]:
        """Let a network namespace follow the rows, and the router send its packets there; None: no namespace does.

        Return what Linux cannot stand for, one line each. Raises LookupError if there is no such namespace.
        """
        core, self._namespace = self.device.core, None
        if core.live is not None:
            core.live.close()
        core.live = None if namespace is None else LiveNetwork(core, namespace)
        self._namespace = namespace
        core.store.revision += 1  # other rows of netwatch are watched
        return () if core.live is None else core.live.limits

    def drop(self) -> None:
        """Reset all connections, at both ends."""
        for connection in self._board.connections:
            connection.drop()

    def vanish(self) -> None:
        """Silence all connections permanently, without notice."""
        for connection in self._board.connections:
            connection.vanish()

    def reboot(self, *, clean: bool = True) -> None:
        """Reboot, or cut the power (`clean=False`: sockets are not closed first); up again after `boot_s`."""
        self._board.reboot(clean=clean)
        self._consoles.clear()

    def rekey(self) -> None:
        """Replace the SSH host key, as a reset or an intruder would."""
        self._flash.forget_host_key()

    def recertify(self) -> None:
        """Replace the certificates, as a reset or an intruder would."""
        self._flash.forget_certificates()
        self._issue(again=True)

    # The air before its radios.

    @property
    def booting(self) -> bool:
        """Whether the router is down after a reboot or power cut."""
        return self._board.booting

    def on_radio(self, on_change: Callable[[], None] | None, carries: Callable[[], bool] | None) -> None:
        """Set the callbacks for changes of this router, and, behind a radio link, for reachability."""
        self._radio, self._carried = on_change, carries
        self._board.radio, self._board.carried = on_change, carries

    def regate(self) -> None:
        """Apply changes of the radio link to the connections."""
        self._board.regate()

    # Inside.

    def _issue(self, *, again: bool = False) -> None:
        """Restore the spec's certificates from an earlier start, or create them."""
        for name in () if self.spec.factory else self.spec.certificates:
            if again or self.device.certificate(name) is None:
                pem = self._flash.certificate(name, common_name=self.spec.name, address=self.spec.management.local)
                with suppress(LookupError):  # somebody has removed it
                    self.device.give_certificate(name, pem.read_text(encoding="ascii"))

    def _visitor(self, service: str) -> Pipe:
        return self._board.visitor(service)

    def _side_visitor(self, service: str) -> Pipe:
        return self._board.visitor(service, self.spec.first_contact)

    def _shell(self, host: RouterHost, address: str) -> LinkMember:
        return ssh.SshConnection(host, self.device, address=address, key=lambda: ssh.host_key(self._flash.host_key))

    async def _handle_change(self) -> None:
        await self._doors.align(self.device.services())
        if self.spec.first_contact is not None:
            await self._side_doors.align(self.device.services())
        self.device.save_to(self._flash)

    def _certificate(self, name: str) -> Path | None:
        pem = self.device.certificate(name)
        return None if pem is None else self._flash.keep(pem)
