"""The planner: actions from the current rows to the desired state; a pure function without I/O.

Port names come first, so that every later row refers to the intended ports. Additions and changes go layer by layer, so
that a row only refers to existing rows; removals come last, in the opposite order. `simulate` returns the rows after a
plan: planning again from them gives no actions.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.core.versions import NEWEST_KNOWN, Version
from atlantis_netcfg.routeros import _types
from atlantis_netcfg.routeros.diff import render, set_lines
from atlantis_netcfg.routeros.menus import MENUS, Shape, rank
from atlantis_netcfg.routeros.pin import sim_of
from atlantis_netcfg.routeros.planner._change import CannotPlan, Context, MenuChange, MenuPlan, Names
from atlantis_netcfg.routeros.planner._firstmatch import plan_first_match
from atlantis_netcfg.routeros.planner._identified import plan_identified
from atlantis_netcfg.routeros.planner._rename import (
    Rename,
    after,
    conflicts,
    is_named_port,
    rename_changes,
    rename_rows,
    renames,
    simulate,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from atlantis_netcfg.routeros._items import DesiredState, RowItem

__all__ = ["CannotPlan", "after", "as_renamed", "newer_than_known", "plan", "rename_rows", "simulate"]


def plan(device: str, desired_state: DesiredState, observation: _types.Observation) -> _types.Plan:
    """Return the actions that lead to the desired state, with their diff and other findings.

    Raises CannotPlan, with all reasons and lines of the text, if the device lacks what the text needs, and KeyError for
    a menu of the text that was not read.
    """
    menus = sorted(desired_state.menus, key=rank)
    facts = observation.facts
    lacking = [each for path in menus for each in _find_unsupported(path, desired_state, facts.version)]
    port_renames = renames(desired_state, observation.rows)
    problems = [*(problem for problem, _ in lacking), *conflicts(port_renames, observation.rows)]
    rows = as_renamed(desired_state, observation.rows)
    # Until it is known what our user may read, a secret that reads as empty counts as one: then it will be asked.
    policies = observation.facts.policies
    sensitive = policies is None or "sensitive" in policies
    context = Context(desired_state, Names(observation.rows), sensitive, sim_of(observation.modem))
    parts = [_plan_menu(path, desired_state, rows[path], context) for path in menus]
    for part in parts:
        _take_names_out(part, port_renames)
        problems += part.problems
    if problems:
        message = join(
            "\n", (msg(f"{arg(device)}: {arg(desired_state.source)}, {arg(problem)}") for problem in problems)
        )
        raise CannotPlan(message, hint=_other_version([since for _, since in lacking], facts))
    changed_menus = {part.menu.path for part in parts if part.changes}
    remarks = [remark for path, remark in desired_state.remarks if path in changed_menus]
    result = _types.Plan(
        device=device,
        actions=tuple(_number_actions([*rename_changes(port_renames, observation), *_sort_changes(parts)])),
        diff=render((part.menu, part.lines) for part in parts),
        drift=tuple(drift for part in parts for drift in part.drift),
        hidden_secrets=tuple(secret for part in parts for secret in part.hidden_secrets),
        foreign=tuple((part.menu.title, part.foreign) for part in parts if part.foreign),
        notes=(
            *newer_than_known(observation.facts.version),
            *desired_state.notes,
            *remarks,
            *dict.fromkeys(note for part in parts for note in part.notes),
        ),
    )
    words = result.foreign_words
    return replace(result, notes=(*result.notes, f"the plan {words}")) if words else result


def newer_than_known(version: Version) -> Iterator[str]:
    """Yield a note if the version is newer than the newest one tested."""
    if version > NEWEST_KNOWN:
        yield msg(
            f"RouterOS {arg(version)} is newer than the newest known version, {arg(NEWEST_KNOWN)}: later changes have "
            "not been reviewed"
        )


def as_renamed(
    desired_state: DesiredState, rows: Mapping[str, tuple[_types.Row, ...]]
) -> dict[str, tuple[_types.Row, ...]]:
    """Return the rows of the desired menus as after the port renames."""
    names = {each.old: each.name for each in renames(desired_state, rows)}
    return {path: rename_rows(path, rows[path], names) for path in desired_state.menus}


def _find_unsupported(path: str, desired_state: DesiredState, version: Version) -> Iterator[tuple[str, Version | None]]:
    """Yield what this version lacks, and the first version that has it; None if only older ones have it."""
    menu = MENUS[path]
    if menu.since is not None and version < menu.since:
        yield (
            msg(f"{arg(menu.title)} needs RouterOS {arg(menu.since)} or later, but this device has {arg(version)}"),
            menu.since,
        )
    for item in desired_state.items[path]:
        for name in item.values:
            field = menu.by_name[name]
            if field.since is not None and version < field.since:
                yield _version_problem(item, name, msg(f"from RouterOS {arg(field.since)} on"), version), field.since
            elif not field.exists(version):
                yield _version_problem(item, name, msg(f"only before RouterOS {arg(field.until)}"), version), None


def _version_problem(item: RowItem, name: str, when: str, version: Version) -> str:
    return msg(
        f"line {arg(item.line)}: {arg(MENUS[item.menu].title)} has `{arg(name)}` {arg(when)}, but this device has "
        f"{arg(version)}"
    )


def _other_version(lacking: Sequence[Version | None], facts: _types.Facts) -> str | None:
    """Return the remedy for unsupported items; None if nothing is missing."""
    if not lacking:
        return None
    newer = [version for version in lacking if version is not None]
    if len(newer) < len(lacking):
        return "remove what RouterOS no longer has from the named lines of the text"
    return msg(f"{arg(facts.upgrade(max(newer)))}; or remove the named lines from the text")


def _plan_menu(path: str, desired_state: DesiredState, rows: tuple[_types.Row, ...], context: Context) -> MenuPlan:
    menu = MENUS[path]
    items = desired_state.items[path]
    if menu.is_ordered:
        return plan_first_match(menu, items, rows, context)
    if menu.shape is Shape.SINGLETON and not rows:
        rows = ({},)
    return plan_identified(menu, items, rows, context)


def _take_names_out(part: MenuPlan, port_renames: list[Rename]) -> None:
    """Leave port names to their own layer, and note which port only gives up its name."""
    if not is_named_port(part.menu):
        return
    shown_ids = {row_id for each in part.changes if "name" in dict(each.values) for row_id in each.ids}
    shorter = [replace(each, values=tuple(pair for pair in each.values if pair[0] != "name")) for each in part.changes]
    part.changes = [each for each in shorter if each.values]
    for each in port_renames:
        if each.menu is part.menu and each.row[".id"] not in shown_ids:
            part.lines += set_lines(each.menu, each.row, (("name", each.name),))
        if each.menu is part.menu and each.in_the_way:
            port = each.menu.name_of(each.row)
            part.notes.append(
                msg(
                    f"{arg(each.menu.title)}: {arg(port)} has the name {arg(each.old)} of another port, and gets its "
                    "own back"
                )
            )


def _sort_changes(parts: list[MenuPlan]) -> list[MenuChange]:
    return sorted((change for part in parts for change in part.changes), key=_turn)


def _number_actions(changes: Iterable[MenuChange]) -> Iterator[_types.Action]:
    for number, change in enumerate(changes, start=1):
        yield _types.Action(
            number=number,
            layer=change.layer,
            menu=change.menu.path,
            verb=change.verb,
            subject=change.subject,
            ids=change.ids,
            values=change.values,
            before=change.before,
            secrets=change.menu.secrets & {name for name, _ in change.values},
            inert=change.inert,
            line=change.line,
        )


def _turn(change: MenuChange) -> tuple[int, int, int, int]:
    """Return the sort key: layer, then menu in table order; removals last, in reverse order."""
    place = rank(change.menu.path)
    if change.verb is _types.Verb.REMOVE and change.layer is _types.Layer.CLEANUP:
        return (_types.Layer.CLEANUP, 1, -change.menu.layer, -place)
    return (change.layer, 0, 0, place)
