"""Output of every command: progress, errors with their hints, and the end.

A command that fails prints a message or one JSON object, and writes a log file for the developers.

Live progress: one line per device on a terminal, one plain line per step elsewhere. Neither is silent for long.
"""

from __future__ import annotations

import os
import re
import shlex
import sys
import threading
import time
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, TextIO

from atlantis_netcfg.core import events, printable
from atlantis_netcfg.core.errors import REHEARSE, DeviceError, ExitCode, NetcfgError, fill_hint
from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.core.printable import Style, StyledText

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from atlantis_netcfg.cli.base.syntax import Arguments, CommandSpec


_CARRIED_WORDS = ("inventory", "authority")
_COMMAND_HINT = re.compile(r"(?:`|: +)provision (?P<command>[a-z][^`…\n]*?)(?=`|$)", re.MULTILINE)
"""A command in a hint: in backquotes, or after a colon at the end of a line."""


def json_text(document: object) -> str:
    """Return one line of JSON for `--json`; money is text, so that no digit of it is rounded."""
    import json

    return json.dumps(document, ensure_ascii=False, default=_as_text)


def _as_text(value: object) -> str:
    from decimal import Decimal

    if isinstance(value, Decimal):
        return str(value)
    raise TypeError(f"{type(value).__name__} is not JSON serializable")


def report_error(error: NetcfgError, command_line: Sequence[str] = (), *, as_json: bool) -> ExitCode:
    """Report a NetcfgError; one with `errors` is reported as each of them.

    Placeholders in a hint (`site=…`) are filled in from the command line.
    """
    errors: Sequence[NetcfgError] = getattr(error, "errors", None) or (error,)
    hints = [item.hint and as_typed(item.hint, command_line) for item in errors]
    _print_errors(list(zip(map(str, errors), hints, strict=True)), error.exit, as_json=as_json)
    return error.exit


def as_typed(hint: str, command_line: Sequence[str]) -> str:
    """Complete the commands in a hint with the site, device and other arguments of the command line."""
    from atlantis_netcfg.cli.base.commands import COMMANDS, choose, load

    with suppress(NetcfgError):
        if REHEARSE in hint and load(choose(command_line, COMMANDS)[0], COMMANDS).command.flag("rehearse") is not None:
            hint = hint.replace(REHEARSE, "add --rehearse")
    words = dict(word.partition("=")[::2] for word in command_line if "=" in word)
    hint = fill_hint(hint, site=words.get("site", ""), device=words.get("device", ""))

    def complete_command(match: re.Match[str]) -> str:
        try:
            name, rest = choose(shlex.split(match["command"]), COMMANDS)
        except (NetcfgError, ValueError):  # what is wrong with a line may itself be quoted
            return match[0]
        if "--help" in rest:
            return match[0]
        command = load(name, COMMANDS).command
        more = ""
        for word in _CARRIED_WORDS:
            if word in words and command.word(word) is not None and f"{word}=" not in match["command"]:
                more += f" {shlex.quote(f'{word}={words[word]}')}"
        if "--rehearse" in command_line and command.flag("rehearse") is not None and "--rehearse" not in rest:
            more += " --rehearse"
        return match[0].replace(match["command"], f"{match['command']}{more}")

    for match in _COMMAND_HINT.finditer(hint):
        end = match.string[match.end() : match.end() + 1]  # the backquote: the beginning of a longer command stays
        hint = hint.replace(f"{match[0]}{end}", f"{complete_command(match)}{end}")
    return hint


def carried_words(arguments: Arguments) -> list[str]:
    """Return the arguments that a suggested command must repeat: inventory, devices and rehearsal."""
    values = [(name, arguments.optional(name)) for name in _CARRIED_WORDS if arguments.command.word(name) is not None]
    words = [f"{name}={value}" for name, value in values if value is not None]
    is_rehearsal = arguments.command.flag("rehearse") is not None and arguments.flag("rehearse")
    return [*words, "--rehearse"] if is_rehearsal else words


class CommandInterrupt(DeviceError):
    """The user stopped the command while no request was pending: earlier verified results stay valid."""

    def __init__(self, stop: KeyboardInterrupt, changed_devices: Sequence[str]) -> None:
        summary = msg(
            f"verified changes on {arg(join(', ', dict.fromkeys(changed_devices)))} remain"
            if changed_devices
            else "nothing was changed"
        )
        super().__init__(msg(f"interrupted by {arg(signal_of(stop))}; {arg(summary)}"))


def signal_of(stop: KeyboardInterrupt) -> str:
    """Return how the user stopped the command: `Ctrl-C`, or the name of another signal."""
    name = str(stop) or "SIGINT"
    return "Ctrl-C" if name == "SIGINT" else name


