"""Environment of a rehearsed checklist: starts all emulated devices and, if requested, sets faults.

It runs the same requests as at the real site, with the emulated devices on this computer.

It maps each endpoint in the inventory to its emulator: a port of this computer instead of a vehicle's address.

If the gateway is a real machine, the machine answers what concerns its network (`machine_requests`).
"""

from __future__ import annotations

import asyncio
import os
import shlex
import time
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any
from zoneinfo import ZoneInfo

from atlantis_netcfg.checklist import probes
from atlantis_netcfg.checklist.probes.base import DhcpOffer, RouterAdvertisement
from atlantis_netcfg.checklist.runner import _real, machine_requests
from atlantis_netcfg.checklist.runner.results import OnAnswer, Questions, trouble_answer
from atlantis_netcfg.checklist.runner.simulated import _world
from atlantis_netcfg.checklist.runner.simulated._faults import FAULTS
from atlantis_netcfg.checklist.runner.simulated.robots import SimulatedRobots
from atlantis_netcfg.core.events import ignore
from atlantis_netcfg.core.paths import state_dir
from atlantis_netcfg.emulator import acoustic, gnss
from atlantis_netcfg.emulator.linux import NOT_FOUND, Computer
from atlantis_netcfg.emulator.mavlink import RunningAutopilot
from atlantis_netcfg.operations.allow_list_test.site import try_out
from atlantis_netcfg.operations.common.request import Mode, Request

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from ipaddress import IPv4Network

    from atlantis_netcfg.checklist.runner.simulated.measured_links import MeasuredLink
    from atlantis_netcfg.inventory import Inventory
    from atlantis_netcfg.operations.common.rehearsal import Rehearsal

_NOBODY = "nothing stands for it in a rehearsal"


