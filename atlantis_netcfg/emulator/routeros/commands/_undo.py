"""Actions of the history: the text that a person sees, and the console commands that undo and redo."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.menus import Shape
from atlantis_netcfg.emulator.routeros.values import id_text, spell
from atlantis_netcfg.emulator.routeros.views import HIDDEN
from atlantis_netcfg.rsc import Statement, print_statement

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from atlantis_netcfg.emulator.routeros.commands._call import Call
    from atlantis_netcfg.emulator.routeros.core import Core
    from atlantis_netcfg.emulator.routeros.store import Item, Table

__all__ = ["added", "changed", "moved", "removed"]

Values = tuple[tuple[str, str | None], ...]


def added(core: Core, call: Call, item: Item) -> None:
    """Record that a row was added."""
    _record(core, call, "added", Statement(call.menu, "remove", target=id_text(item.id)), _add(core, call, item))


def changed(core: Core, call: Call, item: Item, before: Mapping[str, str]) -> None:
    """Record that a row was set."""
    table = core.store.table(call.menu)
    names = sorted(name for name in {*before, *item.values} if before.get(name) != item.values.get(name))
    target = None if table.menu.shape is Shape.SETTINGS else id_text(item.id)
    undo, redo = (
        Statement(call.menu, "set", _values(core, table, names, values), target=target)
        for values in (before, item.values)
    )
    _record(core, call, "changed", undo, redo)


def removed(core: Core, call: Call, item: Item) -> None:
    """Remove a row and record it."""
    undo = _add(core, call, item)
    core.store.remove(call.menu, item)
    _record(core, call, "removed", undo, Statement(call.menu, "remove", target=id_text(item.id)))


def moved(core: Core, call: Call, item: Item, index: int) -> None:
    """Move a row and record it."""
    undo = _move(core, call, item)
    core.store.move(call.menu, item, index)
    _record(core, call, "moved", undo, _move(core, call, item))


def _record(core: Core, call: Call, verb: str, undo: Statement, redo: Statement) -> None:
    commands = print_statement(undo, path=True), print_statement(redo, path=True)
    caller, noun = call.caller, core.store.table(call.menu).menu.noun
    core.history.record(core.store, f"{noun} {verb}", by=caller.user, time=core.stamp(), commands=commands)
    core.note("system,info", f"{noun} {verb} by {caller.via}:{caller.user}@{caller.address}")


def _add(core: Core, call: Call, item: Item) -> Statement:
    table = core.store.table(call.menu)
    names = sorted(name for name in item.values if name in table.args)
    return Statement(call.menu, "add", _values(core, table, names, item.values))


def _move(core: Core, call: Call, item: Item) -> Statement:
    """Where the row stands now, as a command that puts it there."""
    items = core.store.table(call.menu).items
    after = items[items.index(item) + 1 :]
    destination: Values = (("destination", id_text(after[0].id)),) if after else ()
    return Statement(call.menu, "move", destination, target=id_text(item.id))


def _values(core: Core, table: Table, names: Iterable[str], values: Mapping[str, str]) -> Values:
    return tuple((name, _value(core, table, name, values)) for name in names)


def _value(core: Core, table: Table, name: str, values: Mapping[str, str]) -> str | None:
    """Spell a value; None is "unset". Secrets do not stand in the history."""
    arg = table.args.get(name)
    value = spell(values[name], core.store) if name in values else arg.default if arg is not None else None
    return HIDDEN if value and arg is not None and (arg.secret or arg.never) else value
