"""The configuration file of a robot: our reading of the report's section 3.3.1, with the types of its section 3.3.3."""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Literal
from urllib.parse import urlsplit

from pydantic import BeforeValidator, StrictBool

from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.inventory import model
from atlantis_netcfg.inventory.model import _base
from atlantis_netcfg.inventory.robots import ros_names

if TYPE_CHECKING:
    from collections.abc import Iterator

_SCHEMES = ("rtsp", "http", "https", "udp")


def _ros_name(value: object) -> str:
    text = _base.plain(value)
    if why := ros_names.why_no_name(text):
        raise _base.wrong(*why)
    return text


def _ros_type(value: object) -> str:
    text = _base.plain(value)
    if why := ros_names.why_no_type(text):
        raise _base.wrong(*why)
    return text


def _video_link(value: object) -> str:
    text = _base.plain(value)
    like = "example of a link: rtsp://10.64.1.23:8554/bow"
    try:
        parts = urlsplit(text)
        _ = parts.port  # raises ValueError where it is no number
    except ValueError:
        raise _base.wrong("this is not a link to a video stream", like) from None
    if parts.scheme not in _SCHEMES:
        raise _base.wrong(msg(f"the link to a video stream starts with one of {arg(join(', ', _SCHEMES))}"), like)
    if not parts.hostname or re.search(r"\s", text):
        raise _base.wrong("this link names no computer", like)
    if parts.password is not None:
        raise _base.wrong(
            "a password in a link is shown to every operator",
            "configure the camera without a password, or use a separate link",
        )
    return text


_NAME_PATTERN = "^/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*$"
RosName = Annotated[str, BeforeValidator(_ros_name), _base.text_like(_NAME_PATTERN, maxLength=200)]
RosType = Annotated[str, BeforeValidator(_ros_type), _base.text_like("^[a-z][a-z0-9_]*/msg/[A-Z][A-Za-z0-9]*$")]
VideoLink = Annotated[str, BeforeValidator(_video_link), _base.text_like(f"^({'|'.join(_SCHEMES)})://")]


class TopicKind(StrEnum):
    """What a topic carries, by the keys of `telemetry:`."""

    BOOLEAN = "booleans"
    NUMBER = "numbers"
    IMAGE = "images"
    POSE = "poses"
    GPS = "gps"
    POINT_CLOUD = "point_clouds"

    @property
    def message_type(self) -> str:
        """Message type in the report (3.3.3); the package `c4i-asset-msgs` is not public, the others are standard."""
        return _TYPES[self]

    @property
    def moves(self) -> bool:
        """Whether the value changes even at rest, because of movement on the water."""
        return self in {TopicKind.POSE, TopicKind.GPS}

    @property
    def data(self) -> model.TelemetryData:
        """Rate guideline for topics of this kind."""
        return _DATA.get(self, model.TelemetryData.NUMBERS)


_TYPES = {
    TopicKind.BOOLEAN: "c4i_asset_msgs/msg/BoolTimestamped",
    TopicKind.NUMBER: "c4i_asset_msgs/msg/FloatTimestamped",
    TopicKind.IMAGE: "sensor_msgs/msg/Image",
    TopicKind.POSE: "geometry_msgs/msg/Pose",
    TopicKind.GPS: "sensor_msgs/msg/NavSatFix",
    TopicKind.POINT_CLOUD: "sensor_msgs/msg/PointCloud",
}
_DATA = {TopicKind.IMAGE: model.TelemetryData.IMAGES, TopicKind.POINT_CLOUD: model.TelemetryData.POINT_CLOUDS}


class Topic(model.Model):
    """A topic that the robot publishes."""

    topic: RosName
    """Its name: relative to the namespace, or full with a `/` before it."""
    label: model.Text | None = None
    """What operators see; null: the topic's name."""
    type: RosType | None = None
    """Of its messages, where it is not the report's."""


class NumberTopic(Topic):
    """A number that the robot publishes."""

    unit: model.Text | None = None
    """Of the number, as operators see it."""


class Pose(model.Model):
    """Where the robot's position and orientation come from: one of the two."""

    topic: RosName | None = None
    """A topic of `geometry_msgs/msg/Pose`."""
    library: StrictBool = False
    """The robot's program calls the library with it."""


class MissionExecutor(model.Model):
    """Who carries out a plan: one of the two."""

    action: RosName | None = None
    """A ROS action that takes `ExecutePlan`."""
    callback: StrictBool = False
    """A function that the robot's program registers at the library."""


class Telemetry(model.Model):
    """The topics that the control centre shows, by what they carry."""

    booleans: tuple[Topic, ...] = ()
    """Yes or no, of `BoolTimestamped`."""
    numbers: tuple[NumberTopic, ...] = ()
    """Of `FloatTimestamped`."""
    images: tuple[Topic, ...] = ()
    """Of `sensor_msgs/msg/Image`, in low resolution."""
    poses: tuple[Topic, ...] = ()
    """Of `geometry_msgs/msg/Pose`, besides that of `pose:`."""
    gps: tuple[Topic, ...] = ()
    """Positions, of `sensor_msgs/msg/NavSatFix`."""
    point_clouds: tuple[Topic, ...] = ()
    """Of `sensor_msgs/msg/PointCloud`."""


