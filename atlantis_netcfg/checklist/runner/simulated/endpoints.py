"""Where the twin of a declared endpoint really is: a port of this computer in place of a vehicle's address."""

from __future__ import annotations

from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.emulator.acoustic import EvologicsSpec, RunningEvologics, RunningSeatrac
from atlantis_netcfg.emulator.gnss import RunningGpsd, RunningNmea, RunningNmeaPort
from atlantis_netcfg.emulator.mavlink import RunningAutopilot

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.checklist.probes import Listen
    from atlantis_netcfg.checklist.runner.simulated._world import Autopilot, Modem, Receiver, World

__all__ = ["Stand", "standing"]


@dataclass(frozen=True, slots=True)
class Stand:
    """One end of a stream: as it is declared, and as it is here."""

    transport: str
    address: str = ""
    """Of a TCP service, or that datagrams come from."""
    port: int = 0
    device: str = ""
    """Of a serial port."""
    here_port: int = 0
    here_device: str = ""

    def means(self, question: Listen) -> bool:
        """Whether a question goes to this end."""
        if self.transport != question.transport:
            return False
        if self.transport == "serial":
            return self.device == question.device
        return self.port == question.port and (self.transport == "udp" or self.address == question.address)

    def place(self) -> dict[str, Any]:
        """The fields of the question that are otherwise here."""
        if self.transport == "serial":
            return {"device": self.here_device}
        return {"address": "" if self.transport == "udp" else "127.0.0.1", "port": self.here_port}


@contextmanager
def standing(world: World) -> Iterator[tuple[Stand, ...]]:
    """Start every twin that the world describes; they end with the context."""
    with ExitStack() as stack:
        stands = [_receiver(stack, receiver) for receiver in world.receivers.values()]
        stands += [_modem(stack, modem) for modem in world.modems.values()]
        stands += [_autopilot(stack, autopilot) for autopilot in world.autopilots.values()]
        yield tuple(stands)


def _receiver(stack: ExitStack, receiver: Receiver) -> Stand:
    if receiver.device:
        port = stack.enter_context(RunningNmeaPort(receiver.spec))
        return Stand("serial", device=receiver.device, here_device=port.path)
    server = RunningGpsd(receiver.spec) if receiver.gpsd else RunningNmea(receiver.spec)
    stack.enter_context(server)
    return Stand("tcp", receiver.address, receiver.port, here_port=server.port)


def _modem(stack: ExitStack, modem: Modem) -> Stand:
    twin = RunningEvologics(modem.spec) if isinstance(modem.spec, EvologicsSpec) else RunningSeatrac(modem.spec)
    stack.enter_context(twin)
    if modem.device:
        return Stand("serial", device=modem.device, here_device=twin.path)
    return Stand("tcp", modem.address, modem.port, here_port=twin.port)


def _autopilot(stack: ExitStack, autopilot: Autopilot) -> Stand:
    """The stream goes to a port that was free a moment ago: the declared one may be in use on this computer."""
    twin = stack.enter_context(RunningAutopilot(autopilot.spec))
    return Stand("udp", autopilot.address, autopilot.port, here_port=twin.port)
