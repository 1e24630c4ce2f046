"""Longest common subsequence of two lists, quick where they are alike.

Hunt and Szymanski, "A fast algorithm for computing longest common subsequences" (CACM 20, 1977): pairs of equal
elements, then the longest increasing run of positions. Common ends are cut off first.
"""

from __future__ import annotations

from bisect import bisect_left
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Hashable, Sequence

__all__ = ["common"]


def common(old: Sequence[Hashable], new: Sequence[Hashable]) -> list[tuple[int, int]]:
    """Return the positions (in `old`, in `new`) of a longest common subsequence, ascending.

    Of several it prefers one that keeps elements which stand early in `old`, so that those left out tend to move up.
    """
    head = _common_length(old, new, len(old), len(new))
    tail = _common_length(old[::-1], new[::-1], len(old) - head, len(new) - head)
    middle = _increasing(old[head : len(old) - tail], new[head : len(new) - tail])
    ends = [(len(old) - tail + offset, len(new) - tail + offset) for offset in range(tail)]
    return [*((each, each) for each in range(head)), *((head + i, head + j) for i, j in middle), *ends]


def _common_length(old: Sequence[Hashable], new: Sequence[Hashable], *limits: int) -> int:
    length = 0
    while length < min(limits) and old[length] == new[length]:
        length += 1
    return length


def _increasing(old: Sequence[Hashable], new: Sequence[Hashable]) -> list[tuple[int, int]]:
    places: dict[Hashable, list[int]] = {}
    for index in range(len(old) - 1, -1, -1):
        places.setdefault(old[index], []).append(index)
    tops: list[int] = []
    ends: list[_Link] = []
    for position, element in enumerate(new):
        for index in places.get(element, ()):  # descending, so that one element of `new` is used once at most
            pile = bisect_left(tops, index)
            link = (index, position, ends[pile - 1] if pile else None)
            tops[pile : pile + 1] = [index]
            ends[pile : pile + 1] = [link]
    return _chain(ends[-1] if ends else None)


_Link = tuple[int, int, "_Link | None"]


def _chain(link: _Link | None) -> list[tuple[int, int]]:
    pairs: list[tuple[int, int]] = []
    while link is not None:
        index, position, link = link
        pairs.append((index, position))
    return pairs[::-1]
