"""In which order rows of a first-match menu may be inserted or removed when some of them jump to chains of others.

Within a chain: insertion from the top down, removal from the bottom up. A chain that others jump to counts as standing
where the jump stands: its rows come after those above the jump and before those below it. Where no order satisfies all
jumps (two chains that call each other's targets crosswise), the order of the list goes on.
"""

from __future__ import annotations

from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import pairwise
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

__all__ = ["Rule", "insertion", "removal"]


@dataclass(frozen=True, slots=True)
class Rule:
    """As much of a row as order depends on."""

    chain: str
    target: str | None
    """The chain it jumps to."""
    stays: bool
    """It is in the old list and in the new one, at a place that does not change."""


def insertion(rules: Sequence[Rule]) -> list[int]:
    """Return the order in which the rows of the new list are dealt with."""
    return _sorted(rules, after_jump=True)


def removal(rules: Sequence[Rule]) -> list[int]:
    """Return the order in which the rows of the old list are dealt with."""
    last = len(rules) - 1
    return [last - index for index in _sorted(rules[::-1], after_jump=False)]


def _sorted(rules: Sequence[Rule], *, after_jump: bool) -> list[int]:
    """Topological order, by place wherever that is free."""
    followers: list[list[int]] = [[] for _ in rules]
    waiting = [0] * len(rules)
    for first, then in _edges(rules, after_jump=after_jump):
        followers[first].append(then)
        waiting[then] += 1
    ready = [index for index, count in enumerate(waiting) if not count]
    done: list[int] = []
    queued = set(ready)
    while len(done) < len(rules):
        if not ready:
            ready.append(next(index for index in range(len(rules)) if index not in queued))
            queued.add(ready[0])
        index = heappop(ready)
        done.append(index)
        for follower in followers[index]:
            waiting[follower] -= 1
            if not waiting[follower] and follower not in queued:
                queued.add(follower)
                heappush(ready, follower)
    return done


def _edges(rules: Sequence[Rule], *, after_jump: bool) -> Iterator[tuple[int, int]]:
    chains: dict[str, list[int]] = {}
    for index, rule in enumerate(rules):
        chains.setdefault(rule.chain, []).append(index)
    moving = {rule.chain for rule in rules if not rule.stays}
    for members in chains.values():
        yield from pairwise(members)
        for place, index in enumerate(members):
            rule = rules[index]
            target = chains.get(rule.target) if rule.target in moving and rule.target != rule.chain else None
            if target is None:
                continue
            if place + 1 < len(members) and (after_jump or rule.stays):
                yield target[-1], members[place + 1]
            if place and (not after_jump or rule.stays):
                yield members[place - 1], target[0]
