"""One line of the ledger, read."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from datetime import datetime

__all__ = ["Entry"]


@dataclass(frozen=True, slots=True)
class Entry:
    """What happened, when, by whom."""

    number: int
    """From 1 on, without gaps."""
    at: datetime
    who: str
    operation: str
    """Same for all entries of one command."""

    @property
    def words(self) -> str:
        """What happened, in plain words, one line."""
        raise NotImplementedError

    def facts(self) -> dict[str, object]:
        """The entry for `--json`: number, at, who, operation, kind, words, and the record's own fields."""
        raise NotImplementedError
