"""Messages of ROS in DDS: what cyclonedds writes, rosbags reads, which knows ROS' own definitions."""

import shutil
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
import robot_cases
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.inventory.model.robot import TopicKind
from atlantis_netcfg.robots.listener import dds_type_name, ros_type_name, topic_name
from atlantis_netcfg.robots.message_types import MessageTypes

INTERFACES = robot_cases.SHIPPED / "robots" / "interfaces"
needs_cyclone = pytest.mark.skipif(find_spec("cyclonedds") is None, reason="PyPI has no cyclonedds for this machine")


@needs_cyclone
@pytest.mark.parametrize("kind", TopicKind)
def test_serialized_messages_are_readable_by_ros(kind: TopicKind) -> None:
    types, judge = MessageTypes(INTERFACES), get_typestore(Stores.ROS2_FOXY)
    for path in INTERFACES.glob("*/msg/*.msg"):
        judge.register(get_types_from_msg(path.read_text(), f"{path.parts[-3]}/msg/{path.stem}"))
    message = types.empty(kind.message_type)
    if hasattr(message, "header"):
        message.header.frame_id, message.header.stamp.sec = "map", 1_700_000_000
    if kind is TopicKind.IMAGE:
        message.data, message.encoding, message.width = [1, 2, 3], "mono8", 3
    if kind is TopicKind.GPS:
        message.latitude, message.position_covariance = 41.68, [float(number) for number in range(9)]
    if kind is TopicKind.NUMBER:
        message.data = 12.5
    read: Any = judge.deserialize_cdr(message.serialize(), kind.message_type)
    if hasattr(message, "header"):
        assert (read.header.frame_id, read.header.stamp.sec) == ("map", 1_700_000_000)
    if kind is TopicKind.IMAGE:
        assert (read.data.tolist(), read.encoding, read.width) == ([1, 2, 3], "mono8", 3)
    if kind is TopicKind.GPS:
        assert (read.latitude, read.position_covariance.tolist()) == (41.68, list(range(9)))
    if kind is TopicKind.NUMBER:
        assert read.data == 12.5
    assert bytes(judge.serialize_cdr(read, kind.message_type)) == message.serialize()


@needs_cyclone
def test_every_part_of_the_report_s_actions_has_a_type() -> None:
    types = MessageTypes(INTERFACES)
    actions = ("CommandBool", "CommandNumeric", "CommandPath", "CommandPlain", "CommandWaypoint", "ExecutePlan")
    parts = ("Goal", "Result", "Feedback", "FeedbackMessage")
    sent = [f"{service}_{part}" for service in ("SendGoal", "GetResult") for part in ("Request", "Response")]
    names = [f"c4i_asset_msgs/action/{name}_{part}" for name in actions for part in (*parts, *sent)]
    names += ["action_msgs/srv/CancelGoal_Request", "action_msgs/srv/CancelGoal_Response"]
    assert set(names) <= set(types.names())
    assert [types.idl(name).__idl_typename__ for name in names] == [dds_type_name(name) for name in names]


def test_type_and_topic_names_convert_both_ways() -> None:
    assert dds_type_name("std_msgs/msg/String") == "std_msgs::msg::dds_::String_"
    assert ros_type_name("std_msgs::msg::dds_::String_") == "std_msgs/msg/String"
    assert ros_type_name("HelloWorld") is None
    assert [
        topic_name(name)
        for name in ("rt/sparus/pose", "rt/sparus/go_to/_action/status", "rq/sparus/goRequest", "other")
    ] == [
        "/sparus/pose",
        None,
        None,
        None,
    ]


@pytest.mark.parametrize(
    ("file", "text", "words"),
    [
        ("msg/Odd.msg", "float64\n", "Odd.msg cannot be read"),
        ("action/Odd.action", "bool value\n---\nint32 status\n", "three parts separated by `---`; this one has 2"),
        ("srv/Odd.srv", "bool value\n---\n", "neither a message nor an action"),
        ("msg/Odd.txt", "bool value\n", "neither a message nor an action"),
    ],
)
def test_invalid_definition_is_refused(file: str, text: str, words: str, tmp_path: Path) -> None:
    folder = shutil.copytree(INTERFACES, tmp_path / "interfaces")
    odd = folder / "odd_msgs" / file
    odd.parent.mkdir(parents=True)
    odd.write_text(text)
    with pytest.raises(UsageError, match=words):
        MessageTypes(folder)


def test_undefined_type_is_refused_with_the_file_to_add() -> None:
    for name, file in (
        ("msg/Nothing", "msg/Nothing.msg"),
        ("action/Nothing_SendGoal_Request", "action/Nothing.action"),
    ):
        with pytest.raises(UsageError, match=f"the type c4i_asset_msgs/{name} is unknown") as refusal:
            MessageTypes(INTERFACES).empty(f"c4i_asset_msgs/{name}")
        assert refusal.value.hint == f"put its file into robots/interfaces/c4i_asset_msgs/{file} of the inventory"
