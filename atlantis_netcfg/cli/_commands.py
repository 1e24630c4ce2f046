"""The commands by name. Only the module of the command that runs is imported (help imports the declarations of all)."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, NamedTuple

from atlantis_netcfg.core.errors import ExitCode, UsageError, nearest

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from atlantis_netcfg.cli._arguments import Arguments, CommandSpec


class LoadedCommand(NamedTuple):
    """A command of the table, imported."""

    command: CommandSpec
    run: Callable[[Arguments], ExitCode]
    """Do it; raises NetcfgError to fail."""


DEFAULT = "run"
"""The command of a line that begins with a word: `provision site=coastal` is `provision run site=coastal`."""

COMMANDS: Mapping[str, str] = {
    "run": "atlantis_netcfg.cli.runs:site",
    "init": "atlantis_netcfg.cli.inventory:init",
    "validate": "atlantis_netcfg.cli.declaration:validate",
    "adopt": "atlantis_netcfg.cli.adopt:adopt",
    "trust": "atlantis_netcfg.cli.adopt:trust",
    "backup": "atlantis_netcfg.cli.devices:backup",
    "drift": "atlantis_netcfg.cli.devices:drift",
    "links": "atlantis_netcfg.cli.links:links",
    "prove": "atlantis_netcfg.cli.links:prove",
    "verify": "atlantis_netcfg.cli.devices:verify",
    "dds": "atlantis_netcfg.cli.declaration:dds",
    "check": "atlantis_netcfg.cli.checklist:check",
    "report list": "atlantis_netcfg.cli.checklist:report_list",
    "report show": "atlantis_netcfg.cli.checklist:report_show",
    "report verify": "atlantis_netcfg.cli.checklist:report_verify",
    "runs": "atlantis_netcfg.cli.runs:runs",
    "resume": "atlantis_netcfg.cli.runs:resume",
    "rollback": "atlantis_netcfg.cli.runs:rollback",
    "restore": "atlantis_netcfg.cli.devices:restore",
    "upgrade": "atlantis_netcfg.cli.devices:upgrade",
    "image": "atlantis_netcfg.cli.media:image",
    "bundle": "atlantis_netcfg.cli.media:bundle",
    "vpn init": "atlantis_netcfg.cli.vpn.authority:vpn_init",
    "vpn onboard": "atlantis_netcfg.cli.vpn.members:vpn_onboard",
    "vpn list": "atlantis_netcfg.cli.vpn.authority:vpn_list",
    "vpn show": "atlantis_netcfg.cli.vpn.authority:vpn_show",
    "vpn renew": "atlantis_netcfg.cli.vpn.members:vpn_renew",
    "vpn revoke": "atlantis_netcfg.cli.vpn.members:vpn_revoke",
    "vpn sync": "atlantis_netcfg.cli.vpn.network:vpn_sync",
    "vpn status": "atlantis_netcfg.cli.vpn.network:vpn_status",
    "vpn audit": "atlantis_netcfg.cli.vpn.authority:vpn_audit",
    "vpn accept": "atlantis_netcfg.cli.vpn.members:vpn_accept",
    "vpn install": "atlantis_netcfg.cli.vpn.network:vpn_install",
    "version": "atlantis_netcfg.cli.help:version",
    "help": "atlantis_netcfg.cli.help:help",
}
"""Name -> module and its entry in it, in the order of the help; a name of two words is typed as two words."""


def load(name: str, table: Mapping[str, str]) -> LoadedCommand:
    """Import the module of a command; `module:name` has the declaration `NAME` and the function `run_name`."""
    module, _, entry = table[name].partition(":")
    imported = import_module(module)
    return LoadedCommand(getattr(imported, entry.upper()), getattr(imported, f"run_{entry}"))


def choose(typed: Sequence[str], table: Mapping[str, str]) -> tuple[str, list[str]]:
    """Which command a line means, and what is left for it; UsageError when the first word is no command."""
    places = [place for place, argument in enumerate(typed) if not argument.startswith("-")]
    for length in range(len(places), 0, -1):
        name = " ".join(typed[place] for place in places[:length])
        if name in table:
            return name, [argument for place, argument in enumerate(typed) if place not in places[:length]]
    if not places or _means_default(typed, places[0], table):
        return _default(typed, table)
    raise _no_such_command([typed[place] for place in places], table)


def _means_default(typed: Sequence[str], first: int, table: Mapping[str, str]) -> bool:
    """Also where `site=coastal` was meant and `site = coastal` or `--site coastal` was typed."""
    if "=" in typed[first]:
        return True
    words = [word.name for word in load(DEFAULT, table).command.words]
    return typed[first] in words or (first > 0 and typed[first - 1].lstrip("-") in words)


def _default(typed: Sequence[str], table: Mapping[str, str]) -> tuple[str, list[str]]:
    for argument in typed:
        if argument in table and argument != DEFAULT:
            hint = " ".join(["provision", argument, *(other for other in typed if other != argument)])
            raise UsageError(f"`{argument}` is a command: put it before its words", hint=f"type `{hint}`")
    return DEFAULT, list(typed)


def _no_such_command(words: Sequence[str], table: Mapping[str, str]) -> UsageError:
    longer = [name for name in table if name.startswith(f"{words[0]} ")]
    near = nearest(" ".join(words[:2]), longer) or nearest(words[0], table)
    if longer and (near not in longer or len(words) == 1):
        hint = f"`{words[0]}` is followed by: {', '.join(name.removeprefix(words[0] + ' ') for name in longer)}"
    elif near is not None:
        hint = f"did you mean `provision {near}`?"
    else:
        hint = f"there are: {', '.join(table)}"
    return UsageError(f"unknown command `{' '.join(words[:2] if longer else words[:1])}`", hint=hint)
