"""Types of ROS 2 messages as DDS has them: ROS' own, and those of `robots/interfaces/` of an inventory.

`pkg/msg/Name` is `pkg::msg::dds_::Name_` in DDS, the same from Foxy to Jazzy. Of an action `pkg/action/Name` the parts
are known as `Name_Goal`, `Name_Result` and `Name_Feedback`.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.declaration.loading import content, shown_path
from atlantis_netcfg.robots.listener import IdlTypes

if TYPE_CHECKING:
    from pathlib import Path

    from cyclonedds.idl import IdlStruct

INTERFACES = "interfaces"
"""Below `robots/` of an inventory: `<package>/msg/<Name>.msg` and `<package>/action/<Name>.action`."""
_ACTION_PARTS = ("Goal", "Result", "Feedback")
_ZEROS: dict[str, Any] = {"bool": False, "float32": 0.0, "float64": 0.0, "string": "", "wstring": ""}


class MessageTypes:
    """Every known type of a message, by its name in ROS; types for DDS are made when they are asked for."""

    def __init__(self, folder: Path | None = None) -> None:
        """`folder` is `robots/interfaces` of an inventory. Raises UsageError for a file of it that cannot be read."""
        from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415 - it brings numpy

        definitions: dict[str, Any] = dict(get_typestore(Stores.ROS2_FOXY).fielddefs)
        for path in sorted(folder.glob("*/*/*")) if folder is not None and folder.is_dir() else ():
            definitions.update(_read(path))
        self.fields = {name: fields for name, (_, fields) in definitions.items()}
        """As `listener.IdlTypes` takes them, ready for JSON."""
        self._types = IdlTypes(self.fields)

    def __contains__(self, name: str) -> bool:
        return name in self.fields

    def names(self) -> list[str]:
        """Every known type."""
        return sorted(self.fields)

    def idl(self, name: str) -> type[IdlStruct]:
        """The type of a message for DDS. Raises UsageError where it, or one that it holds, is not known."""
        try:
            made: type[IdlStruct] = self._types.idl(name)
        except LookupError as error:
            raise _unknown(str(error.args[0])) from None
        return made

    def empty(self, name: str) -> Any:  # noqa: ANN401 - a message of that type
        """A message with zeros and empty texts."""
        values = {field: self._empty_of(node) for field, node in self._definition(name)}
        return self.idl(name)(**(values or {"structure_needs_at_least_one_member": 0}))

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
    hint = f"put its file into robots/{INTERFACES}/{name}.msg of the inventory"
    return UsageError(f"the type {name} is not known", hint=hint)


def _read(path: Path) -> dict[str, Any]:
    """What one file defines. Raises UsageError."""
    from rosbags.typesys import TypesysError, get_types_from_msg  # noqa: PLC0415 - as above

    package, sort = path.parts[-3], path.parts[-2]
    if (sort, path.suffix) not in {("msg", ".msg"), ("action", ".action")}:
        hint = f"messages are {package}/msg/<Name>.msg, actions {package}/action/<Name>.action"
        raise UsageError(f"{shown_path(path)} is neither a message nor an action", hint=hint)
    made: dict[str, Any] = {}
    try:
        for short, text in _parts(path, content(path).decode()).items():
            made.update(get_types_from_msg(text, f"{package}/{sort}/{short}"))
    except (OSError, ValueError, TypesysError) as error:
        reason = str(error).partition("\n")[0].rstrip(":")
        message = f"{shown_path(path)} cannot be read: {reason}"
        raise UsageError(message, hint="a line is a type and a name, like `float64 data`") from error
    return made


def _parts(path: Path, text: str) -> dict[str, str]:
    """The text of a message by its name; of an action those of its three parts."""
    if path.suffix == ".msg":
        return {path.stem: text}
    parts = re.split(r"(?m)^---\s*$", text)
    if len(parts) != len(_ACTION_PARTS):
        raise ValueError(f"an action has three parts with `---` between them, this one has {len(parts)}")
    return {f"{path.stem}_{words}": part for part, words in zip(parts, _ACTION_PARTS, strict=True)}
