"""Robots on the network of a site: discovery, and mock robots."""

from __future__ import annotations

import asyncio
import math
import re
import socket
import time
from contextlib import nullcontext
from dataclasses import dataclass, replace
from ipaddress import IPv4Address
from pathlib import Path
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.core import errors
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.inventory import InventoryInvalid, model
from atlantis_netcfg.inventory.loader import shown_path
from atlantis_netcfg.inventory.new_inventory.yaml_text import VaultSecret, document
from atlantis_netcfg.inventory.robots import reading
from atlantis_netcfg.links import LinkFinding
from atlantis_netcfg.operations.common.request import refuse_examples
from atlantis_netcfg.robots.message_types import INTERFACES, MessageTypes
from atlantis_netcfg.robots.mock import MockRobot
from atlantis_netcfg.robots.network import Publisher, RobotListener, domain, profile
from atlantis_netcfg.robots.observation import RobotReport, RobotState, judge, vehicle_key
from atlantis_netcfg.robots.recording import BagRecorder
from atlantis_netcfg.robots.replay import BagPlayer, read_bag
from atlantis_netcfg.runs import os_errors_as, write_atomically

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from atlantis_netcfg.inventory import Inventory
    from atlantis_netcfg.inventory.robots.key_names import KeyNames
    from atlantis_netcfg.robots.observation import RobotObservation
    from atlantis_netcfg.robots.replay import Bag

LOOPBACK: Final = "127.0.0.1"
SHORTEST_S, LONGEST_S = 5, 3600
_LISTENERS: Final = 4
"""Number of local DDS participants besides the mock robots: processes that listen on the same computer."""
_HEAD: Final = "# {namespace}: as it was heard on the network, and approved by a person."
_READABLE: Final = 0o644
_POSITION: Final = (41.68, -8.83)
"""Position off Viana do Castelo, used if a site declares no geofence."""


def seconds_of(text: str) -> int:
    """Parse `for=` and `observed=` to seconds; raise UsageError."""
    match = re.fullmatch(r"([0-9]{1,6})(s|m)?", text)
    seconds = int(match[1]) * (60 if match[2] == "m" else 1) if match else 0
    if not SHORTEST_S <= seconds <= LONGEST_S:
        hint = msg(f"type seconds or minutes, from {arg(SHORTEST_S)} s to 1 hour: `30s`, `5m`")
        raise errors.UsageError(f"`{arg(text)}` is not a valid duration", hint=hint)
    return seconds


def robots_of(inventory: Inventory) -> tuple[list[reading.RobotSource], KeyNames]:
    """Return every robot of the inventory; raise InventoryInvalid, or NoMatchError if there is none."""
    sources, names = reading.load_robots(inventory)
    if not sources:
        raise errors.NoMatchError(
            "the inventory has no robots", hint="put the robot files into robots/ (see docs/robots.md)"
        )
    return sources, names


def without_file(vehicle: str) -> errors.NoMatchError:
    """Return the error for a vehicle without a robot file, whose topics are unknown."""
    hint = msg(f"see docs/robots.md; `provision robot validate vehicle={arg(vehicle)}` checks it")
    return errors.NoMatchError(
        f"robots/{arg(vehicle)}.yml, which lists what `{arg(vehicle)}` publishes, does not exist", hint=hint
    )


def dds_of(inventory: Inventory) -> model.Dds:
    """Return the pilot's DDS settings; raise UsageError if there are none."""
    if inventory.pilot.dds is None:
        raise errors.UsageError(
            "`dds` is not set for the pilot", hint="write `dds: {distribution: foxy}` below `pilot:`"
        )
    return inventory.pilot.dds


def own_address(inventory: Inventory, site: str) -> str:
    """Return this computer's address towards a site's LAN, without sending a packet; raise UsageError."""
    network = inventory.sites[site].lan
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((str(network.gateway), 9))
        except OSError as error:
            hint = msg(
                f"connect it to the LAN of {arg(site)}, or join the VPN; or give another address of this computer with "
                "`address=`"
            )
            raise errors.UsageError(
                f"this computer has no route to {arg(network.network)}: {arg(error.strerror)}", hint=hint
            ) from error
        return str(probe.getsockname()[0])


def _ip_address(address: str) -> IPv4Address:
    try:
        return IPv4Address(address)
    except ValueError:
        message = msg(f"`address={arg(address)}` is not an IPv4 address")
        raise errors.UsageError(message, hint="`ip address` shows the addresses of this computer") from None


def listening_address(inventory: Inventory, site: str, address: str | None) -> str:
    """Return the given address, else the one towards the site; raise UsageError for example values."""
    if address is not None and _ip_address(address).is_loopback:
        return address
    refuse_examples(inventory, is_rehearsal=False)
    return address or own_address(inventory, site)


