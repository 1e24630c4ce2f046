"""DDS types of ROS 2 messages: the standard ones, and those of `robots/interfaces/` of an inventory.

`pkg/msg/Name` is `pkg::msg::dds_::Name_` in DDS, the same from Foxy to Jazzy. The parts of an action
`pkg/action/Name` are `Name_Goal`, `Name_Result` and `Name_Feedback`; its messages are `Name_SendGoal_Request` and so
on. Requests and replies begin like those of rmw_cyclonedds: with the client and its request number.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory.loader import content, shown_path
from atlantis_netcfg.robots.listener import IdlTypes, dds_type_name

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from cyclonedds.idl import IdlStruct

INTERFACES = "interfaces"
"""Folder below `robots/` of an inventory: `<package>/msg/<Name>.msg` and `<package>/action/<Name>.action`."""
_ACTION_PARTS = ("Goal", "Result", "Feedback")
_REQUEST_ID = {"client": "uint64", "number": "int64"}
_GOAL_ID = {"goal_id": "unique_identifier_msgs/UUID"}
_ACTION_MESSAGES = {
    "SendGoal_Request": _REQUEST_ID | _GOAL_ID | {"goal": "{action}_Goal"},
    "SendGoal_Response": _REQUEST_ID | {"accepted": "bool", "stamp": "builtin_interfaces/Time"},
    "GetResult_Request": _REQUEST_ID | _GOAL_ID,
    "GetResult_Response": _REQUEST_ID | {"status": "int8", "result": "{action}_Result"},
    "FeedbackMessage": _GOAL_ID | {"feedback": "{action}_Feedback"},
}
"""Messages of an action, as rosidl composes them from its parts: the type of each field."""
_CANCEL_MESSAGES = {
    "action_msgs/srv/CancelGoal_Request": _REQUEST_ID | {"goal_info": "action_msgs/GoalInfo"},
    "action_msgs/srv/CancelGoal_Response": _REQUEST_ID
    | {"return_code": "int8", "goals_canceling": "action_msgs/GoalInfo[]"},
}
_NAMED_TYPE, _SEQUENCE = 2, 4
"""Field kinds of rosbags."""
_ZEROS: dict[str, Any] = {"bool": False, "float32": 0.0, "float64": 0.0, "string": "", "wstring": ""}


class MessageTypes:
    """All known message types by ROS name; DDS types are built on first use."""

    def __init__(self, folder: Path | None = None) -> None:
        """`folder` is `robots/interfaces` of an inventory. Raises UsageError if a file in it cannot be read."""
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # noqa: PLC0415 - it brings numpy

        self.store = get_typestore(Stores.ROS2_FOXY)
        """Type store for rosbags. File types are added as definitions only: creating their classes would use `exec`."""
        definitions: dict[str, Any] = self.store.fielddefs
        for name, fields in _CANCEL_MESSAGES.items():
            (definitions[name],) = get_types_from_msg(_text(fields), name).values()
        for path in sorted(folder.glob("*/*/*")) if folder is not None and folder.is_dir() else ():
            definitions.update(_read(path))
        self.fields = {name: fields for name, (_, fields) in definitions.items()}
        """Field definitions in the format of `listener.IdlTypes`, ready for JSON."""
        self._types = IdlTypes(self.fields)
        self._unchecked: dict[str, type[IdlStruct]] = {}

    def __contains__(self, name: str) -> bool:
        return name in self.fields

    def names(self) -> list[str]:
        """Return the names of all known types."""
        return sorted(self.fields)

    def idl(self, name: str) -> type[IdlStruct]:
        """Return the DDS type of a message. Raises UsageError if it, or a type it contains, is unknown."""
        try:
            result: type[IdlStruct] = self._types.idl(name)
        except LookupError as error:
            raise _unknown(str(error.args[0])) from None
        return result

    def unchecked_type(self, name: str) -> type[IdlStruct]:
        """Return a type of this name that accepts any message: cyclonedds silently drops those that are too short."""
        if name not in self._unchecked:
            from cyclonedds.idl import make_idl_struct, types  # noqa: PLC0415 - there is none for aarch64

            fields = {"octet": types.uint8}
            self._unchecked[name] = make_idl_struct(name.rpartition("/")[2], dds_type_name(name), fields)
        return self._unchecked[name]

    def empty(self, name: str) -> Any:  # noqa: ANN401 - a message of that type
        """Return a message of this type with zeros and empty strings."""
        values = {field: self._empty_of(node) for field, node in self._definition(name)}
        return self.idl(name)(**(values or {"structure_needs_at_least_one_member": 0}))

    def items(self, name: str, field: str) -> str | None:
        """Return the element type of a list field; None if the type has no such list field."""
        for each, (kind, of) in self._definition(name):
            if each == field and int(kind) == _SEQUENCE and int(of[0][0]) == _NAMED_TYPE:
                return str(of[0][1])
        return None

    def _definition(self, name: str) -> list[tuple[str, Any]]:
        if name not in self.fields:
            raise _unknown(name)
        fields: list[tuple[str, Any]] = self.fields[name]
        return fields

    def _empty_of(self, node: Any) -> Any:  # noqa: ANN401 - a value of a message
        kind, of = node
        match int(kind):
            case 1:
                return _ZEROS.get(of[0], 0)
            case 2:
                return self.empty(of)
            case 3:
                return [self._empty_of(of[0]) for _ in range(of[1])]
            case _:
                return []


def _unknown(name: str) -> UsageError:
    package, sort, short = name.split("/")
    file = f"{short.partition('_')[0]}.action" if sort == "action" else f"{short}.msg"
    hint = msg(f"put its file into robots/{arg(INTERFACES)}/{arg(package)}/{arg(sort)}/{arg(file)} of the inventory")
    return UsageError(f"the type {arg(name)} is unknown", hint=hint)


def _read(path: Path) -> dict[str, Any]:
    """Return the definitions of one file. Raises UsageError."""
    from rosbags.typesys import TypesysError, get_types_from_msg  # noqa: PLC0415 - as above

    package, sort = path.parts[-3], path.parts[-2]
    if (sort, path.suffix) not in {("msg", ".msg"), ("action", ".action")}:
        hint = msg(f"messages are {arg(package)}/msg/<Name>.msg, actions {arg(package)}/action/<Name>.action")
        raise UsageError(f"{arg(shown_path(path))} is neither a message nor an action", hint=hint)
    result: dict[str, Any] = {}
    try:
        for short, text in _parts(path, content(path).decode()).items():
            result.update(get_types_from_msg(text, f"{package}/{sort}/{short}"))
    except (OSError, ValueError, TypesysError) as error:
        reason = str(error).partition("\n")[0].rstrip(":")
        message = msg(f"{arg(shown_path(path))} cannot be read: {arg(reason)}")
        raise UsageError(message, hint="a line is a type and a name, like `float64 data`") from error
    return result


def _parts(path: Path, text: str) -> dict[str, str]:
    """Return message definitions by name; an action file has three parts."""
    if path.suffix == ".msg":
        return {path.stem: text}
    parts = re.split(r"(?m)^---\s*$", text)
    if len(parts) != len(_ACTION_PARTS):
        raise ValueError(msg(f"an action has three parts separated by `---`; this one has {arg(len(parts))}"))
    texts = {f"{path.stem}_{words}": part for part, words in zip(parts, _ACTION_PARTS, strict=True)}
    action = "/".join((*path.parts[-3:-1], path.stem))
    return texts | {f"{path.stem}_{words}": _text(fields, action) for words, fields in _ACTION_MESSAGES.items()}


def _text(fields: Mapping[str, str], action: str = "") -> str:
    return "\n".join(f"{kind.format(action=action)} {name}" for name, kind in fields.items())
