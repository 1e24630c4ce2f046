"""The configuration: tables of rows, references by id, and each change with its state before and after."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NamedTuple

from atlantis_netcfg.emulator.routeros import menus
from atlantis_netcfg.emulator.routeros.values import reference, references, spell

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from atlantis_netcfg.emulator.routeros.answers import Caller
    from atlantis_netcfg.emulator.routeros.schema import Schema


@dataclass(slots=True)
class HistoryEntry:
    """One action that changed one row; `undo` and `redo` are its console commands."""

    number: int
    action: str
    by: str
    policy: str
    time: str
    undo: str
    redo: str
    changes: tuple[StoreChange, ...]
    floating: bool = False
    """The action would be undone by safe mode."""
    undone: bool = False


@dataclass(slots=True)
class ActionHistory:
    """The latest actions, oldest first, and the session that holds safe mode."""

    limit: int
    entries: list[HistoryEntry] = field(default_factory=list)
    holder: Caller | None = None
    """Session that holds safe mode, also after it closes, until its changes are undone; None: no session."""
    _count: int = 0

    def record(self, store: RowStore, action: str, *, by: str, time: str, commands: tuple[str, str]) -> None:
        """Record an action with the changes collected by the store; `commands` undo and redo it.

        In safe mode, an action beyond the limit ends safe mode silently, and nothing will be undone.
        """
        changes, store.changes = tuple(store.changes), []
        if not changes:
            return
        self._count += 1
        self.entries = [entry for entry in self.entries if not entry.undone]
        policy = "write,policy" if changes[0].menu.startswith("/user") else "write"
        self.entries.append(
            HistoryEntry(self._count, action, by, policy, time, *commands, changes, floating=self.holder is not None)
        )
        if sum(entry.floating for entry in self.entries) > self.limit:
            self.release()
        del self.entries[: -self.limit]

    def join(self, first: int) -> None:
        """Merge all entries from this index on into one, with the commands of the first."""
        later = self.entries[first:]
        if later:
            changes = tuple(change for entry in later for change in entry.changes)
            self.entries[first:] = [replace(later[0], changes=changes)]

    def settle(self, first: int) -> None:
        """Remove the entries from this index on from safe mode, so that they stay."""
        for entry in self.entries[first:]:
            entry.floating = False

    def take(self, caller: Caller) -> None:
        """Enter safe mode."""
        self.holder = caller

    def release(self) -> None:
        """Leave safe mode and keep all changes."""
        self.holder = None
        for entry in self.entries:
            entry.floating = False

    def unroll(self, store: RowStore) -> None:
        """Undo all changes of all sessions since safe mode began, newest first, and leave safe mode."""
        for entry in reversed([entry for entry in self.entries if entry.floating and not entry.undone]):
            _undo_entry(store, entry)
        self.entries = [entry for entry in self.entries if not entry.floating]
        self.holder = None

    def undo(self, store: RowStore) -> bool:
        """Undo the latest action not yet undone."""
        for entry in reversed(self.entries):
            if not entry.undone:
                _undo_entry(store, entry)
                entry.undone = True
                return True
        return False

    def redo(self, store: RowStore) -> bool:
        """Redo the oldest undone action."""
        for entry in self.entries:
            if entry.undone:
                for change in entry.changes:
                    store.put_back(change, forward=True)
                entry.undone = False
                return True
        return False

    def clear(self) -> None:
        """Clear the history, as a reboot does."""
        self.entries.clear()
        self.holder = None


def _undo_entry(store: RowStore, entry: HistoryEntry) -> None:
    for change in reversed(entry.changes):
        store.put_back(change)


_SPACE_MENUS = {
    "bridge": ("/interface/bridge",),
    "interface": (*menus.INTERFACES, "/ip/vrf"),
    "table": ("/routing/table", "/ip/vrf"),
}
"""A VRF is an interface and a routing table with the same name (Manual, VRF)."""


@dataclass(slots=True, eq=False)
class StoredItem:
    """One row, compared by identity because lists of thousands are searched for it.

    `values`: given values in stored form; missing ones have their default. The dict is replaced, never modified.
    """

    id: int
    values: dict[str, str]
    factory: dict[str, str] | None = None
    """Factory content of the row; None: the row was added later."""
    dynamic: bool = False
    print_cache: PrintedRow | None = None
    """Latest printed form of the row; None: not cached."""


@dataclass(frozen=True, slots=True)
class PrintedRow:
    """Cached arguments of a row as the API prints them, valid while `values` is the row's content."""

    values: dict[str, str]
    row: dict[str, str]
    references: tuple[menus.Arg, ...]
    """Arguments with names of other rows, which may change at any time."""
    secrets: tuple[str, ...]


class PlacedRow(NamedTuple):
    """The content of a row and its position."""

    values: dict[str, str]
    position: int


@dataclass(frozen=True, slots=True)
class StoreChange:
    """One row before and after a change; None: does not exist."""

    menu: str
    id: int
    before: PlacedRow | None
    after: PlacedRow | None