def computers_of(inventory: Inventory, sites: Sequence[str]) -> list[str]:
    """Return the addresses of possible listeners: the sites' computers, every control centre, configured peers."""
    computers = [
        host.device
        for host in inventory.hosts.values()
        if isinstance(host.device, model.ServerComputer)
        and (host.site in sites or isinstance(host.device, model.ControlCentre))
    ]
    addresses = [str(each.address) for each in computers]
    addresses += [str(each.vpn_address) for each in computers if each.vpn_address is not None]
    return [*addresses, *(str(peer.address) for peer in dds_of(inventory).peers if peer.site in {None, *sites})]


def peers_of(inventory: Inventory, sites: Sequence[str]) -> list[str]:
    """Return the addresses of possible participants at sites: robots, and those of `computers_of`."""
    reservations = [each for site in sites for each in inventory.sites[site].lan.reservations]
    robots = [str(each.address) for each in reservations if each.name in inventory.vehicles]
    return [*robots, *computers_of(inventory, sites)]


def expected_at(inventory: Inventory, site: str) -> list[str]:
    """Return the vehicles tested at a site; guests until their last day."""
    vehicle_names, past = inventory.sites[site].checklist.vehicles, reading.past_guests(inventory)

    def is_tested(key: str, vehicle: model.Vehicle) -> bool:
        if isinstance(vehicle, model.Guest):
            return site in vehicle.tested_at and key not in past
        return vehicle_names is None or key in vehicle_names

    return [key for key, vehicle in inventory.vehicles.items() if is_tested(key, vehicle)]


def recorder(inventory: Inventory, folder: str) -> BagRecorder:
    """Return a recorder that writes a bag into a new folder; raise UsageError."""
    return BagRecorder(Path(folder), MessageTypes(inventory.root / reading.FOLDER / INTERFACES))


def discover(
    inventory: Inventory, site: str, seconds: float, address: str | None, record: BagRecorder | None = None
) -> tuple[RobotObservation, list[RobotReport]]:
    """Listen at a site, and compare the observation with the robots' files; raise UsageError."""
    _, names = robots_of(inventory)
    dds = dds_of(inventory)
    types = MessageTypes(inventory.root / reading.FOLDER / INTERFACES)
    local = listening_address(inventory, site, address)
    with (
        domain(dds.domain, profile(local, peers_of(inventory, [site]), dds.participants)) as number,
        record or nullcontext(),
    ):
        keep = record.add if record is not None else None
        observation = RobotListener(number, types, names.configuration_topic, local, keep).listen(seconds)
    return observation, compare(inventory, site, observation)


def compare(inventory: Inventory, site: str, observation: RobotObservation) -> list[RobotReport]:
    """Compare an observation for a site, made anywhere, with the robots' files; raise as `robots_of`."""
    sources, names = robots_of(inventory)
    expected_vehicles = expected_at(inventory, site)
    reports = [
        replace(
            report,
            findings=tuple(
                replace(each, hint=errors.fill_hint(each.hint or "", site=site)) for each in report.findings
            ),
        )
        for report in judge(observation, sources, expected_vehicles, names, reading.past_guests(inventory))
    ]
    for vehicle in sorted({*expected_vehicles} - {source.vehicle for source in sources}):
        error = without_file(vehicle)
        finding = LinkFinding(Verdict.INCONCLUSIVE, "file-missing", str(error), error.hint)
        reports.append(RobotReport(vehicle, RobotState.MISSING, vehicle, (finding,)))
    return reports


def save(inventory: Inventory, namespace: str, observation: RobotObservation, encrypt: Callable[[str], str]) -> Path:
    """Write the file of an observed robot whose vehicle is in the inventory; its token is encrypted.

    Raises NoMatchError, UsageError, InventoryInvalid: then nothing is written.
    """
    names, _ = reading.key_names(inventory)
    copies = {
        each.writer.participant: reading.read_published(each.text, names)[0] for each in observation.configurations
    }
    robots = [robot for robot in copies.values() if robot is not None and robot.name == namespace]
    if len(robots) != 1:
        message = msg(f"{arg(len(robots))} robots use the namespace `{arg(namespace)}`, so no file was written")
        others = join(", ", sorted({robot.name for robot in copies.values() if robot is not None})) or "none"
        raise errors.NoMatchError(message, hint=f"readable configurations were received from: {arg(others)}")
    vehicle = vehicle_key(namespace)
    path = inventory.root / reading.FOLDER / f"{vehicle}.yml"
    if vehicle not in inventory.vehicles:
        hint = "add it to the inventory first: the finding `robot-unknown` shows the command"
        raise errors.NoMatchError(f"no such vehicle: `{arg(vehicle)}`; no file was written", hint=hint)
    if path.exists():
        raise errors.UsageError(
            f"{arg(shown_path(path))} already exists",
            hint="remove `save=`: then what is received is compared with that file",
        )
    token = robots[0].token
    assert isinstance(token, Secret)  # noqa: S101 - what is published is in clear
    tree = robots[0].model_dump(mode="json", exclude_unset=True, exclude_none=True, exclude={"token"})
    text = document(
        {**tree, "token": VaultSecret(encrypt(token.reveal()))}, (msg(_HEAD.format(namespace=arg(namespace))),)
    )
    with os_errors_as("the robot's file", path):
        write_atomically(path, text.encode(), mode=_READABLE)
    try:
        reading.load_robots(inventory)
    except InventoryInvalid:
        path.unlink()
        raise
    return path


