"""How a command that did not succeed ends: words for a person or one JSON object, and a log file for us."""

from __future__ import annotations

import re
import shlex
import sys
from typing import TYPE_CHECKING

from atlantis_netcfg.core import printable
from atlantis_netcfg.core.errors import DeviceFailed, ExitCode, NetcfgError, complete

if TYPE_CHECKING:
    from collections.abc import Sequence

    from atlantis_netcfg.cli._arguments import Arguments, Command


_CARRIED = ("inventory", "authority")
_ADVISED = re.compile(r"(?:`|: +)provision (?P<command>[a-z][^`…\n]*?)(?=`|$)", re.MULTILINE)
"""A command in a hint: in backquotes, or at the end of a line behind a colon."""


def failed(error: NetcfgError, typed: Sequence[str] = (), *, as_json: bool) -> ExitCode:
    """Tell an error that has words of its own; one that carries `errors` is told as each of them.

    What a hint leaves open (`site=…`) is filled in from what was typed.
    """
    errors: Sequence[NetcfgError] = getattr(error, "errors", None) or (error,)
    hints = [item.hint and as_typed(item.hint, typed) for item in errors]
    _tell(list(zip(map(str, errors), hints, strict=True)), error.exit, as_json=as_json)
    return error.exit


def as_typed(hint: str, typed: Sequence[str]) -> str:
    """A hint whose commands go on where the typed one was: its site and device, and what `carried` gives."""
    from atlantis_netcfg.cli._commands import COMMANDS, choose, load

    words = dict(word.partition("=")[::2] for word in typed)
    hint = complete(hint, site=words.get("site", ""), device=words.get("device") or words.get("host") or "")

    def completed(found: re.Match[str]) -> str:
        try:
            name, rest = choose(shlex.split(found["command"]), COMMANDS)
        except (NetcfgError, ValueError):  # what is wrong with a line may itself be quoted
            return found[0]
        if "--help" in rest:
            return found[0]
        command = load(name, COMMANDS).COMMAND
        more = ""
        for word in _CARRIED:
            if word in words and command.word(word) is not None and f"{word}=" not in found["command"]:
                more += f" {shlex.quote(f'{word}={words[word]}')}"
        if "--rehearse" in typed and command.flag("rehearse") is not None and "--rehearse" not in rest:
            more += " --rehearse"
        return found[0].replace(found["command"], f"{found['command']}{more}")

    return _ADVISED.sub(completed, hint)


def carried(arguments: Arguments) -> list[str]:
    """What a command that a hint advises has to be told as well, as it was typed: whose files, and which devices."""
    named = [(name, arguments.optional(name)) for name in _CARRIED if arguments.command.word(name) is not None]
    words = [f"{name}={value}" for name, value in named if value is not None]
    rehearsed = arguments.command.flag("rehearse") is not None and arguments.flag("rehearse")
    return [*words, "--rehearse"] if rehearsed else words


class Stopped(DeviceFailed):
    """A person has stopped the command where nothing was in flight: what was read back before stands."""

    def __init__(self, stop: KeyboardInterrupt, changed: Sequence[str]) -> None:
        kept = f"what was read back of {', '.join(dict.fromkeys(changed))} stays" if changed else "nothing was changed"
        super().__init__(f"stopped by {signal_of(stop)}; {kept}")


def signal_of(stop: KeyboardInterrupt) -> str:
    """How a person has stopped us: `Ctrl-C`, or the name of another signal."""
    name = str(stop) or "SIGINT"
    return "Ctrl-C" if name == "SIGINT" else name


def interrupted(command: Command | None, typed: Sequence[str], stop: KeyboardInterrupt, *, as_json: bool) -> ExitCode:
    """Tell that Ctrl-C was obeyed, and whether a device may have been changed by then."""
    how = signal_of(stop)
    if command is not None and command.changes and not _changes_nothing(command, typed):
        message = f"stopped by {how}; what a device kept is not known here"
        hint = command.again or "`provision runs` shows what was confirmed, and how a run that is unfinished goes on"
        _tell([(message, hint)], ExitCode.UNKNOWN, as_json=as_json)
        return ExitCode.UNKNOWN
    _tell([(f"stopped by {how}; nothing was changed", None)], ExitCode.FAILED, as_json=as_json)
    return ExitCode.FAILED


def _changes_nothing(command: Command, typed: Sequence[str]) -> bool:
    return any(flag.harmless and f"--{flag.name}" in typed for flag in command.flags)


def crashed(error: BaseException, typed: Sequence[str], *, as_json: bool) -> ExitCode:
    """Tell an error that nobody foresaw in one sentence; the traceback goes to a log file."""
    from atlantis_netcfg.core import crash_report
    from atlantis_netcfg.core.paths import state_dir

    return failed(crash_report.crashed(error, repr(list(typed)), state_dir), as_json=as_json)


def _tell(errors: Sequence[tuple[str, str | None]], code: ExitCode, *, as_json: bool) -> None:
    if as_json:
        import json

        rows = [{"message": message, "hint": hint} for message, hint in errors]
        print(json.dumps({"exit": int(code), "errors": rows}, ensure_ascii=False))
        return
    _tell_person(errors)


def tell(errors: Sequence[NetcfgError]) -> None:
    """Tell a person what is wrong beside a result that stands."""
    _tell_person([(str(error), error.hint) for error in errors])


def _tell_person(errors: Sequence[tuple[str, str | None]]) -> None:
    for message, hint in errors:
        lines = message.splitlines() + (hint.splitlines() if hint else [])
        text = "\n".join(
            f"{'       ' if place else 'error: '}{printable.line(line)}" for place, line in enumerate(lines)
        )
        print(text, file=sys.stderr)
