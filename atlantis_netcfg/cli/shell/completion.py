"""`provision help completion bash|zsh|fish`: a script for completion of `provision` by Tab in that shell.

Arguments, flags, choices, sites, devices, vehicles, partners and runs are current: at every Tab the script calls
`provision complete`, so that it never becomes outdated.
"""

from __future__ import annotations

from pathlib import Path

from atlantis_netcfg.cli.base import syntax
from atlantis_netcfg.core.errors import ExitCode

COMPLETION = syntax.CommandSpec(
    "help completion",
    "print a shell completion script",
    words=(syntax.Word("shell", "the shell", is_required=True, choices=("bash", "zsh", "fish"), bare=True),),
    details=(
        "For this window, in bash: `source <(./provision help completion bash)`. "
        "In zsh the same after `compinit`; in fish: `./provision help completion fish | source`.\n"
        "For every window see docs/engineers/completion.md."
    ),
)


def run_completion(arguments: syntax.Arguments) -> ExitCode:
    """Print the script for a shell."""
    print(Path(__file__).with_name(f"{arguments.word('shell')}.txt").read_text(encoding="utf-8"), end="")
    return ExitCode.DONE
