"""What a script is made of, once it is parsed."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from atlantis_netcfg.twin.console.where import Where

__all__ = ["Attempt", "Choice", "Command", "Find", "Put", "Statement", "Variable"]


@dataclass(frozen=True, slots=True)
class Find:
    """`[find name=value ...]`."""

    menu: str
    where: Where
    place: int


@dataclass(slots=True)
class Command:
    """A command with its arguments."""

    menu: str
    name: str
    arguments: dict[str, str | Find | Command] = field(default_factory=dict)
    unset: list[str] = field(default_factory=list)
    where: Where = ()
    place: int = 0


@dataclass(frozen=True, slots=True)
class Put:
    """`:put` with a text or a command whose return value it prints."""

    what: str | Command | Find


@dataclass(frozen=True, slots=True)
class Attempt:
    """`:do { ... } on-error={ ... }`: the second block runs where a command of the first one fails."""

    tried: tuple[Statement, ...]
    rescue: tuple[Statement, ...]


@dataclass(frozen=True, slots=True)
class Variable:
    """What whoever runs the script has put in: `$"response-count"`."""

    name: str


@dataclass(frozen=True, slots=True)
class Choice:
    """`:if (left sign right) do={ ... } else={ ... }`."""

    left: Variable | Find
    sign: str
    right: int
    then: tuple[Statement, ...]
    otherwise: tuple[Statement, ...] = ()


Statement = Command | Put | Attempt | Choice
