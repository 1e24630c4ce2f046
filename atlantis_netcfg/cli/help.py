"""`provision help` and `provision version`.

`provision help`: the overview; `provision COMMAND --help` tells one command.

`provision version`: what to quote in a question to us.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli._arguments import JSON, Arguments, CommandSpec
from atlantis_netcfg.cli._commands import load
from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.language import translate

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping


HELP = CommandSpec("help", "print this overview")


def run_help(_arguments: Arguments) -> ExitCode:
    """Print the commands and the exit codes."""
    from atlantis_netcfg.cli._commands import COMMANDS

    print(translate(overview(COMMANDS)))
    return ExitCode.DONE


MEANING: Mapping[ExitCode, str] = {
    ExitCode.DONE: "done, or nothing to do",
    ExitCode.OUR_FAULT: "provision itself failed; the details are in a log file",
    ExitCode.CHANGES: "`--plan` found changes",
    ExitCode.USAGE: "the command line, the inventory or this machine's set-up has an error; no device was contacted",
    ExitCode.FAILED: "something failed; the device was rolled back or left as found",
    ExitCode.UNKNOWN: "the outcome on a device is unknown: the link was lost before it was confirmed",
    ExitCode.CHECKS_FAILED: "checks failed, devices differ, or something that was asked for could not be proved",
    ExitCode.NOTHING: "nothing matched, or nothing was checked",
}
"""The exit codes in words; docs/exit-codes.md holds the same table."""

_WIDTH = 100


def overview(table: Mapping[str, str]) -> str:
    """What `provision --help` prints."""
    commands = [load(name, table).command for name in table]
    return "\n".join(
        [
            "provision: declare, plan, guard, apply and verify the sites of the ATLANTIS pilot",
            "",
            "Usage:",
            "  provision site=NAME [words] [--flags]",
            "  provision COMMAND [words] [--flags]",
            "",
            "Commands (`provision COMMAND --help` tells its words and flags):",
            *_columns((command.name, command.summary) for command in commands),
            "",
            "Exit codes:",
            *_columns((str(int(code)), meaning) for code, meaning in MEANING.items()),
        ]
    )


def of_command(command: CommandSpec) -> str:
    """What `provision COMMAND --help` prints."""
    required = [word.shown for word in command.words if word.required]
    optional = [f"[{word.shown}]" for word in command.words if not word.required]
    flags = [f"[--{flag.name}{f' {flag.takes}' if flag.takes else ''}]" for flag in command.flags]
    lines = [f"provision {command.name}: {command.summary}", "", "Usage:"]
    lines += _wrapped(f"provision {command.name}", [*required, *optional, *flags])
    if command.words:
        lines += ["", "Words:", *_columns((word.shown, _word_help(word.help, word.required)) for word in command.words)]
    rows = [(flag.shown, flag.help) for flag in command.flags] + [("-h, --help", "print this text")]
    lines += ["", "Flags:", *_columns(rows)]
    if command.details:
        lines += ["", command.details.strip()]
    return "\n".join(lines)


def _word_help(text: str, required: bool) -> str:  # noqa: FBT001 - a row of a table, not a switch
    return f"{text} (required)" if required else text


def _wrapped(start: str, pieces: list[str]) -> list[str]:
    """The usage line, broken between its pieces where a console would break it anywhere."""
    lines = [f"  {start}"]
    for piece in pieces:
        if len(lines[-1]) + len(piece) >= _WIDTH:
            lines.append(" " * (len(start) + 2))
        lines[-1] += f" {piece}"
    return lines


def _columns(rows: Iterable[tuple[str, str]]) -> list[str]:
    table = list(rows)
    width = max((len(left) for left, _ in table), default=0)
    return [f"  {left:<{width}}  {right}" for left, right in table]


VERSION = CommandSpec("version", "print the versions of provision, Python and ansible-core", flags=(JSON,))


def run_version(arguments: Arguments) -> ExitCode:
    """Print the versions without importing what they belong to."""
    versions = _versions()
    if arguments.flag("json"):
        import json

        print(json.dumps({"exit": int(ExitCode.DONE), "errors": [], "versions": versions}))
    else:
        print("\n".join(f"{name} {version}" for name, version in versions.items()))
    return ExitCode.DONE


def _versions() -> dict[str, str]:
    import platform
    from importlib import metadata

    from atlantis_netcfg import __version__

    return {
        "provision": __version__,
        "Python": platform.python_version(),
        "ansible-core": metadata.version("ansible-core"),
    }
