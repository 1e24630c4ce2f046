"""When two readings of a device are the same state: what was configured, not what moves by itself."""

from __future__ import annotations

import hashlib
import json
from typing import TYPE_CHECKING

from atlantis_netcfg.routeros._items import Desired, Item
from atlantis_netcfg.routeros.menus import MENUS, Field, Menu, Shape

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from atlantis_netcfg.core.versions import Version
    from atlantis_netcfg.routeros._items import RunTime
    from atlantis_netcfg.routeros._types import Observed, Plan, Row

_Content = tuple[str, ...]
"""The values of a row, in the order of its menu's fields."""
_BETWEEN, _END = "\x1f", "\x1e"
"""ASCII's separators of units and of records, for what is hashed."""


def differing(before: Observed, now: Observed, run_time: Sequence[RunTime] = ()) -> tuple[str, ...]:
    """Return the menus (as a person writes them) whose configuration differs.

    What a device does to rows of ours by itself (`run_time`) is no difference where it is named.
    """
    paths = dict.fromkeys((*before.rows, *now.rows))
    return tuple(
        MENUS[path].title
        for path in paths
        if _content(path, before, run_time=run_time) != _content(path, now, run_time=run_time)
    )


def digest(observed: Observed) -> str:
    """Return a hash of the configuration without its secrets, so that it may be written down."""
    state = hashlib.sha256()
    for path in sorted(observed.rows):
        rows = map(_BETWEEN.join, _content(path, observed, secrets=False))
        state.update(_END.join((path, *rows, _END)).encode(errors="surrogateescape"))
    return state.hexdigest()


def plan_hash(plan: Plan) -> str:
    """Return a hash of what a person sees of a plan, so that the plan agreed to can be told from another one."""
    actions = [
        (action.menu, action.verb, action.subject, action.ids, action.shown(), action.before) for action in plan.actions
    ]
    return hashlib.sha256(json.dumps(actions).encode()).hexdigest()


def invalid(observed: Observed) -> tuple[str, ...]:
    """Return the rows of ours that the device has taken but does not use, with its reason where it gives one."""
    return tuple(
        f"{menu.name_of(row)} in {menu.title} ({row.get('.about') or 'invalid'})"
        for menu in map(MENUS.__getitem__, observed.rows)
        for row in observed.rows[menu.path]
        if menu.is_ours(row) and (row.get("invalid") in ("true", "yes") or row.get(".about", "").startswith("inactiv"))
    )


def restoring(before: Observed) -> Desired:
    """Return the observed state as something to declare: every row and every value, nothing else."""
    menus = [MENUS[path] for path in before.rows if not MENUS[path].readonly]
    items = {menu.path: tuple(_items(menu, before.rows[menu.path], before.facts.version)) for menu in menus}
    return Desired("the state before the run", items, frozenset(items), restores=True)


def _items(menu: Menu, rows: tuple[Row, ...], version: Version) -> list[Item]:
    return [
        Item(menu.path, _values(menu, row, version), exists=menu.shape is not Shape.LIST or menu.is_stock(row))
        for row in rows
        if menu.is_touchable(row)
    ]


def _values(menu: Menu, row: Row, version: Version) -> Mapping[str, str | None]:
    """What the row says, and None for what it did not say and nothing else would take back: it was unset."""
    return {
        each.name: row.get(each.name)
        for each in menu.fields
        if not each.unread and (each.name in row or (each.keep and each.default is None and each.exists(version)))
    }


def _content(
    path: str, observed: Observed, *, secrets: bool = True, run_time: Sequence[RunTime] = ()
) -> list[_Content]:
    """Return the rows of a menu; of first-match rows the order counts, but only among those of one chain."""
    menu = MENUS[path]
    moved = [each for each in run_time if each.menu == path]
    rows = [row for row in observed.rows.get(path, ()) if menu.is_touchable(row)]
    if menu.chain is not None:
        rows = sorted(rows, key=lambda row: row.get(menu.chain or "", ""))
    shown = [each for each in menu.fields if not each.unread and (secrets or not each.secret)]
    content = [_row(menu, _as_declared(menu, row, moved) if moved else row, shown) for row in rows]
    return content if menu.ordered else sorted(content)


def _as_declared(menu: Menu, row: Row, moved: Iterable[RunTime]) -> Row:
    """Return a row of ours with the declared values where the device has put others in their place."""
    if not menu.is_ours(row):
        return row
    return {**row, **{each.name: each.declared for each in moved if each.covers(menu, each.name, each.declared, row)}}


def _row(menu: Menu, row: Row, shown: Iterable[Field]) -> _Content:
    """Return a row in canonical form; a property that is empty or at its default may be printed or left out."""
    return tuple(
        menu.form(each.name, row) if (text := row.get(each.name)) is None else each.form(text) for each in shown
    )