@dataclass(frozen=True, slots=True)
class RehearsedTransport:
    """Runs requests in a rehearsal: real agent program for streams, simulated program output of a gateway."""

    devices: _real.ProbeTransport
    """Transport of the real site, with emulators and machines as its devices."""
    computer: Computer | None
    """Stands for the gateway, and for this computer as far as programs are run; None: the site has none."""
    stands: Sequence[EmulatorEndpoint]
    site: str
    links: Mapping[str, MeasuredLink]
    """Link -> what would have been measured."""
    robots: SimulatedRobots = field(default_factory=SimulatedRobots)
    machine_vpn: IPv4Network | None = None
    """Network of the VPN if the gateway is a real machine, which then answers some requests; None: simulated."""

    async def ask(
        self, place: probes.Place, host: str | None, questions: Questions, result: OnAnswer
    ) -> Mapping[str, probes.Answer]:
        """Run all requests of one place in one turn; see `Ears.ask`."""
        if place is probes.Place.ROUTER:
            return await self.devices.ask(place, host, questions, result)
        real = [pair for pair in questions if place is probes.Place.GATEWAY and self._is_for_machine(pair[1])]
        if not real:
            return await self._simulate(questions, result)
        answer_maps = await asyncio.gather(
            self.devices.ask(place, host, real, result),
            self._simulate([pair for pair in questions if pair not in real], result),
        )
        return {key: answer for answers in answer_maps for key, answer in answers.items()}

    def _is_for_machine(self, question: probes.Question) -> bool:
        if self.machine_vpn is None:
            return False
        return machine_requests.limit_of(question, self.machine_vpn) == machine_requests.MACHINE

    async def _simulate(self, questions: Questions, result: OnAnswer) -> Mapping[str, probes.Answer]:
        """Run requests with the emulators on this computer."""
        streams = [(key, stream) for key, request in questions if (stream := self._relocate(request)) is not None]
        answers: dict[str, probes.Answer] = {}
        names = {key for key, _ in streams}
        for key, question in questions:
            if key not in names:
                answers[key] = self._answer(question)
                result(key, answers[key])
        if streams:
            by_key = dict(questions)

            def progress(key: str, answer: probes.Answer) -> None:
                result(key, self._with_sender(by_key[key], answer))

            results = await _real.ask_here(streams, progress)
            answers.update({key: self._with_sender(by_key[key], answer) for key, answer in results.items()})
        return answers

    def _with_sender(self, question: probes.Question, answer: probes.Answer) -> probes.Answer:
        """Replace the senders of datagrams by the address of the emulated device in the inventory."""
        if not isinstance(answer, probes.Transcript) or not isinstance(question, probes.Listen) or not answer.senders:
            return answer
        stand = next(item for item in self.stands if item.means(question))
        return replace(answer, senders=(stand.address,) * len(answer.senders))

    def _relocate(self, question: probes.Question) -> probes.Listen | None:
        """Return the stream request with the emulator's endpoint; None if it is no stream, or has no emulator."""
        if not isinstance(question, probes.Listen):
            return None
        stand = next((item for item in self.stands if item.means(question)), None)
        return None if stand is None else replace(question, **stand.place())

    def _answer(self, question: probes.Question) -> probes.Answer:
        if isinstance(question, probes.RobotsHeardRequest | probes.VpnMembersRequest):
            return self.robots.answer(question)
        return (
            self._link_record(question)
            if isinstance(question, probes.LinkRecordRequest)
            else self._answer_by_computer(question)
        )

    def _answer_by_computer(self, question: probes.Question) -> probes.Answer:
        if self.computer is None or isinstance(question, probes.Listen):
            return trouble_answer(question, _NOBODY)
        if isinstance(question, probes.RunProgram):
            return self._run_program(question, self.computer)
        if isinstance(question, probes.DhcpDiscoverRequest | probes.RouterSolicitRequest):
            return self._of_segment(question, self.computer)
        if isinstance(question, probes.DdsDiscoverRequest):
            return self._discover(question, self.computer)
        if isinstance(question, probes.ReflectRequest):
            return self._reflect(question, self.computer)
        return trouble_answer(question, _NOBODY)

    def _link_record(self, question: probes.LinkRecordRequest) -> probes.LinkRecordResult:
        """Return a simulated record, marked as a rehearsal."""
        now, link = datetime.now(UTC), self.links.get(question.link)
        return probes.LinkRecordResult(
            None, "", None if link is None else link.record(self.site, now), now, is_rehearsal=True
        )

    @staticmethod
    def _run_program(question: probes.RunProgram, computer: Computer) -> probes.CommandResult:
        request_time = time.time()
        rc, out, err = computer.answer(question.argv)
        trouble, words = None, ""
        if rc == NOT_FOUND:
            trouble, words = probes.Trouble.MISSING, f"there is no program {shlex.quote(question.argv[0])}"
        return probes.CommandResult(trouble, words, rc, out, err, computer.now, request_time, time.time())

    @staticmethod
    def _discover(question: probes.DdsDiscoverRequest, computer: Computer) -> probes.DdsDiscoverResult:
        prefix = os.urandom(12)
        datagrams = computer.participants(question.domain, question.address, prefix)
        if datagrams is None:
            return probes.DdsDiscoverResult(
                probes.Trouble.UNREACHABLE, f"{question.address}: Cannot assign requested address"
            )
        return probes.DdsDiscoverResult(None, "", prefix, datagrams)

    @staticmethod
    def _reflect(question: probes.ReflectRequest, computer: Computer) -> probes.ReflectResult:
        """Return simulated replies, marked as such."""
        tokens = tuple(os.urandom(16).hex() for _ in range(question.count))
        replies = computer.reflect(question.source, question.address, tokens)
        if replies is None:
            return probes.ReflectResult(
                probes.Trouble.UNREACHABLE, f"{question.source}: Cannot assign requested address"
            )
        return probes.ReflectResult(None, "", tokens, tuple(probes.ReflectReply(*row) for row in replies))

    @staticmethod
    def _of_segment(
        question: probes.DhcpDiscoverRequest | probes.RouterSolicitRequest, computer: Computer
    ) -> probes.Answer:
        """Return the simulated result of a discovery on the segment of an interface."""
        absent = f"this computer has no interface {question.interface}"
        if isinstance(question, probes.RouterSolicitRequest):
            routers = computer.routers(question.interface)
            if routers is None:
                return probes.RouterAdvertisements(probes.Trouble.MISSING, absent)
            advertisements = (RouterAdvertisement(r.address, r.mac.lower(), r.lifetime_s, r.prefixes) for r in routers)
            return probes.RouterAdvertisements(None, "", tuple(advertisements))
        dhcp_offers = computer.offers(question.interface, question.cards)
        if dhcp_offers is None:
            return probes.DhcpOffers(probes.Trouble.MISSING, absent)
        offers = (DhcpOffer(offer.server, offer.mac.lower(), offer.address, offer.router) for offer in dhcp_offers)
        return probes.DhcpOffers(None, "", tuple(offers))


@dataclass(frozen=True, slots=True)
class EmulatorEndpoint:
    """Endpoint of a stream: as in the inventory, and its emulator."""

    transport: str
    address: str = ""
    """Address of a TCP service, or the sender address of datagrams."""
    port: int = 0
    device: str = ""
    """Device of a serial port."""
    here_port: int = 0
    here_device: str = ""

    def means(self, question: probes.Listen) -> bool:
        """Return whether a request is for this endpoint."""
        if self.transport != question.transport:
            return False
        if self.transport == "serial":
            return self.device == question.device
        return self.port == question.port and (self.transport == "udp" or self.address == question.address)

    def place(self) -> dict[str, Any]:
        """Return the request's fields that differ for the emulator."""
        if self.transport == "serial":
            return {"device": self.here_device}
        return {"address": "" if self.transport == "udp" else "127.0.0.1", "port": self.here_port}


