"""Commands that stand in for the real ones where the frame itself is tested."""

import sys
from collections.abc import Callable
from types import ModuleType

import pytest

from atlantis_netcfg.cli.base.syntax import JSON, VERBOSE, Arguments, CommandSpec, Flag, Word
from atlantis_netcfg.core.errors import ExitCode

RUN = CommandSpec(
    "run",
    "change a site",
    words=(
        Word("site", "the site to change", is_required=True, example="coastal"),
        Word("device", "these devices only", many=True, example="router"),
        Word("bearer", "the link in use", choices=("ptp", "lte", "satellite")),
    ),
    flags=(
        Flag("plan", "stop after planning", harmless=True),
        Flag("keep", "keep the run there", takes="DIR"),
        JSON,
        VERBOSE,
    ),
    details="Nothing is changed with --plan.",
    changes=True,
)
SHOW = CommandSpec("show", "show a site", words=(Word("site", "the site to show"),), flags=(JSON,))
ONBOARD = CommandSpec("vpn onboard", "let a partner in", words=(Word("partner", "the partner", is_required=True),))


class Table(dict[str, str]):
    """A table of stand-in commands; `runs` holds the arguments with which each was run."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, act: Callable[[Arguments], ExitCode]) -> None:
        super().__init__()
        self.runs: list[Arguments] = []
        for command in (RUN, SHOW, ONBOARD):
            entry = command.name.replace(" ", "_")
            module = ModuleType(f"stand_in_for_{entry}")
            vars(module).update({entry.upper(): command, f"run_{entry}": self._recorded(act)})
            monkeypatch.setitem(sys.modules, module.__name__, module)
            self[command.name] = f"{module.__name__}:{entry}"

    def _recorded(self, act: Callable[[Arguments], ExitCode]) -> Callable[[Arguments], ExitCode]:
        def run(arguments: Arguments) -> ExitCode:
            self.runs.append(arguments)
            return act(arguments)

        return run


def done(_arguments: Arguments) -> ExitCode:
    return ExitCode.DONE
