"""Settings, and menus whose rows have keys: match desired rows with existing ones, then compare."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.routeros import _types, diff
from atlantis_netcfg.routeros._items import RowItem
from atlantis_netcfg.routeros.menus import Menu, Shape
from atlantis_netcfg.routeros.planner import _change

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

_Value = tuple[str, ...]


@dataclass(slots=True, eq=False)
class _Match:
    """A desired row, the existing row to change, and whether a new row is needed after all."""

    item: RowItem
    row: _types.Row | None = None
    writes: tuple[tuple[str, str], ...] = ()
    is_replaced: bool = False
    after_those: list[_Match] = field(default_factory=list)
    """Rows that must release a value first."""

    def after(self) -> dict[str, str]:
        """Return the row as after the change."""
        if self.row is None:
            return self.item.defined_values
        unset = {name[1:] for name, _ in self.writes if name.startswith("!")}
        return {name: value for name, value in {**self.row, **dict(self.writes)}.items() if name not in unset}


@dataclass(slots=True)
class _MatchedRows:
    """The rows of one menu and their matches."""

    menu: Menu
    context: _change.Context
    report: _change.MenuPlan
    matches: list[_Match] = field(default_factory=list)
    unmatched_rows: list[_types.Row] = field(default_factory=list)
    """Rows that are not declared."""
    early: list[_types.Row] = field(default_factory=list)
    """Rows removed first, because they hold a value that another row needs."""


def plan_identified(
    menu: Menu, items: Iterable[RowItem], rows: Iterable[_types.Row], context: _change.Context
) -> _change.MenuPlan:
    """Plan one menu of settings, of fixed rows, or of rows with keys."""
    work = _MatchedRows(menu, context, _change.MenuPlan(menu))
    _match(work, items, [row for row in rows if menu.is_touchable(row)])
    for match in work.matches:
        if match.row is not None:
            match.writes = _change.writes(
                context, work.report, match.item, match.row, is_managed=_is_managed(work, match)
            )
    _make_room(work)
    _report_changes(work)
    _report_left(work)
    return work.report


def _match(work: _MatchedRows, items: Iterable[RowItem], rows: list[_types.Row]) -> None:
    """Match by keys, then by properties that must be unique; then report rows without a match."""
    menu = work.menu
    waiting: dict[_Value, deque[_types.Row]] = {}
    for row in sorted(rows, key=lambda each: not menu.is_ours(each)):
        waiting.setdefault(menu.identity(row), deque()).append(row)
    for item in items:
        candidates = waiting.get(item.identity)
        work.matches.append(_Match(item, candidates.popleft() if candidates else None))
    work.unmatched_rows = _not_matched(work, rows)
    for name in menu.unique:
        _match_by(work, name)
    _match_settings(work)
    for match in work.matches:
        if match.row is None and (match.item.exists or menu.shape is not Shape.LIST):
            work.report.problems.append(_missing_row_text(menu, match.item, rows))
    undeclared_values = work.context.desired_state.undeclared_values.get(menu.path, {})
    work.matches += [
        _Match(RowItem(menu.path, {**_keys(menu, row), **undeclared_values}), row) for row in _find_implied_rows(work)
    ]
    work.unmatched_rows = _not_matched(work, work.unmatched_rows)


def _not_matched(work: _MatchedRows, rows: list[_types.Row]) -> list[_types.Row]:
    matched_ids = {id(match.row) for match in work.matches}
    return [row for row in rows if id(row) not in matched_ids]


def _match_by(work: _MatchedRows, name: str) -> None:
    free = {work.menu.form(name, row): row for row in work.unmatched_rows if row.get(name)}
    for match in work.matches:
        if match.row is None and match.item.values.get(name) and not match.item.exists:
            match.row = free.pop(work.menu.form(name, match.item.defined_values), None)
    work.unmatched_rows = _not_matched(work, work.unmatched_rows)


def _match_settings(work: _MatchedRows) -> None:
    """Match settings, which always exist as one row, even if the device returns none."""
    if work.menu.shape is Shape.SINGLETON:
        for match in work.matches:
            match.row = match.row if match.row is not None else {}


def _keys(menu: Menu, row: _types.Row) -> dict[str, str | None]:
    return {key: row[key] for key in menu.keys if key in row}


def _find_implied_rows(work: _MatchedRows) -> list[_types.Row]:
    """Return rows omitted from a saved state because they had defaults, and unused ports."""
    if work.menu.path in work.context.desired_state.undeclared_values:
        return list(work.unmatched_rows)
    if not (work.context.desired_state.restores and work.context.is_entire(work.menu)):
        return []
    if work.menu.shape is Shape.LIST:
        return [row for row in work.unmatched_rows if work.menu.is_stock(row)]
    return list(work.unmatched_rows)


def _missing_row_text(menu: Menu, item: RowItem, rows: list[_types.Row]) -> str:
    there = join(", ", (menu.name_of(row) for row in rows))
    return msg(
        f"line {arg(item.line)}: {arg(menu.name_of(item.defined_values))} does not exist in {arg(menu.title)}; the "
        f"device has {arg(there or 'none')}"
    )


def _is_managed(work: _MatchedRows, match: _Match) -> bool:
    """Return True if properties not in the inventory return to their defaults."""
    if work.context.is_entire(work.menu):
        return True
    if work.menu.shape is not Shape.LIST or match.item.exists or match.row is None:
        return False
    return work.menu.is_ours(match.row) or match.item.is_marked


def _make_room(work: _MatchedRows) -> None:
    """Remove or change first the rows that hold a unique value which another row needs."""
    if not work.menu.unique:
        return
    for names in (work.menu.keys, *((name,) for name in work.menu.unique)):
        holders = {_value(work.menu, names, row): row for row in _present_rows(work)}
        owners = {id(match.row): match for match in work.matches if match.row is not None}
        for match in work.matches:
            if match.row is None or match.writes:
                desired_value = _value(work.menu, names, match.after())
                holder = holders.get(desired_value)
                if holder is not None and holder is not match.row:
                    owner = owners.get(id(holder))
                    leaves = owner is not None and _value(work.menu, names, owner.after()) != desired_value
                    _make_way(work, match, holder, owner, leaves=leaves)
    work.matches = _in_turn(work)


def _present_rows(work: _MatchedRows) -> Iterator[_types.Row]:
    yield from (match.row for match in work.matches if match.row is not None)
    yield from (row for row in work.unmatched_rows if row not in work.early)


def _value(menu: Menu, names: tuple[str, ...], values: _types.Row) -> _Value | None:
    """Return the value that must be unique; None if the row has none."""
    return tuple(menu.form(name, values) for name in names) if any(values.get(name) for name in names) else None


def _make_way(work: _MatchedRows, match: _Match, holder: _types.Row, owner: _Match | None, *, leaves: bool) -> None:
    """Plan how the holder of a value releases it; `owner` is the match of the holder's row, if any."""
    if owner is not None and leaves:
        match.after_those.append(owner)
    elif owner is None and _is_removable(work, holder):
        work.early.append(holder)
    else:
        here, there = work.menu.name_of(match.item.defined_values), work.menu.name_of(holder)
        work.report.problems.append(
            msg(
                f"line {arg(match.item.line)}: {arg(here)} cannot exist together with {arg(there)}, which is on the "
                "device"
            )
        )


