"""The command line: `provision plan site=coastal`.

Every exit goes through `main`: a NetcfgError is printed with its exit code, any other exception as one sentence with
its traceback in a log file. Commands are modules of this package, listed in `base/commands.py`; their dependencies are
imported when they run, so that `--help` responds at once.
"""

from __future__ import annotations

import atexit
import errno
import gc
import io
import os
import sys
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.cli.base import commands, output
from atlantis_netcfg.core import processes
from atlantis_netcfg.core.errors import ExitCode, NetcfgError
from atlantis_netcfg.core.language import as_typed
from atlantis_netcfg.core.printable import ASCII, Printer
from atlantis_netcfg.core.processes import stop_signals

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from atlantis_netcfg.cli.base.syntax import CommandSpec

__all__ = ["main"]

_OBJECTS = 50_000
"""Allocations between garbage collections: nearly all objects of a start stay, and collecting took a fifth of it."""
_HELP = frozenset({"-h", "--help"})


def main(argv: Sequence[str] | None = None, *, table: Mapping[str, str] = commands.COMMANDS) -> int:
    """Run one command line and return its exit code; tests replace `table`."""
    command_line = list(sys.argv[1:] if argv is None else argv)
    if argv is None:
        os.environ["PATH"] = processes.program_path()
    gc.set_threshold(_OBJECTS)
    # Python's end looks at all objects for garbage, a sixth of a run's time; what must be closed is, by its `with`.
    atexit.register(gc.freeze)
    _open_streams()
    line, code, before = _CommandLine(command_line, table), None, stop_signals.handlers()
    try:
        stop_signals.install_handlers()
        code = line.end()
        stop_signals.ignore()
    except KeyboardInterrupt as stop:
        code = line.interrupt(stop) if code is None else code
    if line.is_started:
        from atlantis_netcfg.core import paths

        paths.finish_command(code)
    if argv is not None:  # the process goes on without us
        stop_signals.restore(before)
    return int(code)


class _CommandLine:
    """Parses and runs one command line."""

    def __init__(self, command_line: list[str], table: Mapping[str, str]) -> None:
        self.command_line = command_line
        self.table = table
        self.command: CommandSpec | None = None
        self.is_started = False

    def end(self) -> ExitCode:
        """Run the command; report every error as a message."""
        if self.command_line[:1] == ["complete"]:
            return _print_candidates(self.command_line[1:], self.table)
        as_json = "--json" in self.command_line
        try:
            self._choose_language()
            code = self._run()
        except NetcfgError as error:
            return output.report_error(error, self.command_line, as_json=as_json)
        except Exception as error:  # noqa: BLE001 - the last door: nothing may end in a traceback on the screen
            if name := stop_signals.pending_stop():
                return self.interrupt(KeyboardInterrupt(name))
            return output.report_crash(error, self.command_line, as_json=as_json)
        return code

    def interrupt(self, stop: KeyboardInterrupt) -> ExitCode:
        """Report an interruption by the user."""
        stop_signals.ignore()
        return output.report_interrupt(self.command, self.command_line, stop, as_json="--json" in self.command_line)

    def _run(self) -> ExitCode:
        if not self.command_line or (set(self.command_line) <= _HELP):
            return self._overview()
        if self.command_line == ["--version"]:
            self.command_line = ["help", "version"]
        first = self.command_line[:2]
        if first[0] == "help" and first[1:] and not first[1].startswith("-") and " ".join(first) not in self.table:
            self.command_line = [*self.command_line[1:], "--help"]
        if group := self._group():
            return _print_group(group, self.table)
        name, rest = commands.choose(self.command_line, self.table)
        entry = commands.load(name, self.table)
        self.command = entry.command
        if _HELP & set(rest):
            return _print_help(entry.command, self.table)
        from atlantis_netcfg.cli.base.syntax import parse
        from atlantis_netcfg.core import paths, temporary

        arguments = parse(entry.command, rest)
        temporary.remove_orphans()
        self.is_started = paths.start_command()
        return entry.run(arguments)

    def _choose_language(self) -> None:
        """Remove `--lang pt` from the line, or read the language from the environment. Raises UsageError.

        Every command accepts the flag, and none has to define it.
        """
        from atlantis_netcfg.core import language

        language_code, self.command_line = _without_language(self.command_line)
        language.use(language.of_environment() if language_code is None else language.parse_language(language_code))

    def _group(self) -> str:
        """Return the command group whose help is requested, as in `provision vpn --help`; otherwise empty.

        A group that is itself a command lists its subcommands in its own help.
        """
        words = [argument for argument in self.command_line if argument not in _HELP]
        alone = len(words) == 1 and words != self.command_line and words[0] not in self.table
        return words[0] if alone and any(name.startswith(f"{words[0]} ") for name in self.table) else ""

    def _overview(self) -> ExitCode:
        from atlantis_netcfg.cli.help import overview

        has_words = bool(self.command_line)
        print(as_typed(overview(self.table)), file=sys.stdout if has_words else sys.stderr)
        return ExitCode.DONE if has_words else ExitCode.USAGE


