"""`provision help`: the overview, the exit codes and the versions.

`provision help`, `provision --help`: the overview; `provision COMMAND --help` describes one command or a group of them.

`provision help exit-codes`: what each exit code means; `provision help version`: the versions, for a support request.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli.base import syntax
from atlantis_netcfg.cli.base.commands import COMMANDS, DEFAULT, load, summary_of
from atlantis_netcfg.core import printable
from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.language import as_typed, translate
from atlantis_netcfg.core.messages import arg, join, msg

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping


HELP = syntax.CommandSpec("help", "print this overview")


def run_help(_arguments: syntax.Arguments) -> ExitCode:
    """Print the overview."""
    print(overview(COMMANDS))
    return ExitCode.DONE


EXIT_CODES = syntax.CommandSpec("help exit-codes", "print the exit codes")


def run_exit_codes(_arguments: syntax.Arguments) -> ExitCode:
    """Print the exit codes and their meaning."""
    print("\n".join(_columns((str(int(code)), translate(meaning)) for code, meaning in MEANING.items())))
    return ExitCode.DONE


MEANING: Mapping[ExitCode, str] = {
    ExitCode.DONE: "done, or nothing to do",
    ExitCode.OUR_FAULT: "provision itself failed; the details are in a log file",
    ExitCode.CHANGES: "a plan found changes",
    ExitCode.USAGE: "error in the command line, the inventory or this computer's setup; no device was contacted",
    ExitCode.FAILED: "something failed; the device was rolled back or left as found",
    ExitCode.UNKNOWN: "a device's state is unknown: the link was lost before confirmation",
    ExitCode.CHECKS_FAILED: "checks failed, devices differ, or a request could not be proved",
    ExitCode.NOTHING: "nothing matched, or nothing was checked",
}
"""The exit codes in words; docs/exit-codes.md holds the same table."""

WIDTH = 80
"""Columns of a terminal that no line of help exceeds."""
_COLUMN = 26
"""A longer text in the left column of a table has a line of its own."""


def overview(table: Mapping[str, str]) -> str:
    """Return the text of `provision --help`: at most 24 lines."""
    rows = [
        ("site=NAME" if word == DEFAULT else word, translate(summary))
        for word, summary in first_words(table)
        if word != HELP.name
    ]
    return "\n".join(
        [
            *_paragraph("provision: configure and verify the sites of the ATLANTIS pilot"),
            "",
            f"{translate('Usage')}:",
            "  provision site=NAME [arguments] [--options]",
            "  provision COMMAND [arguments] [--options]",
            "",
            f"{translate('Commands')}:",
            *_columns(rows),
            "",
            *_paragraph("`provision COMMAND --help` describes a command; for the first, COMMAND is `run`."),
            *_paragraph("`provision help --help` lists exit codes, versions, completion, manual page."),
        ]
    )


def first_words(table: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    """Yield the first words of the commands, in their order, each with its summary."""
    for word in dict.fromkeys(name.split()[0] for name in table):
        yield word, summary_of(word, table)


def of_group(word: str, table: Mapping[str, str]) -> str:
    """Return the text of `provision vpn --help`: the commands whose first word is this one."""
    lines = [f"{translate('Usage')}:", msg(f"  provision {arg(word)} COMMAND [arguments] [--options]"), ""]
    lines += _paragraph(msg(f"`provision {arg(word)} COMMAND --help` describes a command."))
    return "\n".join([*lines, *_subcommands(word, table)])


def _subcommands(word: str, table: Mapping[str, str]) -> list[str]:
    commands = [load(name, table).command for name in table if name.startswith(f"{word} ")]
    rows = ((command.name, translate(command.summary)) for command in commands)
    return ["", f"{translate('Commands')}:", *_columns(rows)] if commands else []


def of_command(command: syntax.CommandSpec, table: Mapping[str, str]) -> str:
    """Return the text of `provision COMMAND --help`."""
    required_words = [word.usage for word in command.words if word.is_required]
    optional = [f"[{word.usage}]" for word in command.words if not word.is_required]
    flags = [f"[--{flag.name}{f' {flag.takes}' if flag.takes else ''}]" for flag in command.flags]
    lines = [
        *_paragraph(msg(f"provision {arg(command.name)}: {arg(translate(command.summary))}")),
        "",
        f"{translate('Usage')}:",
    ]
    lines += _wrap_usage(as_typed(f"provision {command.name}"), [*required_words, *optional, *flags])
    if command.words:
        lines += ["", f"{translate('Arguments')}:", *_columns((word.usage, word_text(word)) for word in command.words)]
    rows = ((flag.usage, translate(flag.help)) for flag in (*command.flags, *syntax.FRAME))
    lines += ["", f"{translate('Options')}:", *_columns(rows)]
    for paragraph in command.details.strip().splitlines():
        lines += ["", *_paragraph(paragraph)]
    return "\n".join([*lines, *_subcommands(command.name, table)])


def word_text(word: syntax.Word) -> str:
    """Return the help text of an argument, with its choices unless its usage contains them."""
    text = translate(word.help)
    if word.choices and "|".join(word.choices) not in word.usage:
        text += msg(f": {arg(join(', ', word.choices))}")
    return f"{text} ({translate('required')})" if word.is_required else text


def _wrap_usage(start: str, pieces: list[str]) -> list[str]:
    """Return the usage line, wrapped between its parts."""
    lines = [f"  {start}"]
    for piece in pieces:
        if len(lines[-1]) + 1 + len(piece) > WIDTH:
            lines.append(" " * (len(start) + 2))
        lines[-1] += f" {piece}"
    return lines


def _columns(rows: Iterable[tuple[str, str]], width: int = 0) -> list[str]:
    """Format a table of two columns; `width` is that of the left one, to align several tables."""
    table = list(rows)
    width = width or max((len(left) for left, _ in table if len(left) <= _COLUMN), default=_COLUMN)
    lines: list[str] = []
    for left, right in table:
        first, *others = printable.fill(right, WIDTH - width - 4) or [""]
        if len(left) > width:
            lines += [f"  {left}", msg(f"  {'':<{width}}  {arg(first)}")]
        else:
            lines.append(msg(f"  {arg(left):<{width}}  {arg(first)}"))
        lines += [msg(f"  {'':<{width}}  {arg(other)}") for other in others]
    return lines


def _paragraph(text: str) -> list[str]:
    return printable.fill(translate(text), WIDTH)


VERSION = syntax.CommandSpec(
    "help version",
    "print the versions of provision, Python and ansible-core",
    flags=(syntax.JSON,),
)


def run_version(arguments: syntax.Arguments) -> ExitCode:
    """Print the versions without importing the packages."""
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
