r"""Statements of the supported subset: `:put`, `:error`, `:do { ... } on-error={ ... }`, `:if`, and menu commands.

Also statements that pass texts to the device's own parser: `:put [:parse "..."]`, `:foreach` over texts, and `:local`
with the result of a command, `[:execute script=(...) as-string]`.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.commands.read import Condition, Where
from atlantis_netcfg.emulator.routeros.schema import OLDEST_TREE, UNSEEN, UNSEEN_UNTIL
from atlantis_netcfg.emulator.routeros.spec import Deviation
from atlantis_netcfg.emulator.routeros.values import BadValue, FlagValue

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator

    from atlantis_netcfg.emulator.routeros.core import Core
    from atlantis_netcfg.emulator.routeros.menus import Arg


@dataclass(frozen=True, slots=True)
class Variable:
    """A variable set by the script or its caller: `$"response-count"`."""

    name: str


Template = tuple[str | Variable, ...]
"""A text with variables in it."""


@dataclass(frozen=True, slots=True)
class Find:
    """The expression `[find name=value ...]`."""

    menu: str
    where: Where
    place: int


@dataclass(slots=True)
class MenuCommand:
    """A menu command with its arguments."""

    menu: str
    name: str
    arguments: dict[str, str | Template | Find | MenuCommand] = field(default_factory=dict)
    unset: list[str] = field(default_factory=list)
    where: Where = ()
    place: int = 0
    line: int = 1


@dataclass(frozen=True, slots=True)
class Parse:
    """The expression `[:parse text]`."""

    text: Template


@dataclass(frozen=True, slots=True)
class Put:
    """`:put` with a text, or with a command or parsed code whose value it prints."""

    what: Template | MenuCommand | Find | Parse


@dataclass(frozen=True, slots=True)
class LocalVariable:
    """`:local name [command]`."""

    name: str
    value: MenuCommand | Find


@dataclass(frozen=True, slots=True)
class Each:
    """`:foreach index,value in={"text";"text"} do={ ... }`; other loops are not emulated."""

    index: str
    value: str
    texts: tuple[Template, ...]
    body: tuple[Statement, ...]


@dataclass(frozen=True, slots=True)
class Failure:
    """`:error "text"`."""

    text: Template
    line: int


@dataclass(frozen=True, slots=True)
class DoOnError:
    """`:do { ... } on-error={ ... }`: the second block runs if a command of the first fails."""

    body: tuple[Statement, ...]
    rescue: tuple[Statement, ...]


@dataclass(frozen=True, slots=True)
class IfStatement:
    """`:if (left sign right) do={ ... } else={ ... }`; right of `~` is a regular expression.

    Left of a time in seconds (`90s`) is a command that returns a time: `[/system resource get uptime]`.

    A number is compared with a variable or with the row count of a `find`: `($"response-count" = 0)`,
    `([:len [/ip route find disabled=no]] > 0)`; or a variable with a regular expression: `($v ~ "^ok")`.
    """

    left: Variable | Find | MenuCommand
    sign: str
    right: int | str
    then: tuple[Statement, ...]
    otherwise: tuple[Statement, ...] = ()


Statement = MenuCommand | Put | Failure | DoOnError | IfStatement | LocalVariable | Each


_ESCAPES = {
    '"': '"',
    "\\": "\\",
    "n": "\n",
    "r": "\r",
    "t": "\t",
    "$": "$",
    "?": "?",
    "_": " ",
    "a": "\a",
    "b": "\b",
    "f": "\f",
    "v": "\v",
}
_HEX = re.compile(r"[0-9A-F]{2}")
_VARIABLE = re.compile(r"[A-Za-z0-9_]+")
_QUOTED_NAME = re.compile(r"[A-Za-z0-9_-]+")
_BARE = re.compile(r"[^\s\"\\$&'();=?\[\]^{|}]+")
_PLAIN = re.compile(r"[^\"$\\]+")
_INDENT = " \t"


class ConsoleError(Exception):
    """Syntax error of the console; `str()` is its message, with line and column.

    `verdict` is the result of `:parse`, if that is another text.
    """

    def __init__(self, message: str, verdict: str = "") -> None:
        super().__init__(message)
        self.verdict = verdict or message


@dataclass(slots=True)
class TextPart:
    r"""A script and a position in it.

    Quoting (Manual, Scripting: Constant Escape Sequences): only double quotes; within them `$name` is substituted, by
    nothing if no such variable exists, and `\` starts an escape; outside them `$` and `\` are errors.
    """

    source: str
    at: int = 0
    end: int = field(init=False)
    _starts: list[int] = field(init=False)

    def __post_init__(self) -> None:
        self.source = self.source.replace("\r\n", "\n")
        self.end = len(self.source)
        self._starts = [0, *(match.end() for match in re.finditer("\n", self.source))]

    def error(self, words: str, at: int | None = None) -> ConsoleError:
        """Build the error for a position, by default the current one."""
        return ConsoleError(self.add_position(words, self.at if at is None else at))

    def add_position(self, words: str, at: int) -> str:
        """Append line and column of a position to a message; columns count bytes."""
        line = bisect_right(self._starts, at) - 1
        before = self.source[self._starts[line] : at]
        return f"{words} (line {line + 1} column {len(before.encode(errors='surrogateescape')) + 1})"

    @property
    def line(self) -> int:
        """Number of the current line, from 1."""
        return bisect_right(self._starts, self.at)

    def peek(self) -> str:
        """Return the next character, or "" at the end."""
        return self.source[self.at : self.at + 1]

    def take(self, text: str) -> bool:
        """Skip `text` if it comes next; return whether it did."""
        if not self.source.startswith(text, self.at):
            return False
        self.at += len(text)
        return True

    def match(self, pattern: re.Pattern[str]) -> str | None:
        """Skip and return a match of the pattern, or None."""
        match = pattern.match(self.source, self.at)
        if match is None:
            return None
        self.at = match.end()
        return match[0]

    def space(self) -> None:
        """Skip white space and joined line ends, but not line ends."""
        while self.at < self.end:
            if self.peek() in _INDENT:
                self.at += 1
            elif not self._skip_line_join():
                return
            else:
                self._notes()

    def _notes(self) -> None:
        """Skip comments between joined lines (as 7.23.3 does)."""
        while self.peek() == "#":
            self.skip_line()
            self.take("\n")
            self._indent()

    def _skip_line_join(self) -> bool:
        if not self.take("\\\n"):
            return False
        self._indent()
        return True

    def _indent(self) -> None:
        while self.peek() and self.peek() in _INDENT:
            self.at += 1

    def skip_line(self) -> None:
        """Skip to the end of the line."""
        while self.peek() not in ("\n", ""):
            self.at += 1

    def value(self) -> str:
        """Parse a quoted or bare value. Raises ConsoleError if there is none."""
        while self._skip_line_join():
            pass
        if self.peek() == '"':
            return "".join(part for part in self.template() if isinstance(part, str))
        start = self.at
        parts = []
        while (part := self.match(_BARE)) is not None:
            parts.append(part)
            if not self._skip_line_join():
                break
        if not parts or self.peek() in tuple("\"\\$&'()=?[^{|"):
            raise self.error("syntax error", self.at if parts else start)
        return "".join(parts)

    def template(self) -> Template:
        """Parse a quoted text: pieces and variables. Raises ConsoleError."""
        start = self.at
        self.at += 1
        pieces = list(self._pieces(start))
        self.at += 1
        return tuple(pieces)

    def _pieces(self, start: int) -> Iterator[str | Variable]:
        pieces: list[str] = []
        while self.peek() != '"':
            if self.at >= self.end:
                raise self.error("syntax error", start)
            if self.peek() == "$":
                yield _decode(pieces)
                pieces = []
                yield self.variable()
            else:
                pieces.append(self.match(_PLAIN) or self._character())
        yield _decode(pieces)

    def variable(self) -> Variable:
        """Parse `$name` or `$"name"`. Raises ConsoleError."""
        start = self.at
        self.at += 1
        is_quoted = self.take('"')
        name = self.match(_QUOTED_NAME if is_quoted else _VARIABLE)
        if name is None or (is_quoted and not self.take('"')):
            raise self.error("syntax error", start)
        return Variable(name)

    def _character(self) -> str:
        if self.peek() == "\\":
            return "" if self._skip_line_join() or self.take("\\ ") or self.take("\\\t") else self._escape()
        self.at += 1
        return self.source[self.at - 1]

    def _escape(self) -> str:
        start = self.at
        self.at += 1
        code = self.match(_HEX)
        if code is not None:
            return bytes([int(code, 16)]).decode(errors="surrogateescape")
        char = self.peek()
        if char not in _ESCAPES or not char:
            raise self.error("syntax error", start)
        self.at += 1
        return _ESCAPES[char]


def _decode(pieces: list[str]) -> str:
    return "".join(pieces).encode(errors="surrogateescape").decode(errors="surrogateescape")


_SEGMENT = re.compile(r"[A-Za-z0-9][A-Za-z0-9-]*")
_NAME = re.compile(r"!?[A-Za-z0-9][A-Za-z0-9._/-]*(?==)|\.[A-Za-z0-9][A-Za-z0-9._-]*(?==)")
_UNSET = re.compile(r"![A-Za-z0-9][A-Za-z0-9._/-]*(?=[\s\]]|$)")
_READS = re.compile(r"\b(?:export|find|get|monitor|print)\b")
_PUT = re.compile(r":put(?=\s)")
_ERROR = re.compile(r":error(?=\s)")
_DO = re.compile(r":do(?=\s|\{)")
_DELAY = re.compile(r":delay[ \t]+\d+(?:ms|[smh])?(?![\w.])")
"""Delays: the emulator does at once what takes a device time."""
_IF = re.compile(r":if(?=\s|\()")
_LEN = re.compile(r"\[:len\s+")
_COMPARISON = re.compile(r"!=|<=|>=|[=<>~]")
_FOREACH = re.compile(r":foreach[ \t]+([a-z]+),([a-z]+)[ \t]+in=\{")
_LOCAL = re.compile(r":local[ \t]+([a-z]+)[ \t]+(?=\[)")
_PARSE = re.compile(r"\[:parse(?=[\s\"$(])")
_ROOT = re.compile(r":(?=execute\s)")
_REST = re.compile(r"[^\n;\]}]*")
_INTEGER = re.compile(r"\d+")
_THEN, _ELSE = re.compile(r"do="), re.compile(r"else=")
_PROPERTY = re.compile(r"\.?[A-Za-z0-9][A-Za-z0-9.-]*")
_SIGN = re.compile(r"!=|[=~<>]")
_JOINT = re.compile(r"(?:and|or)(?=\s)|&&|\|\|")
_ON_ERROR = re.compile(r"on-error=")
_POSITIONAL = {
    "set": ("numbers",),
    "remove": ("numbers",),
    "enable": ("numbers",),
    "disable": ("numbers",),
    "unset": ("numbers", "value-name"),
    "comment": ("numbers",),
    "move": ("numbers", "destination"),
    "monitor": ("numbers",),
    "show-capabilities": ("number",),
    "get": ("number", "value-name"),
    "import": ("file-name",),
    "sign": ("number",),
    "run": ("number",),
    "ping": ("address",),
}


@dataclass(slots=True)
class Parser:
    """Parses one statement after another; a menu on its own line is the starting point of the lines below.

    Names are checked while parsing, as in RouterOS: a script with a misspelt word does not start.
    """

    core: Core
    text: TextPart
    menu: str = "/"
    only_code: bool = False
    """For `:parse`: the script is not executed."""

    def statements(self) -> Iterator[Statement]:
        """Yield each statement. Raises ConsoleError."""
        while self._next():
            statement = self._statement()
            if statement is not None:
                yield statement
            self.text.space()
            if self.text.peek() not in ("\n", ";", ""):
                raise self.text.error("expected end of command")

    def _next(self) -> bool:
        """Skip to the next statement, over empty lines and comments."""
        while True:
            self.text.space()
            if self.text.peek() == "#":
                self.text.skip_line()
            elif not (self.text.take("\n") or self.text.take(";")):
                return bool(self.text.peek())

    def _statement(self) -> Statement | None:
        if self.text.match(_DELAY) is not None:
            return None
        word = self._scripting()
        if word is not None:
            return word
        if self.text.peek() in tuple(":{}()[]$\\\"'"):
            raise self.text.error("syntax error")
        command = self._command()
        if command.name:
            return command
        self.menu = command.menu
        return None

    def _scripting(self) -> Statement | None:
        """Parse a statement other than a menu command, if there is one."""
        if self.text.match(_PUT) is not None:
            self.text.space()
            return Put(self._put_argument())
        if self.text.match(_DO) is not None:
            return self._do_on_error()
        if self.text.match(_IF) is not None:
            return self._if_statement()
        if self.text.match(_ERROR) is not None:
            return self._error_statement()
        if (local := self.text.match(_LOCAL)) is not None:
            return LocalVariable(local.split()[1], self._bracket())
        return self._foreach() if self.text.peek() == ":" else None

    def _do_on_error(self) -> DoOnError:
        menu = self.menu
        body = self._block()
        self.text.space()
        if self.text.match(_ON_ERROR) is None:
            raise self.text.error("syntax error")
        attempt = DoOnError(body, self._block())
        self.menu = menu
        return attempt

    def _if_statement(self) -> IfStatement:
        menu = self.menu
        self._expect("(")
        left = self._left_operand()
        self.text.space()
        sign = self.text.match(_COMPARISON)
        self.text.space()
        pattern = sign == "~" and isinstance(left, Variable) and self.text.peek() == '"'
        right = self.text.value() if pattern else self.text.match(_INTEGER)
        if isinstance(left, MenuCommand) and not self.text.take("s"):
            raise self.text.error("syntax error")
        if sign is None or right is None or (sign == "~" and not pattern):
            raise self.text.error("syntax error")
        self._expect(")")
        self.text.space()
        if self.text.match(_THEN) is None:
            raise self.text.error("syntax error")
        then = self._block()
        self.text.space()
        otherwise = self._block() if self.text.match(_ELSE) is not None else ()
        self.menu = menu
        return IfStatement(left, sign, right if pattern else int(right), then, otherwise)

    def _foreach(self) -> Each | None:
        names = _FOREACH.match(self.text.source, self.text.at)
        if names is None:
            return None
        self.text.at = names.end()
        menu = self.menu
        texts: list[Template] = []
        while not self.text.take("}"):
            if texts and not self.text.take(";"):
                raise self.text.error("syntax error")
            if self.text.peek() != '"':
                raise self.text.error("syntax error")
            texts.append(self.text.template())
        self.text.space()
        if self.text.match(_THEN) is None:
            raise self.text.error("syntax error")
        body = self._block()
        self.menu = menu
        return Each(names[1], names[2], tuple(texts), body)

    def _left_operand(self) -> Variable | Find | MenuCommand:
        self.text.space()
        if self.text.peek() == "$":
            return self.text.variable()
        if self.text.peek() == "[" and _LEN.match(self.text.source, self.text.at) is None:
            result = self._bracket()
            if isinstance(result, MenuCommand):
                return result
            raise self.text.error("syntax error")
        if self.text.match(_LEN) is None:
            raise self.text.error("syntax error")
        result = self._bracket()
        self._expect("]")
        if not isinstance(result, Find):
            raise self.text.error("syntax error")
        return result

    def _expect(self, sign: str) -> None:
        self.text.space()
        if not self.text.take(sign):
            raise self.text.error("syntax error")

    def _block(self) -> tuple[Statement, ...]:
        self.text.space()
        if not self.text.take("{"):
            raise self.text.error("syntax error")
        inside: list[Statement] = []
        while self._next() and self.text.peek() != "}":
            statement = self._statement()
            if statement is not None:
                inside.append(statement)
            self.text.space()
            if self.text.peek() not in ("\n", ";", "}"):
                raise self.text.error("expected end of command")
        if not self.text.take("}"):
            raise self.text.error("syntax error")
        return tuple(inside)

    def _put_argument(self) -> Template | MenuCommand | Find | Parse:
        if self.text.match(_PARSE) is not None:
            self.text.space()
            parse = Parse(self._template())
            self._expect("]")
            return parse
        return self._bracket() if self.text.peek() == "[" else self._template()

    def _template(self) -> Template:
        """Parse a quoted text, a variable, or several of them in parentheses, joined by dots."""
        if self.text.peek() == '"':
            return self.text.template()
        if self.text.peek() == "$":
            return (self.text.variable(),)
        if not self.text.take("("):
            return (self.text.value(),)
        pieces = list(self._template())
        while self.text.take("."):
            pieces += self._template()
        if not self.text.take(")"):
            raise self.text.error("syntax error")
        return tuple(pieces)

    def _error_statement(self) -> Failure:
        line = self.text.line
        self.text.space()
        return Failure(self._template(), line)

    # --- commands --------------------------------------------------------------------------------------------------

    def _command(self) -> MenuCommand:
        """Parse path, command and arguments; a command without name is only a path."""
        place, line = self.text.at, self.text.line
        menu = "/" if self.text.take("/") or self.text.match(_ROOT) is not None else self.menu
        schema = self.core.schema
        while True:
            start = self.text.at
            word = self.text.match(_SEGMENT)
            if word is None:
                return MenuCommand(menu, "", place=place, line=line)
            word = self._whole(word, schema.words(menu))
            below = f"{menu.rstrip('/')}/{word}"
            if schema.has_menu(below):
                menu = below
                self._step()
            elif schema.has_command(menu, word):
                command = MenuCommand(menu, word, place=place, line=line)
                self._arguments(command)
                return command
            else:
                error = self._bad_command(word, start)
                unseen = ConsoleError(f"not rehearsed by the twin: {below}", error.verdict)
                raise unseen if self._unseen(below) else error

    def _unseen(self, path: str) -> bool:
        """Return whether a device may have a menu that no recorded command tree has."""
        schema = self.core.schema
        on_board = path in (UNSEEN if "routerboard" in schema.features else ())
        # What only reads is refused as a word that nobody has, as adoption asks older devices for newer menus.
        rest = _REST.match(self.text.source, self.text.at)
        reads = rest is not None and _READS.search(rest[0]) is not None
        return on_board or not (reads or schema.at_least(UNSEEN_UNTIL.get(path, OLDEST_TREE)))

    def _whole(self, word: str, candidates: Collection[str]) -> str:
        """Expand an abbreviated name, if it is unique.

        Menus and commands as recorded on 7.23.3, arguments as in the manual (Command Line Interface, Quick Typing). An
        ambiguous name is refused like an unknown one. Assumption: console-ambiguous
        """
        longer = [name for name in candidates if name.startswith(word)] if word not in candidates else []
        guesses = self.core.deviates(Deviation.AMBIGUOUS)
        return longer[0] if len(longer) == 1 or (longer and guesses) else word

    def _step(self) -> None:
        """Skip to the next word of a path: `ip/address` and `ip address` are the same from version 7.

        Changed in version 7 (Manual, Changelog). Assumption: slash-words-6
        """
        if self.text.peek() == "/" and not self.core.schema.at_least("7.0"):
            raise self.text.error("expected command name")
        if not self.text.take("/"):
            self.text.space()

    def _bad_command(self, word: str, start: int) -> ConsoleError:
        """Build the error for an unknown command; `:parse` returns code with the error and the words after it."""
        # On every version. Assumption: parse-words
        words = self.text.add_position(f"bad command name {word}", start)
        rest = _REST.match(self.text.source, start)
        return ConsoleError(words, f"(<%% {words} {';'.join(re.split(r'[/ ]+', rest[0].strip() if rest else word))})")

    def _bad_parameter(self, command: MenuCommand, name: str, start: int) -> ConsoleError:
        """Build the error for an unknown argument; from 7.23 it names the argument and the column after it."""
        # Recorded on 7.22.1 and on 7.23rc1 to 7.23.3; others answer as the next of these. Assumption: parse-words
        if not self.core.schema.at_least("7.23beta1"):
            return self.text.error("expected end of command", start)
        words = self.text.add_position(f"bad parameter {name}", start + len(name))
        path = f"{command.menu.rstrip('/')}/{command.name}"
        # Of a first argument the column is behind its name, of a later one before it, as in four records.
        # Wherever there is no record: Assumption: parse-words
        column = start if command.arguments else start + len(name)
        return ConsoleError(words, f"(evl {self.text.add_position(f'bad parameter {name}', column)} {path})")

    def _arguments(self, command: MenuCommand) -> None:
        """Parse the rest of the command; brackets in it start in the command's own menu."""
        outer, self.menu = self.menu, command.menu
        self.text.space()
        if command.name == "find" and not self._where(command):
            self._conditions(command)
        self._plain_arguments(command)
        self.menu = outer

    def _plain_arguments(self, command: MenuCommand) -> None:
        argument_names = self._argument_names(command)
        positional = list(_POSITIONAL.get(command.name, ()))
        if command.name == "get" and "number" not in self.core.schema.arguments(command.menu, "get"):
            positional.remove("number")  # settings have no rows: `get name`
        group = ""
        while self._has_more():
            start = self.text.at
            if (unset := self.text.match(_UNSET)) is not None:
                whole = self._whole(unset[1:], argument_names)
                self._check_parameter(command, whole, argument_names, start)
                command.unset.append(whole)
            elif (name := self.text.match(_NAME)) is not None:
                name = self._whole(f"{group}{name}" if name.startswith(".") else name, argument_names)
                group = name.rpartition(".")[0]
                self._check_parameter(command, name, argument_names, start)
                command.arguments[name] = self._argument_value(command, name)
            elif command.name == "print" and self._where(command):
                return
            else:
                self._positional_argument(command, argument_names, positional, start)

    def _argument_names(self, command: MenuCommand) -> frozenset[str]:
        names = self.core.schema.arguments(command.menu, command.name)
        if command.name in ("add", "set"):
            table = self.core.store.table(command.menu)
            names &= {*table.args, "numbers", "copy-from", "place-before"}
        return names

    def _has_more(self) -> bool:
        self.text.space()
        return self.text.peek() not in ("\n", ";", "]", "}", "")

    def _check_parameter(self, command: MenuCommand, name: str, argument_names: frozenset[str], start: int) -> None:
        if name not in argument_names:
            raise self._bad_parameter(command, name, start)

    def _argument_value(self, command: MenuCommand, name: str) -> str | Template | Find | MenuCommand:
        """Parse `=value` after a name; a flag takes none, which only running reports, not `:parse` (7.22.1, 7.23)."""
        arg = self._arg(command, name)
        if arg is not None and isinstance(arg.kind, FlagValue) and not self.only_code:
            raise self.text.error("expected end of command")
        self.text.at += 1
        start = self.text.at
        value = self._value()
        if not isinstance(value, str) or arg is None:
            return value
        try:
            normal_value = arg.kind.normalise(value)
            return arg.kind.code(normal_value) if self.only_code else normal_value
        except BadValue as error:
            raise self.text.error("syntax error", start) from error

    def _arg(self, command: MenuCommand, name: str) -> Arg | None:
        return self.core.store.table(command.menu).args.get(name) if command.name in ("add", "set") else None

    def _positional_argument(
        self, command: MenuCommand, argument_names: frozenset[str], positional: list[str], start: int
    ) -> None:
        if positional:
            command.arguments[positional.pop(0)] = self._value()
            return
        word = self.text.match(_SEGMENT)
        if word is None:
            raise self.text.error("syntax error", start)
        word = self._whole(word, argument_names)
        self._check_parameter(command, word, argument_names, start)
        if self.text.peek() == "=":
            raise self.text.error("syntax error")
        command.arguments[word] = ""

    def _value(self) -> str | Template | Find | MenuCommand:
        if self.text.peek() == "[":
            return self._bracket()
        return self._template() if self.text.peek() in ("$", "(") else self.text.value()

    # --- brackets --------------------------------------------------------------------------------------------------

    def _bracket(self) -> Find | MenuCommand:
        place = self.text.at
        self.text.at += 1
        self.text.space()
        outer = self.menu
        command = self._command()
        self.menu = outer
        self.text.space()
        if not command.name or not self.text.take("]"):
            raise self.text.error("syntax error")
        if command.name == "find":
            return self._find(command, place)
        if command.name == "print" and not {"as-value", "count-only"} & set(command.arguments):
            raise self.text.error("syntax error", place)
        return command

    def _find(self, command: MenuCommand, place: int) -> Find:
        return Find(command.menu, command.where, place)

    def _where(self, command: MenuCommand) -> bool:
        """Parse `where name=value ...`; `find` does not need the keyword."""
        start = self.text.at
        if self.text.match(_SEGMENT) != "where":
            self.text.at = start
            return False
        self._conditions(command)
        return True

    def _conditions(self, command: MenuCommand) -> None:
        alternatives: list[list[Condition]] = [[]]
        while self._has_more():
            word = self.text.match(_JOINT)
            if word is None:
                alternatives[-1].append(self._condition())
            elif word in ("or", "||"):
                alternatives.append([])
        command.where = tuple(tuple(alternative) for alternative in alternatives if alternative)

    def _condition(self) -> Condition:
        start = self.text.at
        is_negated = self.text.take("!")
        name = self.text.match(_PROPERTY)
        if name is None:
            raise self.text.error("syntax error", start)
        sign = self.text.match(_SIGN)
        if sign is None:
            return Condition(name, is_negated=is_negated)
        is_quoted = self.text.peek() == '"'
        value = self.text.value()
        return Condition(name, sign, value, is_negated, possible=is_quoted or re.search("[/:]", value) is None)
