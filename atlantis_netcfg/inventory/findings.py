"""Errors of the inventory: what is wrong, where, and what to type instead.

Also hints about names in the inventory: near misses, alternatives, and valid names.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import UsageError, nearest
from atlantis_netcfg.core.messages import arg, join, msg, shorten

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence


@dataclass(frozen=True, slots=True, order=True)
class Mark:
    """A place in a file, as editors count: line and column begin with 1."""

    file: str
    line: int
    column: int

    def __str__(self) -> str:
        return f"{self.file}:{self.line}:{self.column}"


@dataclass(frozen=True, slots=True, order=True)
class Finding:
    """One error of the inventory. Sorts by its place."""

    file: str
    line: int
    column: int
    message: str
    hint: str
    """What to type next."""

    @classmethod
    def at(cls, mark: Mark, message: str, hint: str) -> Finding:
        """Build a finding at a place; long user input is shortened."""
        return cls(mark.file, mark.line, mark.column, shorten(message, _LONGEST), shorten(hint, _LONGEST))

    def __str__(self) -> str:
        return msg(f"{arg(self.file)}:{arg(self.line)}:{arg(self.column)}: {arg(self.message)}")


_LONGEST = 400
_WHERE = "in the inventory; no device was contacted"
MOST_SHOWN = 50


class InventoryInvalid(UsageError):
    """The inventory has errors; nothing was contacted."""

    def __init__(self, findings: Iterable[Finding], where: str = _WHERE) -> None:
        self.findings: tuple[Finding, ...] = tuple(sorted(set(findings)))
        super().__init__(report(self.findings, where))

    @property
    def errors(self) -> tuple[UsageError, ...]:
        """Single errors, up to MOST_SHOWN, and the number of remaining ones."""
        errors = [UsageError(str(finding), hint=finding.hint) for finding in self.findings[:MOST_SHOWN]]
        more = len(self.findings) - MOST_SHOWN
        return (*errors, *([UsageError(_omitted_text(more))] if more > 0 else []))


def report(findings: Sequence[Finding], where: str = _WHERE, *, warnings: bool = False) -> str:
    """Format errors or warnings for a technician: place, problem, correction; and the count at the end."""
    lines = [msg(f"{arg(finding)}\n  -> {arg(finding.hint)}") for finding in findings[:MOST_SHOWN]]
    lines += [_omitted_text(len(findings) - MOST_SHOWN)] if len(findings) > MOST_SHOWN else []
    noun = "warning" if warnings else "error"
    return join("\n", [*lines, msg(f"{arg(len(findings))} {noun}{'s' if len(findings) != 1 else ''} {where}")])


def _omitted_text(number: int) -> str:
    return msg(f"{arg(number)} more not shown: correct these first")


_MANY = 12


def suggest(word: str, known_words: Iterable[str], *, none: str) -> str:
    """Return a hint for an unknown word: the near miss, else all known words, else `none`."""
    words = list(known_words)
    near = nearest(word, words)
    if near is not None:
        return msg(f"did you mean `{arg(near)}`?")
    return msg(f"available: {arg(choices(words))}") if words else none


def choices(words: Iterable[str]) -> str:
    """Join words with commas; a long list is shortened."""
    every = list(words)
    return join(", ", every[:_MANY]) + msg(f" … ({arg(len(every))} in all)" if len(every) > _MANY else "")


def shown_key(key: str) -> str:
    """Return only the first word of a key: a typing error may put a password after it."""
    word = re.match(r"[\w.-]*", key)
    return key if word is None or word.group() == key else f"{word.group()}…"


def why_no_name(text: str) -> tuple[str, str] | None:
    """Return what is wrong with a name, and a correction; None: an RFC 1123 label of at most 32 characters."""
    if re.fullmatch(r"[a-z0-9](?:[a-z0-9-]{0,30}[a-z0-9])?", text):
        return None
    near = re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")[:32].strip("-")
    rule = "lower-case letters, digits and hyphens inside, 32 at most"
    return msg(
        f"`{arg(text)}` is not a valid name: a name has {arg(rule)}"
    ), near or "example of a name: coastal-router"
