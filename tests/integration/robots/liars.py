"""Mock robots of which each lies in one way, and a listener, on the loopback of a namespace: prints its findings."""

import json
import sys
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from atlantis_netcfg.declaration import load
from atlantis_netcfg.declaration.robots.key_names import KeyNames
from atlantis_netcfg.declaration.robots.reading import RobotSource, read_declared, read_published, robot_files
from atlantis_netcfg.robots import mock
from atlantis_netcfg.robots.message_types import MessageTypes
from atlantis_netcfg.robots.network import Publisher, RobotListener, domain, profile
from atlantis_netcfg.robots.observation import judge

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

    def _every(self, rate_hz: float, name: str, kind: str, now: float, make: Callable[[], Any]) -> None:
        short = name.rpartition("/")[2]
        if short in self.left_out:
            return
        other = self.types_of.get(short)

        def made() -> Any:  # noqa: ANN401 - a message
            return self.types.empty(other) if other else self.change(short, make())

        super()._every(self.rates.get(short, rate_hz), name, other or kind, now, made)


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
    unreadable = sum("configuration-unreadable" in {each.code for each in report.findings} for report in reports)
    sys.stdout.write(
        json.dumps({"robots": rows, "unreadable": unreadable, "text": "somebody-else" in json.dumps(rows)})
    )


if __name__ == "__main__":
    main(float(sys.argv[1]))
