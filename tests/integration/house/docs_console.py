"""What the docs say that a console shows: ```console blocks, as commands with exit codes and output.

A line `$ COMMAND` is a command; the lines below it are what it prints, both streams together. `…` stands for any
text within a line, and alone on a line for any number of lines. A command without lines below it may print anything.
A comment right above a block says what else holds:

    <!-- exit: 2 -->               the exit code, or one for each command of the block: `exit: 0 2`
    <!-- output: example -->       the output depends on the machine: shown, not compared
    <!-- not executed: REASON -->  the block is not run; the reason is for the reader of the source

A table right below a block says what its last command asks and what is typed: the answer in back-ticks, or Enter alone.

    | It asks | You type, then Enter |
    |---|---|
    | Your name | `A. Technician` |
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import dropwhile, takewhile
from pathlib import Path

_DIRECTIVE = re.compile(r"\b(exit|output|not executed): *([^;]+?) *(?:;|-->)")
_ANYTHING = "…"
_HEADS = ("| It asks |", "| Pergunta |")
_COLUMNS = 2


@dataclass(frozen=True)
class Shown:
    """One command as a page shows it."""

    place: str
    command: str
    exit: int
    output: str
    compared: bool
    answers: tuple[tuple[str, str], ...] = ()
    """What it asks, and what is typed."""

    def agrees(self, printed: str) -> bool:
        """Whether what was printed is what the page shows."""
        if not self.compared or not self.output:
            return True
        lines = ["(?:.*\n)*?" if line == _ANYTHING else f"{_line(line)}\n" for line in self.output.splitlines()]
        return re.fullmatch("".join(lines), "".join(f"{line.rstrip()}\n" for line in printed.splitlines())) is not None


def _line(shown: str) -> str:
    """Also over more than one line: where `…` stands for a long name, a terminal wraps behind it."""
    return r"[\s\S]*?".join(re.escape(part).replace(r"\ ", r"\s") for part in shown.rstrip().split(_ANYTHING))


def shown(page: Path) -> list[Shown]:
    """The commands of a page, in its order. ValueError where a block cannot be understood."""
    found: list[Shown] = []
    for place, directives, lines, table in _blocks(page):
        commands = _commands(place, directives, lines)
        if commands and table:
            commands[-1] = replace(commands[-1], answers=tuple(_answer(place, row) for row in table))
        found.extend(commands)
    return found


def _answer(place: str, row: str) -> tuple[str, str]:
    """Of a row of a table: the question, and what is typed."""
    cells = [cell.strip() for cell in row.strip("| ").split(" | ")]
    if len(cells) != _COLUMNS:
        raise ValueError(f"{place}: a row below the block is not a question and an answer: {row}")
    typed = re.search(r"`([^`]+)`", cells[1])
    return cells[0], typed[1] if typed is not None else ""


def _blocks(page: Path) -> Iterator[tuple[str, dict[str, str], list[str], list[str]]]:
    """Each block: where it stands, what the comment above says, its lines, and the rows of the table below it."""
    lines = page.read_text(encoding="utf-8").splitlines()
    above, block, place = "", None, ""
    for number, line in enumerate(lines, 1):
        if block is None and line == "```console":
            block, place = list[str](), f"{page.name}:{number}"
        elif block is not None and line == "```":
            directives = dict(_DIRECTIVE.findall(above)) if above.startswith("<!--") else {}
            if above.startswith("<!--") and not directives:
                raise ValueError(f"{place}: the comment above says no known step: {above}")
            yield place, directives, block, _table(lines[number:])
            block, above = None, ""
        elif block is not None:
            block.append(line)
        elif line.strip():
            above = line.strip()
    if block is not None:
        raise ValueError(f"{place}: the block has no end")


def _table(below: list[str]) -> list[str]:
    """The rows of questions right below a block; none where something else stands there."""
    rows = list(takewhile(lambda line: line.startswith("|"), dropwhile(lambda line: not line.strip(), below)))
    return rows[2:] if rows and rows[0].startswith(_HEADS) else []


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
