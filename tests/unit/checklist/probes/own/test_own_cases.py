import ast
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import yaml
from own_broken import BROKEN
from own_world import SITE, World, declaration, own_steps
from row_subtests import for_each_row

from atlantis_netcfg.checklist.probes import Cell, Step, site_checks
from atlantis_netcfg.checklist.probes.site_checks import NAMES, steps
from atlantis_netcfg.checklist.report import ItemKind, Phase
from atlantis_netcfg.inventory.model import OperatorStation

LISTED: dict[str, dict[str, list[str]]] = yaml.safe_load(
    (Path(__file__).parent / "own_cases.yml").read_text(encoding="utf-8")
)
OTHERWISE = {"address-by-hand", "draw-untold", "file-differs", "no-fault", "not-the-best", "server-not-asked"}
"""Codes of sites that are declared otherwise: test_own_declared.py."""
AT_THE_CENTRE = {"gateway-silent"}
"""Codes of the control centre's site: test_own_centre.py."""
OF_AN_ACCESS_POINT = {
    *("network-closed", "network-not-yet-open", "network-open", "other-channel", "other-network"),
    *("radio-missing", "stations", "unknown-station"),
}
"""Of a gateway that opens a network: test_own_access_point.py."""
OF_A_MEASURED_LINK = {
    *("beyond-the-limit", "cut-short", "emulated", "never-measured", "not-proved", "not-readable", "of-the-future"),
    *("other-far-end", "other-kind", "other-link", "qualified", "stale", "way-not-proved"),
}
"""Of links that were measured: test_own_link_qualified.py."""


@for_each_row("name", list(BROKEN))
def test_exactly_the_fault_is_reported(name: str) -> None:
    assert BROKEN[name]().findings() == {**LISTED["healthy"], **LISTED[name]}


def test_every_case_and_every_code_is_listed() -> None:
    assert list(LISTED) == list(BROKEN)
    told = {line.split(" ")[1].rstrip(":") for case in LISTED.values() for lines in case.values() for line in lines}
    assert told | OTHERWISE | AT_THE_CENTRE | OF_AN_ACCESS_POINT | OF_A_MEASURED_LINK == set(codes())


def codes() -> Iterator[str]:
    """The first argument of every call that makes a finding; those for a trouble stand in a table."""
    for path in sorted(Path(site_checks.__path__[0]).glob("*.py")):
        calls = (node for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(node, ast.Call))
        for call in calls:
            name = ast.unparse(call.func).rpartition(".")[2]
            if name in {"good", "warn", "fail", "unknown"} and isinstance(call.args[0], ast.Constant):
                yield str(call.args[0].value)
    yield from ("router-tunnel", "router-tunnel-address", "gateway-tunnel", "gateway-tunnel-address")
    yield "answered-twice"  # of every ping
    yield from ("not-reached", "no-answer", "denied", "no-program", "in-use")


def test_all_checks_are_automatic_and_have_their_item() -> None:
    assert tuple(step.name for step in own_steps()) == NAMES
    assert {(step.kind, step.phase) for step in own_steps()} == {(ItemKind.AUTOMATIC, Phase.BENCH)}
    assert all("coastal-" in " ".join(step.concerns) for step in own_steps())


def of(site: str) -> tuple[Step, ...]:
    return steps(Cell(declaration(), site, None, "site"))


def test_undeclared_parts_of_a_site_are_skipped_by_name() -> None:
    skipped = {step.name: step.unless for step in of("scc") if step.unless}
    assert skipped == {"satellite-filter": "the site has no satellite"}
    assert [step.name for step in of("te4sea") if step.unless] == []


def test_site_without_a_gateway_is_checked_from_the_control_centre() -> None:
    assert not [step.name for step in of("scc") if step.kind is ItemKind.PERSON]
    found = {step.name: step for step in of("scc")}
    assert found["dds"].title == "DDS responds on the control centre"
    assert all(
        "scc-control" in found[name].concerns for name in ("rogue-dhcp", "rogue-router", "vpn", "dds", "certificates")
    )


def test_checks_without_a_usable_computer_are_for_a_person() -> None:
    """A site whose only computer is an operator's: its programs are not ours to ask."""
    control = declaration().hosts["scc-control"]
    kept = control.device.model_dump(include={"mac", "address", "vpn_address"})
    operators = OperatorStation.model_validate({"kind": "operator_station", **kept})
    hosts = {**declaration().hosts, control.name: replace(control, device=operators)}
    every = steps(Cell(replace(declaration(), hosts=hosts), "scc", None, "site"))
    found = {step.name: step for step in every if step.kind is ItemKind.PERSON}
    assert set(found) == {"rogue-dhcp", "rogue-router", "vpn", "dds", "data-reaches-scc"}
    assert "no gateway computer and no control centre" in found["rogue-dhcp"].do
    assert found["rogue-dhcp"].look_for == "Only the router offers addresses: 10.64.0.1."
    assert found["vpn"].do.startswith("On scc-vpn and scc-control, ")
    assert "scc-control has 10.80.0.2" in found["vpn"].look_for
    assert found["dds"].do.startswith("On a computer at scc, ")
    assert all(step.do and step.look_for and step.concerns for step in found.values())


def test_vpn_and_dds_items_remain_if_undeclared() -> None:
    hosts = {name: host for name, host in declaration().hosts.items() if name != "scc-control"}
    server = hosts["scc-vpn"]
    hosts["scc-vpn"] = replace(server, device=server.device.model_copy(update={"vpn_address": None}))
    pilot = declaration().pilot.model_copy(update={"qualify": None})
    silent = pilot.model_copy(update={"dds": None})
    for whole in (replace(declaration(), hosts=hosts, pilot=each) for each in (pilot, silent)):
        found = {step.name: step for step in steps(Cell(whole, "scc", None, "site"))}
        assert {found[name].kind for name in ("vpn", "dds")} == {ItemKind.PERSON}
        assert not [name for name in ("vpn", "dds") if found[name].unless]
    assert "The inventory has no device of scc in the VPN" in found["vpn"].do
    assert "The inventory has no DDS" in found["dds"].do


def test_site_without_a_router_still_has_every_item() -> None:
    hosts = {name: host for name, host in declaration().hosts.items() if name != f"{SITE}-router"}
    without = replace(declaration(), hosts=hosts)
    found = steps(Cell(without, SITE, None, "site"))
    assert tuple(step.name for step in found) == NAMES
    assert {step.kind for step in found} == {ItemKind.PERSON}, "the site has a satellite, and boxes that are fed"
    assert all("the site has no router in the inventory that could be queried." in step.do for step in found)


def test_evidence_names_device_and_value_and_no_secret() -> None:
    world = World()
    every = [one for step in own_steps() for one in world.judged(step).evidence]
    assert all(one.what and one.value for one in every)
    assert not [one for one in every if "EXAMPLE-" in one.value or "PRIVATE" in one.value]
    assert "ether2 of coastal-router: powered-on" in " / ".join(f"{one.what}: {one.value}" for one in every)
