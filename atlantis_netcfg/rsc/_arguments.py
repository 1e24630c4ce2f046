"""The part of a statement behind its command word: selector or target, then arguments."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from atlantis_netcfg.rsc._values import ValueTextError, unquote
from atlantis_netcfg.rsc._words import FLAGS

if TYPE_CHECKING:
    from atlantis_netcfg.rsc._lines import LogicalLine
    from atlantis_netcfg.rsc._model import RscError

__all__ = ["Arguments", "skip_space"]

_SPACE = re.compile(r"[ \t]*")
_NAME = re.compile(r"\.?[A-Za-z0-9][A-Za-z0-9_/-]*(?:\.[A-Za-z0-9_/-]+)*")
_QUOTED = re.compile(r'"(?:[^"\\]|\\.)*"')
_BARE = re.compile(r"[!#%-'*-:<-Z^-z|~]+")
_SELECTOR = re.compile(r"\[[ \t]*find(?=[ \t\]])(?:[ \t]+where(?=[ \t\]]))?")
_BLANK = ("", " ", "\t")
_GLUED_MENU = re.compile(r"/[a-z0-9-]+(?: [a-z0-9-]+)*$")

_ROW_HINT = 'rows look like:  add name=value name="a value with spaces"'


def skip_space(text: str, offset: int) -> int:
    """Return the offset of the next character that is not white space."""
    match = _SPACE.match(text, offset)
    return match.end() if match else offset


@dataclass(slots=True)
class Arguments:
    """Reads one line from `offset` up to `end`; what was found stands in the attributes."""

    line: LogicalLine
    offset: int
    verb: str
    values: list[tuple[str, str | None]] = field(default_factory=list)
    find: tuple[tuple[str, str], ...] | None = None
    target: str | None = None
    end: int = field(init=False)
    """Where the statement ends: the end of the line, or the menu that RouterOS glued to it (see `_check_end`)."""
    _prefix: str = ""
    _selecting: bool = False

    def __post_init__(self) -> None:
        self.end = len(self.line.text)

    def read(self) -> None:
        """Read everything. Raises RscError at the first mistake."""
        while self._advance():
            if self._char() == "[":
                self._selector()
            elif unset := self._unset():
                self.values.append((unset, None))
            elif pair := self._pair():
                self.values.append(pair)
            else:
                self._word()

    def _advance(self) -> bool:
        self.offset = skip_space(self.line.text, self.offset)
        return self.offset < self.end

    def _char(self) -> str:
        return self.line.text[self.offset : self.offset + 1]

    def _selected(self) -> bool:
        return self.find is not None or self.target is not None

    def _selector(self) -> None:
        start = self.offset
        match = _SELECTOR.match(self.line.text, start)
        if match is None:
            raise self.line.error(start, "only a selector of the form [ find name=value ] can stand here")
        if self._selected():
            raise self.line.error(start, "the statement says twice which rows it is about")
        self.offset = match.end()
        pairs: list[tuple[str, str]] = []
        self._selecting = True
        while self._advance() and self._char() != "]":
            pair = self._pair()
            if pair is None:
                raise self.line.error(self.offset, "inside [ find ... ] only name=value is understood here")
            pairs.append(pair)
        if self.offset >= self.end:
            raise self.line.error(start, "this [ is never closed", hint="end the selector with  ]")
        self._selecting = False
        self.offset += 1
        self.find = tuple(pairs)

    def _unset(self) -> str | None:
        if self._char() != "!":
            return None
        match = _NAME.match(self.line.text, self.offset + 1)
        if match is None or self.line.text[match.end() : match.end() + 1] not in _BLANK:
            return None
        name = self._full_name(match[0])
        self.offset = match.end()
        return name

    def _pair(self) -> tuple[str, str] | None:
        match = _NAME.match(self.line.text, self.offset)
        if match is None or self.line.text[match.end() : match.end() + 1] != "=":
            return None
        name = self._full_name(match[0])
        self.offset = match.end() + 1
        return name, self._value(name)

    def _full_name(self, name: str) -> str:
        """Undo the elision of RouterOS 7: behind `configuration.country=X`, `.mode=ap` is `configuration.mode=ap`."""
        if not name.startswith("."):
            self._prefix = name.rpartition(".")[0] or self._prefix
            return name
        if not self._prefix:
            raise self.line.error(self.offset, f"`{name}` has no argument before it whose prefix it could share")
        return self._prefix + name

    def _value(self, name: str) -> str:
        start, char = self.offset, self._char()
        quoted = char == '"'
        match = (_QUOTED if quoted else _BARE).match(self.line.text, start)
        if match is None and quoted:
            hint = 'close it with  "  and write a quote within the value as  \\"'
            raise self.line.error(start, f"the quote that opens the value of `{name}` is never closed", hint=hint)
        if match is None and char not in _BLANK:
            raise self.line.error(start, f"the value of `{name}` cannot start with {_shown(char)}", hint=_quotes(name))
        if match is None:
            raise self.line.error(start, f"`{name}=` has no value", hint=f'an empty value is written  {name}=""')
        self.offset = match.end()
        self._check_end(name, quoted=quoted)
        return self._unquoted(match[0], start)

    def _check_end(self, name: str, *, quoted: bool) -> None:
        following = self._char()
        if following in _BLANK or (following == "]" and self._selecting):
            return
        # /export terse forgets the line end before the menu line that it prints above a row with a volatile comment
        # (seen on 7.15.3); after a closing quote that menu can be told from the value.
        if quoted and _GLUED_MENU.match(self.line.text, self.offset):
            self.end = self.offset
            return
        complaint = f"{_shown(following)} cannot stand in the value of `{name}` like this"
        raise self.line.error(self.offset, complaint, hint=_quotes(name))

    def _unquoted(self, literal: str, start: int) -> str:
        try:
            return unquote(literal)
        except ValueTextError as error:
            raise self.line.error(start + error.offset, str(error), hint=r"a backslash itself is written  \\") from None

    def _word(self) -> None:
        start = self.offset
        match = (_QUOTED if self._char() == '"' else _BARE).match(self.line.text, start)
        if match is None:
            raise self.line.error(start, f"{_shown(self._char())} cannot stand here", hint=_ROW_HINT)
        word = match[0]
        may_be_target = self.verb != "add" and not self.values and not self._selected()
        if word.lstrip(".") in FLAGS and not may_be_target:
            self.values.append((self._full_name(word), ""))
        elif may_be_target:
            self.target = self._unquoted(word, start)
        else:
            raise self._stray(start, word)
        self.offset = match.end()

    def _stray(self, start: int, word: str) -> RscError:
        if word.startswith("#"):
            hint = "move it to a line of its own above"
            return self.line.error(start, "a comment cannot follow on the same line", hint=hint)
        hint = _quotes(self.values[-1][0]) if self.values else _ROW_HINT
        return self.line.error(start, f"`{word}` stands alone, without name=", hint=hint)


def _quotes(name: str) -> str:
    return f'a value with spaces or signs needs quotes:  {name}="..."'


def _shown(char: str) -> str:
    """Give a character that cannot be seen its name."""
    return char if char.isprintable() and not char.isspace() else f"the character {unicodedata.name(char, ascii(char))}"
