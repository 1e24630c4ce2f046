"""Reply sentences as the core hands them to the wire, and the refusal that becomes a `!trap`."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum


class Category(IntEnum):
    """`=category=` of a trap (Manual, API)."""

    MISSING = 0
    ARGUMENT = 1
    INTERRUPTED = 2
    SCRIPTING = 3
    GENERAL = 4
    API = 5
    TTY = 6
    RETURN = 7


@dataclass(frozen=True, slots=True)
class Answer:
    """One reply sentence: `!re`, `!done`, `!trap`, `!empty` or `!fatal`, then its words; the wire adds `.tag`."""

    kind: str
    words: tuple[str, ...] = ()

    @property
    def last(self) -> bool:
        """Nothing follows under this tag."""
        return self.kind in ("!done", "!fatal")

    @classmethod
    def row(cls, properties: dict[str, str]) -> Answer:
        """One item."""
        return cls("!re", tuple(f"={name}={value}" for name, value in properties.items()))

    @classmethod
    def done(cls, ret: str | None = None) -> Answer:
        """The end, with what the command returns."""
        return DONE if ret is None else cls("!done", (f"=ret={ret}",))

    @classmethod
    def fatal(cls, text: str) -> Answer:
        """The end of the session: a bare text word, after which the router closes."""
        return cls("!fatal", (text,))


DISK_FULL = "failure: disk full"
"""What a command says that would write more than the flash can take. Assumption: refusal-words"""
DONE = Answer("!done")
EMPTY = Answer("!empty")


class Trap(Exception):
    """The router refuses, in its own words."""

    def __init__(self, message: str, category: Category | None = None) -> None:
        super().__init__(message)
        self.message = message
        self.category = category

    def answer(self) -> Answer:
        """The `!trap` sentence; a `!done` has to follow it."""
        category = () if self.category is None else (f"=category={int(self.category)}",)
        return Answer("!trap", (*category, f"=message={self.message}"))


@dataclass(frozen=True, slots=True)
class Caller:
    """A session that has logged in. `address` is the technician's, not the loopback's."""

    number: int
    user: str
    group: str
    via: str
    address: str
    since: float
