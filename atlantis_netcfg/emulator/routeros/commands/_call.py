"""One command as API and console hand it to the handlers, what they return, and how they refuse."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.answers import Category, Trap

if TYPE_CHECKING:
    from atlantis_netcfg.emulator.routeros.answers import Caller
    from atlantis_netcfg.emulator.routeros.core import Core


@dataclass(slots=True)
class Call:
    """A command of a menu with its arguments."""

    caller: Caller
    menu: str
    command: str
    arguments: dict[str, str] = field(default_factory=dict)
    unset: tuple[str, ...] = ()
    queries: tuple[str, ...] = ()
    console: bool = False
    """Typed or scripted, not sent as an API sentence: rows may be called by their number."""

    @property
    def path(self) -> str:
        """Menu and command in one."""
        return f"{self.menu.rstrip('/')}/{self.command}"


@dataclass(slots=True)
class Result:
    """Rows for `!re`, a value for `=ret=`, text for a console."""

    rows: list[dict[str, str]] = field(default_factory=list)
    ret: str | None = None
    text: str = ""
    listing: bool = False
    """A print: without rows the API answers `!empty` from 7.18."""


Handler = Callable[["Core", Call], Result]


class MissingArgument(Trap):
    """A mandatory argument was not given; API and console have different words for it."""

    def __init__(self, name: str, *others: str) -> None:
        super().__init__(f"missing ={name}=", Category.MISSING)
        self.console = f"missing value(s) of argument(s) {' '.join((name, *others))}"


def no_such_item() -> Trap:
    """Say that no row has this id or name."""
    return Trap("no such item", Category.MISSING)


def unknown(name: str) -> Trap:
    """Say that the command has no such argument."""
    return Trap(f"unknown parameter {name}")
