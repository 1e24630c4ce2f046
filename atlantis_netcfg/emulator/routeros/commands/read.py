"""Commands print, getall, get and find (Manual, API; Manual, Console).

Also the conditions of `find` and `print where` (Manual, Console: Expressions in where).

A bare value with `/` or `:` has another type than the property: it matches nothing (seen on a CHR 7.23.2, tik4net,
Docs/findings-cli.md).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros import answers
from atlantis_netcfg.emulator.routeros.commands import _checks
from atlantis_netcfg.emulator.routeros.commands._computed import COMPUTED_MENUS
from atlantis_netcfg.emulator.routeros.commands.radio import add_inherited
from atlantis_netcfg.emulator.routeros.core import Call, CallResult, Core
from atlantis_netcfg.emulator.routeros.menus import Shape
from atlantis_netcfg.emulator.routeros.modem import settle
from atlantis_netcfg.emulator.routeros.schema import offered_values
from atlantis_netcfg.emulator.routeros.spec import Deviation
from atlantis_netcfg.emulator.routeros.views import rows, without_counters

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence


_OPERATIONS = re.compile(r"[!&|.]|\d+")


def matches(queries: Sequence[str], row: Mapping[str, str], *, orders_texts: bool = True) -> bool:
    """Evaluate the query words (without `?`) on one item; any false value left on the stack rejects it.

    Raises Trap on an invalid word.
    """
    stack: list[bool] = []
    for query in queries:
        if query.startswith("#"):
            _apply_operations(query[1:], stack)
        else:
            stack.append(_is_query_true(query, row, orders_texts=orders_texts))
    return all(stack)


def _is_query_true(query: str, row: Mapping[str, str], *, orders_texts: bool) -> bool:
    if query.startswith("-"):
        return query[1:] not in row
    if query.startswith(("<", ">")):
        name, _, value = query[1:].partition("=")
        return name in row and _less(row[name], value, greater=query.startswith(">"), orders_texts=orders_texts)
    name, equals, value = query.removeprefix("=").partition("=")
    return row.get(name, "") == value if equals else bool(row.get(name))


def _less(local: str, other: str, *, greater: bool, orders_texts: bool) -> bool:
    """Compare numbers, or texts letter by letter. Assumption: api-query-order."""
    if greater:
        local, other = other, local
    return int(local) < int(other) if local.isdecimal() and other.isdecimal() else orders_texts and local < other


def _apply_operations(text: str, stack: list[bool]) -> None:
    operations = _OPERATIONS.findall(text)
    if not operations or "".join(operations) != text:
        raise answers.Trap("invalid query")
    for operation in operations:
        _apply(operation, stack)


def _apply(operation: str, stack: list[bool]) -> None:
    """Apply an operator; below its bottom the stack has an endless supply of true values."""
    if operation == "!":
        stack.append(not _pop(stack))
    elif operation == "&":
        right, left = _pop(stack), _pop(stack)
        stack.append(left and right)
    elif operation == "|":
        right, left = _pop(stack), _pop(stack)
        stack.append(left or right)
    elif operation == ".":
        stack.append(stack[-1] if stack else True)
    else:
        index = int(operation)
        stack.append(stack[-1 - index] if index < len(stack) else True)


def _pop(stack: list[bool]) -> bool:
    return stack.pop() if stack else True


_PROPLIST = (".proplist", "proplist")
_ANY = {
    *_PROPLIST,
    "detail",
    "stats",
    "count-only",
    "without-paging",
    "terse",
    "brief",
    "value-list",
    "show-ids",
    "as-value",
    "config",
}


def all_rows(core: Core, call: Call) -> list[dict[str, str]]:
    """Return the rows of the call's menu that this session may see."""
    if call.menu in COMPUTED_MENUS:
        return COMPUTED_MENUS[call.menu](core, call)
    menu_rows = rows(core, call.menu, sensitive="sensitive" in core.policies(call.caller))
    if call.menu == "/tool/netwatch" and core.deviates(Deviation.TIMES):
        menu_rows = [{**row, "interval": "10000 ms"} for row in menu_rows]
    if call.menu == "/system/scheduler" and core.deviates(Deviation.JOB_TEXT):
        menu_rows = [{**row, "on-event": row["on-event"][:4096]} for row in menu_rows]
    if call.menu == "/ip/route" and core.deviates(Deviation.NAMES):
        menu_rows = [{**row, "gateway": core.first_names.get(row["gateway"], row["gateway"])} for row in menu_rows]
    return menu_rows if "config" in call.arguments else add_inherited(core, call.menu, menu_rows)


