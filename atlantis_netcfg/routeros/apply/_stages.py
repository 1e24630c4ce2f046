"""How a plan is cut so that safe mode never has to remember more than it can.

A plan within the budget is one piece. Otherwise harmless additions may go outside safe mode: those that others name
(address lists, pools) before it, those that name others (leases) after it. What is left is cut into pieces with a
checkpoint between them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from atlantis_netcfg.routeros._types import Layer, Verb
from atlantis_netcfg.routeros.safe_mode import BUDGET

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from atlantis_netcfg.routeros._types import Action, Plan
    from atlantis_netcfg.routeros.apply._protection import Protection

_NAMED, _NAMING = True, False


@dataclass(frozen=True, slots=True)
class Stages:
    """The actions of a plan by how they are sent; within each in the order of the plan."""

    prepare: tuple[Action, ...] = ()
    protected: tuple[tuple[Action, ...], ...] = ()
    """Pieces, each within the budget of one safe mode."""
    finish: tuple[Action, ...] = ()


def cut(plan: Plan, protection: Protection, budget: int = BUDGET) -> Stages:
    """Cut a plan in the way that costs the fewest round trips; without safe mode there is nothing to cut for."""
    if not protection.holds:
        return Stages(prepare=plan.actions)
    ways = [_cut(plan, budget, outside) for outside in ((), (_NAMED,), (_NAMING,), (_NAMED, _NAMING))]
    return min(ways, key=_cost)


def _cut(plan: Plan, budget: int, outside: Sequence[bool]) -> Stages:
    """Cut with those harmless additions outside that are named by others (True), or name others (False)."""
    out = [action for action in plan.actions if _harmless(action) and (action.layer is Layer.FOUNDATION) in outside]
    rest = [action for action in plan.actions if action not in out]
    return Stages(
        prepare=tuple(action for action in out if action.layer is Layer.FOUNDATION),
        protected=tuple(_pieces(rest, budget)),
        finish=tuple(action for action in out if action.layer is not Layer.FOUNDATION),
    )


def _cost(stages: Stages) -> int:
    """Return round trips: a preparation also keeps safe mode from being taken beside the last reading."""
    checkpoints = max(0, len(stages.protected) - 1)
    return 2 * bool(stages.prepare) + bool(stages.finish) + 7 * checkpoints


def _harmless(action: Action) -> bool:
    return action.inert and action.verb is Verb.ADD


def _pieces(actions: Sequence[Action], budget: int) -> Iterator[tuple[Action, ...]]:
    piece: list[Action] = []
    left = budget
    for action in (part for whole in actions for part in _parts(whole, budget)):
        if action.weight > left:
            yield tuple(piece)
            piece, left = [], budget
        piece.append(action)
        left -= action.weight
    if piece:
        yield tuple(piece)


def _parts(action: Action, budget: int) -> Iterator[Action]:
    """Cut one action over many rows; its parts keep its number, and it counts as done when the last one is."""
    for start in range(0, max(1, len(action.ids)), budget):
        yield replace(action, ids=action.ids[start : start + budget])
