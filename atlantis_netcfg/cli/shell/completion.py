"""`provision completion bash|zsh|fish`: a script that lets Tab complete a line of `provision` in that shell.

Words, flags, choices, sites, devices, vehicles, partners and runs are those of the moment: at every Tab the script asks
`provision complete`, so that it never grows old.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from atlantis_netcfg.cli.base.arguments import CommandSpec, Group
from atlantis_netcfg.core.errors import ExitCode

if TYPE_CHECKING:
    from atlantis_netcfg.cli.base.arguments import Arguments


def _print(shell: str) -> ExitCode:
    print(Path(__file__).with_name(f"{shell}.txt").read_text(encoding="utf-8"), end="")
    return ExitCode.DONE


COMPLETION_BASH = CommandSpec(
    "completion bash",
    "print a script that completes lines in bash",
    group=Group.LAPTOP,
    details="For this window: `source <(./provision completion bash)`. For every window see docs/completion.md.",
)


def run_completion_bash(_arguments: Arguments) -> ExitCode:
    """Print the script."""
    return _print("bash")


COMPLETION_ZSH = CommandSpec(
    "completion zsh",
    "print a script that completes lines in zsh",
    group=Group.LAPTOP,
    details="For this window: `source <(./provision completion zsh)`, after `compinit`.",
)


def run_completion_zsh(_arguments: Arguments) -> ExitCode:
    """Print the script."""
    return _print("zsh")


COMPLETION_FISH = CommandSpec(
    "completion fish",
    "print a script that completes lines in fish",
    group=Group.LAPTOP,
    details="For this window: `./provision completion fish | source`.",
)


def run_completion_fish(_arguments: Arguments) -> ExitCode:
    """Print the script."""
    return _print("fish")
