"""The differences of one menu as rows: what a plan would add, set, move and remove, with what belongs together paired.

A plan is made to be carried out: a rule of the firewall that somebody has edited is added anew and removed, since no
packet may meet a half of it. Whoever reads about drift wants to hear that it was changed, and how.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

from atlantis_netcfg.routeros._types import Verb
from atlantis_netcfg.routeros.drift._model import DriftKind
from atlantis_netcfg.routeros.menus import MARK

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from atlantis_netcfg.routeros._types import Action, Row
    from atlantis_netcfg.routeros.menus import Menu

_Values = Mapping[str, str]
_Key = Callable[[_Values], Hashable]
_T = TypeVar("_T", bound=Mapping[str, str])


@dataclass(frozen=True, slots=True)
class Raw:
    """One difference: the row as it shall be, and as it is."""

    kind: DriftKind
    declared: Mapping[str, str] | None = None
    found: Row | None = None

    def differing(self, menu: Menu) -> tuple[str, ...]:
        """Return the properties that differ, in the order of the table."""
        declared, found = self.declared, self.found
        if declared is None or found is None:
            return ()
        return tuple(
            each.name
            for each in menu.fields
            if not each.unread
            and (not each.keep or each.name in declared)
            and menu.form(each.name, declared) != menu.form(each.name, found)
        )


def raw_differences(menu: Menu, actions: Iterable[Action], rows: Sequence[Row]) -> list[Raw]:
    """Turn the actions on one menu into differences, in the order: settings and rows as they are, then what is new."""
    by_id = {row.get(".id", ""): row for row in rows}
    found: list[Raw] = []
    place: dict[str, int] = {}
    missing: list[_Values] = []
    gone: list[_Values] = []
    for action in actions:
        there = [by_id[each] for each in action.ids]
        if action.verb is Verb.ADD:
            missing.append(dict(action.values))
        elif action.verb is Verb.REMOVE:
            gone += there
        elif action.verb is Verb.MOVE:
            found += [Raw(DriftKind.ORDER, row, row) for row in there]
        else:
            for row in there or [*rows[:1], {}][:1]:
                # A port gets its name by itself, and one of two that swap theirs gets it in two steps: it is one row.
                at = place.setdefault(row.get(".id", ""), len(found))
                before = found.pop(at).declared if at < len(found) else None
                found.insert(at, Raw(DriftKind.CHANGED, _after(before or row, action), row))
    found += [_together(menu, declared, row) for declared, row in _pairs(menu, missing, gone)]
    found += [Raw(DriftKind.MISSING, declared=values) for values in missing]
    return found + [Raw(DriftKind.ADDED, found=row) for row in gone]


def content(menu: Menu, values: Mapping[str, str]) -> tuple[str, ...]:
    """Return all of a row that can be compared between readings: nothing secret, nothing that the device computes."""
    fields = (each for each in menu.fields if not (each.keep or each.secret or each.unread))
    return tuple(menu.form(each.name, values) for each in fields)


def marked(values: Mapping[str, str]) -> str | None:
    """Return the comment of a row that carries our mark; it tells what the row is for, whatever else has changed."""
    comment = values.get("comment", "")
    return comment if comment.startswith(MARK) else None


def _after(row: _Values, action: Action) -> dict[str, str]:
    unset = {name[1:] for name, _ in action.values if name.startswith("!")}
    kept = {name: value for name, value in row.items() if name not in unset}
    return kept | {name: value for name, value in action.values if not name.startswith("!")}


def _together(menu: Menu, declared: Mapping[str, str], row: Row) -> Raw:
    raw = Raw(DriftKind.CHANGED, declared, row)
    return raw if raw.differing(menu) else Raw(DriftKind.ORDER, declared, row)


def alone(key: _Key, rows: Iterable[_T]) -> dict[Hashable, _T]:
    """Return the rows by a key, where it stands for one row only; None stands for none."""
    found: dict[Hashable, list[_T]] = {}
    for row in rows:
        found.setdefault(key(row), []).append(row)
    return {value: alike[0] for value, alike in found.items() if value is not None and len(alike) == 1}


def _pairs(menu: Menu, missing: list[_Values], gone: list[_Values]) -> list[tuple[_Values, _Values]]:
    """Take out of both lists what is one row: by its whole content, by its keys, then by our own words about it."""
    pairs = _paired_by(lambda values: content(menu, values), missing, gone)
    if menu.keys:
        pairs += _paired_by(menu.identity, missing, gone)
    return pairs + _paired_by(marked, missing, gone)


def _paired_by(key: _Key, missing: list[_Values], gone: list[_Values]) -> list[tuple[_Values, _Values]]:
    desired, there = alone(key, missing), alone(key, gone)
    pairs = [(values, there[value]) for value, values in desired.items() if value in there]
    taken = {id(row) for pair in pairs for row in pair}
    for rows in (missing, gone):
        rows[:] = [row for row in rows if id(row) not in taken]
    return pairs
