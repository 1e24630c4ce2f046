"""The commands by name. Only the module of the command that runs is imported (help imports the declarations of all)."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, cast

from atlantis_netcfg.cli._parse import nearest
from atlantis_netcfg.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from atlantis_netcfg.cli._arguments import CommandModule

__all__ = ["COMMANDS", "DEFAULT", "choose", "load"]

DEFAULT = "run"
"""The command of a line that begins with a word: `provision site=coastal` is `provision run site=coastal`."""

COMMANDS: Mapping[str, str] = {
    "help": "atlantis_netcfg.cli.help",
    "version": "atlantis_netcfg.cli.version",
}
"""Name -> module, in the order of the help; a name of two words is typed as two words."""


def load(name: str, table: Mapping[str, str]) -> CommandModule:
    """The module of a command."""
    return cast("CommandModule", import_module(table[name]))


def choose(typed: Sequence[str], table: Mapping[str, str]) -> tuple[str, list[str]]:
    """Which command a line means, and what is left for it; UsageError when the first word is no command."""
    places = [place for place, argument in enumerate(typed) if not argument.startswith("-")]
    if not places or "=" in typed[places[0]]:
        return _default(typed, table)
    for length in range(len(places), 0, -1):
        name = " ".join(typed[place] for place in places[:length])
        if name in table:
            return name, [argument for place, argument in enumerate(typed) if place not in places[:length]]
    raise _no_such_command(typed[places[0]], table)


def _default(typed: Sequence[str], table: Mapping[str, str]) -> tuple[str, list[str]]:
    for argument in typed:
        if argument in table and argument != DEFAULT:
            hint = " ".join(["provision", argument, *(other for other in typed if other != argument)])
            raise UsageError(f"`{argument}`: a command comes first", hint=f"type `{hint}`")
    return DEFAULT, list(typed)


def _no_such_command(name: str, table: Mapping[str, str]) -> UsageError:
    near = nearest(name, table)
    hint = f"did you mean `provision {near}`?" if near else f"there are: {', '.join(table)}"
    return UsageError(f"`{name}` is no command of provision", hint=hint)
