"""First-match menus: from the old list to the new one without a gap in between.

Old list O, new list N, kept rows K = a longest common subsequence of both, chain by chain, by full content. Rows of N
that are not kept are inserted from the top down, each after the rows of N above it; then rows of O that are not kept
are removed from the bottom up. At every moment each packet gets the verdict of O or that of N. While inserting: if a
new row is the first match, all rows of N above it exist and do not match; if an old row is, no row of O above it
matches, since none was removed. While removing: all of N exists, and so do all rows of O above any old row.

A row that N has higher up is moved: a packet that matched it still meets it, or a row of N above it. A row that N has
further down is added there and removed above. So a row is changed in place only in properties that neither match nor
decide.

With jumps this holds for each chain; `_sequence` makes it hold for the whole if a chain is new or removed, or if its
callers stay unchanged.
"""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass, field
from functools import cached_property
from heapq import heappop, heappush
from itertools import pairwise
from typing import TYPE_CHECKING

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.routeros import _types, diff
from atlantis_netcfg.routeros.planner import _change

if TYPE_CHECKING:
    from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence

    from atlantis_netcfg.routeros._items import RowItem
    from atlantis_netcfg.routeros.menus import Menu


def common(old: Sequence[Hashable], new: Sequence[Hashable]) -> list[tuple[int, int]]:
    """Return the positions (in `old`, in `new`) of a longest common subsequence, ascending.

    Of several it prefers one with elements early in `old`, so that the others tend to move up. Hunt and Szymanski, "A
    fast algorithm for computing longest common subsequences" (CACM 20, 1977): pairs of equal elements, then the longest
    increasing sequence of positions. Common prefix and suffix are removed first.
    """
    head = _common_length(old, new, len(old), len(new))
    tail = _common_length(old[::-1], new[::-1], len(old) - head, len(new) - head)
    middle = _longest_increasing(old[head : len(old) - tail], new[head : len(new) - tail])
    ends = [(len(old) - tail + offset, len(new) - tail + offset) for offset in range(tail)]
    return [*((each, each) for each in range(head)), *((head + i, head + j) for i, j in middle), *ends]


def _common_length(old: Sequence[Hashable], new: Sequence[Hashable], *limits: int) -> int:
    length = 0
    while length < min(limits) and old[length] == new[length]:
        length += 1
    return length


def _longest_increasing(old: Sequence[Hashable], new: Sequence[Hashable]) -> list[tuple[int, int]]:
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


@dataclass(frozen=True, slots=True)
class Rule:
    """The properties of a row that its order depends on."""

    chain: str
    target: str | None
    """The chain to which the rule jumps; None: no jump."""
    stays: bool
    """The rule is in the old and in the new list, at an unchanged position."""


def insertion(rules: Sequence[Rule]) -> list[int]:
    """Return the order in which rows of the new list are inserted."""
    return _sort_rules(rules, after_jump=True)


def removal(rules: Sequence[Rule]) -> list[int]:
    """Return the order in which rows of the old list are removed."""
    last = len(rules) - 1
    return [last - index for index in _sort_rules(rules[::-1], after_jump=False)]


def _sort_rules(rules: Sequence[Rule], *, after_jump: bool) -> list[int]:
    """Sort topologically, and by position if the order is free.

    Within a chain: insertion from the top down, removal from the bottom up. A chain that others jump to counts as if at
    the jump: its rows come after those above the jump and before those below it. If no order satisfies all jumps (two
    chains with crossed calls), the order of the list is used.
    """
    followers: list[list[int]] = [[] for _ in rules]
    waiting = [0] * len(rules)
    for first, then in _edges(rules, after_jump=after_jump):
        followers[first].append(then)
        waiting[then] += 1
    ready = [index for index, count in enumerate(waiting) if not count]
    result: list[int] = []
    queued_indexes = set(ready)
    while len(result) < len(rules):
        if not ready:
            ready.append(next(index for index in range(len(rules)) if index not in queued_indexes))
            queued_indexes.add(ready[0])
        index = heappop(ready)
        result.append(index)
        for follower in followers[index]:
            waiting[follower] -= 1
            if not waiting[follower] and follower not in queued_indexes:
                queued_indexes.add(follower)
                heappush(ready, follower)
    return result


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


