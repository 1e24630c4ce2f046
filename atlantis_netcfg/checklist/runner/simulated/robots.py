"""Simulated robots of a rehearsal: they publish as in their files, until a fault changes it."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.checklist import probes
from atlantis_netcfg.checklist.probes.robot_files import RobotFiles
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.robots.listener import CONFIGURATION_TYPE
from atlantis_netcfg.robots.mock import RATES_HZ
from atlantis_netcfg.robots.observation import HeardConfiguration, HeardWriter, RobotObservation

if TYPE_CHECKING:
    from collections.abc import Callable

    from atlantis_netcfg.inventory import Inventory

    Change = Callable[[RobotObservation, str], None]

NOT_REHEARSED: Final = (
    "robots: no packet of DDS is carried; what is heard follows from their files, and so does who is in the VPN",
)
_SECONDS: Final = 20.0
_BYTES: Final = 100


@dataclass(slots=True)
class SimulatedRobots:
    """Observations at each place, and the VPN members; robots by vehicle."""

    here: RobotObservation = field(default_factory=lambda: RobotObservation(_SECONDS))
    centre: RobotObservation = field(default_factory=lambda: RobotObservation(_SECONDS))
    members: dict[str, probes.VpnMember] = field(default_factory=dict)

    @classmethod
    def honest(cls, inventory: Inventory, site: str) -> SimulatedRobots:
        """Simulate the robots tested at a site, each as in its file; none if there are no files."""
        files = RobotFiles.read(inventory, site)
        if files is None:
            return cls()
        here = honest_observation(files)
        members = {
            key: probes.VpnMember(f"EXAMPLE-{key}", key, has_certificate=True, session=f"192.0.2.{number}:1194")
            for number, key in enumerate(files.sources, start=1)
        }
        return cls(here, deepcopy(here), members)

    def answer(self, question: probes.RobotsHeardRequest | probes.VpnMembersRequest) -> probes.Answer:
        """Return the result that the real site would give."""
        if isinstance(question, probes.VpnMembersRequest):
            return probes.VpnMembersResult(None, "", tuple(self.members.values()))
        return probes.RobotsHeardResult(None, "", self.centre if question.host else self.here)

    def change(self, vehicle: str, change: Change) -> None:
        """Change what a robot publishes, at both places. Raises KeyError where there is no such robot."""
        if vehicle not in self.members:
            raise KeyError(vehicle)
        for observation in (self.here, self.centre):
            change(observation, vehicle)


def honest_observation(files: RobotFiles, seconds: float = _SECONDS) -> RobotObservation:
    """Return the observation of robots that publish as in their files; participants are named by vehicle."""
    observation = RobotObservation(seconds)
    for key in files.tested_vehicles:
        if key not in files.sources:
            continue
        observation.participants[key] = msg(f"the emulated {arg(key)}")
        configuration = _writer(key, files.names.configuration_topic, CONFIGURATION_TYPE, 1.0, seconds)
        observation.configurations.append(HeardConfiguration(configuration, files.sources[key].text().encode()))
        observation.writers += [
            _writer(key, topic.name, topic.message_type, RATES_HZ[topic.kind], seconds)
            for topic in files.robot(key).topics()
        ]
    return observation


def _writer(key: str, topic: str, kind: str, rate_hz: float, seconds: float) -> HeardWriter:
    count = int(seconds * rate_hz)
    last_s = (count - 1) / rate_hz
    return HeardWriter(
        key, topic, kind, messages=count, octets=count * _BYTES, last_s=last_s, contents={b"1", b"2"}, stamp_age_s=0.0
    )


def remove_robot(observation: RobotObservation, vehicle: str) -> None:
    """Remove all data of a robot."""
    observation.participants.pop(vehicle, None)
    observation.writers = [row for row in observation.writers if row.participant != vehicle]
    observation.configurations = [row for row in observation.configurations if row.writer.participant != vehicle]


def remove_topic(ending: str) -> Change:
    """Remove a robot's topic with this ending."""

    def change(observation: RobotObservation, vehicle: str) -> None:
        rows = observation.writers
        observation.writers = [row for row in rows if row.participant != vehicle or not row.topic.endswith(ending)]

    return change


def topic(ending: str, change: Callable[[HeardWriter], None]) -> Change:
    """Change a robot's topic with this ending."""

    def change_all(observation: RobotObservation, vehicle: str) -> None:
        for row in observation.writers:
            if row.participant == vehicle and row.topic.endswith(ending):
                change(row)

    return change_all


def says(old: str, new: str) -> Change:
    """Make a robot publish a configuration that differs from its file."""

    def change(observation: RobotObservation, vehicle: str) -> None:
        for row in observation.configurations:
            if row.writer.participant == vehicle:
                row.text = row.text.replace(old.encode(), new.encode())

    return change


def another(namespace: str = "") -> Change:
    """Add another participant with the same file; `namespace`: prefix of its name."""

    def change(observation: RobotObservation, vehicle: str) -> None:
        row = next(each for each in observation.configurations if each.writer.participant == vehicle)
        text = row.text.replace(b"namespace: ", f"namespace: {namespace}".encode())
        observation.participants["another"] = "another emulated robot"
        observation.configurations.append(HeardConfiguration(replace(row.writer, participant="another"), text))

    return change
