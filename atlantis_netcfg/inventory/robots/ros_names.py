"""Names of ROS 2 topics and actions, and their mapping to DDS topic names."""

from __future__ import annotations

import re

from atlantis_netcfg.core.messages import arg, msg

_LONGEST = 200
"""Maximum length. DDS allows 255; an action's five topics add up to 30 (`rr/…/_action/cancel_goalReply`)."""


def why_no_name(text: str) -> tuple[str, str] | None:
    """Return why ROS 2 rejects a topic or namespace name, and what to type instead; None if it is valid.

    Rules: design.ros2.org, topic and service names.
    """
    like = "examples of a name: /sparus/pose, or pose for one in the robot's namespace"
    if len(text) > _LONGEST:
        return msg(f"this name has {arg(len(text))} characters: the maximum is {arg(_LONGEST)}"), "choose a shorter one"
    if text.startswith("~"):
        return msg(f"`{arg(text)}` depends on a node name, which is unknown outside the robot"), like
    if odd := re.search(r"[^A-Za-z0-9_/]", text):
        near = re.sub(r"/{2,}", "/", re.sub(r"[^A-Za-z0-9_/]+", "_", text))
        return msg(f"`{arg(text)}` is not a ROS name: `{arg(odd[0])}` is not a letter, digit, `_` or `/`"), near
    parts = text.removeprefix("/").split("/")
    why, near = "", like
    if "" in parts:
        why, near = "a part between two `/` is empty", re.sub(r"/{2,}", "/", text).rstrip("/") or like
    elif "__" in text:
        why, near = "there are two `_` in a row", re.sub("_{2,}", "_", text)
    elif digit := next((part for part in parts if part[0].isdigit()), ""):
        why = msg(f"`{arg(digit)}` starts with a digit")
    return (msg(f"`{arg(text)}` is not a ROS name: {arg(why)}"), near) if why else None


def resolve(name: str, namespace: str) -> str:
    """Return a topic's full name: `pose` of `sparus` is /sparus/pose; a name that begins with `/` is full already."""
    return name if name.startswith("/") else f"/{namespace.strip('/')}/{name}"


def why_no_type(text: str) -> tuple[str, str] | None:
    """Return why a text is no ROS 2 message type, and what to type instead; None if it is one."""
    if re.fullmatch(r"[a-z][a-z0-9_]*/msg/[A-Z][A-Za-z0-9]*", text):
        return None
    short = re.fullmatch(r"([a-z][a-z0-9_]*)/([A-Z][A-Za-z0-9]*)", text)
    near = f"{short[1]}/msg/{short[2]}" if short else "example of a type: geometry_msgs/msg/PoseStamped"
    return msg(f"`{arg(text)}` is not a ROS 2 message type"), near