async def hear(inventory: Inventory, site: str, seconds: float) -> RobotObservation:
    """Listen at a site without blocking other tasks; raise UsageError."""
    names, _ = reading.key_names(inventory)
    dds = dds_of(inventory)
    local = listening_address(inventory, site, None)
    types = await asyncio.to_thread(MessageTypes, inventory.root / reading.FOLDER / INTERFACES)
    with domain(dds.domain, profile(local, peers_of(inventory, [site]), dds.participants)) as number:
        return await RobotListener(number, types, names.configuration_topic, local).listen_beside_others(seconds)


def ending(reports: Sequence[RobotReport], observation: RobotObservation) -> errors.ExitCode:
    """Return the exit code: 0 if every expected robot was observed and matches; never for strangers or silence."""
    declared_reports = [report for report in reports if report.state is RobotState.DECLARED]
    if not observation.participants or not declared_reports:
        return errors.ExitCode.CHECKS_FAILED
    is_success = all(
        report.state is not RobotState.UNKNOWN and report.verdict in {Verdict.PASS, Verdict.WARN} for report in reports
    )
    return errors.ExitCode.DONE if is_success else errors.ExitCode.CHECKS_FAILED


@dataclass(frozen=True, slots=True)
class MockPlace:
    """The place of mock robots on the network."""

    address: str
    """Address of this computer at which others reach the mock robots."""
    peers: Sequence[str]
    """Addresses at which listeners may run."""


def mock_place(inventory: Inventory, site: str | None, address: str | None) -> MockPlace:
    """Return the place for robots of a site; without a site, this computer alone. Raise UsageError."""
    if site is None:
        return MockPlace(str(_ip_address(address or LOOPBACK)), ())
    # Not where robots may be: what goes to many addresses that nobody has fills the buffer that all else waits in.
    return MockPlace(listening_address(inventory, site, address), computers_of(inventory, [site]))


def mock(
    inventory: Inventory,
    vehicles: Sequence[str],
    place: MockPlace,
    seconds: float | None,
    watch: Callable[[Sequence[MockRobot]], None],
) -> list[MockRobot]:
    """Simulate these robots for the given time; `watch` is called before each round, at least ten times a second.

    Raises UsageError, and NoMatchError for a robot without a file.
    """
    sources, names = robots_of(inventory)
    dds = dds_of(inventory)
    types = MessageTypes(inventory.root / reading.FOLDER / INTERFACES)
    selected_sources = {each.vehicle: each for each in sources if not vehicles or each.vehicle in vehicles}
    for vehicle in vehicles:
        if vehicle not in selected_sources:
            raise without_file(vehicle)
    robots = [(each.robot, each.text()) for each in selected_sources.values() if each.robot]
    participants = max(len(robots) + _LISTENERS, dds.participants)
    with domain(dds.domain, profile(place.address, place.peers, participants)) as number:
        mocks = [
            MockRobot(robot, text, *_POSITION, types, Publisher(number, types), names.configuration_topic)
            for robot, text in robots
        ]
        _publish(mocks, seconds, lambda: watch(mocks))
    return mocks


def replay(  # noqa: PLR0913 - what a person types
    inventory: Inventory,
    bag: str,
    place: MockPlace,
    seconds: float | None,
    tell: Callable[[Bag, BagPlayer], None],
    *,
    loop: bool,
) -> None:
    """Publish a bag until it or the time ends; `tell` gets its contents at the start. Raise UsageError."""
    dds, (names, findings) = dds_of(inventory), reading.key_names(inventory)
    if findings:
        raise InventoryInvalid(findings, reading.NO_ROBOT_CONTACTED)
    types = MessageTypes(inventory.root / reading.FOLDER / INTERFACES)
    with domain(dds.domain, profile(place.address, place.peers, max(_LISTENERS, dds.participants))) as number:
        contents = read_bag(Path(bag), types, names)
        player = BagPlayer(contents, types, number, names.configuration_topic, loop=loop)
        tell(contents, player)
        _publish([player], seconds)


def _publish(
    actors: Sequence[MockRobot | BagPlayer], seconds: float | None, watch: Callable[[], None] = lambda: None
) -> None:
    """Publish what is due until the time is over or nothing remains."""
    until = math.inf if seconds is None else time.monotonic() + seconds
    next_s = 0.0
    while time.monotonic() < until and next_s < math.inf:
        watch()
        next_s = min(each.step(time.monotonic()) for each in actors)
        time.sleep(min(0.1, max(0.0, next_s - time.monotonic())))
