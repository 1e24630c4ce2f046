"""How plans are cut so that safe mode never overflows, and what that costs."""

import pytest

from atlantis_netcfg.routeros._types import Action, Layer, Plan, Verb
from atlantis_netcfg.routeros.apply._protection import Protection
from atlantis_netcfg.routeros.apply._work import Stages, split_plan

BUDGET = 10


def action(number: int, *, inert: bool = False, layer: Layer = Layer.POLICY, rows: int = 0) -> Action:
    ids = tuple(f"*{each}" for each in range(rows))
    verb = Verb.REMOVE if rows else Verb.ADD
    return Action(number, layer, "/ip/firewall/address-list", verb, str(number), ids=ids, inert=inert)


def plan(*actions: Action) -> Plan:
    return Plan("router", actions, "")


def sizes(stages: Stages) -> tuple[int, list[int], int]:
    weights = [sum(each.weight for each in piece) for piece in stages.pieces]
    return len(stages.prepare), weights, len(stages.finish)


def mixed(named: int, plain: int, naming: int) -> Plan:
    numbers = iter(range(1, 1000))
    return plan(
        *(action(next(numbers), inert=True, layer=Layer.FOUNDATION) for _ in range(named)),
        *(action(next(numbers)) for _ in range(plain)),
        *(action(next(numbers), inert=True) for _ in range(naming)),
    )


@pytest.mark.parametrize(
    ("named", "plain", "naming", "expected"),
    [
        (0, 0, 0, (0, [], 0)),
        (3, 4, 3, (0, [10], 0)),
        (3, 5, 3, (0, [8], 3)),
        (5, 8, 0, (5, [8], 0)),
        (5, 8, 5, (5, [8], 5)),
        (1, 14, 1, (0, [10, 6], 0)),
        (0, 15, 300, (0, [10, 5], 300)),
        (300, 0, 0, (300, [], 0)),
        (0, 35, 0, (0, [10, 10, 10, 5], 0)),
    ],
)
def test_split_uses_the_fewest_round_trips(
    named: int, plain: int, naming: int, expected: tuple[int, list[int], int]
) -> None:
    assert sizes(split_plan(mixed(named, plain, naming), Protection.SAFE_MODE, BUDGET)) == expected


def test_every_action_is_sent_once_and_in_order() -> None:
    whole = mixed(7, 33, 12)
    stages = split_plan(whole, Protection.SAFE_MODE, BUDGET)
    sent = [*stages.prepare, *(each for piece in stages.pieces for each in piece), *stages.finish]
    assert sorted(each.number for each in sent) == [each.number for each in whole.actions]
    assert [each.number for piece in stages.pieces for each in piece] == sorted(
        each.number for piece in stages.pieces for each in piece
    )


def test_action_over_too_many_rows_is_split() -> None:
    stages = split_plan(plan(action(1), action(2, rows=25), action(3)), Protection.SAFE_MODE, BUDGET)
    assert sizes(stages) == (0, [1, 10, 10, 6], 0)
    rows = [row for piece in stages.pieces for each in piece for row in each.ids]
    assert rows == [f"*{each}" for each in range(25)]


def test_without_protection_nothing_is_split() -> None:
    assert sizes(split_plan(mixed(0, 35, 0), Protection.NONE, BUDGET)) == (35, [], 0)
