"""Drift: differences between a device and the inventory, with owner and time of origin.

It is computed from a plan, so drift is exactly what a run would change, plus what it would leave alone. Pure: the last
confirmed state and the device's history are passed as text and rows. docs/running.md explains the terms of the report.

Assumption: history-names-ids
Assumption: history-newest-first
"""

from __future__ import annotations

import re
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Any, TypeVar

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.core.secret import MASK
from atlantis_netcfg.routeros import _types, snapshot
from atlantis_netcfg.routeros.api import Command
from atlantis_netcfg.routeros.diff import added_row, existing_row
from atlantis_netcfg.routeros.menus import MARK, MENUS, Menu, PropertyKind, Shape, canonical, rank
from atlantis_netcfg.routeros.planner import as_renamed
from atlantis_netcfg.routeros.rsc import quote

if TYPE_CHECKING:
    from datetime import datetime

    from atlantis_netcfg.routeros._items import DesiredState


__all__ = [
    "HISTORY",
    "ChangeRecord",
    "Comparison",
    "Difference",
    "DriftHistory",
    "DriftKind",
    "FieldDifference",
    "Owner",
    "Past",
    "Since",
    "compare",
]


class DriftKind(StrEnum):
    """Kind of difference of one row, or of the settings of one menu."""

    MISSING = "missing"
    """Declared, but missing on the device."""
    CHANGED = "changed"
    """Declared and present, with other values."""
    ADDED = "added"
    """Present but not declared, in an exclusively managed menu: a run would remove it."""
    ORDER = "order"
    """Declared and present, at a different position of a list in which the first match decides."""
    FOREIGN = "foreign"
    """A foreign row beside ours: a run ignores it."""
    HIDDEN = "hidden"
    """Declared, but not shown by the device, so that it cannot be compared."""
    OPEN = "open"
    """Safe mode, a scheduler job or a marker that a run or a user has not closed."""


class Owner(StrEnum):
    """Owner of the row, by inventory and mark. RouterOS's own rows never count as differences."""

    DECLARED = "declared"
    FORMER = "formerly declared"
    """The row has our mark, but is no longer in the inventory."""
    TECHNICIAN = "technician"
    """No mark: somebody created it on the device."""
    RUN = "a run"
    """Armed, or set as a marker, by a run of this tool."""
    SESSION = "a session"
    """A user who is logged in, or was when the connection was lost."""


class Since(StrEnum):
    """Time of origin, relative to the last state that a run read back."""

    AFTER = "after"
    """The device was different then: somebody has changed it since."""
    ALREADY = "already"
    """The device already had this value: not the device has changed, but the inventory."""
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True)
class FieldDifference:
    """One property with desired and actual value; secrets are masked."""

    name: str
    desired_value: str
    actual_value: str


@dataclass(frozen=True, slots=True)
class ChangeRecord:
    """An entry of the device's own history: who, when and what, in its words and by its clock."""

    by: str
    at: str
    what: str


@dataclass(frozen=True, slots=True)
class Difference:
    """One difference between desired and actual state."""

    menu: str
    """Menu in console notation: `/ip firewall filter`."""
    subject: str
    kind: DriftKind
    owner: Owner
    mark: str = ""
    """The comment by which the inventory or the owner explains the row."""
    row: str = ""
    """The whole row in the device's own language, if the row is missing or superfluous."""
    fields: tuple[FieldDifference, ...] = ()
    since: Since = Since.UNKNOWN
    why_unknown: str = ""
    deed: ChangeRecord | None = None

    @property
    def counts(self) -> bool:
        """True if it is drift: comparable, and not a foreign row that a run has seen and left alone."""
        if self.kind is DriftKind.FOREIGN:
            return self.since is not Since.ALREADY
        return self.kind is not DriftKind.HIDDEN

    def as_dict(self) -> dict[str, Any]:
        """Return the difference as JSON-able data."""
        return {
            "menu": self.menu,
            "subject": self.subject,
            "kind": self.kind.value,
            "owner": self.owner.value,
            "mark": self.mark,
            "row": self.row,
            "fields": [
                {"name": field.name, "declared": field.desired_value, "found": field.actual_value}
                for field in self.fields
            ],
            "since": self.since.value,
            "why_unknown": self.why_unknown,
            "history": None
            if self.deed is None
            else {"by": self.deed.by, "at": self.deed.at, "action": self.deed.what},
            "counts": self.counts,
        }


