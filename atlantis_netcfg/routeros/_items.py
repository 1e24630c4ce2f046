"""Desired rows parsed from text, with their line numbers; converts one statement to one row."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import UsageError, nearest
from atlantis_netcfg.core.messages import arg, conjunction, msg
from atlantis_netcfg.routeros import menus

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from atlantis_netcfg.routeros._types import Row
    from atlantis_netcfg.routeros.rsc import Statement


@dataclass(frozen=True, slots=True)
class RowItem:
    """One desired row, or the desired settings of a menu without rows."""

    menu: str
    values: Mapping[str, str | None]
    """Properties in the order of the text, keys included; None is `!name`, which unsets the property."""
    line: int = 0
    exists: bool = False
    """The text only modifies the row: it must already exist on the device."""
    unknown: frozenset[str] = frozenset()
    """Properties whose value the text does not contain (an export hides secrets): they stay unchanged."""

    @property
    def defined_values(self) -> dict[str, str]:
        """The properties that have a value."""
        return {name: value for name, value in self.values.items() if value is not None}

    @property
    def identity(self) -> tuple[str, ...]:
        """The values of the key properties that identify the row within its menu, in canonical form."""
        return menus.MENUS[self.menu].identity(self.defined_values)

    @property
    def is_marked(self) -> bool:
        """True for a row that carries our mark."""
        return (self.values.get("comment") or "").startswith(menus.MARK)


@dataclass(frozen=True, slots=True)
class RunTime:
    """A value that the device itself replaces while it works, and restores afterwards."""

    menu: str
    name: str
    declared_value: str
    instead: str
    temporary: bool = False
    """Only while a link is selected for a limited time (`routeros/link_use.py`)."""

    def covers(self, menu: menus.Menu, name: str, desired_value: str | None, row: Row) -> bool:
        """Return True if the row's value is the one that the device substitutes for the desired value."""
        each = menu.by_name[name]
        mine = (self.menu, self.name) == (menu.path, name)
        return (
            mine
            and each.form(self.declared_value) == each.form(desired_value)
            and each.form(self.instead) == menu.form(name, row)
        )


@dataclass(frozen=True, slots=True)
class DesiredState:
    """The desired state of one device, as parsed from its text."""

    source: str
    items: Mapping[str, tuple[RowItem, ...]]
    """Rows by menu, in the order of the text. A menu may have no rows."""
    entire: frozenset[str] = frozenset()
    """Exclusively managed menus: rows that the text does not contain are removed, whoever added them."""
    undeclared_values: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    """Expected values that the text does not contain, by menu of fixed rows."""
    restores: bool = False
    """The text is a saved state: in exclusively managed menus, omitted properties have their default."""
    notes: tuple[str, ...] = ()
    """Parts of the text that could not be adopted."""
    pin_refusal: str = ""
    """Why the PIN in the text must not be sent again; empty: no known reason."""
    run_time: tuple[RunTime, ...] = ()
    """Values that the device changes by itself: neither drift nor to be corrected."""
    partial: frozenset[str] = frozenset()
    """Menus of which the text contains only some rows; the other rows are ignored, whoever owns them."""
    remarks: tuple[tuple[str, str], ...] = ()
    """Pairs of a menu and a remark for the user who consents to a change in it."""

    @property
    def menus(self) -> tuple[str, ...]:
        """The menus that must be read before anything can be planned."""
        return tuple(self.items)


class Mistake(UsageError):
    """One error in the text; `str()` begins with the text's name and line."""


def near(word: str, words: Iterable[str]) -> str:
    """Return `; did you mean X?`, or nothing when no word is close."""
    close = nearest(word, words)
    return msg(f"; did you mean {arg(close)}?") if close else ""


def known_menu(path: str) -> menus.Menu:
    """Return the menu definition. Raises Mistake, without file and line, for an unknown menu."""
    if path not in menus.MENUS:
        title = "/" + path.strip("/").replace("/", " ")
        hint = near(title, (menu.title for menu in menus.MENUS.values()))
        raise Mistake(f"{arg(title)} is no menu that can be declared{arg(hint)}")
    return menus.MENUS[path]


def item_of(statement: Statement) -> RowItem:
    """Convert one statement to its desired row. Raises Mistake, without file and line."""
    menu = known_menu(statement.menu)
    if menu.readonly:
        raise Mistake(f"{arg(menu.title)} can be looked at, but not declared")
    if statement.verb == "add":
        return _build_added_item(menu, statement)
    if statement.verb == "set":
        return _build_set_item(menu, statement)
    raise Mistake(f"`{arg(statement.verb)}` is not allowed in a declaration: write `add` or `set`")


def _build_added_item(menu: menus.Menu, statement: Statement) -> RowItem:
    if menu.shape is menus.Shape.SINGLETON:
        raise Mistake(f"{arg(menu.title)} holds settings and no rows: write `set` instead of `add`")
    if menu.shape is menus.Shape.FIXED:
        raise Mistake(f"the rows of {arg(menu.title)} are there already: write `set [ find {arg(menu.keys[0])}=... ]`")
    values = _values(menu, statement)
    for key in menu.keys:
        if values.get(key) is None and (key in values or menu.by_name[key].default is None):
            raise Mistake(f"a row of {arg(menu.title)} needs `{arg(key)}`, which tells it from the others")
    return RowItem(menu.path, values, statement.line)


def _build_set_item(menu: menus.Menu, statement: Statement) -> RowItem:
    values = _values(menu, statement)
    if menu.shape is menus.Shape.SINGLETON:
        if statement.find is not None or statement.target is not None:
            raise Mistake(f"{arg(menu.title)} holds settings and no rows: write `set name=value` without a row")
        return RowItem(menu.path, values, statement.line)
    keys = _parse_selector(menu, statement)
    # A key may be written only where the row is found by another property: `set [ find default-name=ether1 ] name=wan`.
    changed_keys = [key for key in menu.keys if key in values and values[key] != keys[key]]
    if changed_keys:
        raise Mistake(
            f"`{arg(changed_keys[0])}` tells the rows of {arg(menu.title)} apart and cannot be changed: "
            "declare a new row"
        )
    return RowItem(menu.path, {**keys, **values}, statement.line, exists=True)


def _parse_selector(menu: menus.Menu, statement: Statement) -> dict[str, str]:
    """Return the key values given by the statement's selector."""
    example = " ".join(f"{key}=..." for key in menu.keys)
    if not menu.keys:
        raise Mistake(f"rows of {arg(menu.title)} have no name to find them by: declare them with `add`")
    if statement.target is not None:
        if statement.target.isdecimal() or statement.target.startswith("*") or len(menu.keys) > 1:
            raise Mistake(
                f"`{arg(statement.target)}` is another row on another router: write `set [ find {arg(example)} ]`"
            )
        return {menu.keys[0]: statement.target}
    result = dict(statement.find or ())
    if set(result) != set(menu.keys):
        raise Mistake(
            f"a row of {arg(menu.title)} is found by its {arg(conjunction(menu.keys))}: write `[ find {arg(example)} ]`"
        )
    return result


def _values(menu: menus.Menu, statement: Statement) -> dict[str, str | None]:
    values: dict[str, str | None] = {}
    for name, value in statement.values:
        if name not in menu.by_name:
            raise Mistake(f"{arg(menu.title)} has no argument `{arg(name)}`{arg(near(name, menu.by_name))}")
        if name in values:
            raise Mistake(f"`{arg(name)}` is given twice")
        values[name] = value
    return values
