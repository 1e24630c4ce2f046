"""`provision help man`: the manual page, generated from the definitions of the commands, like `--help`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli.base.commands import COMMANDS, load
from atlantis_netcfg.cli.base.syntax import FRAME, CommandSpec
from atlantis_netcfg.cli.help import MEANING, first_words, word_text
from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.language import translate

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from atlantis_netcfg.cli.base.syntax import Arguments

MAN = CommandSpec(
    "help man",
    "print the manual page",
    details=(
        "To read it: `provision help man | man -l -`. To keep it: "
        "`provision help man > ~/.local/share/man/man1/provision.1`, then `man provision`."
    ),
)


_INPUT = 78
"""Columns of a line in the source of the manual."""
_SPECIAL = {"\\": "\\e", "-": "\\-", "`": "\\(ga", "'": "\\(aq"}


def run_man(_arguments: Arguments) -> ExitCode:
    """Print the manual page as roff."""
    print(page(COMMANDS))
    return ExitCode.DONE


def page(table: Mapping[str, str]) -> str:
    """Return the manual page as roff, with the macros of man(7)."""
    from atlantis_netcfg import __version__

    lines = [
        f'.TH PROVISION 1 "" "provision {__version__}" "ATLANTIS"',
        ".nh",
        ".ad l",
        _section("Name"),
        _text(f"provision - {translate('configure and verify the sites of the ATLANTIS pilot')}"),
        _section("Synopsis"),
        _usage("provision", "site=NAME [arguments] [--options]"),
        ".br",
        _usage("provision", "COMMAND [arguments] [--options]"),
    ]
    for word, summary in first_words(table):
        lines += [_section(word), _text(translate(summary))]
        for name in table:
            if name.split()[0] == word:
                lines += _command(load(name, table).command)
    lines.append(_section("Options of every command"))
    for flag in FRAME:
        lines += [".TP", f"\\fB{_escape(flag.usage)}\\fR", _text(translate(flag.help))]
    lines.append(_section("Exit codes"))
    for code, meaning in MEANING.items():
        lines += [".TP 4", _text(str(int(code))), _text(translate(meaning))]
    return "\n".join(lines)


def _command(command: CommandSpec) -> Iterator[str]:
    yield f".SS {_quote(f'provision {command.form}')}"
    yield _text(translate(command.summary))
    for word in command.words:
        yield from (".TP", f"\\fB{_escape(word.usage)}\\fR", _text(word_text(word)))
    for flag in command.flags:
        yield from (".TP", f"\\fB{_escape(flag.usage)}\\fR", _text(translate(flag.help)))
    for paragraph in command.details.strip().splitlines():
        yield from (".PP", _text(translate(paragraph)))


def _section(title: str) -> str:
    return f".SH {_quote(translate(title).upper())}"


def _usage(bold: str, rest: str) -> str:
    return f"\\fB{_escape(bold)}\\fR {_escape(rest)}"


def _quote(text: str) -> str:
    return '"' + _escape(text).replace('"', "\\(dq") + '"'


def _text(text: str) -> str:
    """Wrap text for roff, so that no line is too long or starts a request."""
    from textwrap import wrap

    lines = wrap(_escape(text), _INPUT, break_long_words=False, break_on_hyphens=False)
    return "\n".join(f"\\&{line}" if line.startswith(".") else line for line in lines)


def _escape(text: str) -> str:
    """Escape backslashes and hyphens, so that `--plan` can be copied from the page."""
    return "".join(_SPECIAL.get(each, each if each.isascii() else f"\\[u{ord(each):04X}]") for each in text)
