"""What a run may cost: the executor asks once, when it has read the device and made its plan, and never decides."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from atlantis_netcfg.routeros._types import Observed
    from atlantis_netcfg.routeros.estimate import Estimate

__all__ = ["Admission", "Toll"]


@dataclass(frozen=True, slots=True)
class Admission:
    """Whether a run may go on."""

    notes: tuple[str, ...] = ()
    """What its result shall say in any case."""
    refusal: str | None = None
    """Why it may not."""
    hint: str | None = None


class Toll(Protocol):
    """Who knows what the bearers cost and what a person has agreed to."""

    def judge(self, seen: Observed, estimate: Estimate | None, *, spends: bool, planned: bool) -> Admission:
        """Say whether a run may go on; `spends`: it would send more than it has; `planned`: not before a person agrees.

        Where it spends nothing more there is nothing to refuse.
        """
