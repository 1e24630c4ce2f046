"""The side of a device that a console session sees: lines, prompt, Ctrl+X, and what is asked at a first login."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.console.run import run_line, run_script
from atlantis_netcfg.emulator.routeros.console.typed import Printed, handle_line, holds, prompt, safe_key
from atlantis_netcfg.emulator.routeros.factory import default_configuration
from atlantis_netcfg.emulator.routeros.listen import emit
from atlantis_netcfg.emulator.routeros.values import id_text
from atlantis_netcfg.rsc import quote

if TYPE_CHECKING:
    from atlantis_netcfg.emulator.routeros.answers import Caller
    from atlantis_netcfg.emulator.routeros.core import Core

_DEFAULTS_OFF = """/ip dns set allow-remote-requests=no
/ip neighbor discovery-settings set discover-interface-list=static
/tool mac-server set allowed-interface-list=all
/tool mac-server mac-winbox set allowed-interface-list=all
"""


class ConsoleBackend:
    """What `Device` adds for consoles."""

    _core: Core

    def tick(self) -> None:
        """Do what has become due."""
        raise NotImplementedError

    def type(self, caller: Caller, line: str, *, width: int | None = None, confirmed: bool = False) -> Printed:
        """Run one line in the caller's console session.

        `width` is his screen's, in columns; None is the exec channel's. `confirmed`: its question was answered with
        yes. A line that nobody can answer (exec, scripts) asks nothing.
        """
        self.tick()
        printed = handle_line(self._core, caller, line, width=width, confirmed=confirmed)
        emit(self._core)
        return printed

    def prompt(self, caller: Caller) -> str:
        """The console's prompt, e.g. `[admin@MikroTik] /ip/address> `; `<SAFE>` ends it while he holds safe mode."""
        return prompt(self._core, caller)

    def safe_key(self, caller: Caller, choice: str = "") -> Printed:
        """Ctrl+X or F4: take or release safe mode; `choice` (u, r or d) answers the question about another's hold."""
        self.tick()
        printed = safe_key(self._core, caller, choice)
        emit(self._core)
        return printed

    def safe_held(self, caller: Caller) -> bool:
        """Does this session hold safe mode."""
        return holds(self._core, caller)

    def keep(self, caller: Caller) -> None:
        """`/quit`: the session ends, and what it did in safe mode stays (Manual, Configuration Management)."""
        if holds(self._core, caller):
            self._core.history.release()

    def notices(self, caller: Caller) -> list[str]:
        """What the console tells this session without being asked; each is handed out once."""
        local = [text for number, text in self._core.notices if number == caller.number]
        self._core.notices = [notice for notice in self._core.notices if notice[0] != caller.number]
        return local

    def again(self, caller: Caller) -> Caller:
        """Another session of the same login: SSH opens one for each of its channels."""
        another = replace(caller, number=self._core.number(), since=self._core.now())
        self._core.sessions[another.number] = another
        return another

    def at_least(self, version: str) -> bool:
        """Does it run `version` or a newer one."""
        return self._core.schema.at_least(version)

    def settings(self, menu: str) -> dict[str, str]:
        """The values of a menu without rows."""
        table = self._core.store.table(menu)
        return {name: self._core.store.text(table, table.items[0], name) or "" for name in table.args}

    # --- a first login ---------------------------------------------------------------------------------------------

    def greetings(self, caller: Caller) -> tuple[str, ...]:
        """What the console still has to ask this one: `licence`, `default-configuration`, `password`.

        Whoever has an empty password is asked for a new one at every login (tik4net, Docs/findings-cli.md).
        """
        left = self._core.greetings
        users = self._core.store.table("/user")
        empty = any(
            self._core.store.text(users, item, "name") == caller.user
            and not self._core.store.text(users, item, "password")
            for item in users.items
        )
        return (*left, "password") if empty and "password" not in left else left

    def greeted(self, question: str) -> None:
        """The question needs not be asked again."""
        self._core.greetings = tuple(greeting for greeting in self._core.greetings if greeting != question)

    def default_configuration(self) -> str:
        """What the factory put on it, as text."""
        return default_configuration(self._core.spec)

    def remove_defaults(self, caller: Caller) -> None:
        """Take the default configuration away (`r` at the first login)."""
        self.tick()
        store = self._core.store
        for path, table in list(store.tables.items()):
            marked = [item for item in table.items if (store.text(table, item, "comment") or "").startswith("defconf")]
            if marked:
                run_line(self._core, caller, f"remove {','.join(id_text(item.id) for item in marked)}", path)
        run_script(self._core, caller, _DEFAULTS_OFF)

    def set_password(self, caller: Caller, password: str) -> str:
        """Give the caller a new password; the console's refusal, or nothing."""
        self.tick()
        line = f"/user set [find name={quote(caller.user)}] password={quote(password)}"
        return run_line(self._core, caller, line, "/")[0].error or ""
