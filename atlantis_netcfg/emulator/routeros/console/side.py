"""A console session of an emulated router: prompts, lines, Ctrl+X, safe mode, messages to other sessions.

Sources: Manual, Command Line Interface; Manual, Configuration Management: Safe Mode.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.boot import default_configuration
from atlantis_netcfg.emulator.routeros.commands.read import emit
from atlantis_netcfg.emulator.routeros.console.run import run_line, run_script
from atlantis_netcfg.emulator.routeros.core import Core, notify_holder_lost
from atlantis_netcfg.emulator.routeros.values import id_text
from atlantis_netcfg.routeros.rsc import quote

if TYPE_CHECKING:
    from atlantis_netcfg.emulator.routeros.answers import Caller


REBOOT = "Reboot, yes? [y/N]:"
_REBOOTING = "system will reboot shortly"
_REBOOT = re.compile(r"/?system[ /]+reboot")
HIJACK = "Hijacking Safe Mode from someone - unroll/release/don't take it [u/r/d]:"
_TAKEN_MESSAGE, _RELEASED_MESSAGE = "[Safe Mode taken]", "[Safe Mode released]"
_QUITS = ("quit", "/quit")


@dataclass(frozen=True, slots=True)
class ConsoleReply:
    """Response of the console: text, success, and how the session continues."""

    text: str = ""
    has_failed: bool = False
    is_paged: bool = False
    """A terminal shows the text page by page: it is output of `print`."""
    asks: str = ""
    """Question that must be confirmed first; empty: none."""
    over: bool = False
    """The session ends."""
    has_quit: bool = False
    """The session ends by `/quit`: changes made in safe mode are kept."""


def handle_line(
    core: Core, caller: Caller, line: str, *, width: int | None = None, is_confirmed: bool = False
) -> ConsoleReply:
    """Run a line at the caller's prompt; a path moves the prompt to its menu."""
    command = line.strip()
    if width is not None and not is_confirmed and _REBOOT.fullmatch(command):
        return ConsoleReply(asks=REBOOT)
    if command in _QUITS:
        return ConsoleReply(text="interrupted", over=True, has_quit=True)
    menu = core.menus.get(caller.number, "/")
    if command == "..":
        core.menus[caller.number] = menu.rpartition("/")[0] or "/"
        return ConsoleReply()
    if _REBOOT.fullmatch(command):
        error = run_line(core, caller, line, menu)[0].error
        return ConsoleReply(error or _REBOOTING, has_failed=error is not None)
    outcome, core.menus[caller.number] = run_line(core, caller, line, menu, width=width)
    return ConsoleReply(outcome.output, has_failed=outcome.error is not None, is_paged=outcome.is_paged)


def prompt(core: Core, caller: Caller) -> str:
    """Return the prompt `[user@identity] /menu> `; version 6 writes the menu with spaces."""
    identity = core.store.table("/system/identity")
    name = core.store.text(identity, identity.items[0], "name") or ""
    menu = core.menus.get(caller.number, "/")
    if not core.schema.at_least("7.0"):
        menu = "/" + menu.strip("/").replace("/", " ")
    place = "" if menu == "/" else menu
    return f"[{caller.user}@{name}] {place}{'<SAFE>' if holds(core, caller) else '>'} "


def holds(core: Core, caller: Caller) -> bool:
    """Return whether this session holds safe mode."""
    return core.history.holder is not None and core.history.holder.number == caller.number


def safe_key(core: Core, caller: Caller, choice: str) -> ConsoleReply:
    """Take or release safe mode, or ask what to do about another session's."""
    history = core.history
    if holds(core, caller):
        history.release()
        core.note("system,info", f"safe mode released by {caller.user}")
        return ConsoleReply(_RELEASED_MESSAGE)
    if history.holder is not None and choice not in ("u", "r"):
        return ConsoleReply() if choice else ConsoleReply(asks=HIJACK)
    if history.holder is not None:
        notify_holder_lost(core, caller)
        if choice == "u":
            history.unroll(core.store)
        else:
            history.release()
    history.take(caller)
    core.note("system,info", f"safe mode taken by {caller.user}")
    return ConsoleReply(_TAKEN_MESSAGE)


