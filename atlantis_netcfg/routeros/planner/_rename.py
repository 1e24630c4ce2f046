"""Port names. A port is identified by its `default-name`; whatever its current name, it gets the desired one.

Rows refer to an interface by its id, so references to a renamed port follow on the device, and no packet is affected.
Two interfaces never share a name: if ports wait for each other's names, one that does not carry our session gets a
temporary name.

Also here: the rows of a device after a plan, or after its first actions; pure, for the guard and for tests.
"""

from __future__ import annotations

from dataclasses import dataclass
from ipaddress import ip_address, ip_interface
from typing import TYPE_CHECKING

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.routeros import _types, menus
from atlantis_netcfg.routeros.planner._change import MenuChange

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from atlantis_netcfg.routeros._items import DesiredState


_FOLLOWING = (menus.PropertyKind.INTERFACE, menus.PropertyKind.GATEWAY)
_FOR_A_MOMENT = "-atlantis"


@dataclass(frozen=True, slots=True)
class Rename:
    """A port that gets another name."""

    menu: menus.Menu
    row: _types.Row
    name: str
    line: int = 0
    """Line of the text that declares the port; 0: none."""
    in_the_way: bool = False
    """The port is not declared, but has the name of a declared one."""

    @property
    def old(self) -> str:
        """The current name."""
        return self.row["name"]


def is_named_port(menu: menus.Menu) -> bool:
    """Return True if rows of the menu are the device's own ports, radios or modems, which can be renamed."""
    return menu.shape is menus.Shape.FIXED and "name" not in menu.keys and "name" in menu.by_name


def renames(desired_state: DesiredState, rows: Mapping[str, tuple[_types.Row, ...]]) -> list[Rename]:
    """Return the ports to rename: those of the inventory, and those that hold the name of such a port."""
    port_renames: list[Rename] = []
    others: list[tuple[menus.Menu, _types.Row]] = []
    names: set[str] = set()
    for path, items in desired_state.items.items():
        menu = menus.MENUS[path]
        if not is_named_port(menu):
            continue
        item_by_identity = {item.identity: item for item in items}
        for row in rows[path]:
            item = item_by_identity.get(menu.identity(row))
            default = menu.default_of("name", row) if desired_state.restores else None
            name = (item.defined_values.get("name") if item is not None else None) or default
            if name is None:
                others.append((menu, row))
                continue
            names.add(name)
            port_renames.append(Rename(menu, row, name, item.line if item is not None else 0))
    port_renames += _in_the_way(others, names)
    return [each for each in port_renames if each.row.get("name") and each.name != each.row["name"]]


def _in_the_way(others: list[tuple[menus.Menu, _types.Row]], names: set[str]) -> Iterator[Rename]:
    """Restore the factory names of ports whose name another port needs."""
    while there := next((other for other in others if other[1].get("name") in names), None):
        others.remove(there)
        menu, row = there
        if default := menu.default_of("name", row):
            names.add(default)
            yield Rename(menu, row, default, in_the_way=True)


def conflicts(port_renames: Iterable[Rename], rows: Mapping[str, tuple[_types.Row, ...]]) -> Iterator[str]:
    """Yield the new names that are used, and kept, by something else."""
    going = {each.old: each for each in port_renames}
    owners: dict[str, tuple[menus.Menu, _types.Row]] = {}
    for path, menu in menus.MENUS.items():
        if (
            path.startswith("/interface/")
            and "name" in menu.by_name
            and menu.by_name["name"].kind is menus.PropertyKind.INTERFACE
        ):
            owners |= {row["name"]: (menu, row) for row in rows.get(path, ()) if row.get("name")}
    rename_by_name: dict[str, Rename] = {}
    for each in port_renames:
        port = each.menu.name_of(each.row)
        where = msg(f"line {arg(each.line)}: " if each.line else "")
        if other := rename_by_name.setdefault(each.name, each):
            if other is not each:
                yield msg(
                    f"{arg(where)}{arg(port)} and {arg(other.menu.name_of(other.row))} cannot both be called "
                    f"{arg(each.name)}"
                )
            elif each.name in owners and each.name not in going:
                menu, row = owners[each.name]
                title, key = menu.title, menu.keys[0]
                yield msg(
                    f"{arg(where)}{arg(port)} is called {arg(each.old)}, and cannot be called {arg(each.name)}: "
                    f"{arg(title)} has a row of that name. Give it another one on the device: `{arg(title)} set [find "
                    f"{arg(key)}={arg(row.get(key, each.name))}] name={arg(each.name)}-old`"
                )


def rename_changes(port_renames: Iterable[Rename], observation: _types.Observation) -> Iterator[MenuChange]:
    """Yield the renames in an order in which each name is free."""
    waiting = {each.old: each for each in port_renames}
    used = {row["name"] for rows in observation.rows.values() for row in rows if row.get("name")} | {
        each.name for each in waiting.values()
    }
    session_ports = set(_session_ports(observation))
    while waiting:
        now = next((name for name, each in waiting.items() if each.name not in waiting), None)
        if now is not None:
            each = waiting.pop(now)
            yield _rename_change(each, each.name)
            continue
        # All that are left wait for each other.
        now = next((name for name in waiting if name not in session_ports), next(iter(waiting)))
        each = waiting.pop(now)
        spare = each.name + _FOR_A_MOMENT
        while spare in used:
            spare += "-"
        used.add(spare)
        waiting[spare] = each
        yield _rename_change(each, spare)


