r"""Printer of export text, with line wrapping like RouterOS.

A value on the device is a byte string. Here it is text: UTF-8 is decoded, and any other byte (a comment typed in a
Windows code page) is kept as a lone surrogate (`surrogateescape`), so that nothing is lost between device and file.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from atlantis_netcfg.routeros.rsc import _model

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator


ENCODING = "utf-8"
ERRORS = "surrogateescape"

_PLAIN = re.compile(r"[ !#%->@-\[\]-~]*")
"""Text that needs no escaping in quotes."""
_BARE = re.compile(r"[0-9A-Za-z!#%*+,\-./:<>@_~]+")

_ESCAPE_BY_CHAR = {'"': '\\"', "\\": "\\\\", "$": "\\$", "?": "\\?", "\n": "\\n", "\r": "\\r", "\t": "\\t"}
_ESCAPES = {
    **{escape[1]: value for value, escape in _ESCAPE_BY_CHAR.items()},
    "_": " ",
    "a": "\a",
    "b": "\b",
    "f": "\f",
    "v": "\v",
}
_ESCAPE = re.compile(r"\\([0-9A-F]{2}|[\s\S])")
_HEX = re.compile(r"[0-9A-F]{2}")
_QUOTED_VALUE = re.compile(r'"(?:[^"\\]|\\[\s\S])*"')
_FIRST_PRINTABLE, _LAST_PRINTABLE = " ", "~"


def quote(value: str) -> str:
    """Print `value` like RouterOS' `export`; a script may assign the result unchanged.

    Bare if RouterOS prints it bare, else in double quotes with escapes. Source of the escapes: manual, Scripting,
    "Constant Escape Sequences"; of the bare characters: public exports of RouterOS 6 and 7.
    """
    return value if _BARE.fullmatch(value) else in_quotes(value)


def in_quotes(value: str) -> str:
    """Print `value` in quotes, even if not necessary."""
    return f'"{value if _PLAIN.fullmatch(value) else "".join(map(_escape_char, value))}"'


def _escape_char(char: str) -> str:
    if char in _ESCAPE_BY_CHAR:
        return _ESCAPE_BY_CHAR[char]
    if _FIRST_PRINTABLE <= char <= _LAST_PRINTABLE:
        return char
    return "".join(f"\\{byte:02X}" for byte in char.encode(ENCODING, ERRORS))


class ValueTextError(ValueError):
    """A value that cannot be parsed; the message is for the user, `offset` is the position of the error."""

    def __init__(self, message: str, offset: int) -> None:
        super().__init__(message)
        self.offset = offset


def unquote(text: str) -> str:
    """Parse one value of export text, quoted or bare. Raises ValueTextError with a message for the user."""
    if not text.startswith('"'):
        return _require_bare(text)
    if len(text) == 1 or not _QUOTED_VALUE.fullmatch(text):
        raise ValueTextError("the text must end with the one quote that closes it", len(text) - 1)
    raw = _ESCAPE.sub(_unescape, text[1:-1])
    return raw.encode(ENCODING, ERRORS).decode(ENCODING, ERRORS)


def _require_bare(text: str) -> str:
    for offset, char in enumerate(text):
        if char in '"\\$' or not "!" <= char <= "~":
            raise ValueTextError(f"{char} may only stand inside quotes", offset)
    return text


def _unescape(match: re.Match[str]) -> str:
    code = match[1]
    if code in _ESCAPES:
        return _ESCAPES[code]
    if _HEX.fullmatch(code):
        return bytes([int(code, 16)]).decode(ENCODING, ERRORS)
    raise ValueTextError(f"\\{code} is not an escape that RouterOS knows", match.start() + 1)


WIDTH = 79
_INDENT = "    "
_ROUTEROS_6 = re.compile(r"\bRouterOS 6\.")
_PIECE = re.compile(r"\\(?:[0-9A-F]{2}|.)|.")


def console_path(menu: str) -> str:
    """Convert a menu to console notation: `/ip/firewall/filter` is `/ip firewall filter`."""
    return "/" + menu.strip("/").replace("/", " ")


def print_export(export: _model.Export, *, width: int | None = WIDTH) -> str:
    """Print an export; `parse` reads it back to an equal one. With `width=None` each statement is one line."""
    elide = not any(_ROUTEROS_6.search(line) for line in export.header)
    lines = [_comment(line) for line in export.header]
    pending = list(export.menus)
    current: str | None = None
    for statement in export.statements:
        if statement.menu != current:
            lines += map(console_path, _open_menus(pending, statement.menu))
            current = statement.menu
        lines += map(_comment, statement.comments)
        lines.append(print_statement(statement, width=width, elide=elide))
    lines += map(console_path, pending)
    if export.trailer and not current and not export.menus:
        lines.append("")
    lines += map(_comment, export.trailer)
    return "".join(f"{line}\n" for line in lines)


def _open_menus(pending: list[str], menu: str) -> Iterator[str]:
    """Yield the menus that come before `menu` for the first time, then `menu`; remove them from `pending`."""
    if menu in pending:
        while (first := pending.pop(0)) != menu:
            yield first
    yield menu


def _comment(text: str) -> str:
    return f"# {text}".rstrip()


def print_statement(
    statement: _model.Statement, *, width: int | None = None, path: bool = False, elide: bool = False
) -> str:
    """Print one statement without its comments; `path` puts the menu first, as in `export terse`.

    `elide` shortens repeated prefixes (`configuration.country=X .mode=ap`) like RouterOS 7.
    """
    page = _Page(width)
    for word in console_path(statement.menu).split() if path else ():
        page.put(_Atom(word))
    page.put(_Atom(statement.verb, has_space=statement.menu != "/"))
    for atom in _atoms(statement, elide=elide):
        page.put(atom)
    return page.text()


@dataclass(frozen=True, slots=True)
class _Atom:
    """A text that is not split while a line has room for it."""

    text: str
    has_space: bool = True
    """A space precedes it. It is not part of the text, and ends the line if the atom starts the next one."""
    value: str | None = None
    """Value to be quoted and split if no line has room for it; None: a word that must not be split."""


def _atoms(statement: _model.Statement, *, elide: bool) -> Iterator[_Atom]:
    if statement.find is not None:
        yield from (_Atom("["), _Atom("find"))
        yield from _arguments(statement.find, elide=False)
        yield _Atom("]")
    if statement.target is not None:
        yield _Atom(quote(statement.target), value=statement.target)
    yield from _arguments(statement.values, elide=elide)


def _arguments(values: Iterable[tuple[str, str | None]], *, elide: bool) -> Iterator[_Atom]:
    before = ""
    for name, value in values:
        prefix, _, last = name.rpartition(".")
        label = f".{last}" if elide and prefix and prefix == before and value is not None else name
        before = prefix if value is not None else ""
        if value is None:
            yield _Atom(f"!{name}")
        elif value == "" and last in _model.FLAGS:
            yield _Atom(label)
        else:
            yield _Atom(f"{label}=")
            yield _Atom(quote(value), has_space=False, value=value)


@dataclass(slots=True)
class _Page:
    r"""Lines of at most `width` columns, including the backslash that joins them.

    The rule was fitted to 1155 wrapped rows of public exports of RouterOS 6.33 to 7.4, and reproduces all of them
    exactly. A word, a `name=` or a value is kept whole, and goes to the next line if it would end beyond column `width
    - 2` on this one but not on the next. A value too long for any line is quoted and split at column `width - 1`. A
    line feed within a value always starts a line, as its escape. A space that would start a line is written as its
    escape, because the indent of the next line is dropped on reading.
    """

    width: int | None
    lines: list[str] = field(default_factory=list)
    line: str = ""

    def put(self, atom: _Atom) -> None:
        """Add an atom: on this line, on the next, or split over several."""
        space = " " if atom.has_space and self.line else ""
        if self.width is None:
            self.line += space + atom.text
        elif self._room(len(self.line) + len(space), atom):
            self.line += space
            self._fill(atom, atom.text, self.width)
        else:
            self._put_on_next(atom, space, self.width)

    def _put_on_next(self, atom: _Atom, space: str, width: int) -> None:
        whole = self._room(len(_INDENT), atom)
        if (whole or space) and self.line.strip():
            self._wrap(space)
        self._fill(atom, atom.text if whole or atom.value is None else in_quotes(atom.value), width)

    def _room(self, column: int, atom: _Atom) -> bool:
        return self.width is None or column + len(atom.text) <= self.width - 2

    def _fill(self, atom: _Atom, text: str, width: int) -> None:
        # Most values fit as they are; only a line end inside one breaks the line all the same.
        fits = self.line.strip() and len(self.line) + len(text) < width and r"\n" not in text
        for piece in [text] if fits or atom.value is None else _PIECE.findall(text):
            if self.line.strip() and (piece == r"\n" or len(self.line) + len(piece) > width - 1):
                self._wrap()
            starts_line = self.lines and self.line == _INDENT
            self.line += r"\_" if starts_line and piece == " " else piece

    def _wrap(self, tail: str = "") -> None:
        self.lines.append(f"{self.line}{tail}\\")
        self.line = _INDENT

    def text(self) -> str:
        """Return all lines, without a final line end."""
        return "\n".join([*self.lines, self.line])