@dataclass(frozen=True, slots=True)
class Comparison:
    """A device compared with its desired state."""

    menus: tuple[str, ...]
    """All compared menus, including those without differences."""
    differences: tuple[Difference, ...]
    run: str | None = None
    """The run that last read the device's state back; None: no such run."""
    at: datetime | None = None

    @property
    def drift(self) -> tuple[Difference, ...]:
        """The differences that count as drift."""
        return tuple(difference for difference in self.differences if difference.counts)

    def as_dict(self) -> dict[str, Any]:
        """Return the comparison as JSON-able data."""
        confirmed_run = None
        if self.run is not None and self.at is not None:
            confirmed_run = {"run": self.run, "at": self.at.isoformat(timespec="seconds")}
        return {
            "menus": list(self.menus),
            "confirmed": confirmed_run,
            "differences": [difference.as_dict() for difference in self.differences],
        }


_Values = Mapping[str, str]
_Key = Callable[[_Values], Hashable]
_T = TypeVar("_T", bound=Mapping[str, str])


@dataclass(frozen=True, slots=True)
class Raw:
    """One difference: the desired row and the actual row."""

    kind: DriftKind
    desired_row: Mapping[str, str] | None = None
    actual_row: _types.Row | None = None

    def differing(self, menu: Menu) -> tuple[str, ...]:
        """Return the properties that differ, in the order of the table."""
        desired_row, actual_row = self.desired_row, self.actual_row
        if desired_row is None or actual_row is None:
            return ()
        return tuple(
            each.name
            for each in menu.fields
            if not each.unread
            and (not each.keep or each.name in desired_row)
            and menu.form(each.name, desired_row) != menu.form(each.name, actual_row)
        )


def raw_differences(menu: Menu, actions: Iterable[_types.Action], rows: Sequence[_types.Row]) -> list[Raw]:
    """Convert the actions on one menu to differences: existing settings and rows first, then new rows.

    In a plan, a firewall rule edited by somebody is added anew and removed, so that no packet meets a half-edited rule.
    A drift report must instead show that the rule was changed, and how.
    """
    by_id = {row.get(".id", ""): row for row in rows}
    differences: list[Raw] = []
    place: dict[str, int] = {}
    missing: list[_Values] = []
    removed_rows: list[_Values] = []
    for action in actions:
        there = [by_id[each] for each in action.ids]
        if action.verb is _types.Verb.ADD:
            missing.append(dict(action.values))
        elif action.verb is _types.Verb.REMOVE:
            removed_rows += there
        elif action.verb is _types.Verb.MOVE:
            differences += [Raw(DriftKind.ORDER, row, row) for row in there]
        else:
            for row in there or [*rows[:1], {}][:1]:
                # A port gets its name by itself, and one of two that swap theirs gets it in two steps: it is one row.
                at = place.setdefault(row.get(".id", ""), len(differences))
                before = differences.pop(at).desired_row if at < len(differences) else None
                differences.insert(at, Raw(DriftKind.CHANGED, _row_after(before or row, action), row))
    differences += [
        _pair_difference(menu, desired_row, row) for desired_row, row in _pairs(menu, missing, removed_rows)
    ]
    differences += [Raw(DriftKind.MISSING, desired_row=values) for values in missing]
    return differences + [Raw(DriftKind.ADDED, actual_row=row) for row in removed_rows]


def content(menu: Menu, values: Mapping[str, str]) -> tuple[str, ...]:
    """Return the comparable content of a row: without secrets and values that the device computes."""
    fields = (each for each in menu.fields if not (each.keep or each.secret or each.unread))
    return tuple(menu.form(each.name, values) for each in fields)


def mark_of(values: Mapping[str, str]) -> str | None:
    """Return the comment of a row with our mark, which identifies its purpose; None for other rows."""
    comment = values.get("comment", "")
    return comment if comment.startswith(MARK) else None


def _row_after(row: _Values, action: _types.Action) -> dict[str, str]:
    unset = {name[1:] for name, _ in action.values if name.startswith("!")}
    remaining_values = {name: value for name, value in row.items() if name not in unset}
    return remaining_values | {name: value for name, value in action.values if not name.startswith("!")}


def _pair_difference(menu: Menu, desired_row: Mapping[str, str], row: _types.Row) -> Raw:
    raw = Raw(DriftKind.CHANGED, desired_row, row)
    return raw if raw.differing(menu) else Raw(DriftKind.ORDER, desired_row, row)


