"""For any declaration and any device: a plan leads to what is declared, and touches nothing else."""

from collections import Counter

import pytest
from hypothesis import given, reject
from hypothesis import strategies as st
from plan_world import facts

from atlantis_netcfg.core.versions import Version
from atlantis_netcfg.routeros._types import Layer, Observation, Plan, Row, Verb
from atlantis_netcfg.routeros.commands import console, sentence
from atlantis_netcfg.routeros.desired import DesiredState, RowItem
from atlantis_netcfg.routeros.menus import MENUS, Field, Menu, PropertyKind, Shape
from atlantis_netcfg.routeros.planner import CannotPlan, after, plan, simulate

VERSION = Version(7, 18, 2)

_TEXTS: dict[PropertyKind, tuple[str, ...]] = {
    PropertyKind.TEXT: ("a", "b", "", 'c "$d"'),
    PropertyKind.BOOLEAN: ("yes", "no", "true", "false"),
    PropertyKind.FLAG: ("", "no"),
    PropertyKind.NUMBER: ("1", "0x1", "2"),
    PropertyKind.TIME: ("10m", "600s", "00:10:00", "1d"),
    PropertyKind.SIZE: ("1024", "1MiB", "2MiB"),
    PropertyKind.RATE: ("280k", "280000", "1M"),
    PropertyKind.MAC: ("02:00:00:00:00:0a", "02:00:00:00:00:0A", "02:00:00:00:00:0B"),
    PropertyKind.PREFIX: ("10.0.0.1", "10.0.0.1/32", "10.0.0.1/24", "10.0.0.2"),
    PropertyKind.NETWORK: ("10.0.0.0/24", "10.0.0.5/24", "10.1.0.0/16"),
    PropertyKind.SET: ("x,y", "y,x", "z", "!x,y"),
    PropertyKind.PREFIXES: ("10.0.0.1,10.0.0.2", "10.0.0.2/32,10.0.0.1", ""),
    PropertyKind.SEQUENCE: ("x,y", "y,x", ""),
    PropertyKind.POLICY: ("read,write", "write,read,!ftp", "read"),
    PropertyKind.INTERFACE: ("ether1", "ether2", "!ether1"),
    PropertyKind.GATEWAY: ("10.0.0.9", "ether1", "10.0.0.9%ether2"),
}
_COMMENTS = ("atlantis: a", "atlantis: b", "hers", "")


def texts(field: Field) -> tuple[str, ...]:
    return _COMMENTS if field.name == "comment" else _TEXTS[field.kind]


def writable(menu: Menu) -> list[Field]:
    return [each for each in menu.fields if each.exists(VERSION) and not each.board and each.name not in menu.keys]


@st.composite
def rows_of(draw: st.DrawFn, menu: Menu) -> dict[str, str]:
    values = {key: draw(st.sampled_from(texts(menu.by_name[key]))) for key in menu.keys}
    chosen = draw(st.lists(st.sampled_from(writable(menu)), max_size=4, unique_by=lambda each: each.name))
    return values | {each.name: draw(st.sampled_from(texts(each))) for each in chosen}


def is_new(menu: Menu, row: Row, rows: list[dict[str, str]]) -> bool:
    """Could the device hold this row beside the others."""
    if menu.is_ordered:
        return True
    once = [menu.keys, *((name,) for name in menu.unique)]
    return not any(clash(menu, names, row, other) for names in once for other in rows)


def clash(menu: Menu, names: tuple[str, ...], one: Row, other: Row) -> bool:
    values = [[menu.form(name, row) for name in names] for row in (one, other)]
    return values[0] == values[1] and (names == menu.keys or any(one.get(name) for name in names))


@st.composite
def lists_of(draw: st.DrawFn, menu: Menu) -> list[dict[str, str]]:
    rows: list[dict[str, str]] = []
    for row in draw(st.lists(rows_of(menu), max_size=5)):
        if is_new(menu, row, rows):
            rows.append(row)
    return rows


