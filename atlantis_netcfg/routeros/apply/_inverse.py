"""The rollback script that the device runs alone: however much of a plan was done, it restores the rows.

It is computed from observation and plan before anything is sent. Every line is independent and may fail (the row was
never added, the value never changed). A row that the plan adds is removed by a condition that distinguishes it from
every earlier row. A row that it removes is added again if its id is gone. If a first-match menu was reordered, each row
is moved to the end in the old order (manual, Console: `move` without a destination moves to the end).

Paths are written with spaces, which versions 6 and 7 both accept.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import DeviceError
from atlantis_netcfg.routeros import _types, planner
from atlantis_netcfg.routeros.apply._state import restore_target
from atlantis_netcfg.routeros.commands import console
from atlantis_netcfg.routeros.menus import MENUS, Menu
from atlantis_netcfg.routeros.rsc import quote

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence


LIMIT = 60_000
"""Maximum bytes. A script of `/execute` takes 64 kB. Assumption: on-event-60k"""

_FIRST = ("comment", "name", "chain", "action")
"""Properties tried first to distinguish rows."""


class CannotInvert(DeviceError):
    """No script can undo this plan."""


def inverse(observation: _types.Observation, aim: _types.Plan, *, with_secrets: bool = False) -> str:
    """Return a script that undoes any part of `aim`, given the state in `observation`. Raises CannotInvert.

    `with_secrets`: secrets in clear text, as in the rows. The far end of a bridge needs them: a key that stays new at
    one end only would keep the link down.
    """
    then = _types.Observation(observation.facts, planner.simulate(observation.rows, aim))
    try:
        back = planner.plan(aim.device, restore_target(observation), then).actions
    except planner.CannotPlan as problem:
        raise CannotInvert(f"the way back cannot be planned: {problem}") from problem
    # Names of ports go back first, so that every line below speaks of them as they were.
    then = _types.Observation(
        observation.facts, planner.after(then.rows, [each for each in back if each.layer is _types.Layer.NAMES])
    )
    back = tuple(each for each in back if each.layer is not _types.Layer.NAMES)
    changes = _changes(back, observation, then, with_secrets=with_secrets)
    lines = [*_names(aim.actions, observation), *changes, *_restore_order(back, aim.actions, observation, then)]
    text = "".join(f"{line}\n" for line in lines)
    if len(text.encode("utf-8", "surrogateescape")) > LIMIT:
        raise CannotInvert("the way back is too long for one script")
    return text


def _names(forth: Sequence[_types.Action], observation: _types.Observation) -> list[str]:
    """Yield lines that restore port names step by step: after a swap of two names, one passed through a third name."""
    lines: list[str] = []
    rows = observation.rows
    for action in (each for each in forth if each.layer is _types.Layer.NAMES):
        names = [row["name"] for row in rows[action.menu] if row.get(".id") in action.ids]
        lines[:0] = [
            _ignore_errors(f"{MENUS[action.menu].title} set {row_id} name={quote(name)}")
            for row_id, name in zip(action.ids, names, strict=True)
        ]
        rows = planner.after(rows, (action,))
    return lines


def _changes(
    back: Sequence[_types.Action], observation: _types.Observation, then: _types.Observation, *, with_secrets: bool
) -> Iterator[str]:
    removed_rows = {
        path: [row for row in rows if row.get(".id", "") not in _ids(then.rows[path])]
        for path, rows in observation.rows.items()
    }
    for action in back:
        secrets = [value for name, value in action.values if name in action.secrets and value]
        if secrets and not with_secrets:
            raise CannotInvert("the way back would hold a password in clear")
        if not all(secret.strip("*") for secret in secrets):
            raise CannotInvert(f"a secret of {action.subject} cannot be read, and so not written back")
        if action.verb is _types.Verb.REMOVE:
            yield from (_render_removal(action, row_id, observation, then) for row_id in action.ids)
        elif action.verb is _types.Verb.ADD:
            yield _added_again(
                action, removed_rows[action.menu], (*observation.rows[action.menu], *then.rows[action.menu])
            )
        elif action.verb is _types.Verb.SET:
            yield _ignore_errors(_console_line(action))


def _ids(rows: Sequence[_types.Row]) -> frozenset[str]:
    return frozenset(row.get(".id", "") for row in rows)


def _render_removal(
    action: _types.Action, row_id: str, observation: _types.Observation, then: _types.Observation
) -> str:
    menu = MENUS[action.menu]
    row = next(each for each in then.rows[action.menu] if each[".id"] == row_id)
    condition = _condition(menu, row, observation.rows.get(action.menu, ()))
    return _ignore_errors(f"{menu.title} remove [find {condition}]")


def _added_again(action: _types.Action, removed_rows: list[_types.Row], known_rows: Sequence[_types.Row]) -> str:
    """Return the line that adds a removed row again, unless it still exists or exists again."""
    menu, values = MENUS[action.menu], dict(action.values)
    removed_row = next(
        row for row in removed_rows if all(menu.form(name, row) == menu.form(name, values) for name in values)
    )
    removed_rows.remove(removed_row)
    adding = _ignore_errors(_console_line(replace(action, before=None)))
    with suppress(CannotInvert):
        again = _condition(menu, removed_row, [row for row in known_rows if row is not removed_row])
        adding = f":do {{ {menu.title} get [find {again}] comment }} on-error={{ {adding} }}"
    return f":do {{ {menu.title} get {removed_row['.id']} comment }} on-error={{ {adding} }}"


def _restore_order(
    back: Sequence[_types.Action],
    forth: Sequence[_types.Action],
    observation: _types.Observation,
    then: _types.Observation,
) -> Iterator[str]:
    """Yield lines that restore the row order of each reordered first-match menu."""
    reordered_menus = {action.menu for action in back if action.verb in (_types.Verb.ADD, _types.Verb.MOVE)}
    reordered_menus |= {action.menu for action in forth if action.verb is _types.Verb.MOVE}
    for path in sorted(path for path in reordered_menus if MENUS[path].is_ordered):
        menu = MENUS[path]
        rows = [row for row in observation.rows[path] if menu.is_touchable(row)]
        present_ids = _ids(then.rows[path])
        for row in rows:
            others = [each for each in rows if each is not row]
            which = row[".id"] if row[".id"] in present_ids else f"[find {_condition(menu, row, others)}]"
            yield _ignore_errors(f"{menu.title} move {which}")


def _condition(menu: Menu, row: _types.Row, others: Sequence[_types.Row]) -> str:
    """Return the shortest condition that matches this row and none of the others. Raises CannotInvert."""
    readable = [each.name for each in menu.fields if not each.unread and not each.secret and row.get(each.name)]
    rivals = [other for other in others if menu.is_touchable(other)]
    chosen_names: list[str] = []
    for name in (name for name in dict.fromkeys((*_FIRST, *menu.keys, *readable)) if name in readable):
        remaining_rivals = [other for other in rivals if menu.form(name, other) == menu.form(name, row)]
        if not chosen_names or len(remaining_rivals) < len(rivals):
            chosen_names.append(name)
            rivals = remaining_rivals
        if not rivals:
            return " ".join(f"{each}={_quote_operand(row[each])}" for each in chosen_names)
    raise CannotInvert(f"{menu.name_of(row)} in {menu.title} cannot be told from a row that is there already")


def _quote_operand(value: str) -> str:
    """Quote a value that would be parsed as an address or a time, and so never be equal to a text."""
    text = quote(value)
    return f'"{text}"' if text == value and set("/:") & set(value) else text


def _console_line(action: _types.Action) -> str:
    menu = MENUS[action.menu]
    return f"{menu.title} {console(action).removeprefix(f'{action.menu}/')}"


def _ignore_errors(line: str) -> str:
    return f":do {{ {line} }} on-error={{}}"