_Content = tuple[tuple[str, str], ...]


@dataclass
class _Lists:
    """Old and new list, and the progress of the plan."""

    menu: Menu
    context: _change.Context
    report: _change.MenuPlan
    old: list[_types.Row]
    new: list[RowItem]
    retained_places: dict[int, int] = field(default_factory=dict)
    """Maps the new position of a kept row to its old position."""
    moved_places: set[int] = field(default_factory=set)
    """Old positions of rows that were moved up."""
    insertions: dict[int, list[diff.DiffLine]] = field(default_factory=dict)
    """Lines inserted directly before an old position, in order."""
    spare: dict[_Content, list[int]] = field(default_factory=dict)
    """Old positions of rows that are not kept, ascending."""

    def chain(self, values: Mapping[str, str]) -> str:
        """Return the chain of a row; a menu without chains is one chain."""
        return self.menu.form(self.menu.chain, values) if self.menu.chain else ""

    @cached_property
    def unknown(self) -> frozenset[str]:
        """Properties that cannot be compared: a saved state, or the device, does not show them."""
        hidden_names = frozenset() if self.context.sensitive else self.menu.secrets
        return hidden_names.union(*(item.unknown for item in self.new))

    def content(self, values: Mapping[str, str], *, whole: bool = False) -> _Content:
        """Return the comparable properties that match or decide; `whole` adds the cosmetic ones."""
        return _content(self.menu, {name: values[name] for name in values if name not in self.unknown}, whole=whole)

    def standing(self, place: int) -> int:
        """Return the first old position from `place` on whose row was not moved."""
        while place in self.moved_places:
            place += 1
        return place

    def id_at(self, place: int) -> str | None:
        """Return the `.id` of the row at an old place, None at the end."""
        return self.old[place][".id"] if place < len(self.old) else None


def plan_first_match(
    menu: Menu, items: Iterable[RowItem], rows: Iterable[_types.Row], context: _change.Context
) -> _change.MenuPlan:
    """Plan one first-match menu. Dynamic rows are placed by the device and do not count."""
    lists = _Lists(menu, context, _change.MenuPlan(menu), [row for row in rows if menu.is_touchable(row)], list(items))
    old = [lists.content(row) for row in lists.old]
    new = [lists.content(item.defined_values) for item in lists.new]
    _keep(lists, old, new)
    _insert(lists, new)
    _remove(lists)
    _show(lists)
    _warn(lists)
    return lists.report


def _content(menu: Menu, values: Mapping[str, str], *, whole: bool = False) -> _Content:
    """Return the properties that match or decide, in canonical form; `whole` adds the cosmetic ones."""
    fields = [menu.by_name[name] for name in values if name in menu.by_name]
    content = [
        (each, each.form(values[each.name])) for each in fields if not each.keep and (whole or not each.cosmetic)
    ]
    return tuple(sorted((each.name, form) for each, form in content if form != each.absent))


def _keep(lists: _Lists, old: Sequence[_Content], new: Sequence[_Content]) -> None:
    chains: dict[str, tuple[list[int], list[int]]] = {}
    for place, row in enumerate(lists.old):
        chains.setdefault(lists.chain(row), ([], []))[0].append(place)
    for place, item in enumerate(lists.new):
        chains.setdefault(lists.chain(item.defined_values), ([], []))[1].append(place)
    for olds, news in chains.values():
        lists.retained_places.update(_pairs(lists, old, new, olds, news))
    together = _pairs(lists, old, new, range(len(old)), range(len(new)))
    if len(together) == len(lists.retained_places):
        # Then the order of chains among each other, which only a reader notices, costs nothing either.
        lists.retained_places = together
    staying = set(lists.retained_places.values())
    for place, content in enumerate(old):
        if place not in staying:
            lists.spare.setdefault(content, []).append(place)