def report_interrupt(
    command: CommandSpec | None, command_line: Sequence[str], stop: KeyboardInterrupt, *, as_json: bool
) -> ExitCode:
    """Report that Ctrl-C stopped the command, and whether a device may have been changed."""
    how = signal_of(stop)
    if command is not None and command.changes and not _is_harmless(command, command_line):
        message = msg(f"interrupted by {arg(how)}; the state of the devices is unknown")
        hint = (
            command.again or "`provision report runs` shows what was confirmed, and how to continue an unfinished run"
        )
        _print_errors([(message, hint)], ExitCode.UNKNOWN, as_json=as_json)
        return ExitCode.UNKNOWN
    _print_errors([(msg(f"interrupted by {arg(how)}; nothing was changed"), None)], ExitCode.FAILED, as_json=as_json)
    return ExitCode.FAILED


def _is_harmless(command: CommandSpec, command_line: Sequence[str]) -> bool:
    return any(flag.harmless and f"--{flag.name}" in command_line for flag in command.flags)


def report_crash(error: BaseException, command_line: Sequence[str], *, as_json: bool) -> ExitCode:
    """Report an unexpected error in one sentence; the traceback goes to a log file."""
    from atlantis_netcfg.core import crash_report
    from atlantis_netcfg.core.paths import state_dir

    return report_error(crash_report.report_crash(error, repr(list(command_line)), state_dir), as_json=as_json)


def _print_errors(errors: Sequence[tuple[str, str | None]], code: ExitCode, *, as_json: bool) -> None:
    if as_json:
        rows = [{"message": message, "hint": hint} for message, hint in errors]
        print(json_text({"exit": int(code), "errors": rows}))
        return
    _tell_person(errors)


def tell(errors: Sequence[NetcfgError]) -> None:
    """Report errors in addition to a valid result."""
    _tell_person([(str(error), error.hint) for error in errors])


def _tell_person(errors: Sequence[tuple[str, str | None]]) -> None:
    label = translate("error")
    indent = len(label) + 2
    for message, hint in errors:
        lines = [*translate(message).splitlines(), *(translate(hint).splitlines() if hint else ())]
        rows: list[printable.Row] = [
            (StyledText(f"{label}: ", Style.BAD), text) if place == 0 else f"{'':<{indent}}{text}"
            for place, text in enumerate(map(printable.line, lines))
        ]
        width = printable.width_of(sys.stderr)
        printable.show((line for row in rows for line in printable.wrap_row(row, width, indent)), sys.stderr)


def _terminal() -> os.terminal_size:
    import shutil

    return shutil.get_terminal_size((printable.NARROW, 24))


def page(rows: Sequence[printable.Row]) -> None:
    """Print lines; on an interactive terminal, long output goes through `$PAGER`, or else `less`."""
    out, width = sys.stdout, printable.width_of(sys.stdout)
    lines = [line for row in rows for line in printable.wrap_row(row, width, _MARGIN)]
    height = _terminal().lines
    able = os.environ.get("TERM", "dumb") != "dumb"  # `less` asks there whether it may go on
    if width and able and sys.stdin.isatty() and len(lines) >= height and _page_lines(lines):
        return
    printable.show(lines, out)


_MARGIN = 4
"""Indent of continuation lines, if a line of a plan is longer than the terminal is wide."""
_PAGER = "less"
_PAGER_PROMPT = "space\\: next page, q\\: leave"
"""Last line of the screen in `less`, whose prompts need a backslash before a colon."""


def _page_lines(lines: Sequence[printable.Row]) -> bool:
    """Return whether a pager has shown the lines; `less` exits at once if they fit, and keeps colours and output."""
    import subprocess

    pager_command = shlex.split(os.environ.get("PAGER", _PAGER)) or [_PAGER]
    text = printable.paint(lines, colour=printable.shows_colour(sys.stdout))
    sys.stdout.flush()
    try:
        process = subprocess.run(  # noqa: S603 - the program that the person has chosen for this
            pager_command,
            input=text,
            text=True,
            env={"LESS": f"FRXPs{translate(_PAGER_PROMPT)}$", **os.environ},
            check=False,
            errors="replace",
        )
    except OSError:
        return False
    return process.returncode == 0


_ENDS = (events.Stage.DONE, events.Stage.CONFIRMED, events.Stage.UNROLLED, events.Stage.FAILED)
_ROOM = 16
"""Devices shown together; with more, those that have ended scroll away upwards, and the others stay visible."""


SILENCE_S = 20.0
"""A plain log shows what it waits for after so long without a step; a satellite gap can last over a minute."""
_AGE_S = 5.0
"""From this age on, a step on a terminal shows its age."""
_NAMED_DEVICES = 3
"""Devices that a reminder names; it counts the others."""


