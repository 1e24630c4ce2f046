"""`provision complete WORD…`: candidates for the last word of a command line, one per line.

The scripts of `provision help completion` call it at every Tab; a line is a candidate, two spaces, and its meaning.
Errors (an invalid inventory, an unreadable state folder) only shorten the list, and are never printed into the user's
command line. Nothing is contacted, validated or created.
"""

from __future__ import annotations

import re
from contextlib import suppress
from typing import TYPE_CHECKING

from atlantis_netcfg.cli.base import inventory_names, syntax
from atlantis_netcfg.cli.base.commands import DEFAULT, load, summary_of
from atlantis_netcfg.core import language
from atlantis_netcfg.core.errors import ExitCode, NetcfgError
from atlantis_netcfg.core.language import translate

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

Candidate = tuple[str, str]
"""A word, and what it means."""


_GAP = "  "
"""Separator of both: no candidate holds a space, and `core/printable` escapes tabs."""
_NAME = re.compile(r"[\w.:@+-]+")
"""Text that a shell takes unquoted; a name with any other character is not offered."""


def answer(command_line: Sequence[str], table: Mapping[str, str]) -> ExitCode:
    """Print the candidates for the last word of a line."""
    with suppress(NetcfgError, OSError, ValueError):
        language.use(language.of_environment())
        print("".join(f"{value}{_GAP}{meaning}\n" for value, meaning in candidates(command_line, table)), end="")
    return ExitCode.DONE


def candidates(command_line: Sequence[str], table: Mapping[str, str]) -> list[Candidate]:
    """Return the candidates for the last word; `command_line` is what follows `provision`."""
    *before, current = command_line or [""]
    return [
        (value, meaning) for value, meaning in _list_candidates(before, current, table) if value.startswith(current)
    ]


def _list_candidates(before: Sequence[str], current: str, table: Mapping[str, str]) -> Iterator[Candidate]:
    if before and before[-1] == "--lang":
        yield from ((each.value, "") for each in language.Language)
        return
    pairs = zip(("", *before), before, strict=False)
    bare = [word for previous, word in pairs if previous != "--lang" and word[:1] != "-" and "=" not in word]
    name = next((candidate for length in (2, 1) if (candidate := " ".join(bare[:length])) in table), None)
    if name is not None:
        if bare == name.split() and "=" not in current:
            yield from _commands(bare, table)
        yield from _of_command(load(name, table).command, before, current)
        return
    if not any("=" in word for word in (*before, current)):
        yield from _commands(bare, table)
    if not bare:
        yield from _of_command(load(DEFAULT, table).command, before, current)


def _commands(bare: Sequence[str], table: Mapping[str, str]) -> Iterator[Candidate]:
    """Yield the commands, word by word: `vpn`, and after it `init`, `onboard` and the others."""
    meanings: dict[str, str] = {}
    for name in table:
        words = name.split()
        if words[: len(bare)] != list(bare) or len(words) == len(bare):
            continue
        summary = load(name, table).command.summary if bare else summary_of(words[0], table)
        meanings.setdefault(words[len(bare)], translate(summary))
    yield from meanings.items()


def _of_command(command: syntax.CommandSpec, before: Sequence[str], current: str) -> Iterator[Candidate]:
    """Yield the arguments and flags not given yet, or the values of the argument being typed."""
    taking = {f"--{flag.name}" for flag in command.flags if flag.takes}
    if before and before[-1] in taking:
        return
    name, equals, value = current.partition("=")
    if equals:
        word = command.word(name)
        if word is not None:
            yield from _values(word, value, before)
        return
    used_names = {argument.partition("=")[0] for argument in before}
    words = [
        (f"{word.name}=", translate(word.help)) for word in command.words if word.many or word.name not in used_names
    ]
    yield from words
    if current.startswith("-") or not words:
        flags = ((f"--{flag.name}", translate(flag.help)) for flag in (*command.flags, *syntax.FRAME))
        yield from ((flag, text) for flag, text in flags if flag not in used_names)


def _values(word: syntax.Word, value: str, before: Sequence[str]) -> Iterator[Candidate]:
    """Yield the values of an argument; in a list only the last is completed, without values already used."""
    head = value.rpartition(",")[0] if word.many else ""
    used_values = head.split(",")
    start = f"{word.name}={head}," if head else f"{word.name}="
    for candidate, meaning in _value_candidates(word, before):
        if candidate not in used_values and _NAME.fullmatch(candidate):
            yield f"{start}{candidate}", meaning


def _value_candidates(word: syntax.Word, before: Sequence[str]) -> Iterator[Candidate]:
    yield from ((choice, "") for choice in word.choices)
    site = next((argument.partition("=")[2] for argument in before if argument.startswith("site=")), "")
    if word.value_kind in {inventory_names.Values.RUN, inventory_names.Values.RUN_OR_LATEST}:
        if word.value_kind is inventory_names.Values.RUN_OR_LATEST:
            yield "latest", translate("the newest with a saved state")
        yield from ((run, "") for run in _runs(site))
    elif word.value_kind is not None:
        yield from (
            (name, "") for name in inventory_names.names(inventory_names.folder_of(before), word.value_kind, site)
        )


def _runs(site: str) -> list[str]:
    """The runs of a site on this laptop, newest first: the folders of `atlantis_netcfg/runs`."""
    from atlantis_netcfg.core import paths

    state = paths.state_place() / "real"
    return sorted((run.name for run in state.glob(f"{site or '*'}/runs/*")), reverse=True)
