"""What a fault is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from atlantis_netcfg.checklist.runner.simulated._world import World


@dataclass(frozen=True, slots=True)
class Fault:
    """One thing that is broken on purpose."""

    words: str
    """What is so, for whoever trains with it."""
    turns: tuple[str, ...]
    """The items that have to notice; `SITE` stands for the site. All others stay as they are."""
    spoil: Callable[[World], None]
    """Raises KeyError where the site has no such thing."""
