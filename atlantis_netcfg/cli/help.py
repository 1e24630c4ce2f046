"""`provision help`: the overview; `provision COMMAND --help` tells one command."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli._arguments import Command
from atlantis_netcfg.core.errors import ExitCode

if TYPE_CHECKING:
    from atlantis_netcfg.cli._arguments import Arguments

__all__ = ["COMMAND", "run"]

COMMAND = Command("help", "print this overview")


def run(_arguments: Arguments) -> ExitCode:
    """Print the commands and the exit codes."""
    from atlantis_netcfg.cli._commands import COMMANDS
    from atlantis_netcfg.cli._help import overview

    print(overview(COMMANDS))
    return ExitCode.DONE
