r"""Actions as text for a device, and the check of a plan by the device's own parser.

Lines and sentences contain secrets in clear.

`:put [:parse "..."]` prints how RouterOS parses a text, and does not execute it (recorded on 7.20.8 to 7.23.3:
tikoci/centrs, test/fixtures/parse-oracle.json). It checks names; the allowed values of a closed list are requested
from `/console/inspect`. An accepted text is printed in full, so a loop on the device prints refusals only. Each script
ends with a command that must be refused: without that refusal nothing was proved, as silence is not a pass.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.routeros import _types, menus
from atlantis_netcfg.routeros.api import Command, Reply
from atlantis_netcfg.routeros.rsc import in_quotes, quote

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence


def console(action: _types.Action) -> str:
    r"""Return the console line, without line end: `/ip/firewall/filter/add chain=input place-before=*A3`.

    Manual, Scripting, and Configuration Management. Quoted values are escaped so that `$`, `\`, `"` and line ends
    arrive unchanged: inside quotes the console would silently replace `$name`.
    """
    words = [f"{action.menu}/{action.verb}"]
    if action.ids:
        words.append(",".join(action.ids))
    words += (_word(name, value) for name, value in _values(action))
    if action.before is not None:
        words.append(f"{_PLACE[action.verb]}={action.before}")
    return " ".join(words)


def _word(name: str, value: str | None) -> str:
    return name if value is None else f"{name}={quote(value)}"


def _values(action: _types.Action) -> Iterator[tuple[str, str | None]]:
    """Yield names with values; None marks a name without value, which sets a flag (`fib`) or unsets (`!fib`).

    A boolean read over the API is `true`, which is a syntax error on the console (7.23.3).
    """
    fields = menus.MENUS[action.menu].by_name
    for name, value in action.values:
        if name.startswith("!"):
            yield name, None
        elif fields[name].kind is menus.PropertyKind.FLAG:
            yield (name if menus.canonical(menus.PropertyKind.FLAG, value) == "yes" else f"!{name}"), None
        elif fields[name].kind is menus.PropertyKind.BOOLEAN:
            yield name, menus.canonical(menus.PropertyKind.BOOLEAN, value)
        else:
            yield name, value


_PLACE = {_types.Verb.ADD: "place-before", _types.Verb.MOVE: "destination"}


def sentence(action: _types.Action) -> tuple[str, tuple[tuple[str, str], ...]]:
    """Return the command word and its arguments: `/ip/address/set`, `(.id, *5), (disabled, yes)`.

    Manual, API (`!name` unsets a property, ids are joined by commas, `destination` is the row to insert before).
    """
    arguments = [(name, value or "") for name, value in _values(action)]
    if action.ids:
        arguments.insert(0, ("numbers" if action.verb is _types.Verb.MOVE else ".id", ",".join(action.ids)))
    if action.before is not None:
        arguments.append((_PLACE[action.verb], action.before))
    return f"{action.menu}/{action.verb}", tuple(arguments)


def script_command(text: str) -> Command:
    """Return the command that runs a script and replies with its output (available from 7.9 on)."""
    return Command("/execute", (("script", text), ("as-string", "")))


ROOM: Final = 18
"""Sentences that fit in one flight with the reads before a change."""
_LINES = 25
"""Commands of one script: the device replies only after parsing all of them."""
_BYTES = 40_000
"""Maximum bytes of a script's lines before they are quoted twice: `/execute` takes 64 kB (manual, API, Scripting)."""
# Recorded of other menus and arguments; where it is taken instead, that is said. Assumption: parse-words
_CONTROL = "/system/identity/set atlantis=no"
"""Command that every version refuses: it has no such argument."""
_PLACEHOLDER = "00000000"
"""Replaces a secret, which the parser does not need."""
# Recorded on 7.22.1 (tikoci/restraml, docs/mikrotik-bug-native-api-inspect.md), where of 47 words with one property
# each some were lost once in a hundred times, and of 15 none. Assumption: inspect-whole
_COMPLETE = 30
"""Maximum words of a completion list that counts as complete: over the API long lists lose some."""
ENUMERATIONS: Final = frozenset(
    {
        ("/interface/bridge", "protocol-mode"),
        ("/interface/bridge/port", "frame-types"),
        ("/interface/ovpn-client", "protocol"),
        ("/ip/firewall/filter", "action"),
        ("/ip/firewall/mangle", "action"),
        ("/ip/firewall/nat", "action"),
        ("/routing/rule", "action"),
        ("/system/ntp/client", "mode"),
        ("/tool/netwatch", "type"),
    }
)
"""Menus and arguments that accept only a word of a closed list."""

