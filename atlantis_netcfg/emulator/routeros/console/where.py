"""Conditions of `find` and `print where`: which rows they mean (Manual, Console: Expressions in where).

A bare value with `/` or `:` has another type than the property: it matches nothing (seen on a CHR 7.23.2, tik4net,
Docs/findings-cli.md).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

_BOOLS = {"yes": "true", "no": "false"}


@dataclass(frozen=True, slots=True)
class Condition:
    """`name=value`, `name!=value`, `name~value`, `name<value`, `name>value`; `name` alone has the sign `?`."""

    name: str
    sign: str = "?"
    value: str = ""
    negated: bool = False
    possible: bool = True
    """The value has the type of a property."""

    def fits(self, row: Mapping[str, str]) -> bool:
        """Tell whether a row is meant."""
        return self.negated is not self._fits(row.get(self.name, ""))

    def _fits(self, found: str) -> bool:
        if self.sign == "?":
            return found not in ("", "false", "no")
        if not self.possible:
            return self.sign == "!="
        if self.sign == "~":
            return re.search(self.value, found) is not None
        same = found in (self.value, _BOOLS.get(self.value))
        if self.sign in ("=", "!="):
            return same is (self.sign == "=")
        less = _ordered(found) < _ordered(self.value)
        return less if self.sign == "<" else not (less or same)


Where = tuple[tuple[Condition, ...], ...]
"""Alternatives, of each of which all conditions hold; none at all means every row."""


def fits(row: Mapping[str, str], where: Where) -> bool:
    """Tell whether a row is meant."""
    return not where or any(all(condition.fits(row) for condition in item) for item in where)


def _ordered(text: str) -> tuple[int, int, str]:
    return (0, int(text), "") if text.isdecimal() else (1, 0, text)
