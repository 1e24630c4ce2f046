"""`provision recover`: show what earlier runs have left open, and offer to continue or undo it."""

from __future__ import annotations

import shlex
from typing import TYPE_CHECKING

from atlantis_netcfg.cli.base import syntax
from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.language import as_typed, translate
from atlantis_netcfg.core.messages import arg, join, msg

if TYPE_CHECKING:
    from atlantis_netcfg.runs import Run, Store

RECOVER = syntax.CommandSpec(
    "recover",
    "show unfinished runs; resume a run or roll it back",
    words=(syntax.Word("site", "only the runs of this site", example="coastal"),),
    flags=(syntax.Flag("rehearse", "list rehearsals instead of real runs"), syntax.JSON),
    details=(
        "Reads data stored on this computer; no device is contacted. On a terminal it asks which command to run. "
        "`provision recover resume` finds runs that another computer left unfinished on the devices of a site."
    ),
    changes=True,
    plays=True,
)


def run_recover(arguments: syntax.Arguments) -> ExitCode:
    """List the unfinished runs with the commands that continue or undo them; run the one that is chosen."""
    from atlantis_netcfg.cli.base.output import json_text
    from atlantis_netcfg.cli.runs import sites_with_runs
    from atlantis_netcfg.core import paths
    from atlantis_netcfg.runs import Store

    store = Store(paths.state_dir(), is_rehearsal=arguments.flag("rehearse"))
    sites = sites_with_runs(store, arguments.optional("site"))
    unfinished_runs = [(name, run) for name in sites for run in store.unfinished_runs(name)]
    choices = [command for name, run in unfinished_runs for command in _commands(name, run)]
    if arguments.flag("json"):
        rows = [
            {"site": name, "run": run.id, "devices": list(run.unsettled_devices), "commands": _commands(name, run)}
            for name, run in unfinished_runs
        ]
        print(json_text({"exit": int(ExitCode.DONE), "errors": [], "unfinished": rows}))
        return ExitCode.DONE
    for name, run in unfinished_runs:
        print(translate(f"{arg(name)}: run {arg(run.id)} is unfinished on {arg(join(', ', run.unsettled_devices))}"))
    if not choices:
        _print_nothing(store, sites)
        return ExitCode.DONE
    for number, command in enumerate(choices, 1):
        print(as_typed(msg(f"  {arg(number)}: {arg(command)}")))
    return _choose(choices)


def _commands(site: str, run: Run) -> list[str]:
    """Return the command that continues a run and, if it saved a state, the one that undoes it."""
    resume = run.next_command
    if not any(run.before(device) is not None for device in run.unsettled_devices):
        return [resume]
    options = [word for word in shlex.split(resume) if word.startswith("inventory=") or word == "--rehearse"]
    return [resume, shlex.join(["provision", "recover", "rollback", f"site={site}", f"run={run.id}", *options])]


def _print_nothing(store: Store, sites: tuple[str, ...]) -> None:
    print(translate("no unfinished runs"))
    for site in sites:
        if any(run.before(device) is not None for run in store.runs(site) for device in run.outcomes):
            more = " --rehearse" if store.is_rehearsal else ""
            print(
                translate(
                    f"  to undo the newest run: `provision recover rollback site={arg(site)} run=latest{arg(more)}`"
                )
            )


def _choose(choices: list[str]) -> ExitCode:
    """Ask which command to run, and run it; without a terminal, or without a choice, nothing is done."""
    import sys

    from atlantis_netcfg.cli.base.commands import COMMANDS, choose, load
    from atlantis_netcfg.cli.base.consent import read_line

    if not sys.stdin.isatty():
        return ExitCode.DONE
    answer = (read_line(f"{translate(f'Which one? 1 to {arg(len(choices))}, or Enter for none:')} ") or "").strip()
    if not answer.isdecimal() or not 1 <= int(answer) <= len(choices):
        return ExitCode.DONE
    name, words = choose(shlex.split(choices[int(answer) - 1])[1:], COMMANDS)
    entry = load(name, COMMANDS)
    return entry.run(syntax.parse(entry.command, words))