@contextmanager
def start_emulators(world: _world.World) -> Iterator[tuple[EmulatorEndpoint, ...]]:
    """Start every emulator in a world's description; they end with the context."""
    with ExitStack() as stack:
        stands = [_start_receiver(stack, receiver) for receiver in world.receivers.values()]
        stands += [_start_modem(stack, modem) for modem in world.modems.values()]
        stands += [_autopilot(stack, autopilot) for autopilot in world.autopilots.values()]
        yield tuple(stands)


def _start_receiver(stack: ExitStack, receiver: _world.SimulatedReceiver) -> EmulatorEndpoint:
    if receiver.device:
        port = stack.enter_context(gnss.RunningNmeaPort(receiver.spec))
        return EmulatorEndpoint("serial", device=receiver.device, here_device=port.path)
    server = gnss.RunningGpsd(receiver.spec) if receiver.gpsd else gnss.RunningNmea(receiver.spec)
    stack.enter_context(server)
    return EmulatorEndpoint("tcp", receiver.address, receiver.port, here_port=server.port)


def _start_modem(stack: ExitStack, modem: _world.SimulatedModem) -> EmulatorEndpoint:
    emulator = (
        acoustic.RunningEvologics(modem.spec)
        if isinstance(modem.spec, acoustic.EvologicsSpec)
        else acoustic.RunningSeatrac(modem.spec)
    )
    stack.enter_context(emulator)
    if modem.device:
        return EmulatorEndpoint("serial", device=modem.device, here_device=emulator.path)
    return EmulatorEndpoint("tcp", modem.address, modem.port, here_port=emulator.port)


def _autopilot(stack: ExitStack, autopilot: _world.Autopilot) -> EmulatorEndpoint:
    """Start an autopilot; it sends to a free port, because the inventory's port may be in use on this computer."""
    emulator = stack.enter_context(RunningAutopilot(autopilot.spec))
    return EmulatorEndpoint("udp", autopilot.address, autopilot.port, here_port=emulator.port)


@contextmanager
def rehearsed_ears(  # noqa: PLR0913 - what is checked, and how much of it is real
    inventory: Inventory,
    site: str,
    rehearsal: Rehearsal,
    broken: Sequence[str] = (),
    *,
    has_real_tunnels: bool = False,
    prove: _real.RunProof = try_out,
) -> Iterator[RehearsedTransport]:
    """Provide the `ProbeTransport` of a site with only the faults `broken` (names of `FAULTS`), routers configured.

    `has_real_tunnels`: the routers' tunnels are real, so their state is left as it is.
    `prove`: runs the test of a satellite's allow-list.
    """
    world = _world.healthy(inventory, site)
    for around in world.routers.values() if has_real_tunnels else ():
        around.pop("tunnels", None)
    for name in broken:
        FAULTS[name].spoil(world)
    request = Request(state=state_dir(), mode=Mode.DRIFT, rehearsed=True, targets=rehearsal.targets, accept_cost=True)
    with _routers(inventory, world, rehearsal), start_emulators(world) as stands:
        computer = None if world.computer is None else Computer(world.computer)
        yield RehearsedTransport(
            _real.RealTransport(inventory, site, request, ignore, prove=prove),
            computer,
            stands,
            site,
            world.links,
            world.robots,
            inventory.pilot.vpn.network if machine_of(inventory, site, rehearsal) else None,
        )


def machine_of(inventory: Inventory, site: str, rehearsal: Rehearsal) -> str | None:
    """Return the name of the computer from which a site is probed if it is a real machine, else None."""
    gateway = inventory.computer_of(site)
    return gateway.name if gateway is not None and gateway.name in rehearsal.computers.machines else None


@contextmanager
def _routers(inventory: Inventory, world: _world.World, rehearsal: Rehearsal) -> Iterator[None]:
    """Set up the routers' surroundings, and apply the faults; all of it is undone at the end."""
    zone = ZoneInfo(inventory.pilot.time_zone)
    emulated_routers = [name for name in world.routers if name in rehearsal.targets]
    for name in emulated_routers:
        rehearsal.emulators.do(name, "around", **world.routers[name])
        rehearsal.emulators.do(name, "console", words=_world.clock_words(datetime.now(zone)))
    with ExitStack() as back:
        for act in world.acts:
            back.callback(act(rehearsal.emulators.do))
        yield