def _pairs(
    lists: _Lists, old: Sequence[_Content], new: Sequence[_Content], olds: Sequence[int], news: Sequence[int]
) -> dict[int, int]:
    """Pair positions of the new list with those of kept rows in the old one, ascending in both.

    Rows equal in everything, comments included, come first: among several rows of equal content the comment identifies
    the right one.
    """
    pairs = common(
        [lists.content(lists.old[place], whole=True) for place in olds],
        [lists.content(lists.new[place].defined_values, whole=True) for place in news],
    )
    if len(pairs) < len(news):
        pairs = common([old[place] for place in olds], [new[place] for place in news])
    return {news[j]: olds[i] for i, j in pairs}


def _insert(lists: _Lists, new: Sequence[_Content]) -> None:
    """Process the new list from the top down; `lows` and `highs` limit the positions within a chain."""
    chains = [lists.chain(item.defined_values) for item in lists.new]
    highs = _next_kept(lists, chains)
    lows: dict[str, int] = {}
    cursor = 0
    for place in insertion(_rules(lists, [item.defined_values for item in lists.new], set(lists.retained_places))):
        chain = chains[place]
        if place in lists.retained_places:
            cursor = lists.retained_places[place] + 1
            _cosmetics(lists, lists.new[place], lists.old[lists.retained_places[place]])
        else:
            low = lows.get(chain, 0)
            slot = max(low, min(cursor, highs[place]))
            cursor = _place(lists, place, slot, _liftable(lists, new[place], low))
        lows[chain] = cursor


def _next_kept(lists: _Lists, chains: Sequence[str]) -> dict[int, int]:
    """Return, for every new place, the old place of the next kept row of its chain, or the end."""
    result: dict[int, int] = {}
    following: dict[str, int] = {}
    for place in range(len(chains) - 1, -1, -1):
        result[place] = following.get(chains[place], len(lists.old))
        if place in lists.retained_places:
            following[chains[place]] = lists.retained_places[place]
    return result


def _rules(lists: _Lists, rows: Sequence[Mapping[str, str]], staying: set[int]) -> list[Rule]:
    return [
        Rule(lists.chain(row), row.get("jump-target") if row.get("action") == "jump" else None, place in staying)
        for place, row in enumerate(rows)
    ]


def _liftable(lists: _Lists, content: _Content, low: int) -> int | None:
    """Take an equal row from further down in the old list, if there is one, to be moved up."""
    places = lists.spare.get(content, [])
    place = next((each for each in places if each >= low), None)
    if place is not None:
        places.remove(place)
    return place


def _place(lists: _Lists, place: int, slot: int, lifted_place: int | None) -> int:
    """Add or move the row of a new position before an old one; return where the next row may be."""
    item = lists.new[place]
    anchor = lists.standing(slot if lifted_place is None else min(slot, lifted_place))
    if lifted_place is None:
        lists.report.changes.append(_change.build_addition(lists.menu, item, lists.context.names, lists.id_at(anchor)))
        lists.insertions.setdefault(anchor, []).append(
            diff.DiffLine("+", diff.added_row(lists.menu, item.defined_values))
        )
        return anchor
    row = lists.old[lifted_place]
    if anchor == lifted_place:
        lists.retained_places[place] = lifted_place
        _cosmetics(lists, item, row)
        return lifted_place + 1
    lists.moved_places.add(lifted_place)
    lists.report.changes.append(
        _change.MenuChange(
            lists.menu,
            _types.Verb.MOVE,
            lists.menu.layer,
            lists.menu.name_of(row),
            ids=(row[".id"],),
            before=lists.id_at(anchor),
            line=item.line,
        )
    )
    lists.insertions.setdefault(anchor, []).append(diff.DiffLine("+", diff.added_row(lists.menu, item.defined_values)))
    _cosmetics(lists, item, row)
    return anchor


