"""Write commands (add, set, remove, …): each changed row is one history action; errors have the router's text."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.answers import Category, Trap
from atlantis_netcfg.emulator.routeros.commands import _checks
from atlantis_netcfg.emulator.routeros.core import Call, CallResult, Core
from atlantis_netcfg.emulator.routeros.menus import Shape
from atlantis_netcfg.emulator.routeros.schema import required_arguments
from atlantis_netcfg.emulator.routeros.spec import Deviation
from atlantis_netcfg.emulator.routeros.store import StoredItem
from atlantis_netcfg.emulator.routeros.values import BadValue, id_text, reference, seconds
from atlantis_netcfg.emulator.routeros.views import made_rows

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from atlantis_netcfg.emulator.routeros.store import Table

QUEUES = "/queue/interface"
_QUEUES = {"/interface/ethernet": "only-hardware-queue", "/interface/wireless": "wireless-default"}
"""Queues in `/queue/interface` of a factory-new router (verbose exports of 6.48 and 7.17)."""
_SELECTORS = (".id", "numbers", "number")
_BUILTIN = "failure: cannot change builtin"
_PLACEMENT = ("copy-from", "place-before")


def add(core: Core, call: Call) -> CallResult:
    """Add a row, at the end or before another; return its id."""
    table = core.store.table(call.menu)
    argument_names = core.schema.arguments(call.menu, "add") & {*table.args, *_PLACEMENT}
    values = _parse_arguments(core, table, call, argument_names)
    if "copy-from" in call.arguments:
        values = dict(_item(core, call, table, call.arguments["copy-from"]).values) | values
    check_needed(core, call, values)
    index = None
    if "place-before" in call.arguments:
        index = _index(core, call, table, call.arguments["place-before"])
    _checks.complete(core, call.menu, values)
    _checks.check(core, call.menu, values, None)
    item = core.store.insert(call.menu, values, index)
    _expire(core, call.menu, item)
    _checks.record_addition(core, call, item)
    return CallResult(ret=id_text(item.id))


def check_needed(core: Core, call: Call, values: Mapping[str, str]) -> None:
    """Refuse a row without its required arguments, from the recorded list or else from the menu's model."""
    table = core.store.table(call.menu)
    names = required_arguments(core.schema.version, call.menu)
    if isinstance(names, str) and not values:
        raise Trap(names)
    if not names or isinstance(names, str):
        names = tuple(arg.name for arg in table.args.values() if arg.is_required)
    lacking = [name for name in names if name in table.args and name not in values]
    if lacking:
        raise _checks.MissingArgument(*lacking)


def _index(core: Core, call: Call, table: Table, selector: str) -> int:
    """Return the position of a row; the console counts rows from 0."""
    if call.console and selector.isdecimal() and int(selector) < len(table.items):
        return int(selector)
    return table.items.index(_item(core, call, table, selector))


def _expire(core: Core, menu: str, item: StoredItem) -> None:
    """Make an address-list entry with a timeout dynamic: it expires, and is not exported."""
    if menu == "/ip/firewall/address-list" and "timeout" in item.values:
        item.dynamic = True
        core.expires[item.id] = core.now() + (seconds(item.values["timeout"]) or 0)


def set_(core: Core, call: Call) -> CallResult:
    """Set values of rows; several rows are several actions."""
    table = core.store.table(call.menu)
    argument_names = core.schema.arguments(call.menu, "set") & {*table.args}
    change = _parse_arguments(core, table, call, argument_names)
    items = _selected_items(core, call, table)
    _refuse_builtin(items)
    for item in items:
        _set_one(core, call, item, change, unset=call.unset)
    return CallResult()


