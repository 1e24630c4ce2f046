"""What was said to a router, cut into menu, command and argument names: by rules of its own, not by our parser's."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from holes import known
from trees import Tree, parts

_FOLDED = re.compile(r"\\\r?\n *")
_BLOCK = re.compile(r"\s*(?::do \{|\} on-error=\{|\}|)\s*")
"""Lines that only open or close a block."""
_WITHIN = re.compile(r"(?:[a-z-]+=)?\{(.*)\}", re.DOTALL)
_NAME = re.compile(r"!?([a-z][a-z0-9.-]*)(=|$)")
_OF_THE_API = {".proplist", ".tag"}
"""Words that the protocol adds to a command (manual, API)."""


@dataclass(frozen=True, slots=True)
class Said:
    """One command. `command` is empty where the words lead to nothing that the version has."""

    menu: str
    command: str
    names: frozenset[str]
    text: str

    def unknown(self, tree: Tree) -> frozenset[str]:
        """Names that the command does not take in that version and that are no known hole; all if there is none."""
        if known(self.menu, self.command):
            return frozenset()
        if not self.command or not tree.has_command(self.menu, self.command):
            return frozenset({self.text})
        strange = self.names - tree.arguments(self.menu, self.command)
        return frozenset(name for name in strange if not known(self.menu, self.command, name))


def sentence(words: Sequence[str]) -> Said:
    """Read a sentence of the API."""
    path = parts(words[0])
    names = {word[1:].partition("=")[0] for word in words[1:] if word.startswith("=")}
    if path[-1] in ("getall", "listen"):
        path[-1] = "print"
    own = frozenset("numbers" if name == ".id" else name.removeprefix("!") for name in names - _OF_THE_API)
    return Said("/" + "/".join(path[:-1]), path[-1], own, words[0])


def lines(text: str, tree: Tree) -> Iterator[Said]:
    """Read lines of the console: an export, a script, what was typed."""
    menu: list[str] = []
    for line in _FOLDED.sub("", text).splitlines():
        if _BLOCK.fullmatch(line) or line.lstrip().startswith("#"):
            continue
        for statement in _cut(line, ";"):
            words = tokens(statement)
            path, rest = _walked(words, menu, tree)
            if not rest:
                menu = path
                continue
            yield from _command(path, rest, statement, tree)


def tokens(line: str) -> list[str]:
    """Cut at spaces outside of quotes and brackets."""
    return _cut(line, " ")


def _cut(line: str, at: str) -> list[str]:
    found: list[str] = []
    word, depth, quoted, escaped = "", 0, False, False
    for sign in line.strip() + at:
        if quoted:
            quoted = sign != '"' or escaped
            escaped = sign == "\\" and not escaped
        elif sign == '"':
            quoted = True
        elif sign in "[({":
            depth += 1
        elif sign in "])}":
            depth -= 1
        elif sign == at and not depth:
            found += [word.strip()] if word.strip() else []
            word = ""
            continue
        word += sign
    return found


def _walked(words: list[str], menu: list[str], tree: Tree) -> tuple[list[str], list[str]]:
    """Follow words into menus; return where that leads, and the words from the first that is no menu on."""
    path, rest = ([] if words[0].startswith(("/", ":")) else list(menu)), list(words)
    while rest:
        steps = parts(rest[0].lstrip(":")) if "=" not in rest[0] and rest[0][0] not in '"[' else [rest[0]]
        taken = 0
        while taken < len(steps) and tree.kind([*path, *steps[: taken + 1]]) == "menu":
            taken += 1
        path = [*path, *steps[:taken]]
        if taken < len(steps):
            return path, [*steps[taken:], *rest[1:]]
        rest.pop(0)
    return path, rest


def _command(path: list[str], rest: list[str], line: str, tree: Tree) -> Iterator[Said]:
    command, *given = rest
    known = tree.arguments("/" + "/".join(path), command)
    names = set()
    for word in given:
        for inner in re.findall(r"\[\s*(.*?)\s*\]", word) if word.startswith("[") else ():
            yield from lines(f"/{'/'.join(path)} {inner}" if not inner.startswith((":", "/")) else inner, tree)
        if block := _WITHIN.fullmatch(word):
            yield from lines(block[1], tree)
        match = _NAME.match(word)
        if match and (match[2] or match[1] in known):
            names.add(match[1])
    if command == "find":
        names &= known
    yield Said("/" + "/".join(path), command if tree.kind([*path, command]) == "cmd" else "", frozenset(names), line)
