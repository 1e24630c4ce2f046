"""Actions of the history: the text that a person sees, and the console commands that undo and redo."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.rsc import console_path, quote
from atlantis_netcfg.twin.menus import Shape
from atlantis_netcfg.twin.values import id_text, spell

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.twin.commands._call import Call
    from atlantis_netcfg.twin.core import Core
    from atlantis_netcfg.twin.store import Item, Table

__all__ = ["added", "changed", "moved", "removed"]


def added(core: Core, call: Call, item: Item) -> None:
    """Record that a row was added."""
    table = core.store.table(call.menu)
    redo = _command(call, "add", _arguments(core, table, item.values))
    _record(core, call, "added", _command(call, "remove", id_text(item.id)), redo)


def changed(core: Core, call: Call, item: Item, before: Mapping[str, str]) -> None:
    """Record that a row was set."""
    table = core.store.table(call.menu)
    old, new = _difference(core, table, before, item.values)
    who = "" if table.menu.shape is Shape.SETTINGS else id_text(item.id)
    _record(core, call, "changed", _command(call, "set", who, old), _command(call, "set", who, new))


def removed(core: Core, call: Call, item: Item) -> None:
    """Remove a row and record it."""
    table = core.store.table(call.menu)
    undo = _command(call, "add", _arguments(core, table, item.values))
    core.store.remove(call.menu, item)
    _record(core, call, "removed", undo, _command(call, "remove", id_text(item.id)))


def moved(core: Core, call: Call, item: Item, index: int) -> None:
    """Move a row and record it."""
    table = core.store.table(call.menu)
    undo = _command(call, "move", id_text(item.id), _destination(table.items, table.items.index(item) + 1))
    core.store.move(call.menu, item, index)
    redo = _command(call, "move", id_text(item.id), _destination(table.items, table.items.index(item) + 1))
    _record(core, call, "moved", undo, redo)


def _record(core: Core, call: Call, verb: str, undo: str, redo: str) -> None:
    noun = core.store.table(call.menu).menu.noun
    core.history.record(core.store, f"{noun} {verb}", by=call.caller.user, time=core.stamp(), commands=(undo, redo))
    core.note("system,info", f"{noun} {verb} by {call.caller.via}:{call.caller.user}@{call.caller.address}")


def _command(call: Call, verb: str, *parts: str) -> str:
    return " ".join(part for part in (console_path(call.menu), verb, *parts) if part)


def _arguments(core: Core, table: Table, values: Mapping[str, str]) -> str:
    shown = {name: spell(value, core.store) for name, value in values.items() if name in table.args}
    return " ".join(f"{name}={quote(_masked(table, name, value))}" for name, value in sorted(shown.items()))


def _difference(core: Core, table: Table, before: Mapping[str, str], after: Mapping[str, str]) -> tuple[str, str]:
    names = sorted({name for name in {*before, *after} if before.get(name) != after.get(name)})
    return _side(core, table, names, before), _side(core, table, names, after)


def _side(core: Core, table: Table, names: list[str], values: Mapping[str, str]) -> str:
    words = []
    for name in names:
        arg = table.args.get(name)
        value = spell(values[name], core.store) if name in values else arg.default if arg is not None else None
        words.append(f"!{name}" if value is None else f"{name}={quote(_masked(table, name, value))}")
    return " ".join(words)


def _masked(table: Table, name: str, value: str) -> str:
    arg = table.args.get(name)
    return "*****" if arg is not None and (arg.secret or arg.never) and value else value


def _destination(items: list[Item], index: int) -> str:
    return f"destination={id_text(items[index].id)}" if index < len(items) else ""
