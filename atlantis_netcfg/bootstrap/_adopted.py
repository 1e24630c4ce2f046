"""What came of first contact."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from atlantis_netcfg.bootstrap.target import Facts, Standing

__all__ = ["Adopted", "Status"]


class Status(StrEnum):
    """How first contact ended."""

    ALREADY = "unchanged"
    PLANNED = "planned"
    ADOPTED = "changed"


@dataclass(frozen=True, slots=True)
class Adopted:
    """What came of it; `notes` say what nobody has verified, and what to do now."""

    status: Status
    standing: Standing
    steps: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    facts: Facts | None = None
