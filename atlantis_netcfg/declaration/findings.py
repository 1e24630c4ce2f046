"""What is wrong in the inventory, where, and what to type instead: the form in which every error of it is told."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence


@dataclass(frozen=True, slots=True, order=True)
class Mark:
    """A place in a file as an editor counts it: both numbers begin with 1."""

    file: str
    line: int
    column: int

    def __str__(self) -> str:
        return f"{self.file}:{self.line}:{self.column}"


@dataclass(frozen=True, slots=True, order=True)
class Finding:
    """One error of the inventory. Sorts by its place."""

    file: str
    line: int
    column: int
    message: str
    hint: str
    """What to type next."""

    @classmethod
    def at(cls, mark: Mark, message: str, hint: str) -> Finding:
        """An error at a place."""
        return cls(mark.file, mark.line, mark.column, message, hint)

    def __str__(self) -> str:
        return f"{self.file}:{self.line}:{self.column}: {self.message}"


class InventoryInvalid(UsageError):
    """The inventory has errors; nothing was contacted."""

    def __init__(self, findings: Iterable[Finding]) -> None:
        self.findings: tuple[Finding, ...] = tuple(sorted(set(findings)))
        super().__init__(report(self.findings))

    @property
    def errors(self) -> tuple[UsageError, ...]:
        """Each error by itself."""
        return tuple(UsageError(str(finding), hint=finding.hint) for finding in self.findings)


def report(findings: Sequence[Finding], where: str = "in the inventory; no device was contacted") -> str:
    """All errors as a technician reads them: place and error, what to type, and the count as the last line."""
    lines = [f"{finding}\n  -> {finding.hint}" for finding in findings]
    count = "1 error" if len(findings) == 1 else f"{len(findings)} errors"
    return "\n".join([*lines, f"{count} {where}"])
