"""The state read back by a run, as text: for later comparison, and for a replacement device.

It has export syntax but is written from rows read over the API anyway, so it costs no round trip; it is parsed with the
same table of menus. It contains all rows of the menus in the desired state, whoever owns them. It contains no secrets,
and nothing specific to the individual device.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.routeros import rsc
from atlantis_netcfg.routeros.desired import from_export
from atlantis_netcfg.routeros.menus import MENUS, Field, Menu, PropertyKind, Shape, canonical, rank

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from atlantis_netcfg.routeros._items import DesiredState, RowItem
    from atlantis_netcfg.routeros._types import Observation, Row

OF_THE_BOX = frozenset(
    {
        ("/interface/bridge", "admin-mac"),
        ("/interface/ovpn-client", "mac-address"),
        ("/ip/address", "broadcast"),
        ("/ip/address", "network"),
    }
)
"""Properties that the device assigns itself: a replacement device has its own."""


def write(device: str, desired_state: DesiredState, observation: Observation) -> str:
    """Return the state of the menus in the desired state, in the order in which they can be set."""
    facts = observation.facts
    menus = [MENUS[path] for path in sorted(desired_state.menus, key=rank) if not MENUS[path].readonly]
    menus = [menu for menu in menus if menu.is_exported]
    used = frozenset(_used(observation.rows))
    statements = [
        statement
        for menu in menus
        for row, declared_names in _rows(menu, desired_state.items[menu.path], observation.rows[menu.path])
        for statement in _statement(menu, row, declared_names, used)
    ]
    header = (
        msg(f"confirmed state of {arg(device)}: the inventory's menus as they were read back, without secrets"),
        msg(f"by RouterOS {arg(facts.version)}"),
        f"model = {facts.board}",
    )
    return rsc.print_export(rsc.Export(header, tuple(statements), tuple(menu.path for menu in menus)))


def read(text: str, source: str) -> DesiredState:
    """Parse a saved state as desired state: its menus, each in full. Raises RscError."""
    menus = [path for path in rsc.parse(text, source).menus if path in MENUS]
    return from_export(text, menus, source)


def _rows(menu: Menu, items: tuple[RowItem, ...], rows: tuple[Row, ...]) -> Iterator[tuple[Row, frozenset[str]]]:
    """Yield the rows with the properties set in the desired state, which are printed even at their defaults.

    The routing menus of RouterOS 7 export exactly what was set, so that the state is identical.
    """
    # Rows of first-match menus have no keys: what ties them to the inventory is our comment.
    identity = menu.identity if menu.keys or menu.shape is Shape.SINGLETON else lambda values: values.get("comment")
    names_by_key: dict[object, frozenset[str]] = {}
    for item in items:
        key = identity(item.defined_values)
        names_by_key[key] = names_by_key.get(key, frozenset()) | item.defined_values.keys()
    for row in rows:
        if menu.is_touchable(row):
            yield row, names_by_key.get(identity(row), frozenset())


def _used(rows: Mapping[str, tuple[Row, ...]]) -> Iterator[str]:
    """Yield every interface name that a row refers to."""
    for path, menu_rows in rows.items():
        fields = [
            each.name for each in MENUS[path].fields if each.kind in (PropertyKind.INTERFACE, PropertyKind.GATEWAY)
        ]
        if MENUS[path].shape is not Shape.FIXED:
            for row in menu_rows:
                yield from (
                    word.strip("!").rpartition("%")[2] for name in fields for word in row.get(name, "").split(",")
                )


def _statement(menu: Menu, row: Row, declared_names: frozenset[str], used: frozenset[str]) -> Iterator[rsc.Statement]:
    """Yield the statement that sets the row; none for settings and given rows that are at their defaults."""
    values = dict(_values(menu, row, declared_names))
    if menu.shape is Shape.LIST and not menu.is_stock(row):
        yield rsc.Statement(menu.path, "add", tuple(values.items()))
        return
    keys = {key: row.get(key, "") for key in menu.keys}
    if menu.shape is Shape.FIXED and "name" not in menu.keys and row.get("name") in used:
        # Said even where it is the default: a replacement without this port cannot take the state.
        values["name"] = row["name"]
    changed_values = tuple((name, value) for name, value in values.items() if name not in keys)
    if changed_values:
        yield rsc.Statement(menu.path, "set", changed_values, find=tuple(keys.items()) or None)


def _values(menu: Menu, row: Row, declared_names: frozenset[str]) -> Iterator[tuple[str, str | None]]:
    for each in menu.alphabetical:
        value = row.get(each.name)
        if value is None or each.secret or each.unread:
            continue
        is_key_value = each.name == "action" or (each.name in menu.keys and each.default is None)
        if is_key_value or each.name in declared_names or _is_somebodys_choice(menu, each, row):
            yield each.name, _print_value(each, value)


def _is_somebodys_choice(menu: Menu, each: Field, row: Row) -> bool:
    """Return True if a property is not at its default; if that is computed, `no` and `none` count as default."""
    if each.keep and each.default is None:
        is_computed = menu.shape is not Shape.LIST or (menu.path, each.name) in OF_THE_BOX
        return not is_computed and canonical(PropertyKind.BOOLEAN, row[each.name]) not in ("", "no", "none")
    default = each.form(menu.default_of(each.name, row))
    return menu.form(each.name, row) != default


def _print_value(each: Field, value: str) -> str | None:
    if each.kind is PropertyKind.FLAG:
        return "" if canonical(each.kind, value) == "yes" else None
    return canonical(each.kind, value) if each.kind is PropertyKind.BOOLEAN else value