def _rename_change(each: Rename, name: str) -> MenuChange:
    subject = each.menu.name_of(each.row)
    return MenuChange(
        each.menu, _types.Verb.SET, _types.Layer.NAMES, subject, ids=(each.row[".id"],), values=(("name", name),)
    )


def _session_ports(observation: _types.Observation) -> Iterator[str]:
    """Yield interfaces that may carry our session: in a network with its address, and bridge ports."""
    try:
        technician = ip_address(observation.facts.session_address)
    except ValueError:
        return
    for row in observation.rows.get("/ip/address", ()):
        try:
            here = technician in ip_interface(row.get("address", "")).network
        except ValueError:
            continue
        if here and (name := row.get("interface")):
            yield name
            ports = observation.rows.get("/interface/bridge/port", ())
            yield from (port["interface"] for port in ports if port.get("bridge") == name and "interface" in port)


def rename_rows(path: str, rows: Iterable[_types.Row], names: Mapping[str, str]) -> tuple[_types.Row, ...]:
    """Return the rows of a menu as after the renames."""
    menu = menus.MENUS[path]
    fields = [each.name for each in menu.fields if each.kind in _FOLLOWING and not _is_own(menu, each.name)]
    if not names or not fields:
        return tuple(rows)
    return tuple(
        {**row, **{name: _apply_names(row[name], names) for name in fields if name in row}} if row else row
        for row in rows
    )


def _is_own(menu: menus.Menu, name: str) -> bool:
    """Return True if the property is the interface's own name, not a reference."""
    return name in ("name", "default-name") and menu.path.startswith("/interface/")


def _apply_names(text: str, names: Mapping[str, str]) -> str:
    negation = "!" if text.startswith("!") else ""
    words = text.removeprefix("!").split(",")
    return negation + ",".join(_word(word, names) for word in words)


def _word(word: str, names: Mapping[str, str]) -> str:
    address, sign, interface = word.rpartition("%")
    return f"{address}{sign}{names.get(interface, interface)}"


def simulate(rows: Mapping[str, tuple[_types.Row, ...]], plan: _types.Plan) -> dict[str, tuple[_types.Row, ...]]:
    """Return the rows after the whole plan; new rows have ids like `*new7` (the action's number)."""
    return after(rows, plan.actions)


def after(
    rows: Mapping[str, tuple[_types.Row, ...]], actions: Iterable[_types.Action]
) -> dict[str, tuple[_types.Row, ...]]:
    """Return the rows after these actions."""
    state = dict(rows)
    for action in actions:
        old = state.get(action.menu, ())
        state[action.menu] = _DEEDS[action.verb](old, action)
        _follow_names(state, old, action)
    return state


def _add(rows: tuple[_types.Row, ...], action: _types.Action) -> tuple[_types.Row, ...]:
    row = {".id": f"*new{action.number}", "dynamic": "false", **dict(action.values)}
    return _insert_rows(rows, (row,), action.before)


def _set(rows: tuple[_types.Row, ...], action: _types.Action) -> tuple[_types.Row, ...]:
    if menus.MENUS[action.menu].shape is menus.Shape.SINGLETON:
        return (_apply_values(rows[0] if rows else {}, action),)
    return tuple(_apply_values(row, action) if row[".id"] in action.ids else row for row in rows)


def _apply_values(row: _types.Row, action: _types.Action) -> _types.Row:
    unset = {name[1:] for name, _ in action.values if name.startswith("!")}
    remaining_values = {name: value for name, value in row.items() if name not in unset}
    return remaining_values | {name: value for name, value in action.values if not name.startswith("!")}


def _move(rows: tuple[_types.Row, ...], action: _types.Action) -> tuple[_types.Row, ...]:
    moving = tuple(row for row in rows if row[".id"] in action.ids)
    return _insert_rows(tuple(row for row in rows if row[".id"] not in action.ids), moving, action.before)


def _remove(rows: tuple[_types.Row, ...], action: _types.Action) -> tuple[_types.Row, ...]:
    removed_ids = set(action.ids)
    return tuple(row for row in rows if row[".id"] not in removed_ids)


def _insert_rows(
    rows: tuple[_types.Row, ...], new: tuple[_types.Row, ...], before: str | None
) -> tuple[_types.Row, ...]:
    place = next((index for index, row in enumerate(rows) if row[".id"] == before), len(rows))
    return (*rows[:place], *new, *rows[place:])


_DEEDS = {_types.Verb.ADD: _add, _types.Verb.SET: _set, _types.Verb.MOVE: _move, _types.Verb.REMOVE: _remove}


def _follow_names(state: dict[str, tuple[_types.Row, ...]], old: tuple[_types.Row, ...], action: _types.Action) -> None:
    """Update every reference to a renamed interface."""
    name = dict(action.values).get("name")
    if action.verb is not _types.Verb.SET or name is None or not action.menu.startswith("/interface/"):
        return
    names = {row["name"]: name for row in old if row[".id"] in action.ids and "name" in row}
    for path, rows in state.items():
        state[path] = rename_rows(path, rows, names) if path in menus.MENUS else rows
