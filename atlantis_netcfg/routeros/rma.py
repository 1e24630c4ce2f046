"""A saved state for another box than the one it was read from: what belongs to the box stays with it.

What the device gives itself (addresses of its hardware, what its ports can do) is not in a saved state in the first
place. Here go the certificate of its services, which the replacement got when it was adopted, and secrets, which a
saved state never holds: they come from the declaration, where it has them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from atlantis_netcfg.routeros.menus import MENUS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.routeros._items import Desired, Item

_UNIT = {"/ip/service": frozenset({"certificate"})}
"""Properties that stay what they are on the replacement."""


def for_replacement(saved: Desired, declared: Desired) -> Desired:
    """Return the saved state with the secrets of the declaration, and without what belongs to the old box."""
    items = {
        path: tuple(_with_secrets(_unit(item), _twins(item, declared)) for item in rows)
        for path, rows in saved.items.items()
    }
    return replace(saved, items=items, notes=(*saved.notes, *_newer(saved, declared)))


def _newer(saved: Desired, declared: Desired) -> tuple[str, ...]:
    """Return a note on menus that are declared by now, and of which the saved state says nothing."""
    menus = [MENUS[path] for path in declared.menus if path not in saved.items]
    titles = ", ".join(menu.title for menu in menus if menu.exported and not menu.readonly)
    return (f"not in the saved state, and left as they are: {titles}",) if titles else ()


def _unit(item: Item) -> Item:
    local = _UNIT.get(item.menu, frozenset())
    values = {name: value for name, value in item.values.items() if name not in local}
    return replace(item, values=values, unknown=item.unknown | local)


def _twins(item: Item, declared: Desired) -> list[Item]:
    """Return the declared rows that are the saved one; rows without keys have no secrets."""
    if not MENUS[item.menu].keys:
        return []
    return [other for other in declared.items.get(item.menu, ()) if other.identity == item.identity]


def _with_secrets(item: Item, twins: list[Item]) -> Item:
    known: Mapping[str, str | None] = {
        name: twin.values[name] for twin in twins for name in item.unknown if twin.values.get(name)
    }
    secrets = {name: value for name, value in known.items() if name in MENUS[item.menu].secrets}
    return replace(item, values={**item.values, **secrets}, unknown=item.unknown - secrets.keys())
