"""The integration record of a robot: the tests of the report's 4.1.2 to 4.5.2, once for each robot.

Programs check what can be received; a person does and confirms the rest. Nothing is sent to a robot.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes import base
from atlantis_netcfg.checklist.probes.robot import (
    discovery_step,
    pose_of_the_library,
    topics_step,
    unreadable,
    vpn_step,
)
from atlantis_netcfg.checklist.report import ItemKind, Phase
from atlantis_netcfg.inventory.model import EvidenceKind
from atlantis_netcfg.inventory.model.robot import TopicKind

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from atlantis_netcfg.inventory.model.robot import RobotFile

_TOPICS: Mapping[TopicKind, tuple[str, str]] = {
    TopicKind.BOOLEAN: ("booleans", "Its booleans arrive as expected"),
    TopicKind.NUMBER: ("numbers", "Its numbers arrive as expected"),
    TopicKind.POSE: ("pose", "Its pose arrives as expected, and changes"),
    TopicKind.GPS: ("gps", "Its position arrives as expected, and changes"),
    TopicKind.IMAGE: ("images", "Its images arrive as expected"),
    TopicKind.POINT_CLOUD: ("point-clouds", "Its point clouds arrive as expected"),
}


def steps(cell: base.Cell) -> tuple[base.Step, ...]:
    """Return all steps of one robot, in the report's order."""
    if cell.robots is None or cell.vehicle is None:
        return ()
    is_good = cell.vehicle in cell.robots.sources
    every = (
        _robot_steps(cell, cell.robots.robot(cell.vehicle))
        if is_good
        else [replace(unreadable(cell), name="discovery")]
    )
    return tuple(replace(step, phase=Phase.INTEGRATION) for step in every)


def _robot_steps(cell: base.Cell, robot: RobotFile) -> Iterator[base.Step]:
    yield vpn_step("vpn", cell)
    yield discovery_step("discovery", cell)
    kinds = {topic.kind for topic in robot.topics()}
    for kind, (name, title) in _TOPICS.items():
        if kind in kinds:
            yield topics_step(name, title, cell, kind)
        elif kind is TopicKind.POSE:
            yield pose_of_the_library(name, Phase.INTEGRATION)
    if robot.video:
        yield _manual_step(
            "video",
            "Its video is shown at the control centre",
            "Open every video of the robot on an operator's screen.",
            "Each shows the live image of its camera: what moves in front of it also moves on the screen.",
        )
    yield from _BY_PEOPLE
    if any(True for _ in robot.every_command()):
        yield _manual_step(
            "commands",
            "Its commands are carried out",
            "Give each command of the robot once from an operator's screen, in a place where it may move.",
            "The robot does what the command says, and its result is shown. Note which commands were given.",
        )


def _manual_step(name: str, title: str, do: str, look_for: str) -> base.Step:
    return base.Step(
        name=name,
        title=title,
        kind=ItemKind.PERSON,
        phase=Phase.INTEGRATION,
        do=do,
        look_for=look_for,
        evidence=base.EvidenceRequest(EvidenceKind.TEXT),
    )


_BY_PEOPLE = (
    _manual_step(
        "ros1-bridge",
        "Its topics arrive over the bridge from ROS 1",
        "For a ROS 1 robot: start the bridge, and check its topics in ROS 2. For a ROS 2 robot: skip this item.",
        "The topics that the robot publishes in ROS 1 are seen in ROS 2. Note the bridge.",
    ),
    _manual_step(
        "bag-record",
        "A bag of its telemetry and configuration is recorded",
        "Record its topics and its configuration on the robot for a minute, while it moves.",
        "The bag holds messages of each topic. Note where it is, and how many messages it has.",
    ),
    _manual_step(
        "bag-replay",
        "The bag is replayed to the control centre",
        "Play the bag at the control centre, with the robot switched off.",
        "The robot is discovered from it, and its telemetry is shown. Note which bag was used.",
    ),
    _manual_step(
        "plan",
        "A mission plan is sent, and its execution is followed",
        "Send a plan from an operator's screen, in a place where the robot may move. This program sends none.",
        "Its steps are shown as they are carried out, and it ends. Note which plan.",
    ),
)