def _set_one(core: Core, call: Call, item: StoredItem, change: Mapping[str, str], unset: Iterable[str] = ()) -> None:
    values = {name: value for name, value in {**item.values, **change}.items() if name not in set(unset)}
    if values == item.values:
        return
    _checks.complete(core, call.menu, values, changed_names=frozenset(change))
    if values == item.values:
        return
    _checks.check(core, call.menu, values, item)
    before = dict(item.values)
    core.store.update(call.menu, item, values)
    if "name" in change and call.menu.startswith("/interface/") and core.deviates(Deviation.NAMES):
        core.first_names[change["name"]] = before["name"]
    _checks.record_change(core, call, item, before)


def unset(core: Core, call: Call) -> CallResult:
    """Remove properties from rows (`value-name=a,b`)."""
    _check_arguments(core, call, {"value-name"})
    table = core.store.table(call.menu)
    if "value-name" not in call.arguments:
        raise _checks.MissingArgument("value-name")
    names = call.arguments["value-name"].split(",")
    for name in names:
        _check_unset(table, name)
    items = _selected_items(core, call, table)
    _refuse_builtin(items)
    for item in items:
        _set_one(core, call, item, {}, unset=names)
    return CallResult()


def enable(core: Core, call: Call) -> CallResult:
    """Set `disabled=no`."""
    return _set_disabled(core, call, "no")


def disable(core: Core, call: Call) -> CallResult:
    """Set `disabled=yes`."""
    return _set_disabled(core, call, "yes")


def _set_disabled(core: Core, call: Call, disabled_value: str) -> CallResult:
    _check_arguments(core, call, set())
    items = _selected_items(core, call, core.store.table(call.menu))
    _refuse_builtin(items)
    for item in items:
        _set_one(core, call, item, {"disabled": disabled_value})
    return CallResult()


def comment(core: Core, call: Call) -> CallResult:
    """Set a row's comment; an empty one removes it."""
    _check_arguments(core, call, {"comment"})
    if "comment" not in call.arguments:
        raise _checks.MissingArgument("comment")
    items = _selected_items(core, call, core.store.table(call.menu))
    _refuse_builtin(items)
    text = call.arguments["comment"]
    for item in items:
        _set_one(core, call, item, {"comment": text} if text else {}, unset=() if text else ("comment",))
    return CallResult()


def remove(core: Core, call: Call) -> CallResult:
    """Remove rows; nothing is removed if one of them must stay."""
    _check_arguments(core, call, set())
    table = core.store.table(call.menu)
    items = _selected_items(core, call, table)
    _refuse_builtin(items)
    for item in items:
        if item.factory is not None:
            raise Trap("failure: cannot remove builtin")
        _checks.check_removal(core, call.menu, item)
    for item in items:
        _checks.remove_row(core, call, item)
    return CallResult()


def move(core: Core, call: Call) -> CallResult:
    """Move rows before the row `destination`, or to the end."""
    _check_arguments(core, call, {"destination"})
    table = core.store.table(call.menu)
    items = _selected_items(core, call, table)
    _refuse_builtin(items)
    destination = call.arguments.get("destination")
    target = _item(core, call, table, destination) if destination else None
    if target in items:
        return CallResult()
    for item in items:
        others = [other for other in table.items if other is not item]
        index = others.index(target) if target is not None else len(others)
        if table.items.index(item) != index:
            _checks.move_row(core, call, item, index)
    return CallResult()


def check_rows(core: Core, call: Call) -> None:
    """Raise Trap if a command names rows that do not exist."""
    table = core.store.table(call.menu)
    if table.menu.shape is not Shape.SETTINGS and not set(_SELECTORS).isdisjoint(call.arguments):
        _selected_items(core, call, table)


# --- which rows ----------------------------------------------------------------------------------------------------


def _check_arguments(core: Core, call: Call, names: set[str]) -> None:
    argument_names = core.schema.arguments(call.menu, call.command) | names | set(_SELECTORS)
    for name in (*call.arguments, *call.unset):
        if name not in argument_names:
            raise _checks.unknown(name)


