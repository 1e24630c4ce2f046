"""`provision completion bash|zsh|fish`: a script for completion of `provision` by Tab in that shell.

Arguments, flags, choices, sites, devices, vehicles, partners and runs are current: at every Tab the script calls
`provision complete`, so that it never becomes outdated.
"""

from __future__ import annotations

from pathlib import Path

from atlantis_netcfg.cli.base import syntax
from atlantis_netcfg.core.errors import ExitCode


def _print(shell: str) -> ExitCode:
    print(Path(__file__).with_name(f"{shell}.txt").read_text(encoding="utf-8"), end="")
    return ExitCode.DONE


COMPLETION_BASH = syntax.CommandSpec(
    "completion bash",
    "print a script that completes lines in bash",
    group=syntax.Group.LAPTOP,
    details="For this window: `source <(./provision completion bash)`. For all windows: docs/engineers/completion.md.",
)


def run_completion_bash(_arguments: syntax.Arguments) -> ExitCode:
    """Print the script for bash."""
    return _print("bash")


COMPLETION_ZSH = syntax.CommandSpec(
    "completion zsh",
    "print a script that completes lines in zsh",
    group=syntax.Group.LAPTOP,
    details="For this window: `source <(./provision completion zsh)`, after `compinit`.",
)


def run_completion_zsh(_arguments: syntax.Arguments) -> ExitCode:
    """Print the script for zsh."""
    return _print("zsh")


COMPLETION_FISH = syntax.CommandSpec(
    "completion fish",
    "print a script that completes lines in fish",
    group=syntax.Group.LAPTOP,
    details="For this window: `./provision completion fish | source`.",
)


def run_completion_fish(_arguments: syntax.Arguments) -> ExitCode:
    """Print the script for fish."""
    return _print("fish")
