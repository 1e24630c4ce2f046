"""print, getall, get, find: what a menu shows (Manual, API; Manual, Console)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.twin.answers import Category, Trap
from atlantis_netcfg.twin.commands._call import MissingArgument, Result, no_such_item, unknown
from atlantis_netcfg.twin.commands._computed import COMPUTED
from atlantis_netcfg.twin.commands.radio import amounting
from atlantis_netcfg.twin.console.where import Where, fits
from atlantis_netcfg.twin.menus import Shape
from atlantis_netcfg.twin.query import matches
from atlantis_netcfg.twin.views import rows, without_counters

if TYPE_CHECKING:
    from atlantis_netcfg.twin.commands._call import Call
    from atlantis_netcfg.twin.core import Core

__all__ = ["all_rows", "find", "get", "print_", "select"]

_GOING_ON = ("follow", "follow-only", "interval")
_PROPLIST = (".proplist", "proplist")
_ANY = {
    *_PROPLIST,
    "detail",
    "stats",
    "count-only",
    "without-paging",
    "terse",
    "brief",
    "value-list",
    "show-ids",
    "as-value",
    "config",
}


def all_rows(core: Core, call: Call) -> list[dict[str, str]]:
    """Return the rows of the call's menu, as this session may see them."""
    if call.menu in COMPUTED:
        return COMPUTED[call.menu](core, call)
    found = rows(core, call.menu, sensitive="sensitive" in core.policies(call.caller))
    return found if "config" in call.arguments else amounting(core, call.menu, found)


def print_(core: Core, call: Call) -> Result:
    """Show the rows that the queries let through."""
    known = core.schema.arguments(call.menu, "print") | {".proplist"}
    for name in (*call.arguments, *call.unset):
        if name not in known and not (name in ("stats", "detail") and call.menu in COMPUTED):
            raise unknown(name)
        if name not in _ANY:
            raise Trap(f"not rehearsed by the twin: {call.path} {name}")
    found = [row for row in all_rows(core, call) if matches(call.queries, row)]
    if "count-only" in call.arguments:
        return Result(ret=str(len(found)))
    wanted = _proplist(call)
    if wanted is None and "stats" not in call.arguments:
        found = [without_counters(row) for row in found]
    elif wanted is not None:
        found = [{name: row[name] for name in wanted if name in row} for row in found]
    return Result(rows=found, listing=True)


def _proplist(call: Call) -> list[str] | None:
    for name in _PROPLIST:
        if name in call.arguments:
            return list(dict.fromkeys(call.arguments[name].split(",")))
    return None


def select(core: Core, call: Call, where: Where) -> list[str]:
    """Return the ids of the rows that `[find ...]` means."""
    return [row[".id"] for row in all_rows(core, call) if ".id" in row and fits(row, where)]


def find(core: Core, call: Call) -> Result:
    """Return all ids of the menu, joined by `;`."""
    for name in call.arguments:
        if name not in core.schema.arguments(call.menu, "find"):
            raise unknown(name)
        raise Trap(f"not rehearsed by the twin: {call.path} {name}")
    return Result(ret=";".join(row[".id"] for row in all_rows(core, call) if ".id" in row))


def get(core: Core, call: Call) -> Result:
    """Return one property of one row, or the whole row as `name=value;...`."""
    known = core.schema.arguments(call.menu, "get") | {".id", "numbers"}
    for name in call.arguments:
        if name not in known:
            raise unknown(name)
    row = _one(core, call)
    wanted = call.arguments.get("value-name")
    if wanted is None:
        return Result(ret=";".join(f"{key}={value}" for key, value in row.items()))
    if wanted not in row and (call.menu in COMPUTED or wanted not in core.store.table(call.menu).args):
        raise Trap("input does not match any value of value-name", Category.ARGUMENT)
    return Result(ret=row.get(wanted, ""))


def _one(core: Core, call: Call) -> dict[str, str]:
    found = all_rows(core, call)
    number = call.arguments.get(".id") or call.arguments.get("number") or call.arguments.get("numbers")
    if not any(".id" in row for row in found) and _is_settings(core, call.menu):
        return found[0]
    if number is None:
        raise MissingArgument(".id" if not call.console else "number")
    called = core.store.table(call.menu).menu.called if call.menu not in COMPUTED else "name"
    for row in found:
        if number in (row.get(".id"), row.get(called)):
            return row
    raise no_such_item()


def _is_settings(core: Core, menu: str) -> bool:
    return menu in COMPUTED or core.store.table(menu).menu.shape is Shape.SETTINGS
