r"""Parser of export text: the output of `export` of RouterOS 6 and 7, or typed in that style.

Also here: the part of a statement after its command word (selector or target, then arguments), and the joining of
physical lines: `\` at a line's end joins the next one without its indent, also inside quotes.
"""

from __future__ import annotations

import re
import unicodedata
from bisect import bisect_right
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from atlantis_netcfg.routeros.rsc import _model
from atlantis_netcfg.routeros.rsc._print import ValueTextError, unquote

if TYPE_CHECKING:
    from collections.abc import Iterator


_SPACE = re.compile(r"[ \t]*")
_NAME = re.compile(r"\.?[A-Za-z0-9][A-Za-z0-9_/-]*(?:\.[A-Za-z0-9_/-]+)*")
_QUOTED_VALUE = re.compile(r'"(?:[^"\\]|\\.)*"')
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
class RscArguments:
    """Parses one line from `offset` to `end`; the results are in the attributes."""

    line: LogicalLine
    offset: int
    verb: str
    values: list[tuple[str, str | None]] = field(default_factory=list)
    find: tuple[tuple[str, str], ...] | None = None
    target: str | None = None
    end: int = field(init=False)
    """End of the statement: end of the line, or the menu that RouterOS appended to it (see `_check_end`)."""
    _prefix: str = ""
    _selecting: bool = False

    def __post_init__(self) -> None:
        self.end = len(self.line.text)

    def read(self) -> None:
        """Parse the whole line. Raises RscError at the first error."""
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

    def _has_target(self) -> bool:
        return self.find is not None or self.target is not None

    def _selector(self) -> None:
        start = self.offset
        match = _SELECTOR.match(self.line.text, start)
        if match is None:
            raise self.line.error(start, "only a selector of the form [ find name=value ] can stand here")
        if self._has_target():
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
        """Expand RouterOS 7's short form: after `configuration.country=X`, `.mode=ap` is `configuration.mode=ap`."""
        if not name.startswith("."):
            self._prefix = name.rpartition(".")[0] or self._prefix
            return name
        if not self._prefix:
            raise self.line.error(self.offset, f"`{name}` has no argument before it whose prefix it could share")
        return self._prefix + name

    def _value(self, name: str) -> str:
        start, char = self.offset, self._char()
        is_quoted = char == '"'
        match = (_QUOTED_VALUE if is_quoted else _BARE).match(self.line.text, start)
        if match is None and is_quoted:
            hint = 'close it with  "  and write a quote within the value as  \\"'
            raise self.line.error(start, f"the quote that opens the value of `{name}` is never closed", hint=hint)
        if match is None and char not in _BLANK:
            raise self.line.error(
                start, f"the value of `{name}` cannot start with {_describe_char(char)}", hint=_quotes_hint(name)
            )
        if match is None:
            raise self.line.error(start, f"`{name}=` has no value", hint=f'an empty value is written  {name}=""')
        self.offset = match.end()
        self._check_end(name, is_quoted=is_quoted)
        return self._unquote(match[0], start)

    def _check_end(self, name: str, *, is_quoted: bool) -> None:
        following = self._char()
        if following in _BLANK or (following == "]" and self._selecting):
            return
        # /export terse forgets the line end before the menu line that it prints above a row with a volatile comment
        # (seen on 7.15.3); after a closing quote that menu can be told from the value.
        if is_quoted and _GLUED_MENU.match(self.line.text, self.offset):
            self.end = self.offset
            return
        complaint = f"{_describe_char(following)} cannot stand in the value of `{name}` like this"
        raise self.line.error(self.offset, complaint, hint=_quotes_hint(name))

    def _unquote(self, literal: str, start: int) -> str:
        try:
            return unquote(literal)
        except ValueTextError as error:
            raise self.line.error(start + error.offset, str(error), hint=r"a backslash itself is written  \\") from None

    def _word(self) -> None:
        start = self.offset
        match = (_QUOTED_VALUE if self._char() == '"' else _BARE).match(self.line.text, start)
        if match is None:
            raise self.line.error(start, f"{_describe_char(self._char())} cannot stand here", hint=_ROW_HINT)
        word = match[0]
        may_be_target = self.verb != "add" and not self.values and not self._has_target()
        if word.lstrip(".") in _model.FLAGS and not may_be_target:
            self.values.append((self._full_name(word), ""))
        elif may_be_target:
            self.target = self._unquote(word, start)
        else:
            raise self._stray_word_error(start, word)
        self.offset = match.end()

    def _stray_word_error(self, start: int, word: str) -> _model.RscError:
        if word.startswith("#"):
            hint = "move it to a line of its own above"
            return self.line.error(start, "a comment cannot follow on the same line", hint=hint)
        hint = _quotes_hint(self.values[-1][0]) if self.values else _ROW_HINT
        return self.line.error(start, f"`{word}` stands alone, without name=", hint=hint)


def _quotes_hint(name: str) -> str:
    return f'a value with spaces or signs needs quotes:  {name}="..."'


def _describe_char(char: str) -> str:
    """Return a printable character, or the Unicode name of any other."""
    return char if char.isprintable() and not char.isspace() else f"the character {unicodedata.name(char, ascii(char))}"


_INDENT = " \t"


