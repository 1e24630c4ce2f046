"""A mock robot: publishes the topics of its file and answers goals, to test a control centre."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any, Final

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory.model.robot import TopicKind
from atlantis_netcfg.robots.actions import GoalRefusal
from atlantis_netcfg.robots.listener import CONFIGURATION_TYPE, stamp_of
from atlantis_netcfg.robots.mock_action import MockAction

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from atlantis_netcfg.inventory.model.robot import CommandCondition, PublishedTopic, RobotFile
    from atlantis_netcfg.robots.message_types import MessageTypes
    from atlantis_netcfg.robots.network import Publisher

RATES_HZ: Mapping[TopicKind, float] = {
    TopicKind.BOOLEAN: 2.0,
    TopicKind.NUMBER: 2.0,
    TopicKind.POSE: 2.0,
    TopicKind.GPS: 2.0,
    TopicKind.IMAGE: 4.0,
    TopicKind.POINT_CLOUD: 0.5,
}
"""Publishing rate of each kind of topic, within the guidelines of the report's section 3.3.3."""
_RADIUS_M: Final = 5.0
_ROUND_S: Final = 60.0
"""Seconds for one lap of the small circle that the robot sails."""
_METRES_A_DEGREE: Final = 111_320.0
_WIDTH, _HEIGHT = 80, 60
_CHANGE_S: Final = 60.0
"""Seconds after which a boolean used in a condition alternates between false and true."""


@dataclass(slots=True)
class MockRobot:
    """One robot; `step` sends whatever is due."""

    robot: RobotFile
    text: str
    """The configuration as the robot publishes it."""
    latitude: float
    longitude: float
    types: MessageTypes
    publisher: Publisher
    configuration_topic: str
    due: dict[str, float] = field(default_factory=dict)
    message_counts: dict[str, int] = field(default_factory=dict)
    actions: list[MockAction] = field(init=False)
    _changing: frozenset[str] = field(init=False)
    """Boolean topics used in a condition."""
    _began: float | None = field(default=None, init=False)
    _now: float = field(default=0.0, init=False)

    def __post_init__(self) -> None:
        """Offer the actions of the robot file. Raises UsageError if a type is unknown."""
        requirements = {
            self.robot.full_name(command.action): partial(self._require, command.condition)
            for _, _, command in self.robot.every_command()
        }
        conditions = [command.condition for _, _, command in self.robot.every_command()]
        self._changing = frozenset(self.robot.full_name(each.topic) for each in conditions if each is not None)
        self.actions = [
            MockAction(action, self.publisher, self.types, requirements.get(action.name))
            for action in self.robot.actions()
        ]

    def limits(self) -> Iterator[str]:
        """Yield what the mock cannot reproduce: the real program does it without a topic or an action."""
        if self.robot.mission_executor.action is None:
            yield msg(f"{arg(self.robot.name)} accepts no plans: its program receives them by a function")
        if self.robot.pose.topic is None:
            yield msg(f"{arg(self.robot.name)} publishes no pose: its program passes it to the library")

    def _require(self, condition: CommandCondition | None) -> None:
        topic = self.robot.full_name(condition.topic) if condition is not None else ""
        if condition is not None and condition.value != self._boolean(topic):
            value = str(condition.value).lower()
            raise GoalRefusal(msg(f"{arg(topic)} must be {arg(value)}, but is not"))

    def _boolean(self, topic: str) -> bool:
        """Return False; for a topic used by a condition alternate, so that its command can be accepted."""
        return topic in self._changing and int((self._now - (self._began or 0.0)) / _CHANGE_S) % 2 == 1

    def step(self, now: float) -> float:
        """Publish what is due at `now` (monotonic, seconds), answer requests, and return the next due time."""
        self._now, self._began = now, now if self._began is None else self._began
        for action in self.actions:
            action.step(now, time.time_ns())
        self._publish_if_due(1.0, self.configuration_topic, CONFIGURATION_TYPE, now, self._configuration)
        for topic in self.robot.topics():
            self._publish_if_due(
                RATES_HZ[topic.kind], topic.name, topic.message_type, now, partial(self._message, topic, now)
            )
        return min(self.due.values())

    def _publish_if_due(self, rate_hz: float, name: str, kind: str, now: float, make: Callable[[], Any]) -> None:
        if now < self.due.setdefault(name, now):
            return
        self.publisher.publish(name, kind, make())
        self.message_counts[name] = self.message_counts.get(name, 0) + 1
        self.due[name] += 1 / rate_hz

    def _configuration(self) -> Any:  # noqa: ANN401 - a message
        message = self.types.empty(CONFIGURATION_TYPE)
        message.data = self.text
        return message

    def _message(self, topic: PublishedTopic, now: float) -> Any:  # noqa: ANN401 - a message
        message = self.types.empty(topic.message_type)
        stamp = stamp_of(message)
        if stamp is not None:
            wall = time.time()
            stamp.sec, stamp.nanosec = int(wall), int(wall % 1 * 1e9)
        angle = 2 * math.pi * now / _ROUND_S
        east, north = _RADIUS_M * math.cos(angle), _RADIUS_M * math.sin(angle)
        pose = getattr(message, "pose", message)
        match topic.kind:
            case TopicKind.BOOLEAN:
                _set_if_present(message, "data", self._boolean(topic.name))
            case TopicKind.NUMBER:
                _set_if_present(message, "data", 12.0 + math.sin(angle))
            case TopicKind.POSE if hasattr(pose, "position"):
                pose.position.x, pose.position.y = east, north
                pose.orientation.z, pose.orientation.w = math.sin(angle / 2), math.cos(angle / 2)
            case TopicKind.GPS if hasattr(message, "latitude"):
                message.latitude = self.latitude + north / _METRES_A_DEGREE
                message.longitude = self.longitude + east / (_METRES_A_DEGREE * math.cos(math.radians(self.latitude)))
            case TopicKind.IMAGE if hasattr(message, "encoding"):
                message.width, message.height, message.step, message.encoding = _WIDTH, _HEIGHT, _WIDTH, "mono8"
                shade = int(128 + 127 * math.sin(angle))
                message.data = [shade] * (_WIDTH * _HEIGHT)
            case _:
                pass
        return message


def _set_if_present(message: Any, name: str, value: object) -> None:  # noqa: ANN401 - a message of the pilot's own type
    if hasattr(message, name):
        setattr(message, name, value)
