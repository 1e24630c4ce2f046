"""Values that name rows of other menus."""

from __future__ import annotations

import re
from dataclasses import dataclass

from atlantis_netcfg.emulator.routeros.values._base import NOT_OFFERED, BadValue, Kind, Names, reference

__all__ = ["Granted", "Ref", "Refs", "Topics"]


@dataclass(frozen=True, slots=True)
class Ref(Kind):
    """The name (or `*ID`) of a row of a space, or one of `words`."""

    spaces: tuple[str, ...]
    words: tuple[str, ...] = ()

    def parse(self, text: str, names: Names) -> str:
        """Find the row."""
        if text in self.words:
            return text
        for space in self.spaces:
            number = _number(text, space, names)
            if number is not None:
                return reference(space, number)
        raise BadValue(NOT_OFFERED)


def _number(text: str, space: str, names: Names) -> int | None:
    by_id = re.fullmatch(r"\*([0-9A-Fa-f]+)", text)
    if by_id is None:
        return names.id_of(space, text)
    number = int(by_id[1], 16)
    return None if names.name_of(space, number) is None else number


@dataclass(frozen=True, slots=True)
class Refs(Kind):
    """A list of rows of one space, perhaps empty."""

    one: Ref

    def parse(self, text: str, names: Names) -> str:
        """Find each row."""
        return ",".join(self.one.parse(part, names) for part in text.split(",")) if text else ""


@dataclass(frozen=True, slots=True)
class Topics(Kind):
    """Words of a fixed set, each with an optional `!`, in the order in which they were given."""

    words: tuple[str, ...]

    def parse(self, text: str, names: Names) -> str:  # noqa: ARG002
        """Take no other word."""
        for part in text.split(","):
            if part.removeprefix("!") not in self.words:
                raise BadValue(NOT_OFFERED)
        return text


@dataclass(frozen=True, slots=True)
class Granted(Kind):
    """A set of words that is printed whole: those in it, then those not in it with a `!` (`policy` of a user group)."""

    words: tuple[str, ...]

    def parse(self, text: str, names: Names) -> str:  # noqa: ARG002
        """Take those without `!`; what is not named is not granted."""
        parts = text.split(",") if text else []
        if any(part.removeprefix("!") not in self.words for part in parts):
            raise BadValue(NOT_OFFERED)
        inside = [word for word in self.words if word in parts]
        return ",".join([*inside, *(f"!{word}" for word in self.words if word not in parts)])
