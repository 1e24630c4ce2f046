"""What can be broken in a rehearsal, one thing at a time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from atlantis_netcfg.operations.checking.rehearsed._world import World

__all__ = ["FAULTS", "Fault"]


@dataclass(frozen=True, slots=True)
class Fault:
    """One thing that is broken."""

    words: str
    """What is so, for who trains with it."""
    turns: tuple[str, ...]
    """Items that have to notice, `SITE` for the site's name; all others stay as they are."""
    spoil: Callable[[World], None]


FAULTS: Mapping[str, Fault] = {}