class VideoStream(model.Model):
    """A video that operators can open."""

    label: model.Text
    """What operators see."""
    url: VideoLink
    """rtsp, http, https or udp; without a password."""


class CommandCondition(model.Model):
    """When an operator may give a command."""

    topic: RosName
    """One of `telemetry.booleans`."""
    value: StrictBool = True
    """What it must have said last."""


class RobotCommand(model.Model):
    """An action of the robot that an operator may ask for."""

    action: RosName
    """The ROS action: its name relative to the namespace, or full with a `/` before it."""
    label: model.Text
    """What operators see."""
    condition: CommandCondition | None = None
    """Null: it may be given at any time."""


class CommandKind(StrEnum):
    """Commands by what they carry: the union of the report's sections 3.3 and 3.3.1."""

    PLAIN = "plain"
    WAYPOINT = "waypoint"
    PATH = "path"
    TIME = "time"
    SWITCH = "switch"
    NUMERIC = "numeric"

    @property
    def action_type(self) -> str:
        """Action type in the report (3.3.4); it names none for `time`, so that of a number (seconds) is inferred."""
        return f"c4i_asset_msgs/action/{_ACTIONS[self]}"


_ACTIONS = {
    CommandKind.PLAIN: "CommandPlain",
    CommandKind.WAYPOINT: "CommandWaypoint",
    CommandKind.PATH: "CommandPath",
    CommandKind.TIME: "CommandNumeric",
    CommandKind.SWITCH: "CommandBool",
    CommandKind.NUMERIC: "CommandNumeric",
}


class RobotCommands(model.Model):
    """What operators may ask of the robot, by what is sent with it."""

    plain: tuple[RobotCommand, ...] = ()
    """Nothing but the command."""
    waypoint: tuple[RobotCommand, ...] = ()
    """A point."""
    path: tuple[RobotCommand, ...] = ()
    """Several points."""
    time: tuple[RobotCommand, ...] = ()
    """A period."""
    switch: tuple[RobotCommand, ...] = ()
    """On or off."""
    numeric: tuple[RobotCommand, ...] = ()
    """A number."""


@dataclass(frozen=True, slots=True)
class PublishedTopic:
    """A topic of a robot by its full name."""

    name: str
    kind: TopicKind
    message_type: str
    path: tuple[str | int, ...]
    """Where it stands in the file."""


@dataclass(frozen=True, slots=True)
class OfferedAction:
    """An action of a robot by its full name."""

    name: str
    action_type: str
    path: tuple[str | int, ...]
    """Where it stands in the file."""


class RobotFile(model.Model):
    """A robot as it introduces itself to the control centre."""

    version: Literal[1] = 1
    """Of this form of the file."""
    namespace: RosName
    """Unique in the pilot; operators see it as the robot's name."""
    token: model.SecretText
    """Proves to the control centre that it is this robot."""
    pose: Pose
    """Where its position and orientation come from."""
    mission_executor: MissionExecutor
    """Who carries out its plans."""
    telemetry: Telemetry = Telemetry()
    """The topics that operators see."""
    video: tuple[VideoStream, ...] = ()
    """Links, in the order in which operators see them."""
    commands: RobotCommands = RobotCommands()
    """What operators may ask of it."""

    @property
    def name(self) -> str:
        """Namespace without leading and trailing slashes, used to compare robots."""
        return self.namespace.strip("/")

    def topics(self) -> Iterator[PublishedTopic]:
        """Yield every published topic, that of the pose first."""
        if self.pose.topic is not None:
            yield PublishedTopic(
                self.full_name(self.pose.topic), TopicKind.POSE, TopicKind.POSE.message_type, ("pose", "topic")
            )
        for kind in TopicKind:
            for index, topic in enumerate(getattr(self.telemetry, kind.value)):
                path = ("telemetry", kind.value, index, "topic")
                yield PublishedTopic(self.full_name(topic.topic), kind, topic.type or kind.message_type, path)

    def actions(self) -> Iterator[OfferedAction]:
        """Yield every offered action, that of the mission executor first."""
        if self.mission_executor.action is not None:
            path: tuple[str | int, ...] = ("mission_executor", "action")
            yield OfferedAction(self.full_name(self.mission_executor.action), "c4i_asset_msgs/action/ExecutePlan", path)
        for kind, index, command in self.every_command():
            yield OfferedAction(
                self.full_name(command.action), kind.action_type, ("commands", kind.value, index, "action")
            )

    def every_command(self) -> Iterator[tuple[CommandKind, int, RobotCommand]]:
        """Yield kind, index in its list, and command."""
        for kind in CommandKind:
            for index, command in enumerate(getattr(self.commands, kind.value)):
                yield kind, index, command

    def full_name(self, name: str) -> str:
        """Return the full name of a topic or action of this robot."""
        return ros_names.resolve(name, self.namespace)
