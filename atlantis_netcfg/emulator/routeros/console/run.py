"""Run scripts of `/execute`, files of `/import`, and scheduler events.

A script is parsed completely before its first command runs, a file statement by statement: an import with an error in
its last line has already changed the router. Both stop at the first error and undo nothing.
"""

from __future__ import annotations

import operator
import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.answers import Caller, Trap
from atlantis_netcfg.emulator.routeros.commands import read
from atlantis_netcfg.emulator.routeros.commands._checks import MissingArgument, check_known
from atlantis_netcfg.emulator.routeros.console import _parse, people
from atlantis_netcfg.emulator.routeros.core import Call, Core
from atlantis_netcfg.emulator.routeros.spec import Deviation
from atlantis_netcfg.emulator.routeros.values import seconds
from atlantis_netcfg.emulator.routeros.views import without_counters

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping


_COMPARE: dict[str, Callable[[int, int], bool]] = {
    "=": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    ">": operator.gt,
    "<=": operator.le,
    ">=": operator.ge,
}
_PARSED_SCRIPTS = 64
_ADOPTION_MENUS = (
    "/certificate",
    "/file",
    "/interface/ethernet",
    "/ip/address",
    "/ip/service",
    "/system/identity",
    "/user",
)
"""Menus that adoption changes."""
_REFUSALS = (
    *("expected end of command", "expected item id", "failure: ", "input does not match any value", "invalid value"),
    *("missing value", "no such item", "syntax error", "unknown parameter", "value of "),
)
_NUMBERS = frozenset({"destination", "number", "numbers"})


@dataclass(slots=True)
class ScriptOutcome:
    """Output of a script, and the error that stopped it."""

    lines: list[str] = field(default_factory=list)
    error: str | None = None
    is_paged: bool = False
    """A terminal would show the output page by page."""
    return_text: str | None = None
    """Error text returned by `/execute as-string`; None: only the output is returned."""

    @property
    def output(self) -> str:
        """Complete output for people, the error last."""
        return "\n".join(self.lines if self.error is None else [*self.lines, self.error])

    @property
    def as_string(self) -> str:
        """Return value of `/execute as-string`."""
        return self.output if self.return_text is None else "\n".join([*self.lines, self.return_text])


def run_script(core: Core, caller: Caller, script: str, variables: Mapping[str, str] | None = None) -> ScriptOutcome:
    """Parse a whole script, then run it; `variables` are available as `$name`."""
    outcome = ScriptOutcome()
    try:
        statements = core.script_cache.get(script) or list(_parse.Parser(core, _parse.TextPart(script)).statements())
    except _parse.ConsoleError as error:
        outcome.error = _error_text(core, str(error))
        return outcome
    if len(core.script_cache) >= _PARSED_SCRIPTS:
        core.script_cache.clear()
    core.script_cache[script] = statements
    runner = _run(core, caller, statements, outcome, variables=variables)
    if outcome.error is not None and runner.failed_command is not None:
        outcome.return_text = _add_position(core, outcome.error, runner.failed_command)
    return outcome


def _add_position(core: Core, words: str, command: _parse.MenuCommand) -> str:
    """Add command and line to a script's error; before 7.22 not for a missing value."""
    missing = words.startswith("missing value(s)")
    place = f" ({command.menu.rstrip('/')}/{command.name}; line {command.line})"
    return f"{'Script Error: ' if missing else ''}{words}{place if core.schema.at_least('7.22') or not missing else ''}"


def run_line(
    core: Core, caller: Caller, line: str, menu: str, *, width: int | None = None
) -> tuple[ScriptOutcome, str]:
    """Run a line typed at the prompt of `menu`; also return the prompt's new menu.

    `width`: screen width in columns; None: unlimited.
    """
    outcome = ScriptOutcome()
    parser = _parse.Parser(core, _parse.TextPart(line), menu)
    try:
        statements = list(parser.statements())
    except _parse.ConsoleError as error:
        outcome.error = _error_text(core, str(error))
        return outcome, menu
    _run(core, caller, statements, outcome, width)
    return outcome, parser.menu


def run_file(core: Core, caller: Caller, text: str) -> ScriptOutcome:
    """Run a file: each statement runs as soon as it is parsed."""
    outcome = ScriptOutcome()
    source = _parse.TextPart(text)
    try:
        for statement in _parse.Parser(core, source).statements():
            _run(core, caller, [statement], outcome)
            if outcome.error is not None:
                break
    except _parse.ConsoleError as error:
        outcome.error = _error_text(core, str(error))
    return outcome


def _error_text(core: Core, words: str, command: _parse.MenuCommand | None = None) -> str:
    """Return the error text; of RouterOS 6 only errors that adoption may cause are known.

    No command tree of version 6 is published: a name or value missing in the oldest tree may exist there.
    """
    is_known = core.schema.at_least("7.0") or (command is not None and command.menu in _ADOPTION_MENUS)
    return words if is_known or not words.startswith(_REFUSALS) else f"not rehearsed by the twin: RouterOS 6: {words}"