def _without_language(command_line: Sequence[str]) -> tuple[str | None, list[str]]:
    """Return the value of `--lang`, and the line without it; the last one counts."""
    language_code, rest, arguments = None, [], iter(command_line)
    for argument in arguments:
        name, separator, value = argument.partition("=")
        if name == "--lang":
            language_code = value if separator else next(arguments, "")
        else:
            rest.append(argument)
    return language_code, rest


def _print_group(word: str, table: Mapping[str, str]) -> ExitCode:
    from atlantis_netcfg.cli.help import of_group

    print(of_group(word, table))
    return ExitCode.DONE


def _print_candidates(command_line: Sequence[str], table: Mapping[str, str]) -> ExitCode:
    """Print the candidates for shell completion; only shells call this command, at every Tab."""
    from atlantis_netcfg.cli.shell._suggestions import answer

    return answer(command_line, table)


def _print_help(command: CommandSpec, table: Mapping[str, str]) -> ExitCode:
    from atlantis_netcfg.cli.help import of_command

    print(as_typed(of_command(command, table)))
    return ExitCode.DONE


class _PatientStream(io.FileIO):
    """A stream that tolerates a closed reader (`provision links | head`, a closed terminal): the rest is discarded.

    This affects neither the actions nor the exit code.
    """

    def write(self, data: Any, /) -> int:  # noqa: ANN401 - any buffer, as FileIO has it
        """Write the data; after the reader has closed, report success."""
        try:
            return super().write(data)
        except OSError as error:
            if error.errno not in {errno.EPIPE, errno.EIO}:
                raise
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self.fileno())
        os.close(nowhere)
        return len(data)


def _open_streams() -> None:
    """Make output robust: unsupported characters become question marks, and a closed stream causes no error.

    All output goes through a `Printer`, so that text from a device cannot move the cursor or reverse the text.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        # `provision … <&-`: else the next file that is opened becomes our standard input.
        if getattr(sys, name) is None:
            nothing = os.open(os.devnull, os.O_RDWR)
            os.set_inheritable(nothing, True)
            setattr(sys, name, os.fdopen(nothing, "w" if number else "r", encoding="utf-8", closefd=False))
        stream = getattr(sys, name)
        if isinstance(stream, Printer):
            continue
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
            if _shows_ascii_only(stream):
                stream.reconfigure(encoding="ascii", errors=ASCII)
        if number == 0:
            continue
        if _file_descriptor(stream) == number and not isinstance(getattr(stream.buffer, "raw", None), _PatientStream):
            writer = io.BufferedWriter(_PatientStream(number, "w", closefd=False))
            how = (stream.encoding, stream.errors)
            stream = io.TextIOWrapper(writer, *how, line_buffering=stream.line_buffering)
        setattr(sys, name, Printer(stream))


def _shows_ascii_only(stream: io.TextIOWrapper) -> bool:
    """Return whether a terminal is limited to ASCII by `LC_ALL=C`; files and pipes stay UTF-8."""
    return os.environ.get("LC_ALL") in {"C", "POSIX"} and stream.isatty()


def _file_descriptor(stream: object) -> int | None:
    if not isinstance(stream, io.TextIOWrapper):
        return None
    try:
        return stream.fileno()
    except OSError:  # somebody captures what we print
        return None
