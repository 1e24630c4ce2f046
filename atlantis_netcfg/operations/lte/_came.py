"""What has become of the settings of one unit, and how long it may take."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from atlantis_netcfg.bearers.lte.rutos_settings import Change

__all__ = ["Came", "Patience"]


@dataclass(frozen=True, slots=True)
class Patience:
    """How long a unit may take to come back into its network after its settings were reloaded, in seconds."""

    settle_s: float = 120.0
    poll_s: float = 5.0


@dataclass(frozen=True, slots=True)
class Came:
    """What has become of the settings."""

    found: tuple[Change, ...] = ()
    done: bool = False
    held: str | None = None
    commands: int = 0
    taken_back: bool = False
    """The PIN was refused, and the unit does not hold it any more."""

    @property
    def hash(self) -> str:
        """Of what a person sees of the plan."""
        return hashlib.sha256(json.dumps([(one.line, one.removed) for one in self.found]).encode()).hexdigest()

    @property
    def diff(self) -> str:
        """What would be set, as a difference."""
        rows = ((f"- {one.removed}\n" if one.removed else "") + f"+ {one.line}\n" for one in self.found)
        return "".join(rows)
