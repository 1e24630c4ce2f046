"""What a device's version decides: refusals, which all have a hint, and what is newer than anything known."""

import re
from pathlib import Path

import pytest
from plan_world import facts, lines, observed, rows
from row_subtests import for_each_row

from atlantis_netcfg.core.versions import NEWEST_KNOWN, Version
from atlantis_netcfg.routeros._items import DesiredState, RowItem
from atlantis_netcfg.routeros._types import Observation
from atlantis_netcfg.routeros.desired import read
from atlantis_netcfg.routeros.first_contact import run
from atlantis_netcfg.routeros.menus import MENUS, Shape
from atlantis_netcfg.routeros.planner import CannotPlan, plan
from atlantis_netcfg.vpn import routeros as vpn

SOURCES = Path(__file__).parents[4] / "atlantis_netcfg"
RULES = """/routing rule
add action=lookup comment="atlantis: connected" min-prefix=0 table=main
"""
FIELDS = [(menu.path, field.name) for menu in MENUS.values() for field in menu.fields if field.since or field.until]


def before(version: Version) -> str:
    """The newest version that is older."""
    return f"{version.major}.{version.minor - 1}.9" if version.minor else f"{version.major - 1}.49.18"


def refusal(path: str, version: str, *names: str) -> CannotPlan:
    menu = MENUS[path]
    values: dict[str, str | None] = dict.fromkeys(menu.keys, "x")
    item = RowItem(path, {**values, **dict.fromkeys(names, "1")}, exists=menu.shape is not Shape.LIST, line=1)
    desired = DesiredState("the text", {path: (item,)}, frozenset())
    with pytest.raises(CannotPlan) as refused:
        plan("router", desired, Observation(facts(version), rows("")))
    return refused.value


@pytest.mark.parametrize("path", [path for path, menu in MENUS.items() if menu.since is not None])
def test_a_menu_that_a_version_lacks_is_refused_with_a_hint(path: str) -> None:
    since = MENUS[path].since
    assert since is not None
    refused = refusal(path, before(since))
    assert f"needs RouterOS {since} or later, but this device has" in str(refused)
    assert refused.hint is not None
    assert f"install RouterOS {since} or later on it: `provision device upgrade" in refused.hint


@for_each_row(("path", "name"), FIELDS)
def test_an_argument_that_a_version_lacks_is_refused_with_a_hint(path: str, name: str) -> None:
    field = MENUS[path].by_name[name]
    if field.since is None:
        assert field.until is not None
        refused = refusal(path, str(field.until), name)
        assert refused.hint == "remove what RouterOS no longer has from the named lines of the text"
        return
    refused = refusal(path, before(field.since), name)
    assert f"has `{name}` from RouterOS {field.since} on" in str(refused)
    assert refused.hint is not None
    highest = max(field.since, MENUS[path].since or field.since)
    assert f"install RouterOS {highest} or later on it: `provision device upgrade site=… device=…" in refused.hint
    assert refused.hint.endswith("; or remove the named lines from the text")


@pytest.mark.parametrize("version", ["6.49.18", "7.8", "7.16"])
def test_too_old_vpn_member_is_refused_with_a_hint(version: str) -> None:
    with pytest.raises(vpn.RouterTooOld) as refused:
        vpn.check_version(Version.parse(version))
    assert refused.value.hint == "upgrade it to RouterOS 7.17 or later, then try again"
    vpn.check_version(vpn.SINCE)


COMPARES = re.compile(
    r"[Vv]ersions? (?:[<>]=?|not in) |[<>]=? [\w.]*version\b|(?:if|while|and|or) not [\w.]*has_safe_mode"
)
REFUSALS = {
    "operations/doctor/software.py": "tests/unit/operations/doctor: versions of packages, each with what to type",
    "routeros/first_contact/run.py": "tests/integration/routeros/adopt: every objection has a hint, by its class",
    "routeros/first_contact/steps.py": "refuses nothing: it words a reset, a date and a question",
    "routeros/packages.py": "one error with a hint for all of its reasons",
    "routeros/apply/_change.py": "refuses nothing by version: an older device is saved in another way",
    "routeros/apply/_executor.py": "tests/integration/routeros/engine/test_refusals.py",
    "routeros/menus/_model.py": "refuses nothing: it tells",
    "routeros/pair/_end.py": "tests/integration/routeros/pair/test_pair_versions.py",
    "routeros/planner/__init__.py": "above",
    "vpn/routeros.py": "above",
}
"""Files of the product that compare the version of a device, and who holds that what they refuse has a hint."""


