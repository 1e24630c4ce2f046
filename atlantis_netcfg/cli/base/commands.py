"""The commands by name. Only the module of the command that runs is imported (help imports all definitions)."""

from __future__ import annotations

import shlex
from importlib import import_module
from typing import TYPE_CHECKING, NamedTuple

from atlantis_netcfg.core import errors

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from atlantis_netcfg.cli.base.syntax import Arguments, CommandSpec


class LoadedCommand(NamedTuple):
    """An imported command."""

    command: CommandSpec
    run: Callable[[Arguments], errors.ExitCode]
    """Runs the command; raises NetcfgError to fail."""


DEFAULT = "run"
"""Command of a line that begins with an argument: `provision site=coastal` is `provision run site=coastal`."""

COMMANDS: Mapping[str, str] = {
    "run": "atlantis_netcfg.cli.runs:site",
    "links": "atlantis_netcfg.cli.links:links",
    "check": "atlantis_netcfg.cli.checklist:check",
    "drift": "atlantis_netcfg.cli.devices:drift",
    "runs": "atlantis_netcfg.cli.runs:runs",
    "apply": "atlantis_netcfg.cli.plans:apply",
    "init": "atlantis_netcfg.cli.inventory:init",
    "validate": "atlantis_netcfg.cli.declaration:validate",
    "doctor": "atlantis_netcfg.cli.laptop:doctor",
    "adopt": "atlantis_netcfg.cli.adopt:adopt",
    "trust": "atlantis_netcfg.cli.adopt:trust",
    "backup": "atlantis_netcfg.cli.devices:backup",
    "asbuilt": "atlantis_netcfg.cli.asbuilt:asbuilt",
    "use": "atlantis_netcfg.cli.use:use",
    "prove": "atlantis_netcfg.cli.links:prove",
    "qualify": "atlantis_netcfg.cli.qualify:qualify",
    "survey": "atlantis_netcfg.cli.survey:survey",
    "retrieve": "atlantis_netcfg.cli.retrieve:retrieve",
    "qualify show": "atlantis_netcfg.cli.qualify_records:qualify_show",
    "qualify compare": "atlantis_netcfg.cli.qualify_records:qualify_compare",
    "qualify history": "atlantis_netcfg.cli.qualify_records:qualify_history",
    "verify": "atlantis_netcfg.cli.devices:verify",
    "dds": "atlantis_netcfg.cli.declaration:dds",
    "fit": "atlantis_netcfg.cli.fit:fit",
    "robot validate": "atlantis_netcfg.cli.robot:robot_validate",
    "robot discover": "atlantis_netcfg.cli.robot:robot_discover",
    "robot mock": "atlantis_netcfg.cli.robot:robot_mock",
    "report list": "atlantis_netcfg.cli.checklist:report_list",
    "report show": "atlantis_netcfg.cli.checklist:report_show",
    "report verify": "atlantis_netcfg.cli.checklist:report_verify",
    "resume": "atlantis_netcfg.cli.recovery.resume:resume",
    "rollback": "atlantis_netcfg.cli.recovery.rollback:rollback",
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
    "guest add": "atlantis_netcfg.cli.guest:guest_add",
    "guest end": "atlantis_netcfg.cli.guest:guest_end",
    "completion bash": "atlantis_netcfg.cli.shell.completion:completion_bash",
    "completion zsh": "atlantis_netcfg.cli.shell.completion:completion_zsh",
    "completion fish": "atlantis_netcfg.cli.shell.completion:completion_fish",
    "man": "atlantis_netcfg.cli.shell.manual:man",
    "version": "atlantis_netcfg.cli.help:version",
    "help": "atlantis_netcfg.cli.help:help",
}
"""Name -> module and its entry in it; a name of two words is typed as two words.

Help lists them by their groups, and in each group in this order."""


def load(name: str, table: Mapping[str, str]) -> LoadedCommand:
    """Import the module of a command; `module:name` has the definition `NAME` and the function `run_name`."""
    module, _, entry = table[name].partition(":")
    command_module = import_module(module)
    return LoadedCommand(getattr(command_module, entry.upper()), getattr(command_module, f"run_{entry}"))


def choose(command_line: Sequence[str], table: Mapping[str, str]) -> tuple[str, list[str]]:
    """Return the command of a line, and the other arguments; raises UsageError if there is no such command."""
    places = [place for place, argument in enumerate(command_line) if not argument.startswith("-")]
    for length in range(len(places), 0, -1):
        name = " ".join(command_line[place] for place in places[:length])
        if name in table:
            return name, [argument for place, argument in enumerate(command_line) if place not in places[:length]]
    if not places or _means_default(command_line, places[0], table):
        return _default(command_line, table)
    raise _no_such_command(command_line, places, table)


def _means_default(command_line: Sequence[str], first: int, table: Mapping[str, str]) -> bool:
    """Return whether the default command is meant, also for `site = coastal` or `--site coastal`."""
    if "=" in command_line[first]:
        return True
    words = [word.name for word in load(DEFAULT, table).command.words]
    return command_line[first] in words or (first > 0 and command_line[first - 1].lstrip("-") in words)


def _default(command_line: Sequence[str], table: Mapping[str, str]) -> tuple[str, list[str]]:
    for argument in command_line:
        if argument in table and argument != DEFAULT:
            hint = " ".join(["provision", argument, *(other for other in command_line if other != argument)])
            raise errors.UsageError(f"`{argument}` is a command: put it before its words", hint=f"type `{hint}`")
    return DEFAULT, list(command_line)


def _no_such_command(command_line: Sequence[str], places: Sequence[int], table: Mapping[str, str]) -> errors.UsageError:
    words = [command_line[place] for place in places]
    longer = [name for name in table if name.startswith(f"{words[0]} ")]
    near = errors.nearest(" ".join(words[:2]), longer) or errors.nearest(words[0], table)
    if longer and (near not in longer or len(words) == 1):
        hint = f"`{words[0]}` is followed by: {', '.join(name.removeprefix(words[0] + ' ') for name in longer)}"
    elif (line := _meant_line(command_line, places[0], near, table)) is not None:
        hint = f"did you mean `{line}`?"
    else:
        hint = "`provision --help` lists the commands; a site is typed as `site=NAME`"
    return errors.UsageError(f"unknown command `{' '.join(words[:2] if longer else words[:1])}`", hint=hint)


def _meant_line(command_line: Sequence[str], first: int, near: str | None, table: Mapping[str, str]) -> str | None:
    """Return a suggestion if the first word is a site, a flag of the default command, or nearly a command."""
    from atlantis_netcfg.cli.base.inventory_names import Values, folder_of, names

    sites = names(folder_of(command_line), Values.SITE)
    word, flags = command_line[first], [flag.name for flag in load(DEFAULT, table).command.flags]
    rest = [f"site={other}" if other in sites else other for place, other in enumerate(command_line) if place != first]
    if word in sites:
        command = next((name for name in (" ".join(rest[:2]), *rest[:1]) if name in table), None)
        if command is None:
            return shlex.join(["provision", f"site={word}", *rest])
        takes_site = load(command, table).command.word("site") is not None
        return shlex.join(["provision", *rest, *([f"site={word}"] if takes_site else [])])
    flag = word if word in flags else None if near else errors.nearest(word, flags)
    if flag is not None:
        site_words = [] if any(other.startswith("site=") for other in rest) else ["site=NAME"]
        return shlex.join(["provision", *site_words, *rest, f"--{flag}"])
    if near is not None:
        return f"provision {near}"
    site = errors.nearest(word, sites)
    return None if site is None else shlex.join(["provision", f"site={site}", *rest])