def check_syntax(core: Core, text: str) -> str | None:
    """Return the first error that `import dry-run` finds, or None."""
    try:
        list(_parse.Parser(core, _parse.TextPart(text)).statements())
    except _parse.ConsoleError as error:
        return str(error)
    return None


def _run(  # noqa: PLR0913, PLR0917 - a script, who runs it, and where its words go
    core: Core,
    caller: Caller,
    statements: list[_parse.Statement],
    outcome: ScriptOutcome,
    width: int | None = None,
    variables: Mapping[str, str] | None = None,
) -> _Runner:
    runner = _Runner(core, caller, width, dict(variables or {}))
    for statement in statements:
        try:
            outcome.lines.extend(runner.run(statement))
        except MissingArgument as error:
            outcome.error = _error_text(core, error.console, runner.failed_command)
        except Trap as error:
            outcome.error = _error_text(core, error.message, runner.failed_command)
        outcome.is_paged = runner.is_paged
        if outcome.error is not None and not core.deviates(Deviation.SCRIPT_GOES_ON):
            break
    return runner


@dataclass(slots=True)
class _Runner:
    core: Core
    caller: Caller
    width: int | None
    variables: dict[str, str]
    is_paged: bool = False
    """The output may be shown page by page."""
    failed_command: _parse.MenuCommand | None = None
    """Command at which the script stopped."""

    def run(self, statement: _parse.Statement) -> list[str]:
        if isinstance(statement, _parse.DoOnError):
            return self._attempt(statement)
        if isinstance(statement, _parse.IfStatement):
            branch = statement.then if self._holds(statement) else statement.otherwise
            return [line for inner in branch for line in self.run(inner)]
        if isinstance(statement, _parse.LocalVariable):
            self.variables[statement.name] = self._evaluate(statement.value)
            return []
        if isinstance(statement, _parse.Each):
            return self._run_foreach(statement)
        if isinstance(statement, _parse.Failure):
            self.failed_command = None
            raise Trap(f"{self._fill(statement.text)} (:error; line {statement.line})")
        if isinstance(statement, _parse.Put):
            return self._evaluate_put(statement.what)
        return self._command(statement)[1]

    def _evaluate_put(self, what: _parse.Template | _parse.MenuCommand | _parse.Find | _parse.Parse) -> list[str]:
        if isinstance(what, _parse.Parse):
            return [_code(self.core, self._fill(what.text))]
        return [self._fill(what) if isinstance(what, tuple) else self._evaluate(what)]

    def _run_foreach(self, each: _parse.Each) -> list[str]:
        lines: list[str] = []
        for index, text in enumerate(each.texts):
            self.variables |= {each.index: str(index), each.value: self._fill(text)}
            for statement in each.body:
                lines += self.run(statement)
        return lines

    def _fill(self, text: _parse.Template) -> str:
        """Substitute variables; an unset one is empty."""
        return "".join(
            self.variables.get(part.name, "") if isinstance(part, _parse.Variable) else part for part in text
        )

    def _attempt(self, attempt: _parse.DoOnError) -> list[str]:
        """Run a block; if a command fails, keep its effects and run the other block."""
        lines: list[str] = []
        try:
            for statement in attempt.body:
                lines += self.run(statement)
        except Trap:
            for statement in attempt.rescue:
                lines += self.run(statement)
        return lines

    def _holds(self, choice: _parse.IfStatement) -> bool:
        """Evaluate a condition on numbers or times; with an unset variable it is false.

        Assumption: use-uptime-compares
        """
        if isinstance(choice.left, _parse.Find) and isinstance(choice.right, int):
            return _COMPARE[choice.sign](len(self._find_ids(choice.left)), choice.right)
        if isinstance(choice.left, _parse.MenuCommand) and isinstance(choice.right, int):
            elapsed_s = seconds(self._evaluate(choice.left))
            return elapsed_s is not None and _COMPARE[choice.sign](int(elapsed_s), choice.right)
        value = self.variables.get(choice.left.name, "") if isinstance(choice.left, _parse.Variable) else ""
        if isinstance(choice.right, str):
            return re.search(choice.right, value) is not None
        return value.isdecimal() and _COMPARE[choice.sign](int(value), choice.right)

    def _evaluate(self, what: _parse.MenuCommand | _parse.Find) -> str:
        """Return the value of `[...]`: row ids, a property, or a count."""
        if isinstance(what, _parse.Find):
            return ";".join(self._find_ids(what))
        return self._command(what)[0]

    def _find_ids(self, find: _parse.Find) -> list[str]:
        call = Call(self.caller, find.menu, "find", console=True)
        return read.select(self.core, call, find.where)

    def _command(self, command: _parse.MenuCommand) -> tuple[str, list[str]]:
        self.failed_command = None
        try:
            return self._execute(command)
        except Trap:
            self.failed_command = self.failed_command or command
            raise

    def _execute(self, command: _parse.MenuCommand) -> tuple[str, list[str]]:
        arguments = {name: self._argument(value) for name, value in command.arguments.items()}
        for name in _NUMBERS & set(arguments) if self.width is not None else ():
            arguments[name] = self._resolve_numbers(command.menu, arguments[name])
        call = Call(self.caller, command.menu, command.name, arguments, tuple(command.unset), console=True)
        if command.name == "print":
            return self._print(call, command.where)
        result = self.core.dispatch(self.core, call)
        if "as-value" in arguments:
            return _join_rows(result.rows), []
        return result.ret or "", [*result.text.splitlines(), *people.render_report(call.command, result.rows)]

    def _resolve_numbers(self, menu: str, value: str) -> str:
        """Replace row numbers that this session has seen by ids; scripts have none (Manual, Console: Item numbers)."""
        row_ids = self.core.numbered.get((self.caller.number, menu), [])
        parts = value.split(",")
        if not all(part.isdecimal() and int(part) < len(row_ids) for part in parts):
            return value
        return ",".join(row_ids[int(part)] for part in parts)

    def _argument(self, value: str | _parse.Template | _parse.Find | _parse.MenuCommand) -> str:
        if isinstance(value, str):
            return value
        if isinstance(value, tuple):
            return self._fill(value)
        if isinstance(value, _parse.MenuCommand):
            return self._evaluate(value)
        ids = self._find_ids(value)
        if not ids:
            check_known(self.core, value.menu)
            raise Trap("expected item id")
        return ",".join(ids)

    def _print(self, call: Call, where: read.Where) -> tuple[str, list[str]]:
        """Return the value within brackets, and the output for people.

        `as-value` prints nothing, and without `detail` it returns the table's columns (tik4net, Docs/findings-cli.md).
        """
        matching_rows = [row for row in read.all_rows(self.core, call) if read.fits(row, where)]
        words = frozenset(call.arguments)
        if "count-only" in words:
            return str(len(matching_rows)), [str(len(matching_rows))]
        if "stats" not in words:
            matching_rows = [without_counters(row) for row in matching_rows]
        columns = tuple(call.arguments.get("proplist", call.arguments.get(".proplist", "")).split(","))
        view = people.PrintView(call.menu, words, columns if columns != ("",) else (), self.width)
        if "as-value" in words:
            return _join_rows(people.as_value_rows(self.core, view, matching_rows)), []
        if self.width is not None:
            self.core.numbered[self.caller.number, call.menu] = [row.get(".id", "") for row in matching_rows]
        self.is_paged = self.is_paged or "without-paging" not in words
        return "", people.render_print(self.core, view, matching_rows)


