"""`/safe-mode`, `/undo`, `/redo` (Manual, Configuration Management: Safe Mode).

What a second taker is told over the API nobody has published; the text is the console's question as a refusal.

Assumption: safe-mode-second-taker
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.answers import Trap
from atlantis_netcfg.emulator.routeros.commands._call import Result, unknown
from atlantis_netcfg.emulator.routeros.console.typed import rob
from atlantis_netcfg.emulator.routeros.spec import Deviation

if TYPE_CHECKING:
    from atlantis_netcfg.emulator.routeros.commands._call import Call
    from atlantis_netcfg.emulator.routeros.core import Core

__all__ = ["redo", "release", "take", "toggle", "undo", "unroll"]


def _arguments(core: Core, call: Call) -> None:
    for name in (*call.arguments, *call.unset):
        if name not in core.schema.arguments(call.menu, call.command):
            raise unknown(name)


def take(core: Core, call: Call) -> Result:
    """Enter safe mode; only one session may hold it."""
    _arguments(core, call)
    holder = core.history.holder
    if holder is not None and holder.number != call.caller.number:
        if core.deviates(Deviation.SECOND_TAKER):
            rob(core, call.caller)
            core.history.take(call.caller)
            return Result()
        raise Trap(f"failure: safe mode is held by {holder.via}:{holder.user}@{holder.address}")
    if holder is None:
        core.history.take(call.caller)
        core.note("system,info", f"safe mode taken by {call.caller.user}")
    return Result()


def release(core: Core, call: Call) -> Result:
    """Keep everything; any session may do that."""
    _arguments(core, call)
    if core.history.holder is not None:
        rob(core, call.caller)
        core.history.release()
        core.note("system,info", f"safe mode released by {call.caller.user}")
    return Result()


def unroll(core: Core, call: Call) -> Result:
    """Undo everything and leave safe mode; the session goes on."""
    _arguments(core, call)
    if core.history.holder is not None:
        rob(core, call.caller)
        core.history.unroll(core.store)
        core.note("system,info", f"safe mode unrolled by {call.caller.user}")
    return Result(text="Unrolling Safe Mode... Success!")


def toggle(core: Core, call: Call) -> Result:
    """Take or release."""
    return take(core, call) if core.history.holder is None else release(core, call)


def undo(core: Core, _call: Call) -> Result:
    """Undo the latest action."""
    if not core.history.undo(core.store):
        raise Trap("failure: nothing to undo")
    return Result()


def redo(core: Core, _call: Call) -> Result:
    """Do the action undone last again."""
    if not core.history.redo(core.store):
        raise Trap("failure: nothing to redo")
    return Result()
