"""Mock robots of which each lies in one way, and a listener, on the loopback of a namespace.

It prints the findings about each, and what the items of its integration record come to.
"""

import json
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from cyclonedds.pub import DataWriter
from cyclonedds.topic import Topic

from atlantis_netcfg.checklist.probes import Answer, Cell, RobotsHeardResult, VpnMember, VpnMembersResult, integration
from atlantis_netcfg.checklist.probes.robot_files import RobotFiles
from atlantis_netcfg.inventory import load
from atlantis_netcfg.inventory.robots.key_names import KeyNames
from atlantis_netcfg.inventory.robots.reading import RobotSource, read_declared, read_published, robot_files
from atlantis_netcfg.robots import mock
from atlantis_netcfg.robots.message_types import MessageTypes
from atlantis_netcfg.robots.network import Publisher, RobotListener, domain, profile
from atlantis_netcfg.robots.observation import RobotObservation, judge

DOMAIN = 9
SHIPPED = Path(__file__).parents[3] / "inventory"
TYPES = MessageTypes(SHIPPED / "robots" / "interfaces")
TEXT = robot_files(load(SHIPPED))["sparus"].read_text()


class Liar(mock.MockRobot):
    """A robot with a rate, a message or a topic of its own."""

    rates: Mapping[str, float] = {}
    change: Callable[[str, Any], Any] = staticmethod(lambda _topic, message: message)
    types_of: Mapping[str, str] = {}
    left_out: frozenset[str] = frozenset()
    silent: frozenset[str] = frozenset()
    """Topics that are announced, and on which nothing comes."""

    def _publish_if_due(self, rate_hz: float, name: str, kind: str, now: float, make: Callable[[], Any]) -> None:
        short = name.rpartition("/")[2]
        if short in self.left_out:
            return
        if short in self.silent:
            self._announce(name, kind)
            return
        other = self.types_of.get(short)

        def made() -> Any:  # noqa: ANN401 - a message
            return self.types.empty(other) if other else self.change(short, make())

        super()._publish_if_due(self.rates.get(short, rate_hz), name, other or kind, now, made)

    def _announce(self, name: str, kind: str) -> None:
        writers = self.publisher._writers
        if name not in writers:
            participant = self.publisher._participant
            writers[name] = DataWriter(participant, Topic(participant, f"rt{name}", self.types.idl(kind)))


def frozen(topic: str, message: Any) -> Any:  # noqa: ANN401 - a message
    if topic == "pose":
        message.position.x = message.position.y = message.orientation.z = 0.0
        message.orientation.w = 1.0
    return message


def stale(topic: str, message: Any) -> Any:  # noqa: ANN401 - a message
    if topic == "fix":
        message.header.stamp.sec -= 60
    return message


def not_text(topic: str, message: Any) -> Any:  # noqa: ANN401 - a message
    if topic == "configuration":
        message.serialize = lambda **_: b"\x00\x01\x00\x00\x02\x00\x00\x00\xff\x00"
    return message


def stale_boolean(topic: str, message: Any) -> Any:  # noqa: ANN401 - a message
    if topic == "leak":
        message.stamp.sec -= 3600
    return message


LIES: Mapping[str, Mapping[str, Any]] = {
    "honest": {},
    "seldom": {"rates": {"configuration": 0.2}},
    "often": {"rates": {"depth": 20.0}},
    "missing_topic": {"left_out": frozenset({"leak"})},
    "wrong_type": {"types_of": {"depth": "std_msgs/msg/Float64"}},
    "frozen": {"change": staticmethod(frozen)},
    "stale": {"change": staticmethod(stale)},
    "wrong_token": {},
    "other_file": {},
    "stranger": {},
    "twice": {},
    "unreadable": {},
    "not_text": {"change": staticmethod(not_text)},
    "leaving": {},
    "away": {},
    "outside": {},
    "without_configuration": {"left_out": frozenset({"configuration"})},
    "pose_missing": {"left_out": frozenset({"pose"})},
    "boolean_silent": {"silent": frozenset({"leak"})},
    "boolean_stale": {"change": staticmethod(stale_boolean)},
    "image_type": {"types_of": {"image": "sensor_msgs/msg/CompressedImage"}},
    "image_seldom": {"rates": {"image": 1.0}},
    "pose_often": {"rates": {"pose": 12.0}},
}