def print_(core: Core, call: Call) -> CallResult:
    """Return the rows that match the queries."""
    argument_names = core.schema.arguments(call.menu, "print") | {".proplist"}
    for name in (*call.arguments, *call.unset):
        if name not in argument_names and not (name in ("stats", "detail") and call.menu in COMPUTED_MENUS):
            raise _checks.unknown(name)
        if name not in _ANY:
            raise answers.Trap(f"not rehearsed by the twin: {call.path} {name}")
    orders = not core.deviates(Deviation.QUERY_ORDER)
    selected_rows = [row for row in all_rows(core, call) if matches(call.queries, row, orders_texts=orders)]
    if "count-only" in call.arguments and not core.deviates(Deviation.COUNTS):
        return CallResult(ret=str(len(selected_rows)))
    proplist = _proplist(call)
    if proplist is None and "stats" not in call.arguments:
        selected_rows = [without_counters(row) for row in selected_rows]
    elif proplist is not None:
        args = () if call.menu in COMPUTED_MENUS else core.store.table(call.menu).args
        there = {".id", *args, *(name for row in selected_rows for name in row)}
        absent = next((name for name in proplist if name not in there), None)
        if absent is not None and core.deviates(Deviation.PROPERTIES):
            raise _checks.unknown(absent)
        selected_rows = [{name: row[name] for name in proplist if name in row} for row in selected_rows]
    return CallResult(rows=selected_rows, listing=True)


def _proplist(call: Call) -> list[str] | None:
    for name in _PROPLIST:
        if name in call.arguments:
            return list(dict.fromkeys(call.arguments[name].split(",")))
    return None


def select(core: Core, call: Call, where: Where) -> list[str]:
    """Return the ids of the rows that match `[find ...]`."""
    return [row[".id"] for row in all_rows(core, call) if ".id" in row and fits(row, where)]


def find(core: Core, call: Call) -> CallResult:
    """Return all ids of the menu, joined by `;`."""
    for name in call.arguments:
        if name not in core.schema.arguments(call.menu, "find"):
            raise _checks.unknown(name)
        raise answers.Trap(f"not rehearsed by the twin: {call.path} {name}")
    return CallResult(ret=";".join(row[".id"] for row in all_rows(core, call) if ".id" in row))


def get(core: Core, call: Call) -> CallResult:
    """Return one property of one row, or the whole row as `name=value;...`."""
    argument_names = core.schema.arguments(call.menu, "get") | {".id", "numbers"}
    for name in call.arguments:
        if name not in argument_names:
            raise _checks.unknown(name)
    row = _selected_row(core, call)
    value_name = call.arguments.get("value-name")
    if value_name is None:
        return CallResult(ret=";".join(f"{key}={value}" for key, value in row.items()))
    if value_name not in row and (call.menu in COMPUTED_MENUS or value_name not in core.store.table(call.menu).args):
        raise answers.Trap("input does not match any value of value-name", answers.Category.ARGUMENT)
    return CallResult(ret=row.get(value_name, ""))


def _selected_row(core: Core, call: Call) -> dict[str, str]:
    menu_rows = all_rows(core, call)
    number = call.arguments.get(".id") or call.arguments.get("number") or call.arguments.get("numbers")
    if not any(".id" in row for row in menu_rows) and _is_settings(core, call.menu):
        return menu_rows[0]
    if number is None:
        raise _checks.MissingArgument(".id" if not call.console else "number")
    name_property = core.store.table(call.menu).menu.name_property if call.menu not in COMPUTED_MENUS else "name"
    for row in menu_rows:
        if number in (row.get(".id"), row.get(name_property)):
            return row
    raise _checks.no_such_item()


def _is_settings(core: Core, menu: str) -> bool:
    return menu in COMPUTED_MENUS or core.store.table(menu).menu.shape is Shape.SETTINGS