_ANSWER = re.compile(r"^(\d+) ", re.MULTILINE)
_PLACE_OF = r"\(line \d+ column (\d+)\)"
_REFUSALS = (
    re.compile(rf"\(evl (bad parameter [^\s()]+) {_PLACE_OF} "),
    re.compile(rf"\(<%% (bad command name [^\s()]+) {_PLACE_OF} "),
    re.compile(rf"((?:expected|missing) [a-z]+(?: [a-z]+)*|syntax error) {_PLACE_OF}\Z"),
    re.compile(rf"(bad (?:parameter|command name) [^\s()]+) {_PLACE_OF}\Z"),
)
_NOT_UNDERSTOOD = "its parser responds with an unknown message"

_Argument = tuple[str, str]
"""Menu and argument name."""


def script(lines: Iterable[str]) -> str:
    """Return a script that lets the device parse each line and prints number and code of the rejected ones.

    Each line is quoted three times: for the array, for the inner script and for `:parse`.
    """
    # Public scripts do so. Assumption: parse-nested
    texts = ";".join(in_quotes(in_quotes(line)[1:-1]) for line in lines)
    return (
        f":foreach n,s in={{{texts}}} do={{"
        ':local v [:execute script=(":put [:parse \\"".$s."\\"]") as-string];'
        ':if ($v~"^\\\\(evl /") do={} else={:put "$n $v"}}'
    )


@dataclass(slots=True)
class Examination:
    """Check of a plan by the device's parser: requests and results, without any I/O."""

    refusals: dict[str, str] = field(default_factory=dict)
    """Maps a line to the device's error message; empty if the device accepts the line."""
    unclear: str = ""
    """Why not every line was checked."""
    _scripts: list[list[str]] = field(default_factory=list)
    _values: list[tuple[_Argument, tuple[str, ...]]] = field(default_factory=list)
    _good: set[tuple[_Argument, str]] = field(default_factory=set)
    _lists: dict[_Argument, tuple[str, ...] | None] = field(default_factory=dict)
    """Complete lists; None: the device offers none, or the list may be incomplete."""
    _whole: list[_Argument] = field(default_factory=list)

    def questions(
        self, actions: Sequence[_types.Action], rows: Mapping[str, Sequence[_types.Row]]
    ) -> tuple[Command, ...]:
        """Return the open requests for these actions, at most ROOM; `read_answers` reads the replies.

        A value that a row of the menu already has is not checked.
        """
        self._whole = [each for each, _ in self._values if each not in self._lists and self._missing(each)]
        self._values = list(self._find_open_values(actions, rows))
        lines = [] if self.unclear else [line for line in map(_line, actions) if line not in self.refusals]
        lines = list(dict.fromkeys(lines))
        self._scripts = _cut(lines, ROOM - len(self._values) - len(self._whole))
        return (
            *(script_command(script([*part, _CONTROL])) for part in self._scripts),
            *(build_completion_query(*argument) for argument in self._whole),
            *(build_completion_query(*argument, among=values) for argument, values in self._values),
        )

    def _find_open_values(
        self, actions: Sequence[_types.Action], rows: Mapping[str, Sequence[_types.Row]]
    ) -> Iterator[tuple[_Argument, tuple[str, ...]]]:
        values_by_argument: dict[_Argument, dict[str, None]] = {}
        for action in actions:
            for name, value in action.values:
                argument = (action.menu, name)
                is_known = (argument, value) in self._good or argument in self._lists or argument in self._whole
                if (
                    value
                    and argument in ENUMERATIONS
                    and not is_known
                    and all(row.get(name) != value for row in rows.get(action.menu, ()))
                ):
                    values_by_argument.setdefault(argument, {})[value] = None
        return ((argument, tuple(values)) for argument, values in values_by_argument.items())

    def _missing(self, argument: _Argument) -> bool:
        """Return True if an expected value is not in the replies."""
        return any(
            (each, value) not in self._good for each, values in self._values if each == argument for value in values
        )

    def read_answers(self, replies: Sequence[Reply]) -> None:
        """Read the replies to the last `questions`."""
        scripts, whole = len(self._scripts), len(self._whole)
        for part, reply in zip(self._scripts, replies, strict=False):
            self._judge(part, reply)
        for argument, reply in zip(self._whole, replies[scripts:], strict=False):
            words = _completions(reply)
            self._lists[argument] = words if 0 < len(words) <= _COMPLETE else None
        for (argument, _), reply in zip(self._values, replies[scripts + whole :], strict=False):
            self._good |= {(argument, word) for word in _completions(reply)}

    def _judge(self, lines: Sequence[str], reply: Reply) -> None:
        if reply.trap is not None or reply.ret is None:
            text = msg(f" ({arg(reply.trap.message)})" if reply.trap is not None else "")
            self.unclear = msg(f"the device does not run a script that only parses{arg(text)}")
            return
        answers = _answers(reply.ret.replace("\r\n", "\n"))
        if not refusal(answers.pop(len(lines), "")) or any(number > len(lines) for number in answers):
            self.unclear = _NOT_UNDERSTOOD
            return
        for number, line in enumerate(lines):
            words = refusal(answers[number], line) if number in answers else ""
            if words is None:
                self.unclear = _NOT_UNDERSTOOD
            else:
                self.refusals[line] = words

    def doubt(self, actions: Iterable[_types.Action]) -> str:
        """Return why it is uncertain whether the device accepts the whole plan; empty if it is certain."""
        arguments = {(action.menu, name) for action in actions for name, _ in action.values}
        lists = sorted(each for each, words in self._lists.items() if words is None and each in arguments)
        values = (
            msg(f"it does not tell which words `{arg(name)}` of {arg(menus.MENUS[menu].title)} takes")
            for menu, name in lists
        )
        why = join("; ", (*((self.unclear,) if self.unclear else ()), *values))
        return msg(f"INCONCLUSIVE whether this device takes every command of the plan: {arg(why)}" if why else "")

    def objections(self, actions: Iterable[_types.Action], source: str) -> Iterator[str]:
        """Yield what the device rejects, with the line of the desired text."""
        for action in actions:
            words = self.refusals.get(_line(action), "") or next(self._foreign(action), "")
            if words:
                place = msg(f"{arg(source)}, line {arg(action.line)}: " if action.line else "")
                what = msg(f"{arg(action.verb.value)} {arg(action.subject)} in {arg(menus.MENUS[action.menu].title)}")
                yield msg(f"{arg(place)}the device's own parser does not take this ({arg(what)}): {arg(words)}")

    def _foreign(self, action: _types.Action) -> Iterator[str]:
        """Yield values that are not in their closed list."""
        for name, value in action.values:
            words = self._lists.get((action.menu, name))
            if words is not None and value not in words:
                yield msg(f"`{arg(name)}` is one of {arg(', '.join(words))}, not {arg(value)}")


