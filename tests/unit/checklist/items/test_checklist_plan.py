"""The list is Table 3, whole: no X of it drops out, whatever is declared, and whatever a column has to say."""

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from atlantis_netcfg.checklist import Answers, Checklist, Scope, plan
from atlantis_netcfg.checklist.plan import drawing
from atlantis_netcfg.checklist.probes import registry
from atlantis_netcfg.checklist.report import ItemKind, Phase
from atlantis_netcfg.core.errors import ExitCode, NoMatchError
from atlantis_netcfg.inventory import Inventory
from atlantis_netcfg.inventory.model import Column, Endpoints

ROOT = Path(__file__).parents[4]
ANSWERS = ROOT / "tests" / "data" / "answers" / "coastal.yml"
PROBES = ROOT / "docs" / "engineers" / "probes.md"
COPY = Path(__file__).with_name("table3.md")
ORIGINAL = ROOT.parent / "shared" / "facts" / "pilot.md"
"""Where the facts lie beside the checkout, the copy is compared with them."""
TITLES = {"WiFi": "wifi", "Acoustic": "acoustic", "Satellite": "satellite", "USBL": "usbl", "RC RF": "rc_rf"} | {
    "4G": "4g",
    "GPS": "gps",
}
Cells = dict[str, dict[str, bool]]


def _written(path: Path) -> Cells:
    """The table as it is written down: vehicle, column, whether it is marked."""
    lines = path.read_text(encoding="utf-8").splitlines()
    first = next(number for number, line in enumerate(lines) if line.startswith("| Vehicle | WiFi |"))
    head, _, *rows = (line for line in lines[first : first + 8])
    titles = [TITLES[cell.strip()] for cell in head.strip("|").split("|")[1:]]
    table: Cells = {}
    for row in rows:
        name, *cells = (cell.strip() for cell in row.strip("|").split("|"))
        table[name] = {title: cell == "x" for title, cell in zip(titles, cells, strict=True)}
    return table


def test_a_drawn_vehicle_has_its_own_items_and_the_vpn_those_of_the_site(
    declaration: Inventory, coastal: Checklist
) -> None:
    drawn = drawing(declaration, coastal)
    items = {node.key: set(node.items) for node in drawn.nodes if node.kind == "vehicle"}
    expected: dict[str, set[str]] = {}
    for entry in coastal.entries:
        if entry.item.vehicle is not None:
            expected.setdefault(entry.item.vehicle, set()).add(entry.item.id)
    assert items == expected
    (vpn,) = [link for link in drawn.links if link.kind == "vpn" and link.items]
    assert set(vpn.items) <= {entry.item.id for entry in coastal.entries if entry.item.vehicle is None}


@pytest.fixture(scope="module")
def coastal(declaration: Inventory) -> Checklist:
    return plan(declaration, "coastal")


def _planned(listed: Checklist) -> Cells:
    """The grid as it is planned: a cell is marked where at least one item of it is of the table."""
    found = {(one.item.vehicle, one.item.endpoint) for one in listed.entries if one.item.table3}
    vehicles = [row for row in listed.rows if row.kind != "location"]
    return {row.name: {column: (row.key, column) in found for column in listed.columns} for row in vehicles}


def test_plan_matches_table_3_cell_by_cell(declaration: Inventory) -> None:
    table = _written(COPY)
    assert sum(sum(row.values()) for row in table.values()) == 20
    for site in ("coastal", "te4sea"):
        listed = plan(declaration, site)
        assert _planned(listed) == table
        assert list(_planned(listed)) == list(table)
        assert list(listed.columns) == list(TITLES.values())
    if ORIGINAL.exists():
        assert _written(ORIGINAL) == table


