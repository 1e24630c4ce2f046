"""The promise of first-match menus, for random lists: no packet ever meets a verdict that neither list gives it."""

import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from plan_world import facts

from atlantis_netcfg.routeros._types import Action, Observation, Plan, Row, Verb
from atlantis_netcfg.routeros.desired import DesiredState, RowItem
from atlantis_netcfg.routeros.planner import _firstmatch, after, plan, simulate

FILTER = "/ip/firewall/filter"
PACKETS = range(4)
Rule = dict[str, str]
Rows = tuple[Row, ...]

_ports = st.sets(st.sampled_from(PACKETS), max_size=3).map(lambda ports: ",".join(map(str, sorted(ports))))
_marks = st.sampled_from(("", "atlantis: a", "atlantis: b", "hers"))


def rules(actions: tuple[str, ...], chains: tuple[str, ...]) -> st.SearchStrategy[Rule]:
    return st.fixed_dictionaries(
        {
            "chain": st.sampled_from(chains),
            "action": st.sampled_from(actions),
            "dst-port": _ports,
            "comment": _marks,
            "log": st.sampled_from(("yes", "no")),
        }
    )


def rule_lists(actions: tuple[str, ...], chains: tuple[str, ...]) -> st.SearchStrategy[list[Rule]]:
    return st.lists(rules(actions, chains), max_size=8)


TERMINAL = ("accept", "drop", "log")
plain = rule_lists(TERMINAL, ("input",))
mixed = rule_lists(TERMINAL, ("input", "forward"))


def device(old: list[Rule]) -> Observation:
    dummy: Rule = {".id": "*0", "chain": "input", "action": "passthrough", "dynamic": "true"}
    rows = ({".id": f"*{number}", "dynamic": "false", **rule} for number, rule in enumerate(old, start=1))
    return Observation(facts(), {FILTER: (dummy, *rows)})


def wanted(new: list[Rule], *, entire: bool = True) -> DesiredState:
    items = tuple(RowItem(FILTER, dict(rule), line) for line, rule in enumerate(new, start=1))
    return DesiredState("x.rsc", {FILTER: items}, frozenset({FILTER} if entire else ()))


def single_steps(planned: Plan) -> Iterator[Action]:
    """Every change by itself: a removal of many rows is many moments."""
    for action in planned.actions:
        if action.verb is Verb.REMOVE:
            yield from (replace(action, ids=(each,)) for each in action.ids)
        else:
            yield action


def moments(observed: Observation, planned: Plan) -> Iterator[Rows]:
    rows = dict(observed.rows)
    yield rows[FILTER]
    for action in single_steps(planned):
        rows = after(rows, (action,))
        yield rows[FILTER]


def verdict(rows: Rows, chain: str, packet: int) -> str:
    return decided(rows, chain, packet) or "accept"


def decided(rows: Rows, chain: str, packet: int, depth: int = 0) -> str | None:
    for row in rows:
        ports = row.get("dst-port", "")
        if row["chain"] != chain or (ports and str(packet) not in ports.split(",")):
            continue
        if row["action"] in ("accept", "drop"):
            return row["action"]
        if row["action"] == "return":
            return None
        if row["action"] == "jump" and depth < 4 and (inner := decided(rows, row["jump-target"], packet, depth + 1)):
            return inner
    return None


def content(row: Row) -> tuple[str, ...]:
    return tuple(row.get(name, "") for name in ("chain", "action", "dst-port", "jump-target", "comment", "log"))


def by_chain(rows: list[Row]) -> dict[str, list[tuple[str, ...]]]:
    chains: dict[str, list[tuple[str, ...]]] = {}
    for row in rows:
        chains.setdefault(row["chain"], []).append(content(row))
    return chains


def static(rows: Rows) -> list[Row]:
    return [row for row in rows if row["dynamic"] == "false"]


def check_moments(old: list[Rule], new: list[Rule]) -> Plan:
    observed = device(old)
    planned = plan("r", wanted(new), observed)
    first, *_ = states = list(moments(observed, planned))
    goal = tuple({**rule, "dynamic": "false"} for rule in new)
    for chain in ("input", "forward"):
        for packet in PACKETS:
            allowed = {verdict(first, chain, packet), verdict(goal, chain, packet)}
            assert {verdict(state, chain, packet) for state in states} <= allowed
    assert by_chain(static(states[-1])) == by_chain(list(goal))
    return planned


def longest(old: list[tuple[str, ...]], new: list[tuple[str, ...]]) -> int:
    row = [0] * (len(new) + 1)
    for one in old:
        above, row = row, [0]
        for column, other in enumerate(new):
            row.append(above[column] + 1 if one == other else max(above[column + 1], row[column]))
    return row[-1]


def deciding(rule: Rule) -> tuple[str, ...]:
    return rule["chain"], rule["action"], rule["dst-port"]


@given(plain, plain)
def test_single_chain_is_reached_with_minimal_moves(old: list[Rule], new: list[Rule]) -> None:
    planned = check_moments(old, new)
    final = static(simulate(device(old).rows, planned)[FILTER])
    assert [content(row) for row in final] == [content(rule) for rule in new]
    kept = longest([deciding(rule) for rule in old], [deciding(rule) for rule in new])
    assert sum(action.verb in (Verb.ADD, Verb.MOVE) for action in planned.actions) == len(new) - kept
    assert sum(action.verb is Verb.REMOVE for action in planned.actions) <= 1
    assert sum(action.weight for action in planned.actions if action.verb is Verb.REMOVE) <= len(old) - kept