def index_unique(key: _Key, rows: Iterable[_T]) -> dict[Hashable, _T]:
    """Return the rows by key, for keys that only one row has; rows with key None are omitted."""
    groups: dict[Hashable, list[_T]] = {}
    for row in rows:
        groups.setdefault(key(row), []).append(row)
    return {value: alike[0] for value, alike in groups.items() if value is not None and len(alike) == 1}


def _pairs(menu: Menu, missing: list[_Values], removed_rows: list[_Values]) -> list[tuple[_Values, _Values]]:
    """Remove matching rows from both lists and pair them: by content, then by keys, then by our comment."""
    pairs = _take_pairs_by_key(lambda values: content(menu, values), missing, removed_rows)
    if menu.keys:
        pairs += _take_pairs_by_key(menu.identity, missing, removed_rows)
    return pairs + _take_pairs_by_key(mark_of, missing, removed_rows)


def _take_pairs_by_key(key: _Key, missing: list[_Values], removed_rows: list[_Values]) -> list[tuple[_Values, _Values]]:
    desired_by_key, there = index_unique(key, missing), index_unique(key, removed_rows)
    pairs = [(values, there[value]) for value, values in desired_by_key.items() if value in there]
    paired_ids = {id(row) for pair in pairs for row in pair}
    for rows in (missing, removed_rows):
        rows[:] = [row for row in rows if id(row) not in paired_ids]
    return pairs


HISTORY = Command("/system/history/print", ((".proplist", "action,by,time,undo,redo"),))
_VERBS = "add|set|unset|remove|move|enable|disable|comment"


@dataclass(frozen=True, slots=True)
class DriftHistory:
    """Entries of the device's history, newest first.

    `/system/history` holds the last hundred changes, and is lost on reboot. Manual, Configuration Management: each
    entry has action, by, time, and the commands that undo and redo it. An entry that does not name its row by `.id` is
    not found; then nothing is reported.
    """

    rows: Sequence[_types.Row] = ()

    def deed(self, menu: Menu, raw: Raw) -> ChangeRecord | None:
        """Return the latest entry about the row of a difference."""
        for row in self.rows:
            commands = [command for command in (row.get("undo", ""), row.get("redo", "")) if _is_about(menu, command)]
            if any(_is_about_row(menu, raw, command) for command in commands):
                return ChangeRecord(row.get("by", ""), row.get("time", ""), row.get("action", ""))
        return None


def _is_about(menu: Menu, command: str) -> bool:
    path = "[ /]".join(map(re.escape, menu.path.strip("/").split("/")))
    return re.match(rf"/{path}[ /](?:{_VERBS})\b", command) is not None


def _is_about_row(menu: Menu, raw: Raw, command: str) -> bool:
    if menu.shape is Shape.SINGLETON:
        return True
    if raw.actual_row is not None:
        return re.search(rf"{re.escape(raw.actual_row.get('.id', '*'))}(?![0-9A-Fa-f])", command) is not None
    return raw.desired_row is not None and _adds(menu, raw.desired_row, command)


def _adds(menu: Menu, values: Mapping[str, str], command: str) -> bool:
    """Return True if the command would add a row with these keys, or with this comment."""
    names = menu.keys or ("comment",)
    words = [f"{name}={quote(values[name])}" for name in names if values.get(name)]
    return " add" in command.replace("/add", " add") and bool(words) and all(word in command for word in words)


_NO_HISTORY = DriftHistory()
_UNREAD = "only their number was read; `--plan --remove-foreign` lists them"
_NEVER = "no run has confirmed a state of this device"


@dataclass(frozen=True, slots=True)
class _RowView:
    """One menu with everything needed to report on it."""

    menu: Menu
    desired_state: DesiredState
    rows: Sequence[_types.Row]
    past: Past | None
    history: DriftHistory


def compare(
    desired_state: DesiredState,
    observation: _types.Observation,
    plan: _types.Plan,
    past: Past | None = None,
    history: DriftHistory = _NO_HISTORY,
) -> Comparison:
    """Report the differences; `plan` would lead from `observation` to `desired_state`."""
    rows = as_renamed(desired_state, observation.rows)
    paths = sorted(desired_state.menus, key=rank)
    differences = [
        difference
        for path in paths
        for difference in _menu_differences(_RowView(MENUS[path], desired_state, rows[path], past, history), plan)
    ]
    titles = tuple(MENUS[path].title for path in paths)
    return Comparison(titles, tuple(differences), *(() if past is None else (past.run, past.at)))