def _selected_items(core: Core, call: Call, table: Table) -> list[StoredItem]:
    """Return the selected rows; the single row of a settings menu needs no selector."""
    if table.menu.shape is Shape.SETTINGS:
        if not table.items:
            core.store.insert(call.menu, {})
            core.store.changes.clear()
        return table.items[:1]
    selector = next((call.arguments[name] for name in _SELECTORS if name in call.arguments), None)
    if selector is None:
        raise _checks.MissingArgument(".id" if not call.console else "numbers")
    items = [_item(core, call, table, part) for part in selector.split(",") if part]
    return list({item.id: item for item in items}.values())


def _item(core: Core, call: Call, table: Table, selector: str) -> StoredItem:
    item = find_item(core, table, selector, console=call.console) or queue_row(core, table, selector)
    if item is None:
        if any(row[".id"] == selector for row in made_rows(core, call.menu)):
            raise Trap(_BUILTIN)
        _checks.check_known(core, call.menu)
        raise _checks.no_such_item()
    return item


def queue_row(core: Core, table: Table, interface: str) -> StoredItem | None:
    """Return an interface's row of `/queue/interface`, adding it: every interface has one from the start."""
    number = core.store.id_of("interface", interface) if table.menu.path == QUEUES else None
    if number is None:
        return None
    queue = next((_QUEUES[path] for path in _QUEUES if core.store.table(path).find(number) is not None), "no-queue")
    values = {"interface": reference("interface", number), "queue": table.args["queue"].kind.parse(queue, core.store)}
    table.items.append(StoredItem(core.store.new_id(QUEUES), values, {"interface": interface, "queue": queue}))
    return table.items[-1]


def find_item(core: Core, table: Table, selector: str, *, console: bool = False) -> StoredItem | None:
    """Find a row by `*ID` or name; on the console also by number, as exports refer to built-in rows."""
    if match := re.fullmatch(r"\*([0-9A-Fa-f]+)", selector):
        return table.find(int(match[1], 16))
    if console and selector.isdecimal() and any(item.factory is not None for item in table.items):
        return table.items[int(selector)] if int(selector) < len(table.items) else None
    return next(
        (item for item in table.items if core.store.text(table, item, table.menu.name_property) == selector), None
    )


def _refuse_builtin(items: Iterable[StoredItem]) -> None:
    for item in items:
        if item.dynamic and item.factory is not None:
            raise Trap(_BUILTIN)


# --- what they are given -------------------------------------------------------------------------------------------


def _parse_arguments(core: Core, table: Table, call: Call, argument_names: Iterable[str]) -> dict[str, str]:
    names = set(argument_names)
    values: dict[str, str] = {}
    for name, text in call.arguments.items():
        if call.command != "add" and _selects(table, name):
            continue
        if name not in names or _fixed_name(table, name):
            raise _checks.unknown(name)
        if name == "comment" and not text:
            call.unset = (*call.unset, name)
        elif name not in _PLACEMENT:
            values[name] = _parse_value(core, table, name, text)
    for name in call.unset:
        if name not in names:
            raise _checks.unknown(name)
        _check_unset(table, name)
    return values


def _selects(table: Table, name: str) -> bool:
    """Return whether an argument selects rows; settings have one row without selector, but `.id` is accepted."""
    return name == ".id" or (name in _SELECTORS and table.menu.shape is not Shape.SETTINGS)


def _fixed_name(table: Table, name: str) -> bool:
    """Return whether a name cannot be set: services are selected by their names."""
    return table.menu.path == "/ip/service" and name == "name"


def _parse_value(core: Core, table: Table, name: str, text: str) -> str:
    try:
        return table.args[name].kind.parse(text, core.store)
    except BadValue as error:
        raise Trap(error.words.format(name), Category.ARGUMENT) from error


def _check_unset(table: Table, name: str) -> None:
    """Refuse to unset a required property; menus of the routing process allow everything except the name."""
    arg = table.args.get(name)
    if arg is None:
        raise _checks.unknown(name)
    if arg.is_required or (arg.default is not None and not table.menu.sparse):
        raise Trap(f"invalid value for argument {name}", Category.ARGUMENT)
