"""Desired state: parses export-style text with directives in comments into the rows that a device should have.

`# atlantis:entire /ip firewall filter`: the menu is entirely ours; other rows in it are removed.

`# atlantis:undeclared /interface ethernet disabled=yes`: values for rows that exist on the device but not in the text.

`# atlantis:run-time /ip route distance=10 distance=110`: the device itself replaces 10 by 110 while it works; a row
with either value is in the desired state.

`# atlantis:note /tool netwatch: asking takes {1} MB a day`: a note shown with every plan that changes that menu; its
values stand in braces.

All errors are reported together.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.routeros._items import DesiredState, Mistake, RowItem, RunTime, item_of, known_menu, near
from atlantis_netcfg.routeros.menus import MENUS, Menu, Shape
from atlantis_netcfg.routeros.rsc import Statement, parse

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence


__all__ = ["DesiredState", "Mistake", "RowItem", "from_export", "read"]

_DIRECTIVE = re.compile(r"^[ \t]*#[ \t]*atlantis:(\S*)[ \t]*(.*?)[ \t\r]*$", re.MULTILINE)
_ENTIRE, _UNDECLARED_ROWS, _RUN_TIME, _NOTE = "entire", "undeclared", "run-time", "note"
_VALUE = re.compile(r"\{(.*?)\}")
_SINGLE = re.compile(r"(/.*?)[ \t]+([a-z0-9-]+)=(\S*)")
_EITHER = re.compile(r"(/.*?)[ \t]+([a-z0-9-]+)=(\S*)[ \t]+\2=(\S*)")


def read(text: str, source: str = "text") -> DesiredState:
    """Parse a desired state; `source` is the name of the text in messages.

    Raises RscError if the text is not export text, and Mistake with every line that is not possible.
    """
    export = parse(text, source)
    mistakes: list[str] = []
    entire: dict[str, None] = {}
    undeclared_values: dict[str, dict[str, str]] = {}
    run_time: list[RunTime] = []
    remarks: list[tuple[str, str]] = []
    _parse_directives(text, source, mistakes, (entire, undeclared_values, run_time, remarks))
    items: dict[str, list[RowItem]] = {
        menu: [] for menu in (*export.menus, *entire, *undeclared_values) if menu in MENUS
    }
    first: dict[tuple[str, tuple[str, ...]], int] = {}
    for statement in export.statements:
        try:
            item = item_of(statement)
            _once(item, first)
        except Mistake as mistake:
            mistakes.append(msg(f"{arg(source)}, line {arg(statement.line)}: {arg(mistake)}"))
        else:
            items[item.menu].append(item)
    if mistakes:
        raise Mistake(join("\n", mistakes))
    items_by_menu = {menu: tuple(rows) for menu, rows in items.items()}
    return DesiredState(
        source, items_by_menu, frozenset(entire), undeclared_values, run_time=tuple(run_time), remarks=tuple(remarks)
    )


_Directives = tuple[dict[str, None], dict[str, dict[str, str]], list[RunTime], list[tuple[str, str]]]


def _parse_directives(text: str, source: str, mistakes: list[str], directives: _Directives) -> None:
    entire, undeclared_values, run_time, remarks = directives
    for match in _DIRECTIVE.finditer(text):
        word, argument = match.groups()
        try:
            if word == _ENTIRE:
                entire[_entire_menu(argument)] = None
            elif word == _UNDECLARED_ROWS:
                menu, name, value = _value_in_menu(argument)
                undeclared_values.setdefault(menu, {})[name] = value
            elif word == _RUN_TIME:
                run_time.append(_parse_run_time(argument))
            elif word == _NOTE:
                title, _, remark = argument.partition(": ")
                remarks.append((_menu_named(title).path, msg(_VALUE.sub(lambda match: f"{arg(match[1])}", remark))))
            else:
                directive_names = (_ENTIRE, _UNDECLARED_ROWS, _RUN_TIME, _NOTE)
                raise Mistake(f"unknown directive `atlantis:{arg(word)}`{arg(near(word, directive_names))}")  # noqa: TRY301
        except Mistake as mistake:
            line = text.count("\n", 0, match.start()) + 1
            mistakes.append(msg(f"{arg(source)}, line {arg(line)}: {arg(mistake)}"))


def _menu_named(title: str) -> Menu:
    return known_menu("/" + "/".join(title.strip("/").replace("/", " ").split()))


def _parse_run_time(argument: str) -> RunTime:
    match = _EITHER.fullmatch(argument)
    if match is None:
        raise Mistake("write `atlantis:run-time /menu property=declared property=instead`")
    title, name, declared_value, instead = match.groups()
    menu = _menu_named(title)
    if name not in menu.by_name:
        raise Mistake(f"{arg(menu.title)} has no argument `{arg(name)}`{arg(near(name, menu.by_name))}")
    return RunTime(menu.path, name, declared_value, instead)


def _value_in_menu(argument: str) -> tuple[str, str, str]:
    match = _SINGLE.fullmatch(argument)
    if match is None:
        raise Mistake("write `atlantis:undeclared /menu property=value`")
    title, name, value = match.groups()
    menu = _menu_named(title)
    if menu.shape is not Shape.FIXED or menu.readonly:
        raise Mistake(f"{arg(menu.title)} has no fixed rows")
    if name not in menu.by_name or name in menu.keys:
        raise Mistake(f"{arg(menu.title)} has no argument `{arg(name)}`{arg(near(name, menu.by_name))}")
    return menu.path, name, value


def _entire_menu(argument: str) -> str:
    menu = _menu_named(argument)
    if menu.shape is not Shape.LIST or menu.readonly:
        raise Mistake(f"{arg(menu.title)} cannot be managed entirely, because nobody can add rows to it")
    return menu.path


def _once(item: RowItem, first: dict[tuple[str, tuple[str, ...]], int]) -> None:
    """Refuse a second row with the same identity; first-match rows may repeat."""
    if MENUS[item.menu].is_ordered:
        return
    line = first.setdefault((item.menu, item.identity), item.line)
    if line != item.line:
        name = MENUS[item.menu].name_of(item.defined_values)
        raise Mistake(f"{arg(name)} is defined a second time; the first is on line {arg(line)}")


def from_export(text: str, only: Iterable[str], source: str = "export") -> DesiredState:
    """Parse a saved export as the state to restore, in the menus of `only`.

    Values that an export omits are at their defaults. Exceptions are what it hides: secrets, and menus that it never
    prints, stay as they are on the device. If a menu has a row that we cannot identify, the menu is not restored
    entirely: that row could be the one removed. `notes` lists what cannot be restored. Raises RscError if the text is
    not an export.
    """
    menus = [known_menu(path) for path in dict.fromkeys(only)]
    restorable_menus = [menu for menu in menus if menu.is_exported and not menu.readonly]
    notes = [
        msg(f"{arg(menu.title)} is not part of an export: left unchanged")
        for menu in menus
        if menu not in restorable_menus
    ]
    items: dict[str, list[RowItem]] = {menu.path: [] for menu in restorable_menus}
    gaps: dict[str, None] = {}
    for statement in parse(text, source).statements:
        if statement.menu in items:
            menu = MENUS[statement.menu]
            restored_items = _restore_item(menu, statement, source, notes)
            items[menu.path] += restored_items
            if not restored_items and _is_a_row(menu, statement):
                gaps[menu.path] = None
    notes += [
        msg(f"{arg(MENUS[path].title)}: for that reason, rows that are not in the export are kept") for path in gaps
    ]
    return DesiredState(
        source,
        {menu: tuple(rows) for menu, rows in items.items()},
        frozenset(items) - set(gaps),
        restores=True,
        notes=tuple(notes),
    )


def _restore_item(menu: Menu, statement: Statement, source: str, notes: list[str]) -> Sequence[RowItem]:
    """Return the statement's row, or nothing and a note on why it cannot be restored."""
    foreign = [name for name, _ in statement.values if name not in menu.by_name]
    notes += [
        msg(f"{arg(source)}, line {arg(statement.line)}: `{arg(name)}` of {arg(menu.title)} is left unchanged")
        for name in foreign
    ]
    try:
        item = item_of(_normalize(menu, statement))
    except Mistake as mistake:
        notes.append(msg(f"{arg(source)}, line {arg(statement.line)}: not restored: {arg(mistake)}"))
        return ()
    hidden_names = menu.secrets - set(item.values)
    return (RowItem(item.menu, item.values, item.line, item.exists, hidden_names),)


def _is_a_row(menu: Menu, statement: Statement) -> bool:
    """Return True if the row would be removed or reset to its defaults in case we do not recognise it.

    `set 0` refers to a system row, which cannot be removed; the properties that identify it are not restored.
    """
    is_reported = any(name in menu.by_name and name not in menu.keys for name, _ in statement.values)
    return is_reported or statement.verb == "add" or statement.find is not None or menu.shape is Shape.FIXED


def _normalize(menu: Menu, statement: Statement) -> Statement:
    """Remove arguments unknown to the table, and refer to system rows by name.

    An export refers to them by number (`set 3`) or, if only one exists, by `[ find default=yes ]`.
    """
    target, find = statement.target, statement.find
    if find == (("default", "yes"),) and len(menu.stock) == len(menu.keys) == 1:
        find = ((menu.keys[0], menu.stock[0][0]),)
    if target is not None and target.isdecimal() and len(menu.keys) == 1 and int(target) < len(menu.stock):
        target = menu.stock[int(target)][0]
    values = tuple((name, value) for name, value in statement.values if name in menu.by_name)
    return type(statement)(
        menu=statement.menu,
        verb=statement.verb,
        values=values,
        find=find,
        target=target,
        line=statement.line,
        comments=statement.comments,
    )
