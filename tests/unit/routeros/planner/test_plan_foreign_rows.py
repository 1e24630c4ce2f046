"""Menus with very many rows of others: what a plan counts, and that its work grows with the rows alone."""

from dataclasses import replace

import pytest
from plan_world import observed

from atlantis_netcfg.routeros._types import FEW_FOREIGN, Observation, Row
from atlantis_netcfg.routeros.apply._protection import Protection
from atlantis_netcfg.routeros.apply._state import digest
from atlantis_netcfg.routeros.apply._work import split_plan
from atlantis_netcfg.routeros.desired import read
from atlantis_netcfg.routeros.estimate import LinkMetrics, estimate
from atlantis_netcfg.routeros.guard import ManagementPath, objections
from atlantis_netcfg.routeros.menus import MENUS
from atlantis_netcfg.routeros.planner import plan, simulate
from atlantis_netcfg.routeros.safe_mode import BUDGET

LISTS, FILTER, DNS = "/ip/firewall/address-list", "/ip/firewall/filter", "/ip/dns/static"
ROWS = {
    LISTS: {"list": "sat-allow", "address": "198.18.{}.{}"},
    FILTER: {"chain": "forward", "action": "drop", "src-address": "198.18.{}.{}"},
    DNS: {"name": "h{}-{}.example", "address": "198.18.0.1"},
}
MANY = 122 * BUDGET


def declared(*menus: str) -> str:
    marks = "".join(f"# atlantis:entire {MENUS[menu].title}\n" for menu in menus)
    return (
        marks
        + "".join(f"{MENUS[menu].title}\n" for menu in menus)
        + ('/ip firewall address-list\nadd address=192.0.2.1 comment="atlantis: vpn" list=sat-allow\n')
    )


def there(menu: str, number: int, **more: str) -> Observation:
    found = observed('/ip firewall address-list\nadd address=192.0.2.1 comment="atlantis: vpn" list=sat-allow\n')
    rows: tuple[Row, ...] = tuple(
        {
            ".id": f"*A{each:X}",
            **{name: value.format(each // 250, each % 250) for name, value in ROWS[menu].items()},
            **more,
        }
        for each in range(number)
    )
    return replace(found, rows={**found.rows, menu: (*found.rows[menu], *rows)})


@pytest.mark.parametrize("menu", ROWS)
@pytest.mark.parametrize("number", [1, FEW_FOREIGN, FEW_FOREIGN + 1])
def test_foreign_rows_are_counted_and_reported_above_the_limit(menu: str, number: int) -> None:
    planned = plan("r", read(declared(menu), source="t"), there(menu, number))
    assert (len(planned.actions), planned.weight, planned.foreign_rows) == (1, number, number)
    words = f"removes {number} rows that do not carry our mark: {number} from {MENUS[menu].title}"
    assert planned.foreign_words == (words if number > FEW_FOREIGN else "")
    assert planned.notes == ((f"the plan {words}",) if number > FEW_FOREIGN else ())


def test_foreign_rows_of_several_menus_are_added_up() -> None:
    both = there(LISTS, 60)
    rows = {**both.rows, DNS: there(DNS, 60).rows[DNS]}
    planned = plan("r", read(declared(LISTS, DNS), source="t"), replace(both, rows=rows))
    assert planned.foreign_words == (
        "removes 120 rows that do not carry our mark: 60 from /ip firewall address-list, 60 from /ip dns static"
    )


@pytest.mark.parametrize("menu", ROWS)
def test_rows_with_our_mark_are_not_foreign(menu: str) -> None:
    planned = plan("r", read(declared(menu), source="t"), there(menu, 200, comment="atlantis: former"))
    assert (planned.weight, planned.foreign, planned.foreign_words) == (200, (), "")


@pytest.mark.parametrize("menu", ROWS)
def test_ten_thousand_rows_are_planned_in_linear_time(menu: str) -> None:
    """Nothing here may compare each row with each other: that would be a hundred million steps for each part."""
    found = there(menu, MANY)
    planned = plan("r", read(declared(menu), source="t"), found)
    assert (len(planned.actions), planned.weight, planned.foreign_rows) == (1, MANY, MANY)
    pieces = split_plan(planned, Protection.SAFE_MODE).pieces
    assert [sum(action.weight for action in piece) for piece in pieces] == [BUDGET] * (MANY // BUDGET)
    assert sorted(number for piece in pieces for action in piece for number in action.ids) == sorted(
        row[".id"] for row in found.rows[menu] if row[".id"].startswith("*A")
    )
    assert list(objections(planned, found, ManagementPath("10.64.101.10", "10.64.101.1"))) == []
    after = replace(found, rows=simulate(found.rows, planned))
    assert digest(after) != digest(found)
    assert plan("r", read(declared(menu), source="t"), after).actions == ()
    cost = estimate(planned, LinkMetrics("satellite", 0.7, 352_000, 704_000, is_metered=True), found)
    assert cost.sessions == 1 + MANY // BUDGET - 1 + 1
