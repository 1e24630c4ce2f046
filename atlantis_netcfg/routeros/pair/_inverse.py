"""The way back as a script: what every action of a plan has changed, in the opposite order.

It is run by the device when nobody is there any more, so each line stands for itself: one that fails (the action was
never carried out) does not keep the others from running. Unlike the way back of a single device it writes secrets, in
clear as the rows themselves hold them: a key that stayed new at one end would keep the link away.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.routeros._types import Layer, Verb
from atlantis_netcfg.routeros.menus import MENUS, Kind, Menu, Shape, canonical
from atlantis_netcfg.routeros.planner import after, renamed
from atlantis_netcfg.rsc import quote

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from atlantis_netcfg.routeros._types import Action, Row

__all__ = ["NotInvertible", "inverse"]


class NotInvertible(ValueError):
    """No script can be written that takes this action back exactly."""


def inverse(actions: Sequence[Action], rows: Mapping[str, tuple[Row, ...]]) -> str:
    """Return the lines that take `actions` back on a device that had `rows` before. Raises NotInvertible."""
    names = [action for action in actions if action.layer is Layer.NAMES]
    lines = _names_back(names, rows)
    # By then every port is called as it was, and so is whatever names it.
    called = {dict(action.values)["name"]: row["name"] for action in names for row in _those(action, rows[action.menu])}
    for action in reversed(actions):
        if action.layer is not Layer.NAMES:
            lines += _lines(action, rows.get(action.menu, ()), called)
    return "".join(f":do {{\n{line}\n}} on-error={{\n}}\n" for line in lines)


def _names_back(names: Sequence[Action], rows: Mapping[str, tuple[Row, ...]]) -> list[str]:
    """Give ports their old names, step by step: of two that have swapped theirs, one goes round by another name."""
    lines: list[str] = []
    for action in names:
        lines = [*_lines(action, rows[action.menu], {}), *lines]
        rows = after(rows, (action,))
    return lines


def _lines(action: Action, rows: tuple[Row, ...], called: Mapping[str, str]) -> Iterator[str]:
    menu = MENUS[action.menu]
    if action.verb is Verb.SET:
        names = [name.lstrip("!") for name, _ in action.values]
        if menu.shape is Shape.SINGLETON:
            yield f"{menu.path}/set {_given(menu, rows[0] if rows else {}, names)}"
            return
        for row in _those(action, rows):
            yield f"{menu.path}/set {row['.id']} {_given(menu, row, names)}"
    elif action.verb is Verb.ADD:
        (added,) = renamed(action.menu, (dict(action.values),), called)
        yield f"{menu.path}/remove [find {_where(menu, added)}]"
    elif action.verb is Verb.REMOVE and not menu.ordered:
        for row in _those(action, rows):
            yield f"{menu.path}/add {_given(menu, row, [each.name for each in menu.fields if each.name in row])}"
    else:
        raise NotInvertible(
            f"{action.verb.value} {action.subject} in {menu.title}: its place in the list would be lost"
        )


def _those(action: Action, rows: tuple[Row, ...]) -> list[Row]:
    found = [row for row in rows if row.get(".id") in action.ids]
    if len(found) != len(action.ids):
        raise NotInvertible(f"{action.subject}: its row was not read")
    return found


def _given(menu: Menu, row: Row, names: Sequence[str]) -> str:
    return " ".join(_word(menu, row, name) for name in names)


def _word(menu: Menu, row: Row, name: str) -> str:
    field, value = menu.by_name[name], row.get(name)
    if value is None:
        value = menu.default_of(name, row)
    if field.kind is Kind.FLAG or field.unread:
        raise NotInvertible(f"`{name}` of {menu.title} cannot be written back")
    if field.secret and value and not value.strip("*"):
        raise NotInvertible(f"`{name}` of {menu.title} cannot be read, and so not written back")
    if value is None:
        return f"!{name}"
    return f"{name}={quote(canonical(Kind.BOOLEAN, value) if field.kind is Kind.BOOLEAN else value)}"


def _where(menu: Menu, values: Mapping[str, str]) -> str:
    """Name a row that was added: by its keys, else by all that it was given."""
    names = menu.keys or tuple(name for name in values if not menu.by_name[name].secret)
    return " ".join(f'{name}="{_escaped(values[name])}"' for name in names if name in values)


def _escaped(value: str) -> str:
    quoted = quote(value)
    return quoted[1:-1] if quoted.startswith('"') else quoted
