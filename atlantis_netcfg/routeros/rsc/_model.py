"""The value objects of export text, and the error that parsing it can raise.

Also the few words that the grammar itself must know; all others are left to the device.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Iterator


class RscError(UsageError):
    """Text that is not export text; `line` and `column` (1-based) are those of the user's file."""

    def __init__(self, message: str, *, source: str, line: int, column: int, hint: str | None = None) -> None:
        super().__init__(f"{source}, line {line}, column {column}: {message}", hint=hint)
        self.source = source
        self.line = line
        self.column = column


@dataclass(frozen=True, slots=True)
class Statement:
    """One command of export text; equal to another one with the same effect, wherever it is in the text."""

    menu: str
    """Menu as API path: `/ip/firewall/filter`; the root is `/`."""
    verb: str
    """`add`, `set`, or another command word."""
    values: tuple[tuple[str, str | None], ...] = ()
    """Arguments in the order of the text, with full names (never `.mode`); None is `!name`: the property is unset."""
    find: tuple[tuple[str, str], ...] | None = None
    """Rows selected by `[ find default-name=ether1 ]`; () is `[ find ]`, every row; None: no `find`."""
    target: str | None = None
    """Row given directly after the verb: `set telnet`, `set 0`, `set *3`."""
    line: int = field(default=0, compare=False)
    """First line in the text, 1-based; 0 if not read from a text."""
    comments: tuple[str, ...] = ()
    """Comment lines directly above, without `# `."""

    def get(self, name: str) -> str | None:
        """Return the last value of argument `name`, which is the one the device uses; None if there is none."""
        return dict(self.values).get(name)


@dataclass(frozen=True, slots=True)
class Export:
    """A whole export: its header comments, its statements, and the menus that it opens."""

    header: tuple[str, ...] = ()
    """Comment lines at the very top, without `# `."""
    statements: tuple[Statement, ...] = ()
    menus: tuple[str, ...] = ()
    """In order of first appearance, menus without statements included."""
    trailer: tuple[str, ...] = ()
    """Comment lines below the last statement."""

    def remarks(self) -> Iterator[str]:
        """Yield every comment line, from top to bottom."""
        yield from self.header
        for statement in self.statements:
            yield from statement.comments
        yield from self.trailer


VERBS = frozenset(
    {
        "add",
        "comment",
        "disable",
        "edit",
        "enable",
        "export",
        "find",
        "get",
        "move",
        "print",
        "remove",
        "reset",
        "run",
        "set",
        "unset",
    }
)
"""Commands that most menus have, and no menu's name: they end the path of a full-path line."""

FLAGS = frozenset({"blackhole", "fib", "no-summaries", "passive"})
"""Arguments that `export` prints as a bare name when present; the API gives them an empty value."""