@dataclass(slots=True)
class Table:
    """The ordered rows of one menu."""

    menu: menus.EmulatedMenu
    args: dict[str, menus.Arg]
    """Arguments available with the router's version and board."""
    items: list[StoredItem] = field(default_factory=list)
    _groups: dict[str, dict[str | None, dict[StoredItem, None]]] = field(default_factory=dict)
    """Index: argument to the rows of each stored value, to avoid searching thousands of rows."""

    def find_by_value(self, name: str, value: str | None) -> list[StoredItem]:
        """Return the rows whose stored value equals `value`; None: not set."""
        if name not in self._groups:
            groups: dict[str | None, dict[StoredItem, None]] = {}
            for item in self.items:
                groups.setdefault(item.values.get(name), {})[item] = None
            self._groups[name] = groups
        groups = self._groups[name]
        return [*groups.get(value, ()), *(groups.get(None, ()) if value is not None else ())]

    def update_index(self, item: StoredItem, before: Mapping[str, str] | None, after: Mapping[str, str] | None) -> None:
        """Update the value index after a change of a row; None: does not exist."""
        for name, groups in self._groups.items():
            if before is not None:
                groups.get(before.get(name), {}).pop(item, None)
            if after is not None:
                groups.setdefault(after.get(name), {})[item] = None

    def clear_index(self) -> None:
        """Discard the value index after rows were changed directly."""
        self._groups.clear()

    def find(self, number: int) -> StoredItem | None:
        """Return the row with this id."""
        return next((item for item in self.items if item.id == number), None)