@dataclass(slots=True)
class LogicalLine:
    """One unwrapped statement, menu or comment, with the original position of each character."""

    source: str
    text: str = ""
    _parts: list[tuple[int, int, int]] = field(default_factory=list)
    """(offset in `text`, line, column of that offset), ascending."""

    @property
    def line(self) -> int:
        """The line on which it starts, 1-based."""
        return self._parts[0][1]

    @property
    def is_comment(self) -> bool:
        """True if the line is a comment."""
        return self.text.startswith("#")

    def append(self, text: str, line: int, column: int) -> None:
        """Append a physical line that begins at that position."""
        self._parts.append((len(self.text), line, column))
        self.text += text

    def error(self, offset: int, message: str, *, hint: str | None = None) -> _model.RscError:
        """Return the error for the character at `offset`, with its position in the user's file."""
        start, line, column = self._parts[bisect_right(self._parts, offset, key=lambda part: part[0]) - 1]
        return _model.RscError(message, source=self.source, line=line, column=column + offset - start, hint=hint)


def logical_lines(text: str, source: str) -> Iterator[LogicalLine]:
    """Yield the lines of `text` without indent and line ends (LF or CRLF); empty ones too, as they end a header."""
    current: LogicalLine | None = None
    for number, physical in enumerate(text.removeprefix("\ufeff").removesuffix("\n").split("\n"), start=1):
        content = physical.removesuffix("\r").lstrip(_INDENT)
        column = len(physical.removesuffix("\r")) - len(content) + 1
        logical_line = current or LogicalLine(source)
        is_wrapped = _is_wrapped(content) and not (current is None and content.startswith("#"))
        logical_line.append(content[:-1] if is_wrapped else content, number, column)
        current = logical_line if is_wrapped else None
        if not is_wrapped:
            yield logical_line
    if current is not None:
        raise current.error(
            len(current.text),
            "the text ends in the middle of a statement, because its last line ends with \\",
            hint="copy the whole export, or delete that \\",
        )


def _is_wrapped(content: str) -> bool:
    return (len(content) - len(content.rstrip("\\"))) % 2 == 1


_PATH_WORD = re.compile(r"[a-z0-9][a-z0-9-]*(?:/[a-z0-9][a-z0-9-]*)*(?=[ \t]|$)")
_MENU_HINT = "open the menu first, as in:  /ip firewall filter"


def parse(text: str, source: str = "text") -> _model.Export:
    """Parse a whole export; `source` is its name in errors. Raises RscError at the first error."""
    reader = _Reader()
    for line in logical_lines(text, source):
        reader.take(line)
    return reader.export()


@dataclass(slots=True)
class _Reader:
    """State of the parser: the current menu, and comments that precede the next statement."""

    menu: str | None = None
    header: tuple[str, ...] | None = None
    comments: list[str] = field(default_factory=list)
    statements: list[_model.Statement] = field(default_factory=list)
    menus: dict[str, None] = field(default_factory=dict)

    def take(self, line: LogicalLine) -> None:
        if line.is_comment:
            self.comments.append(line.text[1:].removeprefix(" ").rstrip())
            return
        self._end_header()
        if line.text.strip():
            self._read_command(line)

    def export(self) -> _model.Export:
        self._end_header()
        return _model.Export(self.header or (), tuple(self.statements), tuple(self.menus), tuple(self.comments))

    def _end_header(self) -> None:
        if self.header is None:
            self.header = tuple(self.comments)
            self.comments.clear()

    def _read_command(self, line: LogicalLine) -> None:
        menu, verb, offset = _path(line, self.menu)
        if verb is None:
            self._open_menu(menu)
            return
        arguments = RscArguments(line, offset, verb)
        arguments.read()
        self.menus.setdefault(menu)
        self.statements.append(
            _model.Statement(
                menu=menu,
                verb=verb,
                values=tuple(arguments.values),
                find=arguments.find,
                target=arguments.target,
                line=line.line,
                comments=tuple(self.comments),
            )
        )
        self.comments.clear()
        if menu_text := line.text[arguments.end :]:
            self._open_menu(_join("/", menu_text[1:].split()))

    def _open_menu(self, menu: str) -> None:
        self.menus.setdefault(menu)
        self.menu = menu


def _path(line: LogicalLine, current: str | None) -> tuple[str, str | None, int]:
    """Split a line into menu, command word (None: the line only opens the menu) and the offset of the arguments."""
    text = line.text
    absolute = text.startswith("/")
    offset = int(absolute)
    words: list[str] = []
    verb: str | None = None
    while verb is None and (match := _PATH_WORD.match(text, offset)):
        words += match[0].split("/")
        verb = _verb(line, match)
        offset = skip_space(text, match.end())
    rest = text[offset:].strip()
    if absolute and verb is None and not rest:
        return _join("/", words), None, offset
    if not words or (verb is None and not absolute and not rest and len(words) > 1):
        raise _not_a_command(line, offset)
    menu = "/" if absolute else current
    if menu is None:
        raise line.error(0, "this row stands in no menu", hint=_MENU_HINT)
    return _join(menu, words[:-1]), words[-1], offset


def _verb(line: LogicalLine, match: re.Match[str]) -> str | None:
    """Return the command word that ends the path within this run of `a/b/c`, if there is one."""
    words = match[0].split("/")
    verb = next((word for word in words if word in _model.VERBS), None)
    if verb is not None and verb != words[-1]:
        at = match.start() + match[0].index(verb)
        raise line.error(at, f"`{verb}` is a command, nothing stands below it", hint=f"put a space behind `{verb}`")
    return verb


def _join(menu: str, words: list[str]) -> str:
    return "/" + "/".join([*menu.strip("/").split("/"), *words]).strip("/")


def _not_a_command(line: LogicalLine, offset: int) -> _model.RscError:
    if line.text.startswith((":", "{", "}", "$", "(", "[")):
        hint = "keep scripts in /system script, or leave the line out"
        return line.error(0, "this is a line of a script; only the lines of an export are understood here", hint=hint)
    word = line.text[offset:].split()
    first_word = word[0] if word else line.text.strip()
    return line.error(offset if word else 0, f"`{first_word}` is neither a menu nor a command", hint=_MENU_HINT)