@contextmanager
def progress(*, quiet: bool, out: TextIO | None = None, silence_s: float = SILENCE_S) -> Iterator[events.Subscriber]:
    """Yield the progress subscriber for `out`, by default the current stderr.

    `quiet`: a program reads stdout; a person at a terminal still sees the progress.
    """
    out = out or sys.stderr
    if out.isatty():
        with _live_progress(out) as subscriber:
            yield subscriber
    elif quiet:
        yield events.ignore
    else:
        with _plain(out, silence_s) as subscriber:
            yield subscriber


def line(event: events.Event) -> str:
    """Format one step: `coastal-router  applying 24/112  layer 2 of 4`."""
    count = f" {event.done_count}/{event.total}" if event.total else ""
    words = translate(event.message)
    return printable.line(f"  {event.device:<18} {translate(event.stage.value)}{count}  {words}".rstrip())


def _age(event: events.Event, age_s: float) -> str:
    """Format the duration of a step, and its limit if known."""
    limit = msg(f" of at most {arg(event.limit_s):.0f} s" if event.limit_s else "")
    return translate(f"{arg(age_s):.0f} s{arg(limit)}")


@contextmanager
def _plain(out: TextIO, silence_s: float) -> Iterator[events.Subscriber]:
    """Print one line per step, and a reminder when nothing has been printed for `silence_s`."""
    at_work: dict[str, tuple[events.Event, float]] = {}
    lock, end_event = threading.Lock(), threading.Event()
    step_at = printed_at = time.monotonic()

    def show(event: events.Event) -> None:
        nonlocal step_at, printed_at
        with lock:
            at_work.pop(event.device, None)
            if event.stage not in _ENDS:
                at_work[event.device] = event, time.monotonic()
            step_at = printed_at = time.monotonic()
            print(line(event), file=out, flush=True)

    def remind() -> None:
        nonlocal printed_at
        while not end_event.wait(max(0.0, printed_at + silence_s - time.monotonic())):
            with lock, suppress(OSError, ValueError):  # nobody reads any longer: the run goes on
                now = time.monotonic()
                if now >= printed_at + silence_s:
                    printed_at = now
                    steps = [(event, now - since) for event, since in at_work.values()]
                    print(_reminder(steps, now - step_at), file=out, flush=True)

    thread = threading.Thread(target=remind, name="progress", daemon=True)
    thread.start()
    try:
        yield show
    finally:
        end_event.set()
        thread.join()


def _step(event: events.Event, age_s: float) -> str:
    stage = translate(event.stage.value)
    return msg(f"{arg(stage)}, {arg(_age(event, age_s))}") if age_s >= _AGE_S else stage


def _reminder(at_work: list[tuple[events.Event, float]], age_s: float) -> str:
    """Format a reminder: `  still at work, 40 s without news: coastal-router (connecting, 40 s of at most 120 s)`."""
    names = [msg(f"{arg(event.device)} ({arg(_step(event, since_s))})") for event, since_s in at_work[:_NAMED_DEVICES]]
    if more := len(at_work) - len(names):
        names.append(translate(f"{arg(more)} more"))
    words = translate(f"still running, no news for {arg(age_s):.0f} s")
    return f"  {words}" + msg(f": {arg(join(', ', names))}" if names else "")


@contextmanager
def _live_progress(out: TextIO) -> Iterator[events.Subscriber]:
    from rich.console import Console
    from rich.live import Live
    from rich.text import Text

    latest: dict[str, tuple[events.Event, float]] = {}
    names: set[str] = set()
    console = Console(file=getattr(out, "stream", out))  # what it draws is its own, and its lines are filtered

    def text(event: events.Event, since: float) -> Text:
        age_s = time.monotonic() - since
        age = f"  ({_age(event, age_s)})" if age_s >= _AGE_S and event.stage not in _ENDS else ""
        words = line(event)
        room = console.width - len(age)
        return Text(
            f"{words[: room - 1]}…{age}" if len(words) > room else words + age, overflow="ellipsis", no_wrap=True
        )

    def table() -> Text:
        return Text("\n").join(text(*row) for row in list(latest.values()))

    with Live(get_renderable=table, console=console, refresh_per_second=8, transient=True) as live:

        def show(event: events.Event) -> None:
            names.add(event.device)
            latest[event.device] = event, time.monotonic()
            if event.stage in _ENDS and len(names) > _ROOM:
                for name in [name for name, (item, _) in latest.items() if item.stage in _ENDS]:
                    live.console.print(text(*latest.pop(name)))
            live.refresh()

        yield show
