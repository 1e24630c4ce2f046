"""Renamed ports: whoever names an interface follows on the device by itself, so that nothing else must be changed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.routeros.menus import MENUS, Kind, Menu, Shape

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from atlantis_netcfg.routeros._items import Desired
    from atlantis_netcfg.routeros._types import Row

__all__ = ["new_names", "renamed", "renaming_order"]

_FOLLOWING = (Kind.INTERFACE, Kind.GATEWAY)


def new_names(desired: Desired, rows: Mapping[str, tuple[Row, ...]]) -> dict[str, str]:
    """Return which names of fixed interfaces change, old to new."""
    changes: dict[str, str] = {}
    for path, items in desired.items.items():
        menu = MENUS[path]
        if menu.shape is Shape.FIXED and "name" not in menu.keys and "name" in menu.by_name:
            wanted = {item.identity: item.given.get("name") for item in items}
            for row in rows[path]:
                default = menu.default_of("name", row) if desired.restores else None
                name = wanted.get(menu.identity(row)) or default
                if name is not None and name != row.get("name"):
                    changes[row.get("name", "")] = name
    return changes


def renamed(path: str, rows: Iterable[Row], names: Mapping[str, str]) -> tuple[Row, ...]:
    """Return the rows of a menu as they will read once the interfaces have their new names."""
    menu = MENUS[path]
    fields = [each.name for each in menu.fields if each.kind in _FOLLOWING and not _is_own(menu, each.name)]
    if not names or not fields:
        return tuple(rows)
    return tuple(
        {**row, **{name: _follow(row[name], names) for name in fields if name in row}} if row else row for row in rows
    )


def _is_own(menu: Menu, name: str) -> bool:
    """Tell whether the property is the interface's own name, and no reference to another."""
    return name in ("name", "default-name") and menu.path.startswith("/interface/")


def _follow(text: str, names: Mapping[str, str]) -> str:
    negated = "!" if text.startswith("!") else ""
    words = text.removeprefix("!").split(",")
    return negated + ",".join(_word(word, names) for word in words)


def _word(word: str, names: Mapping[str, str]) -> str:
    address, sign, interface = word.rpartition("%")
    return f"{address}{sign}{names.get(interface, interface)}"


def renaming_order(names: Mapping[str, str]) -> list[str] | None:
    """Return the old names in an order in which no new name is still in use, or None if they go round in a circle."""
    waiting = dict(names)
    order: list[str] = []
    while waiting:
        free = next((old for old, new in waiting.items() if new not in waiting), None)
        if free is None:
            return None
        order.append(free)
        del waiting[free]
    return order
