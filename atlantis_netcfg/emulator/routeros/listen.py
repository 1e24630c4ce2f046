"""`/menu/listen`: rows that change, as they change (Manual, API: Command examples)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.answers import Answer, Category, Trap
from atlantis_netcfg.emulator.routeros.commands.read import all_rows
from atlantis_netcfg.emulator.routeros.core import Listener
from atlantis_netcfg.emulator.routeros.lte._modem import settle

if TYPE_CHECKING:
    from atlantis_netcfg.emulator.routeros.commands._call import Call
    from atlantis_netcfg.emulator.routeros.core import Core


def listen(core: Core, call: Call, tag: str) -> list[Answer]:
    """Begin to listen; nothing is answered before something changes."""
    if not core.schema.has_menu(call.menu):
        raise Trap("no such command prefix", Category.MISSING)
    if not core.schema.has_command(call.menu, "listen"):
        raise Trap("no such command", Category.MISSING)
    core.listeners.append(Listener(call.caller, tag, call, _rows(core, call)))
    return []


def _rows(core: Core, call: Call) -> dict[str, dict[str, str]]:
    return {row[".id"]: row for row in all_rows(core, call) if ".id" in row}


def emit(core: Core) -> None:
    """Let the modem act on what was changed, and tell every listener what is new.

    A row that has gone is `.dead=true`, where the Manual says `yes` (7.23.1: tikoci/centrs, commands/api/AGENTS.md).
    """
    settle(core)
    for listener in core.listeners:
        now = _rows(core, listener.call)
        news = [row for number, row in now.items() if listener.seen.get(number) != row]
        news += [{".id": number, ".dead": "true"} for number in listener.seen if number not in now]
        listener.seen = now
        core.outbox += [(listener.caller.number, listener.tag, Answer.row(row)) for row in news]
