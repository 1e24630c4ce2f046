"""A plan as text: rows in the device's export syntax, with `+`, `-` or ` ` in the margin.

Settings and rows changed in place show only the changed values. Secrets are masked. Unchanged rows are omitted, except
for a few around a change where the order matters.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby
from typing import TYPE_CHECKING

from atlantis_netcfg.core.secret import MASK
from atlantis_netcfg.routeros.menus import Field, Menu, PropertyKind, Shape, canonical
from atlantis_netcfg.routeros.rsc import Statement, print_statement

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from atlantis_netcfg.routeros._types import Row

_CONTEXT = 2


@dataclass(frozen=True, slots=True)
class DiffLine:
    """One row as text, and its margin: `+` new, `-` old, ` ` as it is."""

    margin: str
    text: str


def render(menus: Iterable[tuple[Menu, Sequence[DiffLine]]]) -> str:
    """Return the whole text; empty if no line has a `+` or `-`."""
    parts = [_menu_text(menu, lines) for menu, lines in menus if any(line.margin != " " for line in lines)]
    return "".join(parts)


def _menu_text(menu: Menu, lines: Sequence[DiffLine]) -> str:
    text_lines = [f"  {menu.title}", *_shorten(lines)]
    return "".join(f"{line}\n" for line in text_lines)


def _shorten(lines: Sequence[DiffLine]) -> list[str]:
    """Keep unchanged rows only next to changed ones, and print how many are omitted."""
    changed_indexes = [index for index, line in enumerate(lines) if line.margin != " "]
    near = {index + offset for index in changed_indexes for offset in range(-_CONTEXT, _CONTEXT + 1)}
    text_lines: list[str] = []
    for is_near, run in groupby(enumerate(lines), key=lambda each: each[0] in near):
        texts = [f"{line.margin} {line.text}" for _, line in run]
        text_lines += texts if is_near or len(texts) == 1 else [f"  # {len(texts)} rows as they are"]
    return text_lines


def added_row(menu: Menu, values: Mapping[str, str]) -> str:
    """Return the line that adds a row with these values."""
    return _print(menu, "add", values)


def existing_row(menu: Menu, row: Row) -> str:
    """Return the line that would add an existing row, as in an export: without defaults."""
    names = sorted(each.name for each in menu.fields if each.name in row and not each.keep)
    values = {
        name: row[name]
        for name in names
        if name in (*menu.keys, "action") or menu.form(name, row) != _default(menu, name, row)
    }
    return _print(menu, "add", values)


def _default(menu: Menu, name: str, row: Row) -> str:
    return menu.by_name[name].form(menu.default_of(name, row))


def set_lines(menu: Menu, row: Row, values: Sequence[tuple[str, str]]) -> list[DiffLine]:
    """Return the old and the new line of a change in place."""
    names = [name.removeprefix("!") for name, _ in values]
    old = {name: row.get(name, menu.default_of(name, row)) for name in names}
    new = {name.removeprefix("!"): None if name.startswith("!") else value for name, value in values}
    return [DiffLine("-", _print(menu, "set", old, row)), DiffLine("+", _print(menu, "set", new, row))]


def _print(menu: Menu, verb: str, values: Mapping[str, str | None], row: Row | None = None) -> str:
    """Print one statement; `row` is the target of a `set`."""
    display_values = tuple((name, _display_value(menu.by_name[name], value)) for name, value in values.items())
    keys = tuple((key, row[key]) for key in menu.keys if key in row) if row is not None else ()
    if keys and menu.shape is Shape.FIXED and menu.keys == ("name",):
        return print_statement(Statement(menu.path, verb, display_values, target=keys[0][1]))
    return print_statement(Statement(menu.path, verb, display_values, find=keys or None))


def _display_value(field: Field, value: str | None) -> str | None:
    """Return a value as in an export (the API has `true` for `yes`), or the mask if it is secret."""
    if field.secret and value:
        return MASK
    return canonical(field.kind, value) if value and field.kind is PropertyKind.BOOLEAN else value
