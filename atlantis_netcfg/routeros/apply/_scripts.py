"""Actions as console text with an acknowledgement after each, and the parser of a script's output."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.routeros.commands import console

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from atlantis_netcfg.routeros._types import Action

LIMIT = 60_000
"""Maximum bytes of one script. `/execute` takes 64 kB (manual, API and Scripting)."""

_ACKNOWLEDGEMENT = re.compile(r"ok (\d+)")


@dataclass(frozen=True, slots=True)
class Output:
    """Output of a script: the acknowledged actions, and all other lines."""

    acknowledged_numbers: tuple[int, ...]
    words: str


def lines(action: Action, menu: str | None) -> str:
    """Return the action's script lines; a menu line comes first if the script is not in the action's menu."""
    there = "" if action.menu == menu else f"{action.menu}\n"
    return f'{there}{console(action).removeprefix(f"{action.menu}/")}\n:put "ok {action.number}"\n'


def scripts(actions: Sequence[Action], limit: int = LIMIT) -> Iterator[tuple[str, tuple[Action, ...]]]:
    """Yield scripts of at most `limit` bytes each (or of one action), with their actions."""
    text: list[str] = []
    inside: list[Action] = []
    size = 0
    for action in actions:
        part = lines(action, inside[-1].menu if inside else None)
        if inside and size + len(part.encode()) > limit:
            yield "".join(text), tuple(inside)
            text, inside, size = [], [], 0
            part = lines(action, None)
        text.append(part)
        inside.append(action)
        size += len(part.encode())
    if inside:
        yield "".join(text), tuple(inside)


def action_at(actions: Sequence[Action], line: int) -> Action | None:
    """Return the action at a line (1-based) of the script made of these actions."""
    below, menu = 0, None
    for action in actions:
        below += lines(action, menu).count("\n")
        menu = action.menu
        if line <= below:
            return action
    return None


def output(text: str) -> Output:
    """Parse the output of a script."""
    acknowledged_numbers: list[int] = []
    words: list[str] = []
    for line in text.splitlines():
        match = _ACKNOWLEDGEMENT.fullmatch(line.strip())
        if match is not None:
            acknowledged_numbers.append(int(match[1]))
        elif line.strip():
            words.append(line.strip())
    return Output(tuple(acknowledged_numbers), " ".join(words))