def _cut(lines: Sequence[str], room: int) -> list[list[str]]:
    """Split lines into few scripts, each short enough for the device; never more than `room` if they fit."""
    most = max(_LINES, -(-len(lines) // room))
    scripts: list[list[str]] = []
    size = 0
    for line in lines:
        if not scripts or len(scripts[-1]) == most or size + len(line) > _BYTES:
            scripts.append([])
            size = 0
        scripts[-1].append(line)
        size += len(line)
    return scripts


def _line(action: _types.Action) -> str:
    """Return the action's command for the parser: with one row instead of all, and without secrets."""
    values = tuple((name, _PLACEHOLDER if name in action.secrets else value) for name, value in action.values)
    return console(replace(action, ids=action.ids[:1], values=values))


def build_completion_query(menu: str, name: str, *, among: Sequence[str] = ()) -> Command:
    """Return the request for the list of an argument's values, or for those of `among` that are in it."""
    verb = "add" if menus.MENUS[menu].shape is menus.Shape.LIST else "set"
    path = ",".join((*menu.strip("/").split("/"), verb, name))
    arguments = (("request", "completion"), ("path", path), (".proplist", "completion"))
    # A device that ignores the queries sends all, which is as good. Assumption: inspect-whole
    # One without a radio sends its words all the same. Assumption: offered-without-hardware
    alternatives = [f"?completion={value}" for value in among]
    return Command("/console/inspect", arguments, (*alternatives, *["?#|"] * (len(alternatives) - 1)))


def _completions(reply: Reply) -> tuple[str, ...]:
    return tuple(row.get("completion", "") for row in reply.rows) if reply.trap is None else ()


def _answers(text: str) -> dict[int, str]:
    """Split the output at the line numbers, which only increase."""
    starts: list[tuple[int, re.Match[str]]] = []
    for match in _ANSWER.finditer(text):
        if not starts or int(match[1]) > starts[-1][0]:
            starts.append((int(match[1]), match))
    ends = [match.start() for _, match in starts] + [len(text)]
    return {number: text[match.end() : end].strip() for (number, match), end in zip(starts, ends[1:], strict=True)}


def refusal(code: str, line: str = "") -> str | None:
    """Return the refusal in an output; None if unknown. Text that the device repeats from the line is left out."""
    for refusal in _REFUSALS:
        match = refusal.match(code)
        if match is not None:
            words, name = match[1], _name_at(line, int(match[2]))
            return words if words.startswith("bad ") or not name else msg(f"{arg(words)} at `{arg(name)}`")
    return None


def _name_at(line: str, column: int) -> str:
    """Return the argument at a column (1-based); quoted text is skipped."""
    names = re.finditer(r' (!?[\w.-]+)(?:=(?:"(?:\\.|[^"\\])*"|[^\s"]*))?(?= |\Z)', line)
    return next((match[1] for match in names if match.start(1) < column <= match.end() + 1), "")
