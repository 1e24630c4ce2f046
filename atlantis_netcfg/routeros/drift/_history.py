"""What the device itself remembers: `/system/history`, its latest hundred changes, gone with a reboot.

Manual, Configuration Management: each entry has action, by, time, and the commands that undo and redo it. An entry that
names a row otherwise than by its `.id` is not found, and nothing is said then.

Assumption: history-names-ids
Assumption: history-newest-first
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.routeros.api import Command
from atlantis_netcfg.routeros.drift._model import Deed
from atlantis_netcfg.routeros.menus import Shape
from atlantis_netcfg.rsc import quote

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from atlantis_netcfg.routeros._types import Row
    from atlantis_netcfg.routeros.drift._raw import Raw
    from atlantis_netcfg.routeros.menus import Menu

__all__ = ["HISTORY", "History"]

HISTORY = Command("/system/history/print", ((".proplist", "action,by,time,undo,redo"),))
_VERBS = "add|set|unset|remove|move|enable|disable|comment"


@dataclass(frozen=True, slots=True)
class History:
    """The entries as the device prints them, newest first."""

    rows: Sequence[Row] = ()

    def deed(self, menu: Menu, raw: Raw) -> Deed | None:
        """Return the latest entry about the row of a difference."""
        for row in self.rows:
            commands = [command for command in (row.get("undo", ""), row.get("redo", "")) if _is_about(menu, command)]
            if any(_names(menu, raw, command) for command in commands):
                return Deed(row.get("by", ""), row.get("time", ""), row.get("action", ""))
        return None


def _is_about(menu: Menu, command: str) -> bool:
    path = "[ /]".join(map(re.escape, menu.path.strip("/").split("/")))
    return re.match(rf"/{path}[ /](?:{_VERBS})\b", command) is not None


def _names(menu: Menu, raw: Raw, command: str) -> bool:
    if menu.shape is Shape.SINGLETON:
        return True
    if raw.found is not None:
        return re.search(rf"{re.escape(raw.found.get('.id', '*'))}(?![0-9A-Fa-f])", command) is not None
    return raw.declared is not None and _adds(menu, raw.declared, command)


def _adds(menu: Menu, values: Mapping[str, str], command: str) -> bool:
    """Tell whether the command would bring a row with these keys, or with this comment, back."""
    names = menu.keys or ("comment",)
    words = [f"{name}={quote(values[name])}" for name in names if values.get(name)]
    return " add" in command.replace("/add", " add") and bool(words) and all(word in command for word in words)
