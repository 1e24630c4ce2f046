"""A change of one menu before it is numbered, and its text for the user."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import DeviceError
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.routeros import _types
from atlantis_netcfg.routeros.pin import PinSim, objection

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from atlantis_netcfg.routeros._items import DesiredState, RowItem
    from atlantis_netcfg.routeros.diff import DiffLine
    from atlantis_netcfg.routeros.menus import Field, Menu

_SHOWN_NAMES = 3


class CannotPlan(DeviceError):
    """The device cannot reach the desired state: a row, version or property is missing. Nothing was changed."""


@dataclass(frozen=True, slots=True)
class MenuChange:
    """A planned action without its number."""

    menu: Menu
    verb: _types.Verb
    layer: _types.Layer
    subject: str
    ids: tuple[str, ...] = ()
    values: tuple[tuple[str, str], ...] = ()
    before: str | None = None
    inert: bool = False
    line: int = 0


@dataclass(slots=True)
class MenuPlan:
    """The part of the plan for one menu."""

    menu: Menu
    changes: list[MenuChange] = field(default_factory=list)
    lines: list[DiffLine] = field(default_factory=list)
    drift: list[_types.Drift] = field(default_factory=list)
    hidden_secrets: list[_types.HiddenSecret] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    foreign: int = 0
    """Number of rows without our mark that are removed."""

    def remove(self, rows: list[_types.Row], layer: _types.Layer = _types.Layer.CLEANUP) -> None:
        """Remove rows in the given order."""
        self.changes.append(build_removal(self.menu, rows, layer))
        self.foreign += sum(not self.menu.is_ours(row) for row in rows)


@dataclass(frozen=True, slots=True)
class Context:
    """Shared input for the planning of all menus."""

    desired_state: DesiredState
    names: Names
    sensitive: bool
    """The user may read secrets. Assumption: api-sensitive"""
    """Our group may read secrets, so that a secret which is not printed is not set."""
    sim: PinSim = PinSim.UNKNOWN

    def is_entire(self, menu: Menu) -> bool:
        """Return True if all rows of the menu are ours."""
        return menu.path in self.desired_state.entire

    def is_hidden(self, value: str | None) -> bool:
        """Return True if a secret is hidden: missing, or stars."""
        return not self.sensitive if value is None else value != "" and not value.strip("*")


class Names:
    """Names that existing rows refer to; adding a row with such a name is not harmless."""

    def __init__(self, rows: Mapping[str, tuple[_types.Row, ...]]) -> None:
        self._rows = rows
        self._by: dict[tuple[str, ...], frozenset[str]] = {}

    def name(self, menu: Menu, value: str) -> bool:
        """Return True if any row refers to `value` in a property that names rows of `menu`."""
        if menu.named_by not in self._by:
            self._by[menu.named_by] = frozenset(self._find_values(menu.named_by))
        return value in self._by[menu.named_by]

    def _find_values(self, properties: tuple[str, ...]) -> Iterator[str]:
        for rows in self._rows.values():
            for row in rows:
                yield from (row[name].removeprefix("!") for name in properties if name in row)


def build_addition(menu: Menu, item: RowItem, names: Names, before: str | None = None) -> MenuChange:
    """Return the change that adds a row, before the row with id `before` if given."""
    row, values = item.defined_values, tuple(item.defined_values.items())
    late = bool(menu.late) and all(menu.form(name, row) == menu.by_name[name].form(value) for name, value in menu.late)
    inert = menu.inert and not late and not names.name(menu, row.get(menu.keys[0], ""))
    layer = _types.Layer.CLEANUP if late else menu.layer
    return MenuChange(
        menu, _types.Verb.ADD, layer, menu.name_of(row), values=values, before=before, inert=inert, line=item.line
    )


def build_removal(menu: Menu, rows: list[_types.Row], layer: _types.Layer) -> MenuChange:
    """Return the change that removes rows, in that order."""
    names = [menu.name_of(row) for row in rows]
    subject = join(", ", names[:_SHOWN_NAMES])
    if len(names) > _SHOWN_NAMES:
        subject += msg(f" and {arg(len(names) - _SHOWN_NAMES)} more")
    return MenuChange(menu, _types.Verb.REMOVE, layer, subject, ids=tuple(row[".id"] for row in rows))


def writes(
    context: Context, report: MenuPlan, item: RowItem, row: _types.Row, *, is_managed: bool
) -> tuple[tuple[str, str], ...]:
    """Return what must be set so that `row` has the desired values.

    Properties that the item does not set return to their defaults only if the row is ours (`is_managed`).
    """
    menu = report.menu
    desired_values: dict[str, str | None] = {}
    for name in item.values:
        desired_values |= _plan_property(context, report, item, row, name)
    if is_managed:
        for each in menu.fields:
            is_named = each.name in item.values or each.name in item.unknown
            if each.name in row and not is_named and not _is_kept(context, each):
                default = menu.default_of(each.name, row)
                if not _is_run_time(context, menu, each.name, default, row):
                    desired_values |= _differing(menu, row, each.name, default)
    return tuple((name, value) if value is not None else (f"!{name}", "") for name, value in desired_values.items())


def _is_run_time(context: Context, menu: Menu, name: str, desired_value: str | None, row: _types.Row) -> bool:
    """Return True if the device itself has replaced the desired value."""
    return any(either.covers(menu, name, desired_value, row) for either in context.desired_state.run_time)


def _is_kept(context: Context, each: Field) -> bool:
    return each.keep and (each.default is None or not context.desired_state.restores)


def _plan_property(
    context: Context, report: MenuPlan, item: RowItem, row: _types.Row, name: str
) -> dict[str, str | None]:
    menu, each = report.menu, report.menu.by_name[name]
    if each.unread:
        return {}
    if each.secret and context.is_hidden(row.get(name)):
        report.hidden_secrets.append(_types.HiddenSecret(menu.path, menu.name_of(row), name))
        report.notes.append(
            msg(f"{arg(menu.title)}: `{arg(name)}` of {arg(menu.name_of(row))} cannot be read and is left unchanged")
        )
        return {}
    value = item.values[name]
    if each.is_prompted and value:
        return _plan_prompted_value(context, report, item, row, name)
    desired_value = menu.default_of(name, row) if value is None else value
    if _is_run_time(context, menu, name, desired_value, row):
        return {}
    changes = _differing(menu, row, name, desired_value)
    if changes and each.board and not any(other.board and other.name in row for other in menu.fields):
        report.problems.append(
            msg(f"line {arg(item.line)}: {arg(menu.name_of(row))} of this device has no `{arg(name)}`")
        )
        return {}
    return changes


def _plan_prompted_value(
    context: Context, report: MenuPlan, item: RowItem, row: _types.Row, name: str
) -> dict[str, str | None]:
    """Return a prompted value (a PIN) only while the device asks for it (routeros/pin.py)."""
    value = item.values[name] or ""
    if context.sim is PinSim.FREE:
        return {}
    if context.sim is PinSim.UNKNOWN:
        report.notes.append(
            msg(f"{arg(report.menu.name_of(row))} does not show whether it needs `{arg(name)}`: it is not sent")
        )
        return {}
    if why := objection(context.sim, row.get(name, ""), value, context.desired_state.pin_refusal):
        report.problems.append(msg(f"line {arg(item.line)}: {arg(why)}"))
        return {}
    return {name: value}


def _differing(menu: Menu, row: _types.Row, name: str, desired_value: str | None) -> dict[str, str | None]:
    return {} if menu.by_name[name].form(desired_value) == menu.form(name, row) else {name: desired_value}
