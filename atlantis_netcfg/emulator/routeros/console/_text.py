r"""The characters of a script: where they stand, how lines join, how values are quoted.

Quoting (Manual, Scripting: Constant Escape Sequences): only double quotes; within them `$name` is substituted, by
nothing if no such variable exists, and `\` starts an escape; outside them `$` and `\` are errors.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.console._statements import Variable

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.emulator.routeros.console._statements import Template

_ESCAPES = {
    '"': '"',
    "\\": "\\",
    "n": "\n",
    "r": "\r",
    "t": "\t",
    "$": "$",
    "?": "?",
    "_": " ",
    "a": "\a",
    "b": "\b",
    "f": "\f",
    "v": "\v",
}
_HEX = re.compile(r"[0-9A-F]{2}")
_NAME = re.compile(r"[A-Za-z0-9_]+")
_QUOTED_NAME = re.compile(r"[A-Za-z0-9_-]+")
_BARE = re.compile(r"[^\s\"\\$&'();=?\[\]^{|}]+")
_INDENT = " \t"


class ConsoleError(Exception):
    """The console does not understand the text; `str()` is its message, with line and column.

    `verdict` is what `:parse` returns for it, where that is another text.
    """

    def __init__(self, message: str, verdict: str = "") -> None:
        super().__init__(message)
        self.verdict = verdict or message


@dataclass(slots=True)
class Text:
    """A script and a position in it."""

    source: str
    at: int = 0
    end: int = field(init=False)
    _starts: list[int] = field(init=False)

    def __post_init__(self) -> None:
        self.source = self.source.replace("\r\n", "\n")
        self.end = len(self.source)
        self._starts = [0, *(match.end() for match in re.finditer("\n", self.source))]

    def error(self, words: str, at: int | None = None) -> ConsoleError:
        """Make the error for a position, by default the present one."""
        return ConsoleError(self.placed(words, self.at if at is None else at))

    def placed(self, words: str, at: int) -> str:
        """Return the words with line and column of a position; columns count bytes."""
        line = bisect_right(self._starts, at) - 1
        before = self.source[self._starts[line] : at]
        return f"{words} (line {line + 1} column {len(before.encode(errors='surrogateescape')) + 1})"

    @property
    def line(self) -> int:
        """The number of the present line, from 1."""
        return bisect_right(self._starts, self.at)

    def peek(self) -> str:
        """Return the next character, "" at the end."""
        return self.source[self.at : self.at + 1]

    def take(self, text: str) -> bool:
        """Step over `text` if it comes next."""
        if not self.source.startswith(text, self.at):
            return False
        self.at += len(text)
        return True

    def match(self, pattern: re.Pattern[str]) -> str | None:
        """Step over what fits the pattern."""
        found = pattern.match(self.source, self.at)
        if found is None:
            return None
        self.at = found.end()
        return found[0]

    def space(self) -> None:
        """Step over white space and joined line ends, not over line ends."""
        while self.at < self.end:
            if self.peek() in _INDENT:
                self.at += 1
            elif not self._join():
                return
            else:
                self._notes()

    def _notes(self) -> None:
        """Step over comments between joined lines (read so by 7.23.3)."""
        while self.peek() == "#":
            self.skip_line()
            self.take("\n")
            self._indent()

    def _join(self) -> bool:
        if not self.take("\\\n"):
            return False
        self._indent()
        return True

    def _indent(self) -> None:
        while self.peek() and self.peek() in _INDENT:
            self.at += 1

    def skip_line(self) -> None:
        """Step to the end of the line."""
        while self.peek() not in ("\n", ""):
            self.at += 1

    def value(self) -> str:
        """Read a quoted or bare value. Raises ConsoleError if none comes."""
        while self._join():
            pass
        if self.peek() == '"':
            return "".join(part for part in self.template() if isinstance(part, str))
        start = self.at
        parts = []
        while (part := self.match(_BARE)) is not None:
            parts.append(part)
            if not self._join():
                break
        if not parts or self.peek() in tuple("\"\\$&'()=?[^{|"):
            raise self.error("syntax error", self.at if parts else start)
        return "".join(parts)

    def template(self) -> Template:
        """Read a text in quotes: its pieces, with the variables between them. Raises ConsoleError."""
        start = self.at
        self.at += 1
        pieces = list(self._pieces(start))
        self.at += 1
        return tuple(pieces)

    def _pieces(self, start: int) -> Iterator[str | Variable]:
        found: list[str] = []
        while self.peek() != '"':
            if self.at >= self.end:
                raise self.error("syntax error", start)
            if self.peek() == "$":
                yield _decoded(found)
                found = []
                yield self.variable()
            else:
                found.append(self._character())
        yield _decoded(found)

    def variable(self) -> Variable:
        """Read `$name` or `$"name"`. Raises ConsoleError."""
        start = self.at
        self.at += 1
        quoted = self.take('"')
        name = self.match(_QUOTED_NAME if quoted else _NAME)
        if name is None or (quoted and not self.take('"')):
            raise self.error("syntax error", start)
        return Variable(name)

    def _character(self) -> str:
        if self.peek() == "\\":
            return "" if self._join() or self.take("\\ ") or self.take("\\\t") else self._escape()
        self.at += 1
        return self.source[self.at - 1]

    def _escape(self) -> str:
        start = self.at
        self.at += 1
        code = self.match(_HEX)
        if code is not None:
            return bytes([int(code, 16)]).decode(errors="surrogateescape")
        char = self.peek()
        if char not in _ESCAPES or not char:
            raise self.error("syntax error", start)
        self.at += 1
        return _ESCAPES[char]


def _decoded(found: list[str]) -> str:
    return "".join(found).encode(errors="surrogateescape").decode(errors="surrogateescape")
