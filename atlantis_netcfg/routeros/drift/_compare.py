"""From a plan to what differs: one entry a row, in the words of a person."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.core.secret import MASK
from atlantis_netcfg.routeros._types import is_bare
from atlantis_netcfg.routeros.diff import added_row, existing_row
from atlantis_netcfg.routeros.drift._history import History
from atlantis_netcfg.routeros.drift._model import Comparison, Difference, DriftKind, FieldDifference, Owner, Since
from atlantis_netcfg.routeros.drift._raw import Raw, content, raw_differences
from atlantis_netcfg.routeros.menus import MENUS, Kind, Menu, Shape, canonical, rank
from atlantis_netcfg.routeros.planner import as_renamed

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from atlantis_netcfg.routeros._items import Desired
    from atlantis_netcfg.routeros._types import Observed, Plan, Row
    from atlantis_netcfg.routeros.drift._past import Past

__all__ = ["compare"]

_NO_HISTORY = History()
_UNREAD = "over a metered link only their number is read"
_NEVER = "no run has confirmed a state of this device"


@dataclass(frozen=True, slots=True)
class _View:
    """One menu, and everything that can be said about it."""

    menu: Menu
    desired: Desired
    rows: Sequence[Row]
    past: Past | None
    history: History


def compare(
    desired: Desired, observed: Observed, plan: Plan, past: Past | None = None, history: History = _NO_HISTORY
) -> Comparison:
    """Say what differs; `plan` is what would make `observed` as `desired`."""
    rows = as_renamed(desired, observed.rows)
    paths = sorted(desired.menus, key=rank)
    differences = [
        difference
        for path in paths
        for difference in _of_menu(_View(MENUS[path], desired, rows[path], past, history), plan)
    ]
    titles = tuple(MENUS[path].title for path in paths)
    return Comparison(titles, tuple(differences), *(() if past is None else (past.run, past.at)))


def _of_menu(view: _View, plan: Plan) -> Iterator[Difference]:
    path = view.menu.path
    raws = raw_differences(view.menu, [each for each in plan.actions if each.menu == path], view.rows)
    by_id = {row.get(".id"): row for row in view.rows}
    raws += [Raw(DriftKind.FOREIGN, found=by_id[each.id]) for each in plan.drift if each.menu == path]
    read = [raw for raw in raws if raw.found is None or view.menu.ordered or not is_bare(raw.found)]
    yield from (_told(view, raw) for raw in read)
    if unread := len(raws) - len(read):
        subject = f"{unread} rows more"
        yield Difference(view.menu.title, subject, DriftKind.ADDED, Owner.TECHNICIAN, why_unknown=_UNREAD)
    for hidden in plan.hidden:
        if hidden.menu == path:
            yield _hidden(view.menu, hidden.subject, hidden.name)


def _told(view: _View, raw: Raw) -> Difference:
    menu = view.menu
    since, why = (Since.UNKNOWN, _NEVER) if view.past is None else view.past.since(menu, raw, view.rows)
    values = raw.declared or raw.found or {}
    return Difference(
        menu=menu.title,
        subject="settings" if menu.shape is Shape.SINGLETON else menu.name_of(values),
        kind=raw.kind,
        owner=_owner(menu, raw),
        mark=values.get("comment", ""),
        row=_row(menu, raw),
        fields=tuple(_fields(view, raw)),
        since=since,
        why_unknown=why,
        # What was so already was not done on the device: its history can only tell of something else.
        deed=None if since is Since.ALREADY else view.history.deed(menu, raw),
    )


def _hidden(menu: Menu, subject: str, name: str) -> Difference:
    fields = (FieldDifference(name, MASK, "not shown"),)
    why = "the device does not show it to our user"
    return Difference(menu.title, subject, DriftKind.HIDDEN, Owner.DECLARED, fields=fields, why_unknown=why)


def _owner(menu: Menu, raw: Raw) -> Owner:
    if raw.declared is not None:
        return Owner.DECLARED
    return Owner.FORMER if raw.found is not None and menu.is_ours(raw.found) else Owner.TECHNICIAN


def _row(menu: Menu, raw: Raw) -> str:
    if raw.found is None:
        return added_row(menu, raw.declared or {})
    return "" if raw.declared is not None else existing_row(menu, raw.found)


def _fields(view: _View, raw: Raw) -> Iterator[FieldDifference]:
    if raw.kind is DriftKind.ORDER:
        yield from _place(view, raw)
    declared, found = raw.declared, raw.found
    if declared is not None and found is not None:
        for name in raw.differing(view.menu):
            yield FieldDifference(name, _value(view.menu, name, declared), _value(view.menu, name, found))


def _value(menu: Menu, name: str, values: Mapping[str, str]) -> str:
    each = menu.by_name[name]
    value = values.get(name, menu.default_of(name, values)) or ""
    if each.secret:
        return MASK if value else ""
    return canonical(each.kind, value) if each.kind in (Kind.BOOLEAN, Kind.FLAG) else value


def _place(view: _View, raw: Raw) -> Iterator[FieldDifference]:
    """Yield which place of its list the row has; dynamic rows do not count."""
    menu, row = view.menu, raw.found or {}
    desired = [
        content(menu, item.given) for item in view.desired.items[menu.path] if _same_chain(menu, item.given, row)
    ]
    there = [each for each in view.rows if menu.is_touchable(each) and _same_chain(menu, each, row)]
    local = content(menu, row)
    if local in desired:
        found = next((place for place, each in enumerate(there, 1) if each.get(".id") == row.get(".id")), 0)
        yield FieldDifference("place", str(desired.index(local) + 1), str(found))


def _same_chain(menu: Menu, row: Mapping[str, str], other: Mapping[str, str]) -> bool:
    return not menu.chain or menu.form(menu.chain, row) == menu.form(menu.chain, other)