def device(menu: Menu, rows: list[dict[str, str]]) -> Observation:
    found = tuple({".id": f"*{number}", **row} for number, row in enumerate(rows, start=1))
    return Observation(facts(str(VERSION)), {menu.path: found})


def declared(menu: Menu, rows: list[dict[str, str]], *, entire: bool, restores: bool = False) -> DesiredState:
    items = tuple(RowItem(menu.path, dict(row), line) for line, row in enumerate(rows, start=1))
    return DesiredState("x.rsc", {menu.path: items}, frozenset({menu.path} if entire else ()), restores=restores)


LISTS = [menu for menu in MENUS.values() if menu.shape is Shape.LIST and not menu.readonly]


@pytest.mark.smoke(
    "/system/logging", "/interface/wireless/access-list", "/ip/address", "/ip/firewall/filter", "/ip/route"
)
@pytest.mark.parametrize("menu", LISTS, ids=lambda menu: menu.path)
@given(data=st.data(), entire=st.booleans(), restores=st.booleans())
def test_plan_reaches_the_desired_state(menu: Menu, data: st.DataObject, *, entire: bool, restores: bool) -> None:
    observed = device(menu, data.draw(lists_of(menu)))
    desired = declared(menu, data.draw(lists_of(menu)), entire=entire, restores=restores and entire)
    try:
        planned = plan("r", desired, observed)
    except CannotPlan:
        reject()
    later = Observation(observed.facts, simulate(observed.rows, planned))
    assert plan("r", desired, later).actions == ()
    check_foreign_rows(menu, desired, observed, planned)
    check_values_that_exist_once(menu, observed, planned)
    check_order(planned)


def check_foreign_rows(menu: Menu, desired: DesiredState, observed: Observation, planned: Plan) -> None:
    removed = {each for action in planned.actions if action.verb is Verb.REMOVE for each in action.ids}
    gone = [row for row in observed.rows[menu.path] if row[".id"] in removed]
    replaced = {item.identity for item in desired.items[menu.path]} if menu.unique else set()
    entire = menu.path in desired.entire
    assert entire or all(menu.is_ours(row) or menu.identity(row) in replaced for row in gone)
    assert not any(menu.is_stock(row) for row in gone)


def check_values_that_exist_once(menu: Menu, observed: Observation, planned: Plan) -> None:
    rows = dict(observed.rows)
    for action in planned.actions:
        rows = after(rows, (action,))
        for names in [(name,) for name in menu.unique] + ([menu.keys] if menu.unique else []):
            values = [tuple(menu.form(name, row) for name in names) for row in rows[menu.path] if row.get(names[0])]
            assert max(Counter(values).values(), default=1) == 1


def check_order(planned: Plan) -> None:
    layers = [action.layer for action in planned.actions]
    assert layers == sorted(layers)
    last = [action.verb is Verb.REMOVE for action in planned.actions if action.layer is Layer.CLEANUP]
    assert last == sorted(last)
    for action in planned.actions:
        assert "\n" not in console(action)
        assert sentence(action)[0] == f"{action.menu}/{action.verb}"


SETTINGS = [menu for menu in MENUS.values() if menu.shape is Shape.SINGLETON]


@pytest.mark.smoke("/system/clock", "/ip/dns", "/snmp")
@pytest.mark.parametrize("menu", SETTINGS, ids=lambda menu: menu.path)
@given(data=st.data(), restores=st.booleans())
def test_settings_reach_the_desired_state(menu: Menu, data: st.DataObject, *, restores: bool) -> None:
    row, wanted = data.draw(rows_of(menu)), data.draw(rows_of(menu))
    observed = Observation(facts(str(VERSION)), {menu.path: (row,)})
    desired = declared(menu, [wanted], entire=restores, restores=restores)
    planned = plan("r", desired, observed)
    (final,) = simulate(observed.rows, planned)[menu.path]
    assert {name: menu.form(name, final) for name in wanted} == {name: menu.form(name, wanted) for name in wanted}
    untouched = set(row) - set(wanted)
    assert restores or all(final[name] == row[name] for name in untouched)
    assert plan("r", desired, Observation(observed.facts, {menu.path: (final,)})).actions == ()