def _menu_differences(view: _RowView, plan: _types.Plan) -> Iterator[Difference]:
    path = view.menu.path
    raws = raw_differences(view.menu, [each for each in plan.actions if each.menu == path], view.rows)
    by_id = {row.get(".id"): row for row in view.rows}
    raws += [Raw(DriftKind.FOREIGN, actual_row=by_id[each.id]) for each in plan.drift if each.menu == path]
    read = [raw for raw in raws if raw.actual_row is None or view.menu.is_ordered or not _types.is_bare(raw.actual_row)]
    yield from (_build_difference(view, raw) for raw in read)
    if unread := len(raws) - len(read):
        subject = msg(f"{arg(unread)} more rows")
        yield Difference(view.menu.title, subject, DriftKind.ADDED, Owner.TECHNICIAN, why_unknown=_UNREAD)
    for secret in plan.hidden_secrets:
        if secret.menu == path:
            yield _hidden_difference(view.menu, secret.subject, secret.name)


def _build_difference(view: _RowView, raw: Raw) -> Difference:
    menu = view.menu
    since, why = (Since.UNKNOWN, _NEVER) if view.past is None else view.past.since(menu, raw, view.rows)
    values = raw.desired_row or raw.actual_row or {}
    return Difference(
        menu=menu.title,
        subject="settings" if menu.shape is Shape.SINGLETON else menu.name_of(values),
        kind=raw.kind,
        owner=_owner(menu, raw),
        mark=values.get("comment", ""),
        row=_row(menu, raw),
        fields=tuple(_field_differences(view, raw)),
        since=since,
        why_unknown=why,
        # What was so already was not done on the device: its history can only tell of something else.
        deed=None if since is Since.ALREADY else view.history.deed(menu, raw),
    )


def _hidden_difference(menu: Menu, subject: str, name: str) -> Difference:
    fields = (FieldDifference(name, MASK, "not shown"),)
    why = "the device does not show it to our user"
    return Difference(menu.title, subject, DriftKind.HIDDEN, Owner.DECLARED, fields=fields, why_unknown=why)


def _owner(menu: Menu, raw: Raw) -> Owner:
    if raw.desired_row is not None:
        return Owner.DECLARED
    return Owner.FORMER if raw.actual_row is not None and menu.is_ours(raw.actual_row) else Owner.TECHNICIAN


def _row(menu: Menu, raw: Raw) -> str:
    if raw.actual_row is None:
        return added_row(menu, raw.desired_row or {})
    return "" if raw.desired_row is not None else existing_row(menu, raw.actual_row)


def _field_differences(view: _RowView, raw: Raw) -> Iterator[FieldDifference]:
    if raw.kind is DriftKind.ORDER:
        yield from _place(view, raw)
    desired_row, actual_row = raw.desired_row, raw.actual_row
    if desired_row is not None and actual_row is not None:
        for name in raw.differing(view.menu):
            yield FieldDifference(name, _value(view.menu, name, desired_row), _value(view.menu, name, actual_row))


def _value(menu: Menu, name: str, values: Mapping[str, str]) -> str:
    each = menu.by_name[name]
    value = values.get(name, menu.default_of(name, values)) or ""
    if each.secret:
        return MASK if value else ""
    return canonical(each.kind, value) if each.kind in (PropertyKind.BOOLEAN, PropertyKind.FLAG) else value


def _place(view: _RowView, raw: Raw) -> Iterator[FieldDifference]:
    """Yield the row's desired and actual position in its list; dynamic rows do not count."""
    menu, row = view.menu, raw.actual_row or {}
    desired_contents = [
        content(menu, item.defined_values)
        for item in view.desired_state.items[menu.path]
        if _same_chain(menu, item.defined_values, row)
    ]
    there = [each for each in view.rows if menu.is_touchable(each) and _same_chain(menu, each, row)]
    local = content(menu, row)
    if local in desired_contents:
        actual_place = next((place for place, each in enumerate(there, 1) if each.get(".id") == row.get(".id")), 0)
        yield FieldDifference("place", str(desired_contents.index(local) + 1), str(actual_place))


def _same_chain(menu: Menu, row: Mapping[str, str], other: Mapping[str, str]) -> bool:
    return not menu.chain or menu.form(menu.chain, row) == menu.form(menu.chain, other)


_Verdict = tuple[Since, str]
_NO_SECRETS = (Since.UNKNOWN, "a confirmed state contains no secrets")