def test_items_beside_the_table_are_not_part_of_it(coastal: Checklist) -> None:
    for row in coastal.rows:
        of_row = [one.item for one in coastal.entries if (one.item.vehicle or one.item.location) == row.key]
        assert {item.endpoint for item in of_row if item.table3} == set(row.table3)
        assert {item.endpoint for item in of_row if not item.table3} == set(row.beside)
    assert [row.key for row in coastal.rows if "ethernet" in row.beside] == ["eca-rov"]
    assert coastal.rows[-1].kind == "location"
    assert set(coastal.rows[-1].beside) == {"wifi", "satellite", "4g", "site", "robot", "items"}
    assert [row.key for row in coastal.rows if "robot" in row.beside] == [*VEHICLES, "coastal"]
    assert [row.key for row in coastal.rows if "items" in row.beside] == ["mares", "coastal"]


def test_row_of_a_location_follows_the_inventory(declaration: Inventory) -> None:
    site = declaration.sites["coastal"]
    marked = site.location.model_copy(update={"table3": (Column.SATELLITE, Column.GPS)})
    sites = {**declaration.sites, "coastal": site.model_copy(update={"location": marked})}
    listed = plan(replace(declaration, sites=sites), "coastal")
    items = [one.item for one in listed.entries if one.item.vehicle is None]
    assert {item.endpoint for item in items if item.table3} == {"satellite", "gps"}


def _partners(declaration: Inventory, **partners: str | None) -> Inventory:
    changed = {
        key: vehicle.model_copy(update={"partner": partners[key]})
        for key, vehicle in declaration.vehicles.items()
        if key in partners
    }
    return replace(declaration, vehicles=changed)


@pytest.mark.parametrize(
    ("partners", "told"),
    [
        ({"zarco": "inesc", "eca-rov": "eca"}, "Zarco (inesc), ECA ROV (eca)"),
        ({"zarco": "inesc", "mares": None}, "Zarco (inesc), Mares (partner not in the inventory)"),
        (
            {"sparus": None, "mares": None},
            "Sparus (partner not in the inventory), Mares (partner not in the inventory)",
        ),
        ({"zarco": "inesc", "stork": "inesc"}, ""),
        ({"mares": None}, ""),
        ({}, ""),
    ],
)
def test_robots_not_isolated_in_a_lan_are_noted(
    declaration: Inventory, partners: dict[str, str | None], told: str
) -> None:
    notes = plan(_partners(declaration, **partners), "coastal", Scope(endpoints=("site",))).notes
    found = [note for note in notes if "neighbours in the LAN of coastal reach each other" in note]
    assert len(found) == bool(told)
    assert all(f" {told}." in note for note in found)


def test_lan_without_robots_needs_no_isolation_note(declaration: Inventory) -> None:
    """A robot with an address in another LAN is nobody's neighbour here."""
    assert not plan(declaration, "scc").notes
    assert plan(declaration, "coastal").notes


def test_every_probe_has_its_documented_weakness(declaration: Inventory) -> None:
    """docs/engineers/probes.md has a row for each probe of the pilot's lists and for no other; no cell is empty."""
    entries = [
        one for site in declaration.sites for one in plan(declaration, site).entries if one.step.probe is not None
    ]
    registered = {
        re.sub(r"(site/link-qualified)-.*", r"\1", one.item.id.partition("/")[2]) for one in entries
    }  # one for each link
    rows = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in PROBES.read_text(encoding="utf-8").splitlines()
        if line.startswith("| `")
    ]
    assert all(len(cells) == 3 and all(cells) for cells in rows)
    registered.add("site/access-point")  # of a gateway that opens a network: the pilot's join the vehicles' ones
    registered.add("site/link-qualified")  # where measurements are declared
    assert {item.strip("`") for cells in rows for item in cells[0].split(", ")} == registered


def test_item_ids_are_unique(coastal: Checklist) -> None:
    ids = [one.item.id for one in coastal.entries]
    assert len(set(ids)) == len(ids)
    for one in coastal.entries:
        assert one.item.open is (not one.step.unless)
        if one.step.kind is ItemKind.PERSON and not one.step.unless:
            assert one.step.do or one.item.endpoint == "items", "what is declared has its text alone"
            assert one.step.look_for