def _in_turn(work: _MatchedRows) -> list[_Match]:
    """Order the rows so that each finds its values free; in a cycle, one row is removed and added again."""
    ordered_matches: dict[_Match, None] = {}
    waiting: list[_Match] = []

    def visit(match: _Match) -> None:
        waiting.append(match)
        for other in match.after_those:
            if other in waiting and other.row is not None and not other.is_replaced:
                other.is_replaced = True
                work.early.append(other.row)
            elif other not in waiting and other not in ordered_matches:
                visit(other)
        ordered_matches[waiting.pop()] = None

    for match in work.matches:
        if match not in ordered_matches:
            visit(match)
    return list(ordered_matches)


def _is_removable(work: _MatchedRows, row: _types.Row) -> bool:
    if work.menu.shape is not Shape.LIST or work.menu.is_stock(row):
        return False
    return work.context.is_entire(work.menu) or work.menu.is_ours(row)


def _report_changes(work: _MatchedRows) -> None:
    menu, report = work.menu, work.report
    if work.early:
        report.remove(work.early, menu.layer)
        report.lines += [diff.DiffLine("-", diff.existing_row(menu, row)) for row in work.early]
    for match in work.matches:
        if match.row is None or match.is_replaced:
            _add(work, match.item)
        elif match.writes:
            _set(work, match, match.row)


def _add(work: _MatchedRows, item: RowItem) -> None:
    if item.exists or work.menu.shape is not Shape.LIST:
        return  # reported as a problem
    name = work.menu.name_of(item.defined_values)
    work.report.changes.append(_change.build_addition(work.menu, item, work.context.names))
    work.report.lines.append(diff.DiffLine("+", diff.added_row(work.menu, item.defined_values)))
    for secret in sorted(item.unknown):
        work.report.notes.append(
            msg(f"{arg(work.menu.title)}: `{arg(secret)}` of {arg(name)} is not in the saved export: enter it by hand")
        )


def _set(work: _MatchedRows, match: _Match, row: _types.Row) -> None:
    menu = work.menu
    ids = () if menu.shape is Shape.SINGLETON else (row[".id"],)
    work.report.changes.append(
        _change.MenuChange(
            menu,
            _types.Verb.SET,
            menu.layer,
            menu.name_of(match.after()),
            ids=ids,
            values=match.writes,
            line=match.item.line,
        )
    )
    work.report.lines += diff.set_lines(menu, row, match.writes)
    if match.item.is_marked and not menu.is_ours(row) and menu.shape is Shape.LIST:
        work.report.notes.append(
            msg(f"{arg(menu.title)}: {arg(menu.name_of(row))} existed without our mark, and becomes ours")
        )


def _report_left(work: _MatchedRows) -> None:
    """Remove rows that were ours, or all in a menu that is entirely ours; report the others."""
    menu = work.menu
    if menu.shape is not Shape.LIST or menu.path in work.context.desired_state.partial:
        return
    going = [row for row in work.unmatched_rows if _is_removable(work, row) and row not in work.early]
    if going:
        work.report.remove(going[::-1])
        work.report.lines += [
            diff.DiffLine("-", diff.existing_row(menu, row)) for row in going if not _types.is_bare(row)
        ]
        if bare := sum(map(_types.is_bare, going)):
            work.report.lines.append(
                diff.DiffLine("-", f"# {bare} rows more without our mark, of which only the number was read")
            )
    for row in work.unmatched_rows:
        if not _is_removable(work, row) and not menu.is_stock(row):
            message = "not in the inventory, and not ours: left unchanged"
            work.report.drift.append(
                _types.Drift(menu.path, menu.name_of(row), _types.RowOwner.OTHER, message, row[".id"])
            )