def _join_rows(rows: list[dict[str, str]]) -> str:
    return ";".join(f"{name}={value}" for row in rows for name, value in row.items())


def _code(core: Core, text: str) -> str:
    """Return the output of `:put [:parse "..."]`: the code of the text or its error; nothing is executed.

    Recorded on 7.20.8 to 7.23.3 (tikoci/lsp-routeros-ts, docs/parseil-format.md; tikoci/centrs,
    test/fixtures/parse-oracle.json). Unknown commands and, from 7.23, arguments are reported within the code.
    """
    parser = _parse.Parser(core, _parse.TextPart(text), only_code=True)
    codes: list[str] = []
    try:
        codes += (_code_of(statement) for statement in parser.statements())
    except _parse.ConsoleError as error:
        # What follows a mistake that stands within the code is left out. Assumption: parse-words
        if core.deviates(Deviation.PARSE_WORDS):
            return f"mistake: {error.verdict.strip('(<% ')}"
        return ";".join([*codes, error.verdict]) if error.verdict.startswith("(") else error.verdict
    return ";".join(codes) or ("/" if text else "")


def _code_of(statement: _parse.Statement) -> str:
    if isinstance(statement, _parse.MenuCommand):
        path = f"{statement.menu.rstrip('/')}/{statement.name}"
        arguments = sorted(statement.arguments.items())
        return f"(evl {path}{';'.join(f'{name}={_code_of_value(value)}' for name, value in arguments)})"
    if isinstance(statement, _parse.Put):
        return f"(evl /putmessage={_code_of_value(statement.what)})"
    # Of statements that hold others no code is recorded in full. Assumption: parse-words
    words = {
        _parse.DoOnError: "do",
        _parse.IfStatement: "if",
        _parse.LocalVariable: "local",
        _parse.Each: "foreach",
        _parse.Failure: "error",
    }
    return f"(evl /{words[type(statement)]})"


def _code_of_value(value: str | _parse.Template | _parse.MenuCommand | _parse.Find | _parse.Parse) -> str:
    if isinstance(value, str):
        return value
    if isinstance(value, tuple):
        return "".join(part if isinstance(part, str) else f"${part.name}" for part in value)
    if isinstance(value, _parse.MenuCommand):
        return _code_of(value)
    return f"(evl {value.menu}/find)" if isinstance(value, _parse.Find) else f"(evl /parse{_code_of_value(value.text)})"
