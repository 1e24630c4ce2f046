"""Words that somebody typed, checked one by one; what is wrong is collected, so that it is told together."""

from __future__ import annotations

import re
from enum import StrEnum
from typing import TYPE_CHECKING, TypeVar

from atlantis_netcfg.core.errors import NetcfgError, UsageError
from atlantis_netcfg.core.suggest import nearest
from atlantis_netcfg.vpn.authority import CLIENT_DAYS

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

__all__ = ["Check", "Refused", "shown"]

_Word = TypeVar("_Word", bound=StrEnum)
_MOST_DAYS = 1825
"""Of a member's certificate: it must end well before the authority does."""


class Refused(UsageError):
    """Some of what was asked for cannot be; `errors` holds every reason. Nothing was opened and nothing was written."""

    def __init__(self, errors: Sequence[NetcfgError]) -> None:
        super().__init__("\n".join(str(error) for error in errors))
        self.errors = tuple(errors)


class Check:
    """One request; `words` are its words as they were typed."""

    def __init__(self, words: Mapping[str, str | None]) -> None:
        self.words = words
        self.errors: list[UsageError] = []

    def close(self) -> None:
        """Raise what is wrong: UsageError, Refused where it is more than one thing."""
        if len(self.errors) > 1:
            raise Refused(self.errors)
        if self.errors:
            raise self.errors[0]

    def wrong(self, message: str, hint: str | None = None) -> None:
        """One thing that is wrong, and what to type instead."""
        self.errors.append(UsageError(message, hint=hint))

    def checked(self, check: Callable[[], str]) -> str | None:
        """What `check` gives; None where it refuses, which is kept."""
        try:
            return check()
        except UsageError as error:
            self.errors.append(error)
            return None

    def choice(self, word: str, known: Sequence[_Word]) -> _Word | None:
        """The one of `known` that was typed; None if the word is missing or not known, which is kept."""
        typed = self.words[word]
        if typed is None:
            return None
        for item in known:
            if item.value == typed:
                return item
        near = nearest(typed, known)
        hint = f"did you mean `{word}={near}`?" if near else f"it takes one of: {', '.join(known)}"
        self.wrong(f"`{word}=`: {shown(typed)} is not known", hint)
        return None

    def days(self) -> int | None:
        """How long a certificate is asked to be good."""
        typed = self.words["days"]
        if typed is None:
            return None
        if re.fullmatch(r"[0-9]{1,5}", typed) is None or not 1 <= int(typed) <= _MOST_DAYS:
            self.wrong(f"`days=`: {shown(typed)} is no number from 1 to {_MOST_DAYS}", f"as in `days={CLIENT_DAYS}`")
            return None
        return int(typed)


def shown(typed: str) -> str:
    """What was typed, so that it cannot do anything to a terminal: in quotes, escaped, and cut."""
    text = ascii(typed)[1:-1]
    return f"`{text[:60]}…`" if len(text) > 60 else f"`{text}`"  # noqa: PLR2004 - of a line
