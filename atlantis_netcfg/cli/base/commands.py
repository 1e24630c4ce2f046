"""The commands by name. Only the module of the command that runs is imported (help imports all definitions)."""

from __future__ import annotations

import shlex
from importlib import import_module
from typing import TYPE_CHECKING, NamedTuple

from atlantis_netcfg.core import errors
from atlantis_netcfg.core.messages import alternatives, arg, join, msg

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

HEADS: Mapping[str, str] = {
    "device": "adopt, trust, back up, restore, upgrade or verify a device",
    "measure": "measure links, 4G coverage and the satellite allow-list",
    "robot": "check, discover, add or simulate robots; copy recordings",
    "vpn": "members, certificates and server of the VPN",
    "gateway": "write gateway cards; pack downloads for offline use",
    "report": "checklists, drift, as-built records and past runs",
    "inventory": "create or check an inventory; check this laptop",
}
"""First words that are no command by themselves -> their line of the overview."""

_CLI = "atlantis_netcfg.cli"
COMMANDS: Mapping[str, str] = {
    "run": f"{_CLI}.runs:site",
    "plan": f"{_CLI}.runs:plan",
    "plan apply": f"{_CLI}.plans:apply",
    "check": f"{_CLI}.checklist:check",
    "links": f"{_CLI}.links:links",
    "links use": f"{_CLI}.use:use",
    "recover": f"{_CLI}.recovery.recover:recover",
    "recover resume": f"{_CLI}.recovery.resume:resume",
    "recover rollback": f"{_CLI}.recovery.rollback:rollback",
    "device adopt": f"{_CLI}.adopt:adopt",
    "device trust": f"{_CLI}.adopt:trust",
    "device backup": f"{_CLI}.devices:backup",
    "device restore": f"{_CLI}.devices:restore",
    "device upgrade": f"{_CLI}.devices:upgrade",
    "device verify": f"{_CLI}.devices:verify",
    "measure link": f"{_CLI}.qualify:qualify",
    "measure show": f"{_CLI}.qualify_records:qualify_show",
    "measure compare": f"{_CLI}.qualify_records:qualify_compare",
    "measure history": f"{_CLI}.qualify_records:qualify_history",
    "measure coverage": f"{_CLI}.survey:survey",
    "measure satellite": f"{_CLI}.links:prove",
    "measure fit": f"{_CLI}.fit:fit",
    "robot validate": f"{_CLI}.robot:robot_validate",
    "robot discover": f"{_CLI}.robot:robot_discover",
    "robot mock": f"{_CLI}.robot:robot_mock",
    "robot invite": f"{_CLI}.guest:guest_add",
    "robot dismiss": f"{_CLI}.guest:guest_end",
    "robot dds": f"{_CLI}.declaration:dds",
    "robot retrieve": f"{_CLI}.retrieve:retrieve",
    "vpn init": f"{_CLI}.vpn.authority:vpn_init",
    "vpn onboard": f"{_CLI}.vpn.members:vpn_onboard",
    "vpn list": f"{_CLI}.vpn.authority:vpn_list",
    "vpn show": f"{_CLI}.vpn.authority:vpn_show",
    "vpn renew": f"{_CLI}.vpn.members:vpn_renew",
    "vpn revoke": f"{_CLI}.vpn.members:vpn_revoke",
    "vpn sync": f"{_CLI}.vpn.network:vpn_sync",
    "vpn status": f"{_CLI}.vpn.network:vpn_status",
    "vpn audit": f"{_CLI}.vpn.authority:vpn_audit",
    "vpn accept": f"{_CLI}.vpn.members:vpn_accept",
    "vpn install": f"{_CLI}.vpn.network:vpn_install",
    "gateway image": f"{_CLI}.media:image",
    "gateway bundle": f"{_CLI}.media:bundle",
    "report checklists": f"{_CLI}.checklist:report_list",
    "report show": f"{_CLI}.checklist:report_show",
    "report verify": f"{_CLI}.checklist:report_verify",
    "report drift": f"{_CLI}.devices:drift",
    "report as-built": f"{_CLI}.asbuilt:asbuilt",
    "report runs": f"{_CLI}.runs:runs",
    "inventory init": f"{_CLI}.inventory:init",
    "inventory validate": f"{_CLI}.declaration:validate",
    "inventory doctor": f"{_CLI}.laptop:doctor",
    "help": f"{_CLI}.help:help",
    "help exit-codes": f"{_CLI}.help:exit_codes",
    "help version": f"{_CLI}.help:version",
    "help man": f"{_CLI}.shell.manual:man",
    "help completion": f"{_CLI}.shell.completion:completion",
}
"""Name -> module and its entry in it; a name of two words is typed as two words. Help lists them in this order."""

_OTHER_NAMES = {
    "prove": "measure satellite",
    "qualify": "measure link",
    "survey": "measure coverage",
    "guest": "robot invite",
    "asbuilt": "report as-built",
}
"""What people type that is no command's last word -> the command."""


def summary_of(word: str, table: Mapping[str, str]) -> str:
    """Return the line of the overview for a command's first word."""
    return HEADS[word] if word in HEADS else load(word, table).command.summary


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
    words = [argument for argument in command_line if "=" not in argument and not argument.startswith("-")]
    for name in (" ".join(words[:2]), *words):
        if name in table and name != DEFAULT:
            others = (argument for argument in command_line if argument not in name.split())
            hint = shlex.join(["provision", *name.split(), *others])
            raise errors.UsageError(
                f"`{arg(name)}` is a command: put it before its arguments", hint=f"type `{arg(hint)}`"
            )
    return DEFAULT, list(command_line)


def _no_such_command(command_line: Sequence[str], places: Sequence[int], table: Mapping[str, str]) -> errors.UsageError:
    words = [command_line[place] for place in places]
    if names := _possible_names(words[0], table):
        rest = [argument for argument in command_line if argument != words[0]]
        lines = [shlex.join(["provision", *name.split(), *rest]) for name in names]
        return errors.UsageError(
            f"unknown command `{arg(words[0])}`", hint=f"type {arg(alternatives(f'`{line}`' for line in lines))}"
        )
    longer = [name for name in table if name.startswith(f"{words[0]} ")]
    near = errors.nearest(" ".join(words[:2]), longer) or errors.nearest(words[0], table)
    if near is None and (second := errors.nearest(words[0], [name.split()[-1] for name in table])):
        near = _possible_names(second, table)[0]
    if longer and (near not in longer or len(words) == 1):
        hint = msg(
            f"`{arg(words[0])}` must be followed by: "
            f"{arg(join(', ', (name.removeprefix(words[0] + ' ') for name in longer)))}"
        )
    elif (line := _meant_line(command_line, places[0], near, table)) is not None:
        hint = msg(f"did you mean `{arg(line)}`?")
    else:
        hint = "`provision --help` lists the commands; give a site as `site=NAME`"
    return errors.UsageError(f"unknown command `{arg(' '.join(words[:2] if longer else words[:1]))}`", hint=hint)


def _possible_names(word: str, table: Mapping[str, str]) -> list[str]:
    """Return the commands that this word alone could mean: those whose second word it is."""
    if (name := _OTHER_NAMES.get(word)) in table:
        return [str(name)]
    return [] if word in HEADS else [name for name in table if name.endswith(f" {word}")]


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