@dataclass(frozen=True, slots=True)
class _RowIndex:
    """Index of the rows of one menu: by keys (by content if it has none), and by our comment."""

    by_self: Mapping[tuple[str, ...], Mapping[str, str]]
    by_mark: Mapping[Hashable, Mapping[str, str]]

    @classmethod
    def of(cls, menu: Menu, rows: Sequence[Mapping[str, str]]) -> _RowIndex:
        key = menu.identity if menu.keys else lambda values: content(menu, values)
        return cls({key(row): row for row in reversed(rows)}, index_unique(mark_of, rows))


@dataclass(frozen=True, slots=True)
class Past:
    """The last confirmed state of a device."""

    run: str
    at: datetime
    rows: Mapping[str, tuple[Mapping[str, str], ...]]
    """Rows by menu; only values that differ from the default."""
    indices: dict[str, _RowIndex] = field(default_factory=dict)
    """Row indices by menu, created on first use."""

    @classmethod
    def read(cls, run: str, at: datetime, text: str) -> Past:
        """Parse the text written by `snapshot.write`. Raises RscError."""
        state = snapshot.read(text, msg(f"the state that run {arg(run)} confirmed"))
        return cls(run, at, {path: tuple(item.defined_values for item in items) for path, items in state.items.items()})

    def since(self, menu: Menu, raw: Raw, rows: Sequence[_types.Row]) -> _Verdict:
        """Return when a difference arose, or why that is unknown; `rows` are the menu's current rows."""
        if menu.path not in self.rows:
            return Since.UNKNOWN, msg(f"run {arg(self.run)} did not read this menu")
        if raw.kind is DriftKind.ORDER and raw.actual_row is not None:
            return self._order(menu, raw.actual_row, rows)
        if raw.actual_row is None:
            there = raw.desired_row is not None and self._then(menu, raw.desired_row) is not None
            return (Since.AFTER if there else Since.ALREADY), ""
        then = self._then(menu, raw.actual_row)
        if then is None:
            return Since.AFTER, ""
        if raw.kind is DriftKind.CHANGED:
            return _date_change(menu, raw, then)
        return (Since.ALREADY if content(menu, then) == content(menu, raw.actual_row) else Since.AFTER), ""

    def _then(self, menu: Menu, values: Mapping[str, str]) -> Mapping[str, str] | None:
        """Return the earlier row; settings always exist, and system rows also at their defaults."""
        there = self.rows[menu.path]
        if menu.shape is Shape.SINGLETON:
            return there[0] if there else {}
        if menu.path not in self.indices:
            self.indices[menu.path] = _RowIndex.of(menu, there)
        index = self.indices[menu.path]
        match = index.by_self.get(menu.identity(values) if menu.keys else content(menu, values))
        if match is None and menu.keys and (menu.shape is Shape.FIXED or menu.is_stock(values)):
            return {key: values[key] for key in menu.keys if key in values}
        return match if match is not None else index.by_mark.get(mark_of(values))

    def _order(self, menu: Menu, actual_row: _types.Row, rows: Sequence[_types.Row]) -> _Verdict:
        """Compare the earlier and the current order of the rows in the row's list."""
        chain = menu.form(menu.chain, actual_row) if menu.chain else ""
        then = _chain_contents(menu, self.rows[menu.path], chain)
        now = _chain_contents(menu, [row for row in rows if menu.is_touchable(row)], chain)
        both = set(then) & set(now)
        same = [entry for entry in then if entry in both] == [item for item in now if item in both]
        return (Since.ALREADY if same else Since.AFTER), ""


def _date_change(menu: Menu, raw: Raw, then: Mapping[str, str]) -> _Verdict:
    names = [name for name in raw.differing(menu) if not menu.by_name[name].secret]
    if not names:
        return _NO_SECRETS
    names = [name for name in names if (menu.path, name) not in snapshot.OF_THE_BOX]
    if not names:
        return Since.UNKNOWN, "a confirmed state omits the values that a device sets itself"
    actual_row = raw.actual_row or {}
    same = all(menu.form(name, actual_row) == menu.form(name, then) for name in names)
    return (Since.ALREADY if same else Since.AFTER), ""


def _chain_contents(menu: Menu, rows: Iterable[Mapping[str, str]], chain: str) -> list[tuple[str, ...]]:
    return [content(menu, row) for row in rows if not menu.chain or menu.form(menu.chain, row) == chain]
