"""Export text to statements: what `export` of RouterOS 6 and 7 prints, and what a technician types in that style."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from atlantis_netcfg.rsc._arguments import Arguments, skip_space
from atlantis_netcfg.rsc._lines import LogicalLine, logical_lines
from atlantis_netcfg.rsc._model import Export, RscError, Statement
from atlantis_netcfg.rsc._words import VERBS

__all__ = ["parse"]

_PATH_WORD = re.compile(r"[a-z0-9][a-z0-9-]*(?:/[a-z0-9][a-z0-9-]*)*(?=[ \t]|$)")
_MENU_HINT = "open the menu first, as in:  /ip firewall filter"


def parse(text: str, source: str = "text") -> Export:
    """Read a whole export; `source` is what errors call the text. Raises RscError at the first mistake."""
    reader = _Reader()
    for line in logical_lines(text, source):
        reader.take(line)
    return reader.export()


@dataclass(slots=True)
class _Reader:
    """What is known so far: the menu in force and the comments that wait for their statement."""

    menu: str | None = None
    header: tuple[str, ...] | None = None
    comments: list[str] = field(default_factory=list)
    statements: list[Statement] = field(default_factory=list)
    menus: dict[str, None] = field(default_factory=dict)

    def take(self, line: LogicalLine) -> None:
        if line.is_comment:
            self.comments.append(line.text[1:].removeprefix(" ").rstrip())
            return
        self._end_header()
        if line.text.strip():
            self._command(line)

    def export(self) -> Export:
        self._end_header()
        return Export(self.header or (), tuple(self.statements), tuple(self.menus), tuple(self.comments))

    def _end_header(self) -> None:
        if self.header is None:
            self.header = tuple(self.comments)
            self.comments.clear()

    def _command(self, line: LogicalLine) -> None:
        menu, verb, offset = _path(line, self.menu)
        if verb is None:
            self._open(menu)
            return
        arguments = Arguments(line, offset, verb)
        arguments.read()
        self.menus.setdefault(menu)
        self.statements.append(
            Statement(
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
        if glued := line.text[arguments.end :]:
            self._open(_join("/", glued[1:].split()))

    def _open(self, menu: str) -> None:
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
    verb = next((word for word in words if word in VERBS), None)
    if verb is not None and verb != words[-1]:
        at = match.start() + match[0].index(verb)
        raise line.error(at, f"`{verb}` is a command, nothing stands below it", hint=f"put a space behind `{verb}`")
    return verb


def _join(menu: str, words: list[str]) -> str:
    return "/" + "/".join([*menu.strip("/").split("/"), *words]).strip("/")


def _not_a_command(line: LogicalLine, offset: int) -> RscError:
    if line.text.startswith((":", "{", "}", "$", "(", "[")):
        hint = "keep scripts in /system script, or leave the line out"
        return line.error(0, "this is a line of a script; only the lines of an export are understood here", hint=hint)
    word = line.text[offset:].split()
    found = word[0] if word else line.text.strip()
    return line.error(offset if word else 0, f"`{found}` is neither a menu nor a command", hint=_MENU_HINT)