def _cosmetics(lists: _Lists, item: RowItem, row: _types.Row) -> None:
    """Change the cosmetic properties in place."""
    values = _change.writes(lists.context, lists.report, item, row, is_managed=True)
    menu = lists.menu
    if values:
        name = menu.name_of({**row, **item.defined_values})
        lists.report.changes.append(
            _change.MenuChange(
                menu, _types.Verb.SET, menu.layer, name, ids=(row[".id"],), values=values, line=item.line
            )
        )
    if item.is_marked and not menu.is_ours(row) and not lists.context.is_entire(menu):
        lists.report.notes.append(
            msg(f"{arg(menu.title)}: {arg(menu.name_of(row))} existed without our mark, and becomes ours")
        )


def _remove(lists: _Lists) -> None:
    """Remove rows not in the new list, from the bottom up; foreign rows only if the menu is entirely ours."""
    staying = set(lists.retained_places.values())
    standing = [place for place in range(len(lists.old)) if place not in lists.moved_places]
    going = {place for place in standing if place not in staying and _is_ours(lists, lists.old[place])}
    rules = _rules(
        lists, [lists.old[place] for place in standing], {at for at, place in enumerate(standing) if place not in going}
    )
    order = [standing[at] for at in removal(rules) if standing[at] in going]
    if order:
        lists.report.remove([lists.old[place] for place in order])


def _is_ours(lists: _Lists, row: _types.Row) -> bool:
    return lists.context.is_entire(lists.menu) or lists.menu.is_ours(row)


def _show(lists: _Lists) -> None:
    """Write both lists as one diff: old rows at their positions, new ones where they were inserted."""
    menu, report = lists.menu, lists.report
    items_by_place = {old: lists.new[new] for new, old in lists.retained_places.items()}
    for place in range(len(lists.old) + 1):
        report.lines += lists.insertions.get(place, [])
        if place < len(lists.old):
            report.lines += _diff_row(
                lists, lists.old[place], items_by_place.get(place), has_moved=place in lists.moved_places
            )
    for place, row in enumerate(lists.old):
        if place not in items_by_place and place not in lists.moved_places and not _is_ours(lists, row):
            message = "not in the inventory, and not ours: left unchanged"
            report.drift.append(_types.Drift(menu.path, menu.name_of(row), _types.RowOwner.OTHER, message, row[".id"]))


def _diff_row(lists: _Lists, row: _types.Row, item: RowItem | None, *, has_moved: bool) -> list[diff.DiffLine]:
    text = diff.existing_row(lists.menu, row)
    if item is not None:
        has_changed = any(
            lists.menu.form(name, item.defined_values) != lists.menu.form(name, row) for name in _cosmetic(lists.menu)
        )
        return (
            [diff.DiffLine("-", text), diff.DiffLine("+", diff.added_row(lists.menu, item.defined_values))]
            if has_changed
            else [diff.DiffLine(" ", text)]
        )
    return [diff.DiffLine("-" if has_moved or _is_ours(lists, row) else " ", text)]


def _cosmetic(menu: Menu) -> list[str]:
    return [each.name for each in menu.fields if each.cosmetic]


def _warn(lists: _Lists) -> None:
    """Warn of chains that change together with chains that jump to them, as a packet may meet both changes."""
    staying = set(lists.retained_places.values())
    changed_chains = {lists.chain(lists.old[place]) for place in range(len(lists.old)) if place not in staying}
    changed_chains |= {
        lists.chain(item.defined_values) for place, item in enumerate(lists.new) if place not in lists.retained_places
    }
    for place in staying:
        row = lists.old[place]
        caller, target = lists.chain(row), row.get("jump-target", "")
        if row.get("action") == "jump" and caller != target and {caller, target} <= changed_chains:
            lists.report.notes.append(
                msg(
                    f"{arg(lists.menu.title)}: chain {arg(target)} and its caller {arg(caller)} both change; for a "
                    "moment a packet may meet old rows of one and new rows of the other"
                )
            )
