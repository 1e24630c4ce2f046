"""How a row of the table of menus looks."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

from atlantis_netcfg.emulator.routeros.values import Bool, Kind, Text


class Shape(StrEnum):
    """Kinds of menus, as their commands tell them apart."""

    LIST = "list"
    """Rows that can be added."""
    FIXED = "fixed"
    """Rows that are there and can only be set."""
    SETTINGS = "settings"
    """One row without id."""


class Select(StrEnum):
    """How an export names a row that it cannot add."""

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
    kind: Kind
    default: str | None = None
    """Value of a row that does not say otherwise; None: the property is absent then, and can be unset."""
    required: bool = False
    secret: bool = False
    """Hidden by `export`, and by `print` for groups without policy `sensitive`."""
    never: bool = False
    """Write-only: no command prints it."""
    always: bool = False
    """Exported also where it equals the default, as RouterOS does for a few (`action=accept`, `type=A`)."""
    exported: bool = True
    shown_if: tuple[str, str] | None = None
    """Only part of the row while another argument has this value (`|` separates several)."""


@dataclass(frozen=True, slots=True)
class Unique:
    """No two rows may agree in these arguments (rows that lack one of them do not count)."""

    arguments: tuple[str, ...]
    words: str
    enabled: bool = False
    """Only rows that are not disabled count."""


@dataclass(frozen=True, slots=True)
class Menu:
    """One menu: what its rows hold, how they are told apart, and what a factory-new router has in it."""

    path: str
    shape: Shape
    args: tuple[Arg, ...]
    noun: str
    """What `/system/history` calls a row."""
    space: str = ""
    """Name space in which other menus refer to its rows."""
    called: str = "name"
    """The argument by which a row may be called in place of its id."""
    unique: tuple[Unique, ...] = ()
    factory: tuple[dict[str, str], ...] = ()
    """Rows of a factory-new router; they cannot be removed."""
    factory_dynamic: bool = False
    """The factory's rows are dynamic: they cannot be set either."""
    flags: tuple[str, ...] = ()
    """Boolean properties that the router computes and always prints."""
    builtin_flag: str = ""
    """The flag that marks the factory's rows (`builtin`, `default`)."""
    select: Select = Select.INDEX
    first_id: int = 1
    feature: str = ""
    """Feature of `/system/device-mode` that it needs."""
    exported: bool = True
    sparse: bool = False
    """Exports print what was given, defaults too: how the menus of the routing process behave."""
    modelled: bool = True
    """False: only names of arguments are checked, by the command tree."""
    by_name: dict[str, Arg] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "by_name", {arg.name: arg for arg in self.args})


DISABLED = Arg("disabled", Bool(), "no")
COMMENT = Arg("comment", Text())