class RowStore:
    """All tables of a router, and the name space of references."""

    def __init__(self, schema: Schema, *, reuses_ids: bool = False) -> None:
        self.schema = schema
        self._reuses_ids = reuses_ids
        self.tables: dict[str, Table] = {}
        self.counters: dict[str, int] = {}
        self.revision = 0
        self.changes: list[StoreChange] = []
        """Changes that are not in a history entry yet."""
        self.unsaved: list[tuple[StoreChange, StoredItem]] | None = None
        """Changes of rows since the last write to the flash, in order; None: everything must be written again."""
        self._dynamic_ids: dict[tuple[str, str, int], int] = {}

    def table(self, path: str) -> Table:
        """Return the table of a menu of the schema; it is created empty at first use."""
        if path not in self.tables:
            menu = menus.MODELLED_MENUS.get(path) or menus.generic(self.schema, path)
            names = self.schema.arguments(path, "add") | self.schema.arguments(path, "set")
            fixed_names = {menu.name_property} if menu.shape is menus.Shape.FIXED_ROWS else set()
            known_args = [arg for arg in menu.args if arg.name in names | fixed_names]
            rest = menus.unmodelled_arguments(path, names - set(menu.by_name))
            self.tables[path] = Table(menu, {arg.name: arg for arg in (*known_args, *rest)})
        return self.tables[path]

    # --- names -----------------------------------------------------------------------------------------------------

    def space_tables(self, space: str) -> Iterator[Table]:
        """Yield the tables of a name space; the path of a menu is also accepted."""
        for path in (space,) if space.startswith("/") else _SPACE_MENUS.get(space, ()):
            yield self.table(path)
        for path, table in list(self.tables.items()):
            if table.menu.space == space and path not in _SPACE_MENUS.get(space, ()):
                yield table

    def id_of(self, space: str, name: str) -> int | None:
        """Return the id of the row with that name, or None."""
        for table in self.space_tables(space):
            for item in table.items:
                if self.text(table, item, "name") == name:
                    return item.id
        return None

    def name_of(self, space: str, number: int) -> str | None:
        """Return the name of the row, or None if it was removed."""
        for table in self.space_tables(space):
            if (item := table.find(number)) is not None:
                return self.text(table, item, "name")
        return None

    def text(self, table: Table, item: StoredItem, name: str) -> str | None:
        """Return a property in export format; None: not set and without default."""
        if name in item.values:
            return spell(item.values[name], self)
        arg = table.args.get(name)
        return arg.default if arg is not None else None

    def target(self, table: Table, item: StoredItem, name: str) -> int | None:
        """Return the id of the row that a property references, by value or default."""
        value = item.values.get(name)
        if value is None and (arg := table.args.get(name)) is not None and arg.default is not None:
            value = arg.kind.parse(arg.default, self)
        return next((number for _, number in references(value or "")), None)

    def refer(self, space: str, name: str) -> str:
        """Return the stored form of a reference to an existing row. Raises LookupError."""
        number = self.id_of(space, name)
        if number is None:
            raise LookupError(f"no {space} called {name}")
        return reference(space, number)

    # --- ids -------------------------------------------------------------------------------------------------------

    def new_id(self, path: str) -> int:
        """Allocate the next id of a menu; interfaces of all kinds share a counter. Assumption: api-ids-grow."""
        menu = self.table(path).menu
        if self._reuses_ids and menu.space != "interface":
            used_ids = {item.id for item in self.table(path).items}
            return next(number for number in itertools.count(menu.first_id) if number not in used_ids)
        key = "interface" if menu.space == "interface" else path
        number = self.counters.get(key, menu.first_id)
        self.counters[key] = number + 1
        return number

    def dynamic_id(self, path: str, why: str, source: int) -> int:
        """Return the permanent id of a dynamic row that exists because of row `source`."""
        key = (path, why, source)
        if key not in self._dynamic_ids:
            self._dynamic_ids[key] = self.new_id(path)
        return self._dynamic_ids[key]

    # --- changes ---------------------------------------------------------------------------------------------------

    def place(self, path: str, item: StoredItem) -> PlacedRow:
        """Return a row's current content and position."""
        return PlacedRow(dict(item.values), self.table(path).items.index(item))

    def insert(self, path: str, values: Mapping[str, str], index: int | None = None) -> StoredItem:
        """Insert a row, by default at the end."""
        items = self.table(path).items
        item = StoredItem(self.new_id(path), dict(values))
        position = len(items) if index is None else index
        items.insert(position, item)
        self._record_change(StoreChange(path, item.id, None, PlacedRow(dict(item.values), position)), item)
        return item

    def update(self, path: str, item: StoredItem, values: Mapping[str, str]) -> None:
        """Replace a row's content."""
        before = self.place(path, item)
        item.values = dict(values)
        self._record_change(StoreChange(path, item.id, before, before._replace(values=dict(values))), item)

    def move(self, path: str, item: StoredItem, index: int) -> None:
        """Move a row to a position, counted without the row itself."""
        before = self.place(path, item)
        items = self.table(path).items
        items.remove(item)
        items.insert(index, item)
        self._record_change(StoreChange(path, item.id, before, self.place(path, item)), item)

    def remove(self, path: str, item: StoredItem) -> None:
        """Remove a row."""
        before = self.place(path, item)
        self.table(path).items.remove(item)
        self._record_change(StoreChange(path, item.id, before, None), item)

    def _record_change(self, change: StoreChange, item: StoredItem) -> None:
        self.changes.append(change)
        self._track_change(change, item)

    def _track_change(self, change: StoreChange, item: StoredItem) -> None:
        self.revision += 1
        before, after = (None if place is None else place.values for place in (change.before, change.after))
        self.table(change.menu).update_index(item, before, after)
        if self.unsaved is not None:
            self.unsaved.append((change, item))

    def put_back(self, change: StoreChange, *, forward: bool = False) -> None:
        """Undo (or redo) one change: content, position and id."""
        table = self.table(change.menu)
        content = change.after if forward else change.before
        item = table.find(change.id)
        before = None if item is None else self.place(change.menu, item)
        item = item or StoredItem(change.id, {})
        if before is not None:
            table.items.remove(item)
        if content is not None:
            item.values = dict(content.values)
            table.items.insert(content.position, item)
        self._track_change(StoreChange(change.menu, change.id, before, content), item)

    # --- flash -----------------------------------------------------------------------------------------------------

    def dump_unsaved(self) -> list[tuple[str, int, int | None, list[Any]]]:
        """Return the `unsaved` changes as JSON-able data: menu, id, position (None: removed), other values."""
        return [
            (change.menu, change.id, place and place.position, [place and place.values, item.factory, item.dynamic])
            for change, item in self.unsaved or ()
            for place in (change.after,)
            if not item.dynamic or item.factory is not None
        ]

    def dump(self) -> dict[str, Any]:
        """Return the whole store as JSON-able data."""
        return {
            "counters": dict(self.counters),
            "tables": {
                path: [
                    [item.id, dict(item.values), item.factory, item.dynamic]
                    for item in table.items
                    if not item.dynamic or item.factory is not None
                ]
                for path, table in sorted(self.tables.items())
            },
        }

    def load(self, data: Mapping[str, Any], *, is_upgrade: bool = False) -> None:
        """Replace the whole store by the result of `dump`.

        `is_upgrade`: the data are from another version. Unknown values are dropped, where a device converts some of
        them; menus new in this version keep the factory rows.
        """
        self.counters = {**self.counters, **data["counters"]} if is_upgrade else dict(data["counters"])
        if not is_upgrade:
            self.tables.clear()
        for path, rows in data["tables"].items():
            if is_upgrade and not self.schema.has_menu(path):
                continue
            table = self.table(path)
            table.clear_index()
            table.items = [
                StoredItem(number, dict(values), factory, dynamic) for number, values, factory, dynamic in rows
            ]
            for item in table.items if is_upgrade else ():
                item.values = {name: value for name, value in item.values.items() if name in {*table.args, "name"}}
        self.changes.clear()
        self.unsaved = None
        self._dynamic_ids.clear()
        self.revision += 1
