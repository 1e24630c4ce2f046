"""Faults that strike at a chosen sentence, so that a test can cut a run at every point of it."""

from __future__ import annotations

import re
from enum import StrEnum
from fnmatch import fnmatchcase
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class FaultKind(StrEnum):
    """What happens."""

    GAP = "gap"
    """The bearer carries nothing for `seconds`; TCP survives it."""
    DROP = "drop"
    """The connection is reset under both ends at once; what was under way is lost."""
    VANISH = "vanish"
    """The connection goes silent for good and neither end is told: the cable was pulled."""
    REBOOT = "reboot"
    """The router reboots: EOF, and back after `boot_s`."""
    POWER = "power"
    """The router loses power: no EOF, and back after `boot_s`."""
    TRUNCATE = "truncate"
    """The answer stops after `offset` bytes (half of it without), then EOF."""
    GARBAGE = "garbage"
    """`data` stands in the answer at `offset`."""
    HANG = "hang"
    """The router never answers on this connection again."""


class Fault(BaseModel):
    """One fault, armed for the n-th matching sentence from now; it strikes once."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    do: FaultKind
    sentence: int = Field(default=1, ge=1)
    """Counted over all connections of the router from the moment of arming."""
    match: str = "*"
    """Shell pattern for the command word, e.g. `/ip/firewall/*`; `*` counts `/login`, too.

    A script that only has commands parsed is not `/execute`, which changes something, but `/execute :parse`.
    """
    when: Literal["before", "after"] = "before"
    """Before the sentence is executed, or after and before its answer leaves."""
    seconds: float = Field(default=0.0, ge=0)
    lines: int | None = Field(default=None, ge=0)
    """With `when="after"`: only so many lines of the script in `/execute` are run before it strikes."""
    offset: int | None = Field(default=None, ge=0)
    data: str = "f8ffffff"
    """Bytes in hex; the default begins with a control byte that the manual reserves."""

    def shorten(self, words: tuple[str, ...]) -> tuple[str, ...]:
        """The sentence as far as it gets; a line that ends with a backslash goes on in the next."""
        if self.lines is None:
            return words
        return tuple(self._first_lines(word) if word.startswith("=script=") else word for word in words)

    def _first_lines(self, word: str) -> str:
        script = word.removeprefix("=script=")
        return "=script=" + "\n".join(re.split(r"(?<!\\)\r?\n", script)[: self.lines])


class Faults:
    """The faults that are armed."""

    def __init__(self) -> None:
        self._armed: list[tuple[Fault, int]] = []

    def arm(self, fault: Fault) -> None:
        """Let `fault` strike when its sentence comes."""
        self._armed.append((fault, fault.sentence))

    def disarm(self) -> None:
        """Forget all."""
        self._armed.clear()

    @property
    def armed(self) -> tuple[Fault, ...]:
        """What has not struck yet."""
        return tuple(fault for fault, _ in self._armed)

    @staticmethod
    def command(words: tuple[str, ...]) -> str:
        """Return what patterns are held against."""
        parses = any(word.startswith("=script=:foreach ") and ":put [:parse " in word for word in words)
        return f"{words[0]} :parse" if parses else words[0]

    def upon(self, command: str) -> list[Fault]:
        """Count the sentence that begins with `command`; the faults that strike at it."""
        left = [(fault, n - fnmatchcase(command, fault.match)) for fault, n in self._armed]
        self._armed = [(fault, n) for fault, n in left if n > 0]
        return [fault for fault, n in left if n <= 0]
