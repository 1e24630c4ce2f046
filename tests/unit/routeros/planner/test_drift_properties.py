"""For any declaration and any device: what is told is what a run would do, and a state that is written can be read."""

import json
from datetime import UTC, datetime

import pytest
from hypothesis import given, reject, settings
from hypothesis import strategies as st
from test_planner_properties import LISTS, declared, device, lists_of

from atlantis_netcfg.routeros import snapshot
from atlantis_netcfg.routeros._types import Observation, Verb
from atlantis_netcfg.routeros.drift import Comparison, DriftKind, Past, Since, compare
from atlantis_netcfg.routeros.menus import Menu
from atlantis_netcfg.routeros.planner import CannotPlan, plan, simulate
from atlantis_netcfg.runs.report.drift import drift_lines

AT = datetime(2026, 5, 4, 3, 2, 1, tzinfo=UTC)
EXPORTED = [menu for menu in LISTS if menu.is_exported]


def kinds(found: Comparison) -> list[DriftKind]:
    return [one.kind for one in found.differences]


@pytest.mark.smoke(
    "/system/logging", "/interface/wireless/access-list", "/ip/address", "/ip/firewall/filter", "/ip/route"
)
@pytest.mark.parametrize("menu", EXPORTED, ids=lambda menu: menu.path)
@settings(max_examples=15)
@given(data=st.data(), entire=st.booleans())
def test_drift_equals_what_a_run_would_change(menu: Menu, data: st.DataObject, *, entire: bool) -> None:
    observed = device(menu, data.draw(lists_of(menu)))
    desired = declared(menu, data.draw(lists_of(menu)), entire=entire)
    try:
        planned = plan("r", desired, observed)
    except CannotPlan:
        reject()
    past = Past.read("RUN", AT, snapshot.write("r", desired, observed))
    found = compare(desired, observed, planned, past)
    told = drift_lines(json.loads(json.dumps(found.as_dict())))
    assert bool(told) == bool(planned.actions or planned.drift or planned.hidden_secrets)

    count = {verb: sum(len(one.ids) or 1 for one in planned.actions if one.verb is verb) for verb in Verb}
    whole = kinds(found).count(DriftKind.MISSING) + kinds(found).count(DriftKind.ADDED)
    assert whole <= count[Verb.ADD] + count[Verb.REMOVE]
    assert kinds(found).count(DriftKind.FOREIGN) == len(planned.drift)
    assert len(found.differences) <= sum(count.values()) + len(planned.drift) + len(planned.hidden_secrets)
    assert len(set(map(str, found.differences))) > 0 or not found.differences

    later = Observation(observed.facts, simulate(observed.rows, planned))
    after = compare(desired, later, plan("r", desired, later), past)
    assert set(kinds(after)) <= {DriftKind.FOREIGN, DriftKind.HIDDEN}


@pytest.mark.smoke(
    "/system/logging", "/interface/wireless/access-list", "/ip/address", "/ip/firewall/filter", "/ip/route"
)
@pytest.mark.parametrize("menu", EXPORTED, ids=lambda menu: menu.path)
@settings(max_examples=15)
@given(data=st.data(), entire=st.booleans())
def test_unchanged_device_has_no_changes_since_confirmation(menu: Menu, data: st.DataObject, *, entire: bool) -> None:
    """Whatever is declared by now: a device that is as it was has never changed since then."""
    observed = device(menu, data.draw(lists_of(menu)))
    desired = declared(menu, data.draw(lists_of(menu)), entire=entire)
    try:
        planned = plan("r", desired, observed)
    except CannotPlan:
        reject()
    past = Past.read("RUN", AT, snapshot.write("r", desired, observed))
    found = compare(desired, observed, planned, past).differences
    assert {one.since for one in found if one.kind is not DriftKind.MISSING} <= {Since.ALREADY, Since.UNKNOWN}


@pytest.mark.smoke(
    "/system/logging", "/interface/wireless/access-list", "/ip/address", "/ip/firewall/filter", "/ip/route"
)
@pytest.mark.parametrize("menu", EXPORTED, ids=lambda menu: menu.path)
@settings(max_examples=15)
@given(data=st.data())
def test_device_matches_its_own_snapshot(menu: Menu, data: st.DataObject) -> None:
    rows = data.draw(lists_of(menu))
    observed = device(menu, rows)
    nothing = declared(menu, [], entire=False)
    state = snapshot.read(snapshot.write("r", nothing, observed), "state")
    try:
        planned = plan("r", state, observed)
    except CannotPlan:
        reject()
    assert planned.actions == (), (state.notes, planned.diff)
