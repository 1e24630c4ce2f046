"""What a script is made of, once it is parsed."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from atlantis_netcfg.emulator.routeros.console.where import Where


@dataclass(frozen=True, slots=True)
class Variable:
    """What a script or whoever runs it has put in: `$"response-count"`."""

    name: str


Template = tuple[str | Variable, ...]
"""A text with variables in it."""


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
    arguments: dict[str, str | Template | Find | Command] = field(default_factory=dict)
    unset: list[str] = field(default_factory=list)
    where: Where = ()
    place: int = 0
    line: int = 1


@dataclass(frozen=True, slots=True)
class Parse:
    """`[:parse text]`."""

    text: Template


@dataclass(frozen=True, slots=True)
class Put:
    """`:put` with a text, or with a command or the code of a text, whose value it prints."""

    what: Template | Command | Find | Parse


@dataclass(frozen=True, slots=True)
class Local:
    """`:local name [command]`."""

    name: str
    value: Command | Find


@dataclass(frozen=True, slots=True)
class Each:
    """`:foreach index,value in={"text";"text"} do={ ... }`; of other loops nothing is rehearsed."""

    index: str
    value: str
    texts: tuple[Template, ...]
    body: tuple[Statement, ...]


@dataclass(frozen=True, slots=True)
class Failure:
    """`:error "text"`."""

    text: Template
    line: int


@dataclass(frozen=True, slots=True)
class Attempt:
    """`:do { ... } on-error={ ... }`: the second block runs where a command of the first one fails."""

    tried: tuple[Statement, ...]
    rescue: tuple[Statement, ...]


@dataclass(frozen=True, slots=True)
class Choice:
    """`:if (left sign right) do={ ... } else={ ... }`; right of `~` stands a regular expression."""

    left: Variable | Find
    sign: str
    right: int | str
    then: tuple[Statement, ...]
    otherwise: tuple[Statement, ...] = ()


Statement = Command | Put | Failure | Attempt | Choice | Local | Each
