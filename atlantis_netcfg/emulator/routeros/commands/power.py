"""`/interface/ethernet/poe/monitor`: what each port that can feed gives (Manual, PoE-Out)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.answers import Trap
from atlantis_netcfg.emulator.routeros.commands._call import Call, MissingArgument, Result, no_such_item, unknown
from atlantis_netcfg.emulator.routeros.environment._spec import load_of
from atlantis_netcfg.emulator.routeros.values import id_text

if TYPE_CHECKING:
    from atlantis_netcfg.emulator.routeros.core import Core
    from atlantis_netcfg.emulator.routeros.store import Item

__all__ = ["monitor"]

_SELECTORS = ("numbers", ".id")


def monitor(core: Core, call: Call) -> Result:
    """`monitor <ports> once`; without `once` it would not end."""
    known = core.schema.arguments(call.menu, call.command) | {*_SELECTORS, ".proplist"}
    for name in call.arguments:
        if name not in known:
            raise unknown(name)
    named = next((call.arguments[name] for name in _SELECTORS if name in call.arguments), None)
    if named is None:
        raise MissingArgument("numbers")
    if "once" not in call.arguments:
        raise Trap(f"not rehearsed by the twin: {call.path} without once")
    return Result(rows=[_row(core, _port(core, part)) for part in named.split(",")])


def _port(core: Core, named: str) -> Item:
    """The port of that name or id, if it can feed."""
    table = core.store.table("/interface/ethernet")
    for item in table.items:
        feeds = (item.factory or {}).get("name") in core.spec.poe_ports
        if feeds and named in {id_text(item.id), core.store.text(table, item, "name")}:
            return item
    raise no_such_item()


def _row(core: Core, item: Item) -> dict[str, str]:
    table = core.store.table("/interface/ethernet")
    setting = core.store.text(table, item, "poe-out") or "auto-on"
    local = {"name": core.store.text(table, item, "name") or "", "poe-out": setting}
    return local | load_of(core, (item.factory or {})["name"], setting)