def _thinned(declaration: Inventory, gone: dict[str, set[str]]) -> Inventory:
    thin = {}
    for key, vehicle in declaration.vehicles.items():
        nothing = dict.fromkeys(gone.get(key, set()))
        thin[key] = vehicle.model_copy(update={"endpoints": vehicle.endpoints.model_copy(update=nothing)})
    return replace(declaration, vehicles=thin)


VEHICLES = ("girona500", "sparus", "zarco", "stork", "mares", "eca-rov")


@settings(max_examples=40)
@given(
    gone=st.dictionaries(st.sampled_from(VEHICLES), st.sets(st.sampled_from(sorted(Endpoints.model_fields)))),
    mute=st.sets(st.sampled_from(list(registry.TITLES))),
    silent_site=st.booleans(),
)
def test_every_table_cell_has_an_item_for_any_inventory(
    declaration: Inventory, gone: dict[str, set[str]], mute: set[str], *, silent_site: bool
) -> None:
    """Endpoints that are not declared, columns that have nothing to say: a person is left."""
    said = registry._STEPS
    quiet = {name: (lambda _: ()) if name in mute else steps for name, steps in said.items()}
    with patch.object(registry, "_STEPS", quiet):
        listed = plan(_thinned(declaration, gone), "te4sea" if silent_site else "coastal")
    assert _planned(listed) == _written(COPY)
    for row in listed.rows:
        endpoints = {one.item.endpoint for one in listed.entries if (one.item.vehicle or one.item.location) == row.key}
        assert endpoints == {*row.table3, *row.beside}
    for one in listed.entries:
        if one.item.endpoint in mute:
            assert (one.item.kind, one.item.open) == (ItemKind.PERSON, True)


ROBOT = ("vpn", "discovered", "control-centre", "telemetry", "pose", "rates")


@pytest.mark.parametrize(
    ("scope", "ids", "beyond"),
    [
        (Scope(vehicles=("stork",), endpoints=("gps",)), {"stork/gps"}, "excluded by `vehicle=stork endpoint=gps`"),
        (
            Scope(vehicles=("eca-rov",)),
            {"eca-rov/usbl", "eca-rov/ethernet", *(f"eca-rov/robot/{item}" for item in ROBOT)},
            "excluded by `vehicle=eca-rov`",
        ),
    ],
    ids=["cell", "vehicle"],
)
def test_scope_narrows_and_reports_what_it_omits(
    declaration: Inventory, coastal: Checklist, scope: Scope, ids: set[str], beyond: str
) -> None:
    listed = plan(declaration, "coastal", scope)
    assert {one.item.id for one in listed.entries} == ids
    later = {name for name in listed.beyond if name.partition("/")[2].startswith("integration/")}
    assert {name.partition("/")[0] for name in later} == {*VEHICLES}, "each has a record of its own"
    assert {*listed.beyond, *ids} - later == {one.item.id for one in coastal.entries} | {"mares/items/rinsed"}
    assert {one.why for one in listed.left_out} == {beyond}
    assert {"Mares: GPS", "Coastal testbed: Site"} <= {one.what for one in listed.left_out}
    assert coastal.left_out == ()


def test_phases_together_are_the_whole_list(declaration: Inventory, coastal: Checklist) -> None:
    parts = [plan(declaration, "coastal", Scope(phases=(phase,))) for phase in Phase if not phase.is_alone]
    together = [one.item.id for part in parts for one in part.entries]
    assert sorted(together) == sorted(one.item.id for one in coastal.entries)