@given(mixed, mixed)
def test_list_with_several_chains_is_safe_at_every_step(old: list[Rule], new: list[Rule]) -> None:
    check_moments(old, new)


@given(mixed, st.data())
def test_edited_list_matches_the_new_text_order(old: list[Rule], data: st.DataObject) -> None:
    """Drop and insert rows, but do not reorder: then the whole list, not only each chain, is as the text."""
    new = [rule for rule in old if data.draw(st.booleans())]
    fresh = data.draw(st.lists(st.tuples(st.integers(0, 8), st.integers(0, 99)), max_size=4))
    for place, mark in fresh:
        new.insert(
            place,
            {
                "chain": "input",
                "action": "accept",
                "dst-port": "",
                "comment": f"new {mark}",
                "log": "no",
                "src-port": str(mark),
            },
        )
    planned = check_moments(old, new)
    final = static(simulate(device(old).rows, planned)[FILTER])
    distinct = len({(*deciding(rule), rule.get("src-port")) for rule in [*old, *new]}) == len(
        {id(rule) for rule in [*old, *new]}
    )
    if distinct:
        assert [content(row) for row in final] == [content(rule) for rule in new]


jumping = rule_lists((*TERMINAL, "jump"), ("input", "forward"))
called = st.lists(rules((*TERMINAL, "return"), ("x",)), min_size=1, max_size=4)


def with_chain(callers: list[Rule], chain: list[Rule], places: list[int]) -> list[Rule]:
    """The rows of a chain among those of its callers, in their own order."""
    result = [{**rule, "jump-target": "x"} if rule["action"] == "jump" else rule for rule in callers]
    at = sorted(min(place, len(result)) for place in places[: len(chain)])
    for offset, (place, rule) in enumerate(zip(at, chain, strict=False)):
        result.insert(place + offset, rule)
    return result


places = st.lists(st.integers(0, 8), min_size=4, max_size=4)


@given(mixed, jumping, called, places)
def test_chain_can_be_added_and_removed_safely(
    without: list[Rule], callers: list[Rule], chain: list[Rule], at: list[int]
) -> None:
    calling = with_chain(callers, chain, at)
    check_moments(without, calling)
    check_moments(calling, without)


@given(jumping, called, called, places)
def test_chain_can_change_under_its_callers(
    callers: list[Rule], old: list[Rule], new: list[Rule], at: list[int]
) -> None:
    check_moments(with_chain(callers, old, at), with_chain(callers, new, at))


def test_chain_is_inserted_after_its_jump() -> None:
    callers = [_firstmatch.Rule("input", target, stays=False) for target in (None, "x", None)]
    assert _firstmatch.insertion([*callers, *[_firstmatch.Rule("x", None, stays=False)] * 2]) == [0, 1, 3, 4, 2]


@given(mixed, mixed)
def test_foreign_rows_keep_their_places(old: list[Rule], new: list[Rule]) -> None:
    observed = device(old)
    planned = plan("r", wanted(new, entire=False), observed)
    final = static(simulate(observed.rows, planned)[FILTER])
    foreign = [row[".id"] for row in static(observed.rows[FILTER]) if not row["comment"].startswith("atlantis")]
    left = [row[".id"] for row in final if row[".id"] in foreign]
    moved = {each for action in planned.actions if action.verb is Verb.MOVE for each in action.ids}
    assert set(left) == set(foreign)
    assert all(
        foreign.index(one) < foreign.index(two) for one, two in pairwise(each for each in left if each not in moved)
    )
    again = plan("r", wanted(new, entire=False), Observation(observed.facts, simulate(observed.rows, planned)))
    assert again.actions == ()


def lines_run(new: list[Rule], old: list[Rule]) -> int:
    """How many lines of Python planning takes: a measure that no other work on the machine changes."""
    count = 0

    def trace(_frame: object, event: str, _argument: object) -> object:
        nonlocal count
        count += event == "line"
        return trace

    device_, wanted_ = device(old), wanted(new)
    before = sys.gettrace()
    sys.settrace(trace)  # type: ignore[arg-type]
    try:
        plan("r", wanted_, device_)
    finally:
        sys.settrace(before)
    return count


SHUFFLES: dict[str, Callable[[list[Rule]], list[Rule]]] = {
    "the same": lambda old: old,
    "the first gone": lambda old: old[1:],
    "each seventh changed": lambda old: [
        {**rule, "src-address": "192.0.2.1"} if n % 7 == 0 else rule for n, rule in enumerate(old)
    ],
    "upside down": lambda old: old[::-1],
    "cut like cards": lambda old: old[len(old) // 2 :] + old[: len(old) // 2],
}


@pytest.mark.parametrize("name", SHUFFLES)
def test_work_grows_almost_linearly_with_rows(name: str) -> None:
    few, many = (
        [
            {
                "chain": "input",
                "action": "accept",
                "src-address": f"10.{n // 250}.{n % 250}.1",
                "comment": "",
                "log": "no",
            }
            for n in range(count)
        ]
        for count in (150, 600)
    )
    change = SHUFFLES[name]
    assert lines_run(change(many), many) < 4 * 1.6 * lines_run(change(few), few)
