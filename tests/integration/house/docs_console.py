"""What the docs say that a console shows: ```console blocks, as commands with exit codes and output.

A line `$ COMMAND` is a command; the lines below it are what it prints, both streams together. `…` stands for any
text within a line, and alone on a line for any number of lines. A command without lines below it may print anything.
A comment right above a block says what else holds:

    <!-- exit: 2 -->               the exit code, or one for each command of the block: `exit: 0 2`
    <!-- output: example -->       the output depends on the machine: shown, not compared
    <!-- not executed: REASON -->  the block is not run; the reason is for the reader of the source
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_DIRECTIVE = re.compile(r"\b(exit|output|not executed): *([^;]+?) *(?:;|-->)")
_ANYTHING = "…"


@dataclass(frozen=True)
class Shown:
    """One command as a page shows it."""

    place: str
    command: str
    exit: int
    output: str
    compared: bool

    def agrees(self, printed: str) -> bool:
        """Whether what was printed is what the page shows."""
        if not self.compared or not self.output:
            return True
        lines = ["(?:.*\n)*?" if line == _ANYTHING else f"{_line(line)}\n" for line in self.output.splitlines()]
        return re.fullmatch("".join(lines), "".join(f"{line.rstrip()}\n" for line in printed.splitlines())) is not None


def _line(shown: str) -> str:
    return ".*".join(re.escape(part) for part in shown.rstrip().split(_ANYTHING))


def shown(page: Path) -> list[Shown]:
    """The commands of a page, in its order. ValueError where a block cannot be understood."""
    return [command for place, directives, lines in _blocks(page) for command in _commands(place, directives, lines)]


def _blocks(page: Path) -> Iterator[tuple[str, dict[str, str], list[str]]]:
    above, block, place = "", None, ""
    for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), 1):
        if block is None and line == "```console":
            block, place = list[str](), f"{page.name}:{number}"
        elif block is not None and line == "```":
            directives = dict(_DIRECTIVE.findall(above)) if above.startswith("<!--") else {}
            if above.startswith("<!--") and not directives:
                raise ValueError(f"{place}: the comment above says nothing that is known: {above}")
            yield place, directives, block
            block, above = None, ""
        elif block is not None:
            block.append(line)
        elif line.strip():
            above = line.strip()
    if block is not None:
        raise ValueError(f"{place}: the block has no end")


def _commands(place: str, directives: dict[str, str], lines: list[str]) -> list[Shown]:
    if "not executed" in directives:
        return []
    found: list[tuple[str, list[str]]] = []
    for line in lines:
        if found and found[-1][0].endswith("\\") and not found[-1][1]:
            found[-1] = (f"{found[-1][0][:-1]}{line.strip()}", [])
        elif line.startswith("$ "):
            found.append((line[2:], []))
        elif found:
            found[-1][1].append(line)
        else:
            raise ValueError(f"{place}: the block begins without a command")
    codes = [int(code) for code in directives.get("exit", "0").split()]
    if len(codes) not in (1, len(found)):
        raise ValueError(f"{place}: {len(codes)} exit codes for {len(found)} commands")
    compared = directives.get("output") != "example"
    return [
        Shown(place, command, code, "\n".join(output), compared)
        for (command, output), code in zip(found, codes * (len(found) if len(codes) == 1 else 1), strict=True)
    ]