def source(name: str, text: str) -> RobotSource:
    robot, error = read_published(text.encode(), KeyNames())
    assert robot is not None, error
    (shipped,) = [each for each in _declared() if each.vehicle == "sparus"]
    return replace(shipped, robot=robot, vehicle=name)


def _declared() -> list[RobotSource]:
    return read_declared(load(SHIPPED), KeyNames())


def robot(name: str, text: str) -> mock.MockRobot:
    found, error = read_published(text.encode(), KeyNames())
    assert found is not None, error
    made = type(name, (Liar,), dict(LIES[name]))
    liar: mock.MockRobot = made(
        found, text, 41.68, -8.83, TYPES, Publisher(DOMAIN, TYPES), KeyNames().configuration_topic
    )
    return liar


def items(observation: RobotObservation, declared: Sequence[RobotSource], name: str) -> dict[str, str]:
    """The probed items of a robot's integration record that do not pass; the VPN has a session of all but one."""
    shipped, sources = load(SHIPPED), {each.vehicle: each for each in declared if each.vehicle is not None}
    vehicles = dict.fromkeys(sources, shipped.vehicles["sparus"])
    files = RobotFiles(KeyNames(), sources, tuple(sources))
    cell = Cell(replace(shipped, vehicles=vehicles), "coastal", name, "integration", robots=files)
    answers: dict[str, Answer] = {
        "heard": RobotsHeardResult(None, "", observation),
        "members": VpnMembersResult(
            None,
            "",
            tuple(
                VpnMember(each, each, has_certificate=True, session="" if each == "outside" else "x")
                for each in sources
            ),
        ),
    }
    judged = {step.name: step.probe.judge(answers).verdict.value for step in integration.steps(cell) if step.probe}
    assert set(judged) == {"vpn", "discovery", "booleans", "numbers", "pose", "gps", "images"}
    return {step: verdict for step, verdict in judged.items() if verdict != "PASS"}


def main(seconds: float) -> None:
    texts = {name: TEXT.replace("namespace: sparus", f"namespace: {name}") for name in LIES}
    declared = [
        source(name, text) for name, text in texts.items() if name not in {"stranger", "unreadable", "not_text"}
    ]
    texts["wrong_token"] = texts["wrong_token"].replace("EXAMPLE-sparus-token", "somebody-else")
    texts["other_file"] = texts["other_file"].replace("label: Leak", "label: Water")
    with domain(DOMAIN, profile("127.0.0.1", [], 40)):
        listener = RobotListener(DOMAIN, TYPES, KeyNames().configuration_topic)
        robots = [robot(name, text) for name, text in texts.items() if name != "away"]
        robots.append(robot("twice", texts["twice"]))
        for each in robots:
            if each.robot.name == "unreadable":
                each.text = "namespace: 1unreadable\n"
        until = time.monotonic() + seconds

        def publish() -> None:
            while (left := until - time.monotonic()) > 0:
                if left < seconds / 2:
                    robots[:] = [each for each in robots if each.robot.name != "leaving"]
                for each in robots:
                    each.step(time.monotonic())
                time.sleep(0.01)

        thread = threading.Thread(target=publish)
        thread.start()
        observation = listener.listen(seconds)
        thread.join()
    reports = judge(observation, declared, [each.vehicle or "" for each in declared], KeyNames())
    rows = {
        report.namespace: [report.state.value, *sorted({finding.code for finding in report.findings})]
        for report in reports
    }
    record = {each.vehicle: items(observation, declared, each.vehicle) for each in declared if each.vehicle}
    unreadable = sum("configuration-unreadable" in {each.code for each in report.findings} for report in reports)
    text = "somebody-else" in json.dumps([rows, record])
    sys.stdout.write(json.dumps({"robots": rows, "record": record, "unreadable": unreadable, "text": text}))


if __name__ == "__main__":
    main(float(sys.argv[1]))
