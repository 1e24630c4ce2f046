"""What a person types at the prompt: a line, or Ctrl+X.

Sources: Manual, Command Line Interface; Manual, Configuration Management: Safe Mode.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.console.run import run_line

if TYPE_CHECKING:
    from atlantis_netcfg.emulator.routeros.answers import Caller
    from atlantis_netcfg.emulator.routeros.core import Core

REBOOT = "Reboot, yes? [y/N]:"
_REBOOTING = "system will reboot shortly"
_REBOOT = re.compile(r"/?system[ /]+reboot")
HIJACK = "Hijacking Safe Mode from someone - unroll/release/don't take it [u/r/d]:"
_ROBBED = "[Safe mode released by another user]"
_TAKEN, _RELEASED = "[Safe Mode taken]", "[Safe Mode released]"
_CONSOLES = ("ssh", "console")
_QUITS = ("quit", "/quit")


@dataclass(frozen=True, slots=True)
class Printed:
    """What the console answers: lines, whether the line failed, and how it goes on."""

    text: str = ""
    failed: bool = False
    paged: bool = False
    """A screen holds it back page by page: it came from `print`."""
    asks: str = ""
    """A question stands open; nothing has happened yet."""
    over: bool = False
    """The session ends."""
    quitted: bool = False
    """It ends by `/quit`: what was done in safe mode stays."""


def handle_line(core: Core, caller: Caller, line: str, *, width: int | None = None, confirmed: bool = False) -> Printed:
    """Run a line where the caller's prompt stands, and move the prompt if the line was a path."""
    stripped = line.strip()
    if width is not None and not confirmed and _REBOOT.fullmatch(stripped):
        return Printed(asks=REBOOT)
    if stripped in _QUITS:
        return Printed(text="interrupted", over=True, quitted=True)
    menu = core.menus.get(caller.number, "/")
    if stripped == "..":
        core.menus[caller.number] = menu.rpartition("/")[0] or "/"
        return Printed()
    if _REBOOT.fullmatch(stripped):
        failed = run_line(core, caller, line, menu)[0].error
        return Printed(failed or _REBOOTING, failed=failed is not None)
    outcome, core.menus[caller.number] = run_line(core, caller, line, menu, width=width)
    return Printed(outcome.output, failed=outcome.error is not None, paged=outcome.paged)


def prompt(core: Core, caller: Caller) -> str:
    """`[user@identity] /menu> `; version 6 writes the menu with spaces."""
    identity = core.store.table("/system/identity")
    name = core.store.text(identity, identity.items[0], "name") or ""
    menu = core.menus.get(caller.number, "/")
    if not core.schema.at_least("7.0"):
        menu = "/" + menu.strip("/").replace("/", " ")
    place = "" if menu == "/" else menu
    return f"[{caller.user}@{name}] {place}{'<SAFE>' if holds(core, caller) else '>'} "


def holds(core: Core, caller: Caller) -> bool:
    """Tell whether this session holds safe mode."""
    return core.history.holder is not None and core.history.holder.number == caller.number


def notify_holder_lost(core: Core, caller: Caller) -> None:
    """Let a console whose safe mode somebody else ends know it."""
    holder = core.history.holder
    if holder is not None and holder.number != caller.number and holder.via in _CONSOLES:
        core.notices.append((holder.number, _ROBBED))


def safe_key(core: Core, caller: Caller, choice: str) -> Printed:
    """Take safe mode, release it, or ask what to do about somebody else's."""
    history = core.history
    if holds(core, caller):
        history.release()
        core.note("system,info", f"safe mode released by {caller.user}")
        return Printed(_RELEASED)
    if history.holder is not None and choice not in ("u", "r"):
        return Printed() if choice else Printed(asks=HIJACK)
    if history.holder is not None:
        notify_holder_lost(core, caller)
        if choice == "u":
            history.unroll(core.store)
        else:
            history.release()
    history.take(caller)
    core.note("system,info", f"safe mode taken by {caller.user}")
    return Printed(_TAKEN)
