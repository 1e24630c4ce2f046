"""`/export`: the configuration as text (grammar and wrapping as in `routeros.rsc`)."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros import menus
from atlantis_netcfg.emulator.routeros.access import INACTIVE, is_allowed
from atlantis_netcfg.emulator.routeros.values import FlagValue, id_text, references, spell
from atlantis_netcfg.emulator.routeros.views import applies, factory_value
from atlantis_netcfg.routeros import rsc

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.emulator.routeros.core import Core
    from atlantis_netcfg.emulator.routeros.store import StoredItem, Table

Values = tuple[tuple[str, str | None], ...]


@dataclass(frozen=True, slots=True)
class Form:
    """Options of an export: compact (differences from the defaults) unless `verbose`."""

    verbose: bool = False
    terse: bool = False
    show_sensitive: bool = False
    header: bool = True


def export_text(core: Core, menu: str, form: Form) -> str:
    """Export a menu and everything below it."""
    statements = tuple(
        statement
        for path in _paths(core, menu)
        for statement in _section(core, path, verbose=form.verbose, sensitive=form.show_sensitive)
    )
    top = header(core) if form.header else ()
    if not form.terse:
        return rsc.print_export(rsc.Export(top, statements))
    lines = [f"# {line}".rstrip() for line in top] + [rsc.print_statement(item, path=True) for item in statements]
    return "".join(f"{line}\n" for line in lines)


def header(core: Core) -> tuple[str, ...]:
    """Return the comment lines at the top, without `# `."""
    spec = core.spec
    digest = hashlib.sha256(spec.serial_number.encode()).hexdigest().upper()
    software = f"{digest[:4]}-{digest[4:8]}"
    return (
        f"{core.stamp()} by RouterOS {spec.version}",
        f"software id = {software}",
        "",
        f"model = {spec.board}",
        f"serial number = {spec.serial_number}",
    )


def _paths(core: Core, menu: str) -> list[str]:
    exported_paths = [path for path, table in core.store.tables.items() if table.menu.is_exported]
    selected_paths = [path for path in exported_paths if menu in ("/", path) or path.startswith(f"{menu}/")]
    places = {path: place for place, path in enumerate(menus.EXPORT_ORDER)}
    usual = sorted(selected_paths, key=lambda path: (places.get(path, _place(core, path)), path in places, path))
    return _after_what_they_name(core, usual)


def _after_what_they_name(core: Core, usual: list[str]) -> list[str]:
    """Sort menus after those whose rows they reference, so that an import finds them; else keep the order.

    Exports of 7.15 have `/interface pppoe-client` behind the `/interface vlan` that it runs over.
    """
    order: dict[str, None] = {}

    def put(path: str, above: tuple[str, ...] = ()) -> None:
        referenced_menus = _referenced_menus(core, core.store.table(path))
        for other in usual:
            if other in referenced_menus and other not in (*above, path, *order):
                put(other, (*above, path))
        order.setdefault(path)

    for path in usual:
        put(path)
    return list(order)


def _referenced_menus(core: Core, table: Table) -> set[str]:
    """Return the menus that the exported rows of a table reference."""
    rows = {
        row
        for item in table.items
        for name, value in item.values.items()
        for row in references(value)
        if not item.dynamic and (arg := table.args.get(name)) and _differs(table, item, arg, spell(value, core.store))
    }
    return {
        other.menu.path
        for space, number in rows
        for other in core.store.space_tables(space)
        if other.find(number) is not None
    }


def _place(core: Core, path: str) -> int:
    """Return the position of an unmodelled menu: interfaces before menus that reference them, others last."""
    interfaces = core.store.table(path).menu.space == "interface"
    return menus.EXPORT_ORDER.index("/ip/pool") if interfaces else len(menus.EXPORT_ORDER)


def _section(core: Core, path: str, *, verbose: bool, sensitive: bool) -> Iterator[rsc.Statement]:
    if not core.schema.has_menu(path):
        return
    table = core.store.table(path)
    for position, item in enumerate(table.items):
        if item.dynamic:
            continue
        values = tuple(_values(core, table, item, verbose=verbose, sensitive=sensitive))
        if item.factory is None and table.menu.shape is menus.Shape.LIST:
            yield rsc.Statement(path, "add", values, comments=_comments(core, path))
        elif values:
            yield _set(core, table, item, position, values)


def _set(core: Core, table: Table, item: StoredItem, position: int, values: Values) -> rsc.Statement:
    path, factory = table.menu.path, item.factory or {}
    if table.menu.shape is menus.Shape.SETTINGS:
        return rsc.Statement(path, "set", values)
    select = table.menu.select
    if select is menus.Select.DEFAULT_NAME:
        return rsc.Statement(path, "set", values, find=(("default-name", factory["name"]),))
    if select is menus.Select.FIND_NAME:
        return rsc.Statement(path, "set", values, find=(("name", factory["name"]),))
    if select is menus.Select.NAME:
        return rsc.Statement(path, "set", values, target=core.store.text(table, item, table.menu.name_property))
    return rsc.Statement(path, "set", values, target=str(position) if item.factory is not None else id_text(item.id))


def _comments(core: Core, path: str) -> tuple[str, ...]:
    return (INACTIVE,) if path == "/system/scheduler" and not is_allowed(core.spec, "scheduler") else ()


def _values(
    core: Core, table: Table, item: StoredItem, *, verbose: bool, sensitive: bool
) -> Iterator[tuple[str, str | None]]:
    """Yield names and values in alphabetical order; None is `!name`."""
    for name, arg in sorted(table.args.items()):
        if not arg.is_exported or arg.never or (arg.secret and not sensitive):
            continue
        if not applies(core.store, table, item, arg):
            continue
        stored_value = item.values.get(name)
        value = spell(stored_value, core.store) if stored_value is not None else arg.default
        if verbose or _differs(table, item, arg, value):
            yield from _argument_pairs(arg, value, item)


def _differs(table: Table, item: StoredItem, arg: menus.Arg, value: str | None) -> bool:
    if table.menu.sparse and item.factory is None:
        return arg.name in item.values
    always = arg.always and item.factory is None and value is not None
    usual = arg.default if table.menu.shape is menus.Shape.SETTINGS else factory_value(item, arg)
    return always or value != usual


def _argument_pairs(arg: menus.Arg, value: str | None, item: StoredItem) -> Iterator[tuple[str, str | None]]:
    if value is not None:
        yield arg.name, arg.kind.export(value)
    elif arg.name == "comment":
        if item.factory is not None and "comment" in item.factory:
            yield arg.name, ""
    elif not isinstance(arg.kind, FlagValue):
        yield arg.name, None
