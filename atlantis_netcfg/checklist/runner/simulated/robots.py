"""Robots of a rehearsal: what honest ones would be heard to publish by their files, until a fault changes it."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.checklist.probes import (
    Answer,
    RobotsHeardRequest,
    RobotsHeardResult,
    VpnMember,
    VpnMembersRequest,
    VpnMembersResult,
)
from atlantis_netcfg.checklist.probes.robot_files import RobotFiles
from atlantis_netcfg.robots.listener import CONFIGURATION_TYPE
from atlantis_netcfg.robots.mock import RATES_HZ
from atlantis_netcfg.robots.observation import HeardConfiguration, HeardWriter, Observation

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from atlantis_netcfg.declaration import Declaration

NOT_REHEARSED: Final = (
    "robots: no packet of DDS is carried; what is heard follows from their files, and so does who is in the VPN",
)
_SECONDS: Final = 20.0
_BYTES: Final = 100


@dataclass(slots=True)
class SimulatedRobots:
    """What is heard at each place, and who is in the VPN; robots by their vehicles."""

    here: Observation = field(default_factory=lambda: Observation(_SECONDS))
    centre: Observation = field(default_factory=lambda: Observation(_SECONDS))
    members: dict[str, VpnMember] = field(default_factory=dict)

    @classmethod
    def honest(cls, declaration: Declaration, site: str) -> SimulatedRobots:
        """Those that are tested at a site, each as its file says; none where there is no file."""
        files = RobotFiles.read(declaration, site)
        if files is None:
            return cls()
        here = honest_observation(files)
        members = {
            key: VpnMember(f"EXAMPLE-{key}", key, admitted=True, session=f"192.0.2.{number}:1194")
            for number, key in enumerate(files.sources, start=1)
        }
        return cls(here, deepcopy(here), members)

    def answer(self, question: RobotsHeardRequest | VpnMembersRequest) -> Answer:
        """Answer as the real site would."""
        if isinstance(question, VpnMembersRequest):
            return VpnMembersResult(None, "", tuple(self.members.values()))
        return RobotsHeardResult(None, "", self.centre if question.host else self.here)

    def change(self, vehicle: str, change: Callable[[Observation, str], None]) -> None:
        """Change what a robot publishes, at both places. Raises KeyError where there is no such robot."""
        if vehicle not in self.members:
            raise KeyError(vehicle)
        for observation in (self.here, self.centre):
            change(observation, vehicle)


def honest_observation(files: RobotFiles, seconds: float = _SECONDS) -> Observation:
    """What is heard of robots that do as their files say; a participant is called as its vehicle."""
    observation = Observation(seconds)
    for key, source in files.sources.items():
        robot = source.robot
        if robot is None or key not in files.tested:
            continue
        observation.participants[key] = f"the emulated {key}"
        configuration = _writer(key, files.names.configuration_topic, CONFIGURATION_TYPE, 1.0, seconds)
        observation.configurations.append(HeardConfiguration(configuration, source.text().encode()))
        observation.writers += [
            _writer(key, topic.name, topic.message_type, RATES_HZ[topic.kind], seconds) for topic in robot.topics()
        ]
    return observation


def _writer(key: str, topic: str, kind: str, rate_hz: float, seconds: float) -> HeardWriter:
    count = int(seconds * rate_hz)
    last_s = (count - 1) / rate_hz
    return HeardWriter(
        key, topic, kind, messages=count, octets=count * _BYTES, last_s=last_s, contents={b"1", b"2"}, stamp_age_s=0.0
    )


def of_robot(observation: Observation, vehicle: str, ending: str = "") -> Iterator[HeardWriter]:
    """The publishers of a robot, of the topics that end so."""
    rows = (row for row in observation.writers if row.participant == vehicle and row.topic.endswith(ending))
    yield from rows


def away(observation: Observation, vehicle: str) -> None:
    """Nothing of it is heard."""
    observation.participants.pop(vehicle, None)
    observation.writers = [row for row in observation.writers if row.participant != vehicle]
    observation.configurations = [row for row in observation.configurations if row.writer.participant != vehicle]


def without(ending: str) -> Callable[[Observation, str], None]:
    """Let a robot not publish a topic."""

    def change(observation: Observation, vehicle: str) -> None:
        gone = [*of_robot(observation, vehicle, ending)]
        observation.writers = [row for row in observation.writers if row not in gone]

    return change


def frozen(ending: str) -> Callable[[Observation, str], None]:
    """Let a topic say the same all the time."""

    def change(observation: Observation, vehicle: str) -> None:
        for row in of_robot(observation, vehicle, ending):
            row.contents = {b"1"}

    return change


def stale(ending: str) -> Callable[[Observation, str], None]:
    """Let the stamps of a topic be a minute old."""

    def change(observation: Observation, vehicle: str) -> None:
        for row in of_robot(observation, vehicle, ending):
            row.stamp_age_s = 60.0

    return change


def at_rate(ending: str, rate_hz: float) -> Callable[[Observation, str], None]:
    """Let a topic come at another rate."""

    def change(observation: Observation, vehicle: str) -> None:
        for row in of_robot(observation, vehicle, ending):
            row.last_s = (row.messages - 1) / rate_hz

    return change


def says(old: str, new: str) -> Callable[[Observation, str], None]:
    """Let a robot publish another configuration than that of its file."""

    def change(observation: Observation, vehicle: str) -> None:
        for row in observation.configurations:
            if row.writer.participant == vehicle:
                row.text = row.text.replace(old.encode(), new.encode())

    return change


def twice(observation: Observation, vehicle: str) -> None:
    """Let another participant have its namespace, which publishes nothing else."""
    _also(observation, vehicle, "other", {})


def stranger(observation: Observation, vehicle: str) -> None:
    """Let a robot like this one come under a name that nobody has declared."""
    _also(observation, vehicle, "stranger", {"namespace: ": "namespace: EXAMPLE_"})


def _also(observation: Observation, vehicle: str, key: str, words: dict[str, str]) -> None:
    row = next(each for each in observation.configurations if each.writer.participant == vehicle)
    text = row.text.decode()
    for old, new in words.items():
        text = text.replace(old, new)
    observation.participants[key] = f"the emulated {key}"
    writer = replace(row.writer, participant=key, contents=set(row.writer.contents))
    observation.configurations.append(HeardConfiguration(writer, text.encode()))
