"""The command line: `provision site=coastal --plan`.

Every way to end goes through `main`: a NetcfgError is told in words with its exit code, anything else in one sentence
with its traceback in a log file. Commands are modules of this package, listed in `_commands`; what they need is
imported when they run, so that `--help` answers at once.
"""

from __future__ import annotations

import io
import os
import sys
from typing import TYPE_CHECKING

from atlantis_netcfg.cli._commands import COMMANDS, choose, load
from atlantis_netcfg.errors import ExitCode, NetcfgError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from atlantis_netcfg.cli._arguments import Command

__all__ = ["main"]

_HELP = frozenset({"-h", "--help"})


def main(argv: Sequence[str] | None = None, *, table: Mapping[str, str] = COMMANDS) -> int:
    """Run one command line and give its exit code; `table` stands in for the commands in tests."""
    typed = list(sys.argv[1:] if argv is None else argv)
    _speak_any_text()
    return int(_Line(typed, table).end())


class _Line:
    """One command line on its way to its end."""

    def __init__(self, typed: list[str], table: Mapping[str, str]) -> None:
        self.typed = typed
        self.table = table
        self.command: Command | None = None

    def end(self) -> ExitCode:
        """Run it, and end in words whatever happens."""
        from atlantis_netcfg.cli import _outcome

        as_json = "--json" in self.typed
        try:
            code = self._run()
            sys.stdout.flush()
        except NetcfgError as error:
            return _outcome.failed(error, as_json=as_json)
        except KeyboardInterrupt:
            return _outcome.interrupted(self.command, self.typed, as_json=as_json)
        except BrokenPipeError:
            _drop_stdout()
            return ExitCode.OUR_FAULT
        except Exception as error:  # noqa: BLE001 - the last door: nothing may end in a traceback on the screen
            return _outcome.crashed(error, self.typed, as_json=as_json)
        return code

    def _run(self) -> ExitCode:
        if not self.typed or (set(self.typed) <= _HELP):
            return self._overview()
        if self.typed == ["--version"]:
            self.typed = ["version"]
        if group := self._group():
            return _print_overview(group)
        name, rest = choose(self.typed, self.table)
        module = load(name, self.table)
        self.command = module.COMMAND
        if _HELP & set(rest):
            return _print_help(module.COMMAND)
        from atlantis_netcfg.cli._parse import parse

        return module.run(parse(module.COMMAND, rest))

    def _group(self) -> dict[str, str]:
        """The commands whose first word alone was typed, where it is asked what they are: `provision vpn --help`."""
        words = [argument for argument in self.typed if argument not in _HELP]
        if len(words) != 1 or words == self.typed:
            return {}
        return {name: module for name, module in self.table.items() if name.startswith(f"{words[0]} ")}

    def _overview(self) -> ExitCode:
        from atlantis_netcfg.cli._help import overview

        asked = bool(self.typed)
        print(overview(self.table), file=sys.stdout if asked else sys.stderr)
        return ExitCode.DONE if asked else ExitCode.USAGE


def _print_overview(table: Mapping[str, str]) -> ExitCode:
    from atlantis_netcfg.cli._help import overview

    print(overview(table))
    return ExitCode.DONE


def _print_help(command: Command) -> ExitCode:
    from atlantis_netcfg.cli._help import of_command

    print(of_command(command))
    return ExitCode.DONE


def _speak_any_text() -> None:
    """A console that cannot show a character gets a question mark, not a crash."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


def _drop_stdout() -> None:
    """The reader of our output has left (`provision runs | head`): what is still buffered must not fail at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
