"""Model of a menu, built from the engine's schema (routeros/menus).

Names, shapes and defaults are only in the schema, which is checked against the published command trees. The model adds
the device's behaviour: accepted values, computed values, and errors.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Any, Final

from atlantis_netcfg.emulator.routeros import values
from atlantis_netcfg.emulator.routeros.menus._references import reference, references
from atlantis_netcfg.routeros import menus as schema

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping


class Shape(StrEnum):
    """Kinds of menus, distinguished by their commands."""

    LIST = "list"
    """Rows that can be added."""
    FIXED_ROWS = "fixed"
    """Existing rows that can only be set."""
    SETTINGS = "settings"
    """One row without an id."""


class Select(StrEnum):
    """How an export refers to a row that cannot be added."""

    DEFAULT_NAME = "default-name"
    """`set [ find default-name=ether1 ]`"""
    DEFAULT = "default"
    """`set [ find default=yes ]`"""
    NAME = "name"
    """`set telnet`"""
    FIND_NAME = "find-name"
    """`set [ find name=all ]`"""
    INDEX = "index"
    """`set 0`"""


@dataclass(frozen=True, slots=True)
class Arg:
    """One argument of a menu."""

    name: str
    kind: values.ValueType
    default: str | None = None
    """Value of rows that do not set it; None: the property is then absent, and can be unset."""
    is_required: bool = False
    secret: bool = False
    """Hidden by `export`, and by `print` for groups without policy `sensitive`."""
    never: bool = False
    """Write-only: no command prints it."""
    always: bool = False
    """Also exported if equal to the default, as RouterOS does for a few (`action=accept`, `type=A`)."""
    is_exported: bool = True
    shown_if: tuple[str, str] | None = None
    """The argument belongs to the row only while another argument has this value (`|` separates several)."""


@dataclass(frozen=True, slots=True)
class Unique:
    """Arguments that must be unique in combination; rows without one of them are ignored."""

    arguments: tuple[str, ...]
    words: str
    enabled_only: bool = False
    """Only enabled rows are compared."""


@dataclass(frozen=True, slots=True)
class EmulatedMenu:
    """A menu: contents of its rows, their identity, and its factory rows."""

    path: str
    shape: Shape
    args: tuple[Arg, ...]
    noun: str
    """Name of a row in `/system/history`."""
    space: str = ""
    """Name space in which other menus refer to its rows."""
    name_property: str = "name"
    """The argument that may identify a row instead of its id."""
    unique: tuple[Unique, ...] = ()
    factory: tuple[dict[str, str], ...] = ()
    """Rows of a factory-new router, which cannot be removed."""
    factory_dynamic: bool = False
    """The factory rows are dynamic, so they cannot be set either."""
    flags: tuple[str, ...] = ()
    """Boolean properties that the router computes and always prints."""
    builtin_flag: str = ""
    """Flag that marks factory rows (`builtin`, `default`)."""
    select: Select = Select.INDEX
    first_id: int = 1
    feature: str = ""
    """Feature of `/system/device-mode` that the menu requires; empty: none."""
    is_exported: bool = True
    sparse: bool = False
    """Exports print all given values, even defaults, as the menus of the routing process do."""
    of_the_board: bool = False
    """Its rows depend on the board; those of this router are unknown."""
    by_name: dict[str, Arg] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "by_name", {arg.name: arg for arg in self.args})


DISABLED_ARG = Arg("disabled", values.Bool(), "no")
COMMENT = Arg("comment", values.Text())

_SHAPES: Final = {
    schema.Shape.LIST: Shape.LIST,
    schema.Shape.FIXED: Shape.FIXED_ROWS,
    schema.Shape.SINGLETON: Shape.SETTINGS,
}
_PLAIN: Final = {
    schema.PropertyKind.BOOLEAN: values.Bool(),
    schema.PropertyKind.FLAG: values.FlagValue(),
    schema.PropertyKind.INTERFACE: values.Ref(("interface",)),
    schema.PropertyKind.MAC: values.Mac(),
    schema.PropertyKind.NUMBER: values.Int(),
    schema.PropertyKind.PREFIX: values.Address(v6=False),
    schema.PropertyKind.RATE: values.Rate(),
    schema.PropertyKind.SIZE: values.Size(),
    schema.PropertyKind.TIME: values.Time(),
}
"""Accepted values for each property kind where no narrower rule exists; all other kinds accept any text."""


_LISTS: Final = (schema.PropertyKind.SEQUENCE, schema.PropertyKind.SET)


def _reference_type(path: str, field: schema.Field) -> values.ValueType | None:
    return (references if field.kind in _LISTS else reference)(path, field.name)


def of_schema(
    path: str,
    *,
    shape: Shape | None = None,
    kinds: Mapping[str, values.ValueType] | None = None,
    local: Iterable[Arg] = (),
    without: Iterable[str] = (),
    **rest: Any,  # noqa: ANN401 - fields of Menu
) -> EmulatedMenu:
    """Build a menu from the engine's schema.

    `kinds`: accepted values of arguments; `local`: arguments that the schema lacks, or that the emulator models in more
    detail; `without`: arguments of the schema that no emulated router has.
    """
    menu, narrower = schema.MENUS[path], kinds or {}
    args = {
        field.name: Arg(
            field.name,
            narrower.get(field.name) or _PLAIN.get(field.kind) or _reference_type(path, field) or values.Text(),
            None if field.name == "comment" else field.default,
            secret=field.secret,
        )
        for field in menu.fields
        if field.name not in without
    } | {arg.name: arg for arg in local}
    return EmulatedMenu(path, shape or _SHAPES[menu.shape], tuple(args[name] for name in sorted(args)), **rest)