_DEFAULTS_OFF = """/ip dns set allow-remote-requests=no
/ip neighbor discovery-settings set discover-interface-list=static
/tool mac-server set allowed-interface-list=all
/tool mac-server mac-winbox set allowed-interface-list=all
"""


class ConsoleBackend:
    """Console functions of `Device`."""

    _core: Core

    def tick(self) -> None:
        """Process everything that is due."""
        raise NotImplementedError

    def type(self, caller: Caller, line: str, *, width: int | None = None, is_confirmed: bool = False) -> ConsoleReply:
        """Run one line in the caller's console session.

        `width`: screen width in columns; None for the exec channel. `is_confirmed`: the confirmation question was
        answered with yes. A line that cannot be confirmed (exec, scripts) asks no question.
        """
        self.tick()
        reply = handle_line(self._core, caller, line, width=width, is_confirmed=is_confirmed)
        emit(self._core)
        return reply

    def prompt(self, caller: Caller) -> str:
        """Return the prompt, e.g. `[admin@MikroTik] /ip/address> `; in safe mode it ends with `<SAFE>`."""
        return prompt(self._core, caller)

    def safe_key(self, caller: Caller, choice: str = "") -> ConsoleReply:
        """Handle Ctrl+X or F4: take or release safe mode; `choice` (u, r or d) resolves another session's hold."""
        self.tick()
        reply = safe_key(self._core, caller, choice)
        emit(self._core)
        return reply

    def keep(self, caller: Caller) -> None:
        """Handle `/quit`: the session ends and keeps its safe-mode changes (Manual, Configuration Management)."""
        if holds(self._core, caller):
            self._core.history.release()

    def notices(self, caller: Caller) -> list[str]:
        """Return and remove the pending messages for this session."""
        local = [text for number, text in self._core.notices if number == caller.number]
        self._core.notices = [notice for notice in self._core.notices if notice[0] != caller.number]
        return local

    def again(self, caller: Caller) -> Caller:
        """Open another session of the same login: SSH has one for each channel."""
        another = replace(caller, number=self._core.number(), since=self._core.now())
        self._core.sessions[another.number] = another
        return another

    def at_least(self, version: str) -> bool:
        """Return whether the router runs `version` or a newer one."""
        return self._core.schema.at_least(version)

    def settings(self, menu: str) -> dict[str, str]:
        """Return the values of a settings menu."""
        table = self._core.store.table(menu)
        return {name: self._core.store.text(table, table.items[0], name) or "" for name in table.args}

    # --- a first login ---------------------------------------------------------------------------------------------

    def greetings(self, caller: Caller) -> tuple[str, ...]:
        """Return pending login questions: `licence`, `default-configuration`, `password`.

        A user with an empty password is asked for a new one at every login (tik4net, Docs/findings-cli.md).
        """
        questions = self._core.greetings
        users = self._core.store.table("/user")
        empty = any(
            self._core.store.text(users, item, "name") == caller.user
            and not self._core.store.text(users, item, "password")
            for item in users.items
        )
        return (*questions, "password") if empty and "password" not in questions else questions

    def finish_greeting(self, question: str) -> None:
        """Mark a login question as answered."""
        self._core.greetings = tuple(greeting for greeting in self._core.greetings if greeting != question)

    def default_configuration(self) -> str:
        """Return the factory configuration as text."""
        return default_configuration(self._core.spec)

    def remove_defaults(self, caller: Caller) -> None:
        """Remove the default configuration (`r` at the first login)."""
        self.tick()
        store = self._core.store
        for path, table in list(store.tables.items()):
            default_items = [
                item for item in table.items if (store.text(table, item, "comment") or "").startswith("defconf")
            ]
            if default_items:
                run_line(self._core, caller, f"remove {','.join(id_text(item.id) for item in default_items)}", path)
        run_script(self._core, caller, _DEFAULTS_OFF)

    def set_password(self, caller: Caller, password: str) -> str:
        """Set the caller's password; return the console's error, or an empty string."""
        self.tick()
        line = f"/user set [find name={quote(caller.user)}] password={quote(password)}"
        return run_line(self._core, caller, line, "/")[0].error or ""
