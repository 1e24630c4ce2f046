"""What the rows of a device are after a plan, or after its first few actions: pure, for the guard and for tests."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.routeros._types import Action, Row, Verb
from atlantis_netcfg.routeros.menus import MENUS, Shape
from atlantis_netcfg.routeros.planner._rename import renamed

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from atlantis_netcfg.routeros._types import Plan

__all__ = ["after", "simulate"]


def simulate(rows: Mapping[str, tuple[Row, ...]], plan: Plan) -> dict[str, tuple[Row, ...]]:
    """Return the rows as the whole plan leaves them; new rows have ids of the form `*new7` (the action's number)."""
    return after(rows, plan.actions)


def after(rows: Mapping[str, tuple[Row, ...]], actions: Iterable[Action]) -> dict[str, tuple[Row, ...]]:
    """Return the rows as these actions leave them."""
    state = dict(rows)
    for action in actions:
        old = state.get(action.menu, ())
        state[action.menu] = _DEEDS[action.verb](old, action)
        _follow_names(state, old, action)
    return state


def _add(rows: tuple[Row, ...], action: Action) -> tuple[Row, ...]:
    row = {".id": f"*new{action.number}", "dynamic": "false", **dict(action.values)}
    return _inserted(rows, (row,), action.before)


def _set(rows: tuple[Row, ...], action: Action) -> tuple[Row, ...]:
    if MENUS[action.menu].shape is Shape.SINGLETON:
        return (_changed(rows[0] if rows else {}, action),)
    return tuple(_changed(row, action) if row[".id"] in action.ids else row for row in rows)


def _changed(row: Row, action: Action) -> Row:
    unset = {name[1:] for name, _ in action.values if name.startswith("!")}
    kept = {name: value for name, value in row.items() if name not in unset}
    return kept | {name: value for name, value in action.values if not name.startswith("!")}


def _move(rows: tuple[Row, ...], action: Action) -> tuple[Row, ...]:
    moving = tuple(row for row in rows if row[".id"] in action.ids)
    return _inserted(tuple(row for row in rows if row[".id"] not in action.ids), moving, action.before)


def _remove(rows: tuple[Row, ...], action: Action) -> tuple[Row, ...]:
    gone = set(action.ids)
    return tuple(row for row in rows if row[".id"] not in gone)


def _inserted(rows: tuple[Row, ...], new: tuple[Row, ...], before: str | None) -> tuple[Row, ...]:
    place = next((index for index, row in enumerate(rows) if row[".id"] == before), len(rows))
    return (*rows[:place], *new, *rows[place:])


_DEEDS = {Verb.ADD: _add, Verb.SET: _set, Verb.MOVE: _move, Verb.REMOVE: _remove}


def _follow_names(state: dict[str, tuple[Row, ...]], old: tuple[Row, ...], action: Action) -> None:
    """Let every reference follow an interface that was renamed."""
    name = dict(action.values).get("name")
    if action.verb is not Verb.SET or name is None or not action.menu.startswith("/interface/"):
        return
    names = {row["name"]: name for row in old if row[".id"] in action.ids and "name" in row}
    for path, rows in state.items():
        state[path] = renamed(path, rows, names) if path in MENUS else rows
