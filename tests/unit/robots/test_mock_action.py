"""A mock robot's action beside definitions of the pilot's own, floods, and readers that do not keep up."""

import shutil
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any, cast

import pytest
import robot_cases

from atlantis_netcfg.inventory.model.robot import OfferedAction
from atlantis_netcfg.inventory.robots.key_names import KeyNames
from atlantis_netcfg.inventory.robots.reading import read_published
from atlantis_netcfg.robots.message_types import MessageTypes
from atlantis_netcfg.robots.mock import MockRobot
from atlantis_netcfg.robots.mock_action import MockAction

pytestmark = pytest.mark.skipif(find_spec("cyclonedds") is None, reason="PyPI has no cyclonedds for this machine")
INTERFACES = robot_cases.SHIPPED / "robots" / "interfaces"
KIND = "c4i_asset_msgs/action/ExecutePlan"


class Network:
    """Services with requests that wait, and what was sent, in place of a publisher."""

    def __init__(self, *, keeps_up: bool = True) -> None:
        self.waiting: dict[str, list[Any]] = {}
        self.sent: list[tuple[str, Any]] = []
        self.keeps_up = keeps_up

    def advertise(self, *_: object, **__: object) -> None:
        """Nobody listens."""

    def publish(self, topic: str, _kind: str, message: Any) -> None:  # noqa: ANN401 - a message
        self.send(topic, message)

    def send(self, topic: str, message: Any) -> bool:  # noqa: ANN401 - a message
        message.serialize()
        self.sent.append((topic.rpartition("/")[2], message))
        return self.keeps_up

    def service(self, name: str, _kind: str) -> "NetworkService":
        return NetworkService(self, name.rpartition("/")[2])


class NetworkService:
    def __init__(self, network: Network, name: str) -> None:
        self.network, self.name = network, name

    def requests(self) -> Iterator[Any]:
        yield from self.network.waiting.pop(self.name, [])

    def reply(self, _request: Any, message: Any) -> None:  # noqa: ANN401 - messages
        self.network.send(self.name, message)


def mock_action(network: Network, types: MessageTypes) -> MockAction:
    return MockAction(OfferedAction("/sparus/execute_plan", KIND, ()), cast("Any", network), types, None)


def run(network: Network, action: MockAction, goal: Any) -> list[tuple[str, Any]]:  # noqa: ANN401 - a message
    """Send a goal, ask for its result, and carry it out."""
    goal.goal_id.uuid = [7] * 16
    network.waiting["send_goal"] = network.waiting["get_result"] = [goal]
    for second in range(5):
        action.step(float(second), second * 1_000_000_000)
    return [(name, message) for name, message in network.sent if name in {"send_goal", "feedback", "get_result"}]


def test_site_specific_action_fields_are_filled(tmp_path: Path) -> None:
    folder = shutil.copytree(INTERFACES, tmp_path / "interfaces")
    package = folder / "c4i_asset_msgs"
    (package / "msg" / "Task.msg").write_text("string action\nuint8[] parameters\n")
    text = (
        "c4i_asset_msgs/Task[] tasks\n---\nc4i_asset_msgs/Task[] completed\n---\nfloat32 progress\nstring[] remaining\n"
    )
    (package / "action" / "ExecutePlan.action").write_text(text)
    network, types = Network(), MessageTypes(folder)
    action = mock_action(network, types)
    goal, task = types.empty(f"{KIND}_SendGoal_Request"), types.empty("c4i_asset_msgs/msg/Task")
    task.action, goal.goal.tasks = "dive", [task]
    (_, reply), *feedback, (_, result) = run(network, action, goal)
    assert reply.accepted
    assert [(message.feedback.progress, message.feedback.remaining) for _, message in feedback] == [(0.0, [])] * 2
    assert (result.status, [each.action for each in result.result.completed]) == (4, ["dive"])


def test_slow_feedback_reader_is_reported() -> None:
    network = Network(keeps_up=False)
    types = MessageTypes(INTERFACES)
    goal, step = types.empty(f"{KIND}_SendGoal_Request"), types.empty("c4i_asset_msgs/msg/Step")
    step.action, step.data, goal.goal.plan = "dive", "{}", [step]
    action = mock_action(network, types)
    run(network, action, goal)
    lost = "feedback was lost: one of its readers is too slow"
    assert list(action.notices) == ["goal accepted", lost, lost, "goal succeeded"]


def test_flood_of_unreadable_goals_is_counted_and_partly_reported() -> None:
    network = Network()
    action = mock_action(network, MessageTypes(INTERFACES))
    network.waiting["send_goal"] = [None] * 1000
    action.step(0.0, 0)
    assert (action.counts["unreadable"], len(action.notices)) == (1000, 20)


def test_conditional_command_is_accepted_every_other_minute() -> None:
    text = (robot_cases.SHIPPED / "robots" / "zarco.yml").read_text(encoding="utf-8")
    robot, _ = read_published(text.encode(), KeyNames())
    assert robot is not None
    network, types = Network(), MessageTypes(INTERFACES)
    mock = MockRobot(robot, text, 41.68, -8.83, types, cast("Any", network), "/atlantis/configuration")
    (hold,) = (action for action in mock.actions if action.name == "/zarco/hold")
    armed, accepted = [], []
    for number, now in enumerate((100.0, 161.0, 221.0)):
        mock.step(now)
        armed += [message.data for topic, message in network.sent if topic == "motors_armed"][-1:]
        goal = types.empty("c4i_asset_msgs/action/CommandPlain_SendGoal_Request")
        goal.goal_id.uuid = [number + 1] * 16
        network.waiting["send_goal"] = [goal]
        hold.step(now, 0)
        accepted += [message.accepted for topic, message in network.sent if topic == "send_goal"][-1:]
    assert armed == accepted == [False, True, False]