def inspect(core: Core, call: Call) -> CallResult:
    """Emulate `/console/inspect`: children of a path (`child`), or values for an argument (`completion`).

    Paths are words with commas between them; slashes find nothing (tikoci/centrs, commands/api/AGENTS.md: CHR 7.23.1).
    """
    # Queries pick among the rows. Assumption: inspect-whole
    # Other versions offer the same. Assumption: offered-values
    requests: dict[str, Callable[[Core, Call], list[dict[str, str]]]] = {"child": _children, "completion": _offers}
    request = call.arguments.get("request", "")
    if request not in requests:
        raise answers.Trap(f"not rehearsed by the twin: {call.path} request={request}")
    results = [row for row in requests[request](core, call) if matches(call.queries, row)]
    if not call.queries and core.deviates(Deviation.LISTS) and core.number() % 2:
        results = results[:-1]
    proplist = _proplist(call)
    return CallResult(
        rows=results if proplist is None else [{name: row[name] for name in proplist if name in row} for row in results]
    )


def _path_words(call: Call) -> list[str]:
    path = call.arguments.get("path", "")
    return [word for word in path.split(",") if word] if "/" not in path else ["/"]


def _children(core: Core, call: Call) -> list[dict[str, str]]:
    words = _path_words(call)
    menu, schema = "/" + "/".join(words), core.schema
    kinds = dict.fromkeys(schema.submenus(menu), "dir") if schema.has_menu(menu) else {}
    kinds |= dict.fromkeys(schema.commands(menu), "cmd")
    if not kinds and words:
        kinds = dict.fromkeys(schema.arguments("/" + "/".join(words[:-1]), words[-1]), "arg")
    return [{"name": name, "node-type": kinds[name], "type": "child"} for name in sorted(kinds)]


def _offers(core: Core, call: Call) -> list[dict[str, str]]:
    """Return the values offered for the argument at the path, or at the end of the input (`add action=`)."""
    input_text = call.arguments.get("input", "")
    words = [
        *_path_words(call),
        *re.split(r"[/ =]+", input_text.strip("/ ").rpartition("=")[0] if "=" in input_text else input_text),
    ]
    *path, argument = [word for word in words if word] or [""]
    *menu, command = path or [""]
    where = "/" + "/".join(menu)
    if argument not in core.schema.arguments(where, command):
        return []
    prefix = input_text.rpartition("=")[2] if "=" in input_text else ""
    return [
        {"completion": value, "preference": "80", "show": "true", "style": "none", "text": ""}
        for value in offered_values(where, argument)
        if value.startswith(prefix)
    ]


_BOOLS = {"yes": "true", "no": "false"}


@dataclass(frozen=True, slots=True)
class Condition:
    """A condition `name=value`, `!=`, `~`, `<` or `>`; `name` alone has the sign `?`."""

    name: str
    sign: str = "?"
    value: str = ""
    is_negated: bool = False
    possible: bool = True
    """Whether the value has the type of a property."""

    def fits(self, row: Mapping[str, str]) -> bool:
        """Return whether a row matches."""
        return self.is_negated is not self._fits(row.get(self.name, ""))

    def _fits(self, text: str) -> bool:
        if self.sign == "?":
            return text not in ("", "false", "no")
        if not self.possible:
            return self.sign == "!="
        if self.sign == "~":
            return re.search(self.value, text) is not None
        same = text in (self.value, _BOOLS.get(self.value))
        if self.sign in ("=", "!="):
            return same is (self.sign == "=")
        less = _sort_key(text) < _sort_key(self.value)
        return less if self.sign == "<" else not (less or same)


Where = tuple[tuple[Condition, ...], ...]
"""Alternatives, each with conditions that must all hold; without any alternative every row matches."""


def fits(row: Mapping[str, str], where: Where) -> bool:
    """Return whether a row matches any group of conditions."""
    return not where or any(all(condition.fits(row) for condition in item) for item in where)


def _sort_key(text: str) -> tuple[int, int, str]:
    return (0, int(text), "") if text.isdecimal() else (1, 0, text)


def _rows_by_id(core: Core, call: Call) -> dict[str, dict[str, str]]:
    return {row[".id"]: row for row in all_rows(core, call) if ".id" in row}


def emit(core: Core) -> None:
    """Update the modem after changes, and send news to every listener.

    A removed row is `.dead=true`, where the Manual says `yes` (7.23.1: tikoci/centrs, commands/api/AGENTS.md).
    """
    settle(core)
    for listener in core.listeners:
        now = _rows_by_id(core, listener.call)
        news = [row for number, row in now.items() if listener.shown_rows.get(number) != row]
        news += [{".id": number, ".dead": "true"} for number in listener.shown_rows if number not in now]
        listener.shown_rows = now
        core.outbox += [(listener.caller.number, listener.tag, answers.Answer.row(row)) for row in news]