@pytest.mark.parametrize(
    ("site", "scope", "message", "hint"),
    [
        ("costal", Scope(), "unknown site `costal`", "did you mean `coastal`? choose one of: scc, coastal, te4sea"),
        (
            "coastal",
            Scope(vehicles=("spartus",)),
            "unknown vehicle `spartus`",
            "did you mean `sparus`? choose one of: ",
        ),
        (
            "coastal",
            Scope(endpoints=("lte",)),
            "unknown endpoint `lte`",
            "choose one of: wifi, acoustic, satellite",
        ),
        ("scc", Scope(vehicles=("sparus",)), "`sparus` is not tested at scc", "its vehicles are: none; "),
        (
            "coastal",
            Scope(vehicles=("stork",), endpoints=("usbl",)),
            "no item of the checklist is left",
            "remove an argument: ",
        ),
    ],
)
def test_unknown_site_or_scope_is_refused(
    declaration: Inventory, site: str, scope: Scope, message: str, hint: str
) -> None:
    with pytest.raises(NoMatchError) as error:
        plan(declaration, site, scope)
    assert str(error.value) == message
    assert (error.value.hint or "").startswith(hint)
    assert error.value.exit is ExitCode.NOTHING


def test_shipped_answers_are_complete(coastal: Checklist) -> None:
    """Whoever gives a column a step for a person, or one that needs consent, answers it in tests/data/answers."""
    answers = Answers.read(ANSWERS, coastal)
    for one in coastal.entries:
        name, kind = one.item.id, one.item.kind
        if kind is ItemKind.PERSON and one.item.open:
            assert answers.confirmations.get(name) is not None, f"no answer to {name} in {ANSWERS.name}"
        if kind is ItemKind.ACTIVE and one.item.open:
            agreed = answers.consents(name) or answers.confirmations.get(name)
            assert agreed is not None, f"no consent to {name} in {ANSWERS.name}"
    assert answers.sign_by == "A. Technician"


_DECLARED: Mapping[str, tuple[dict[str, object], ...]] = {
    "wifi": ({"role": "station"}, {"role": "access_point"}, {"role": "station", "seen_by": "coastal-router"}),
    "acoustic": (
        {"driver": "evologics", "acoustic_address": 3, "partner": 4},
        {"driver": "seatrac", "device": "/dev/ttyUSB0"},
    ),
    "usbl": ({"driver": "evologics", "hears": [3]}, {"driver": "seatrac", "device": "/dev/ttyUSB0", "ping": 4}),
    "rc_rf": ({}, {"seen_from": "laptop"}),
    "gps": (
        {"driver": "gpsd"},
        {"driver": "nmea_tcp", "seen_from": "laptop"},
        {"driver": "nmea_serial", "device": "/dev/ttyS0"},
        {"driver": "routeros"},
    ),
    "ethernet": ({}, {"router_port": "ether3"}),
}


@pytest.mark.parametrize("bare", [False, True], ids=["as shipped", "no reservation and no gateway"])
@pytest.mark.parametrize("name", _DECLARED)
def test_list_is_complete_for_any_inventory(declaration: Inventory, name: str, *, bare: bool) -> None:
    """Of vehicles and of the location alike; what misses an address is an item as well."""
    for one in _DECLARED[name]:
        endpoints = Endpoints.model_validate({name: one})
        everything = {"endpoints": endpoints, "table3": tuple(Column), "ethernet": True}
        vehicles = {key: vehicle.model_copy(update=everything) for key, vehicle in declaration.vehicles.items()}
        site = declaration.sites["coastal"]
        lan = site.lan.model_copy(update={"reservations": ()} if bare else {})
        site = site.model_copy(update={"lan": lan, "location": site.location.model_copy(update=everything)})
        hosts = {key: host for key, host in declaration.hosts.items() if not bare or key != "coastal-gateway"}
        sites = {**declaration.sites, "coastal": site}
        listed = plan(replace(declaration, vehicles=vehicles, sites=sites, hosts=hosts), "coastal")
        ids = [each.item.id for each in listed.entries]
        assert len(set(ids)) == len(ids)
        cells = {(each.item.vehicle, each.item.endpoint) for each in listed.entries}
        declared = {("mares", "items"), (None, "items")}
        assert declared < cells
        assert len(cells - declared) == len(vehicles) * 9 + 10
        for each in listed.entries:
            asked = each.step.probe.asks() if each.step.probe is not None else ()
            assert len({question.name for question in asked}) == len(asked)