def test_every_version_comparison_is_reviewed() -> None:
    files = (path for path in SOURCES.rglob("*.py") if path.relative_to(SOURCES).parts[0] not in OTHER_VERSIONS)
    found = {
        str(path.relative_to(SOURCES))
        for path in files
        if COMPARES.search(path.read_text("utf-8").replace("self.", ""))
    }
    assert found == set(REFUSALS)


OTHER_VERSIONS = ("emulator", "computers", "ansible_collections")
"""The emulated devices, and parts that know versions of other things than RouterOS."""


def test_objection_requires_a_hint() -> None:
    with pytest.raises(TypeError):
        run.Objection("too old")  # type: ignore[call-arg]


@pytest.mark.parametrize("version", ["7.24.1", "7.25beta1", "7.25", "8.0"])
def test_version_newer_than_known_is_noted(version: str) -> None:
    planned = plan("router", read(RULES, source="the text"), observed("", version))
    assert planned.notes[0] == (
        f"RouterOS {version} is newer than the newest known version, {NEWEST_KNOWN}: later changes have not been "
        "reviewed"
    )
    assert len(planned.actions) == 1


@pytest.mark.parametrize("version", ["6.49.18", "7.16", "7.23.9", "7.24rc4", "7.24"])
def test_known_version_is_not_called_new(version: str) -> None:
    planned = plan("router", read("/system identity\nset name=a\n", source="the text"), observed("", version))
    assert planned.notes == ()


def test_newer_version_is_noted_even_without_changes() -> None:
    planned = plan("router", read(RULES, source="the text"), observed(RULES, "7.25"))
    assert planned.actions == ()
    assert [note[:39] for note in planned.notes] == ["RouterOS 7.25 is newer than the newest "]


@pytest.mark.parametrize("moved", ["chain=main", "chain=vrf-lookup", "realm=5", "vrf=guests"])
def test_rule_of_ours_in_another_chain_is_replaced(moved: str) -> None:
    """From 7.22 on: it would be asked at another moment, or never, and failover stands on it."""
    declared = read("# atlantis:entire /routing rule\n" + RULES, source="the text")
    assert lines(plan("router", declared, observed(RULES.replace("table=main", f"table=main {moved}"), "7.22"))) == [
        '/routing/rule/add action=lookup comment="atlantis: connected" min-prefix=0 table=main place-before=*1',
        "/routing/rule/remove *1",
    ]


@pytest.mark.parametrize("version", ["7.16", "7.21.5", "7.22", "7.24"])
def test_rule_without_a_chain_is_in_the_user_chain(version: str) -> None:
    """Whether the router prints the default or not: nothing is to be done."""
    declared = read("# atlantis:entire /routing rule\n" + RULES, source="the text")
    printed = (
        RULES.replace("table=main", "table=main chain=user") if Version.parse(version) >= Version(7, 22) else RULES
    )
    for text in (RULES, printed):
        assert plan("router", declared, observed(text, version)).actions == ()


WIFI = "/interface wifi\nset [ find default-name=wifi1 ] configuration.installation=outdoor\n"


@pytest.mark.parametrize("version", ["7.17", "7.18", "7.24"])
def test_cpe_radio_is_planned_from_7_17_on(version: str) -> None:
    seen = observed("/interface wifi\nset [ find default-name=wifi1 ] name=wifi1\n", version)
    assert lines(plan("cpe", read(WIFI, source="the text"), seen)) == [
        "/interface/wifi/set *1 configuration.installation=outdoor"
    ]


def test_cpe_radio_is_refused_before_7_17() -> None:
    seen = observed("/interface wifi\nset [ find default-name=wifi1 ] name=wifi1\n", "7.16.2")
    with pytest.raises(CannotPlan, match=r"from RouterOS 7\.17 on, but this device has 7\.16\.2") as refused:
        plan("cpe", read(WIFI, source="the text"), seen)
    assert refused.value.hint is not None
    assert refused.value.hint.startswith("install RouterOS 7.17 or later on it: `provision device upgrade")
