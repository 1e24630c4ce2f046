"""What every kind of value does, and how a stored value points at a row instead of at its name.

RouterOS keeps references by id: a rename shows everywhere, and a reference to a removed row is shown as that row's
`*ID`. So does the twin: a stored value holds a token in place of the name.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Iterator

INVALID = "invalid value for argument {}"
NOT_OFFERED = "input does not match any value of {}"
_TOKEN = re.compile("\x01([a-z-]+):([0-9A-F]+)\x02")


class BadValue(ValueError):
    """The value is not of this kind; `words` is the device's text, `{}` stands for the argument's name."""

    def __init__(self, words: str = INVALID) -> None:
        super().__init__(words)
        self.words = words


class Names(Protocol):
    """Who is called what: spaces are groups of menus whose rows share their names (`interface`, `pool`, ...)."""

    def id_of(self, space: str, name: str) -> int | None:
        """Return the id of the row of that name, None if there is none."""

    def name_of(self, space: str, number: int) -> str | None:
        """Return the name of the row, None if it has gone."""


@dataclass(frozen=True, slots=True)
class Kind:
    """A value syntax; the base takes anything."""

    def parse(self, text: str, names: Names) -> str:  # noqa: ARG002 - only references look names up
        """Return `text` as it is stored. Raises BadValue."""
        return text

    def typed(self, text: str) -> str:
        """Return what the console makes of a value before the command sees it. Raises BadValue: a syntax error."""
        return text

    def code(self, typed: str) -> str:
        """Return a typed value as `:parse` prints it within the code of a command (7.23.3)."""
        return typed

    def exported(self, stored: str) -> str:
        """Return the value as an export prints it."""
        return stored

    def show(self, stored: str) -> str:
        """Return the value as the API prints it; names are put in by `spell` before."""
        return stored


def id_text(number: int) -> str:
    """Write an id as the device does: `*1F`."""
    return f"*{number:X}"


def reference(space: str, number: int) -> str:
    """Make the stored form of a reference."""
    return f"\x01{space}:{number:X}\x02"


def references(stored: str) -> Iterator[tuple[str, int]]:
    """Yield the rows that a stored value points at."""
    for space, number in _TOKEN.findall(stored):
        yield space, int(number, 16)


def spell(stored: str, names: Names) -> str:
    """Put the names in; a row that has gone is shown by its id."""
    if "\x01" not in stored:
        return stored

    def name(match: re.Match[str]) -> str:
        number = int(match[2], 16)
        found = names.name_of(match[1], number)
        return id_text(number) if found is None else found

    return _TOKEN.sub(name, stored)
