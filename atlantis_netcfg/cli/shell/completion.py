"""`provision completion bash|zsh|fish`: a script that lets Tab complete a line of `provision` in that shell.

Words, flags, choices, sites, devices, vehicles, partners and runs are those of the moment: at every Tab the script asks
`provision complete`, so that it never grows old.
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
    details="For this window: `source <(./provision completion bash)`. For every window see docs/completion.md.",
)


def run_completion_bash(_arguments: syntax.Arguments) -> ExitCode:
    """Print the script."""
    return _print("bash")


COMPLETION_ZSH = syntax.CommandSpec(
    "completion zsh",
    "print a script that completes lines in zsh",
    group=syntax.Group.LAPTOP,
    details="For this window: `source <(./provision completion zsh)`, after `compinit`.",
)


def run_completion_zsh(_arguments: syntax.Arguments) -> ExitCode:
    """Print the script."""
    return _print("zsh")


COMPLETION_FISH = syntax.CommandSpec(
    "completion fish",
    "print a script that completes lines in fish",
    group=syntax.Group.LAPTOP,
    details="For this window: `./provision completion fish | source`.",
)


def run_completion_fish(_arguments: syntax.Arguments) -> ExitCode:
    """Print the script."""
    return _print("fish")
