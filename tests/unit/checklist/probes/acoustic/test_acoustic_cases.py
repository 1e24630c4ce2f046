"""Each mood of a modem, and exactly what is found; streams whole and one byte at a time."""

from pathlib import Path
from typing import Any

import pytest
import yaml
from acoustic_talk import Twin, bytewise, hear, told, twin_of
from row_subtests import for_each_row

from atlantis_netcfg.checklist.probes import Cell, Listen, Probe, Step, Transcript, acoustic, registry, usbl
from atlantis_netcfg.checklist.report import ItemKind
from atlantis_netcfg.emulator.acoustic import EvologicsSpec, RunningSeatrac, SeatracSpec
from atlantis_netcfg.inventory import Inventory

HERE = Path(__file__).parent
CASES: list[dict[str, Any]] = yaml.safe_load((HERE / "acoustic_cases.yml").read_text(encoding="utf-8"))
SITE = "coastal"
COLUMNS = {"acoustic": acoustic.steps, "usbl": usbl.steps}
WELL = {
    "girona500": EvologicsSpec(fix_every_s=0.5, in_water=True),
    "sparus": EvologicsSpec(fix_every_s=0.5, in_water=True, local_address=2, hears=(1,), reaches=(1,)),
    "zarco": SeatracSpec(fix_every_s=0.5, in_water=True),
    "mares": SeatracSpec(fix_every_s=0.5, in_water=True, beacon=2, hears=(1,), reaches=(1,)),
}


def the_step(declaration: Inventory, item: str) -> Step:
    row, column, *name = item.split("/")
    steps = COLUMNS[column](Cell(declaration, SITE, row, column))
    return next(step for step in steps if step.name == "".join(name))


def twins(declaration: Inventory, moods: dict[str, dict[str, Any]]) -> dict[str, Twin]:
    """Twins at the addresses of the shipped declaration; text of a mood stands for its bytes."""
    reserved = {one.name: str(one.address) for one in declaration.sites[SITE].lan.reservations}
    made = {}
    for row, well in WELL.items():
        mood = {
            name: _bytes(value) if name in {"before", "noise"} else value for name, value in moods.get(row, {}).items()
        }
        made[reserved[row]] = twin_of(type(well)(**{**well.model_dump(), **mood}))
    return made


def _bytes(value: str | list[str]) -> bytes | list[bytes]:
    return [one.encode("latin-1") for one in value] if isinstance(value, list) else value.encode("latin-1")


@for_each_row("case", CASES, ids=[f"{case['item']}: {case['case']}" for case in CASES])
def test_findings_match_the_case(declaration: Inventory, case: dict[str, Any]) -> None:
    step = the_step(declaration, case["item"])
    assert step.probe is not None
    there = twins(declaration, case.get("moods", {}))
    heard = hear(step.probe, there)
    assert told(step.probe.judge(heard)) == case["findings"]
    in_pieces = {name: bytewise(answer) for name, answer in heard.items() if isinstance(answer, Transcript)}
    assert told(step.probe.judge(in_pieces)) == case["findings"]
    for twin in there.values():
        assert twin.forbidden == []
        assert not (isinstance(twin, RunningSeatrac) and twin.damaged)
        assert len(twin.transmitted) == (case.get("sent", 0) if twin.inputs else 0)
        assert not twin.transmitted_in_air


@pytest.mark.parametrize("item", sorted({case["item"] for case in CASES}))
def test_every_script_is_allowed(declaration: Inventory, item: str) -> None:
    step = the_step(declaration, item)
    assert step.probe is not None
    for question in step.probe.asks():
        assert isinstance(question, Listen)
        assert registry.find_refusal(question, active=True) is None
        assert (registry.find_refusal(question, active=False) is not None) == (step.kind is ItemKind.ACTIVE)


def test_items_of_one_modem_share_one_request(declaration: Inventory) -> None:
    asked = [set(_probe(declaration, item).asks()) for item in ("sparus/acoustic", "sparus/usbl")]
    assert asked[0] == asked[1]
    assert asked[0] < set(_probe(declaration, "girona500/acoustic/fleet").asks())


def test_only_first_row_has_the_fleet_item(declaration: Inventory) -> None:
    named = {
        row: [step.name for step in acoustic.steps(Cell(declaration, SITE, row, "acoustic"))]
        for row in declaration.vehicles
    }
    assert named == {
        "girona500": ["", "fleet", "message"],
        "sparus": ["", "message"],
        "zarco": ["", "fleet"],
        "stork": [""],
        "mares": [""],
        "eca-rov": [""],
    }


@pytest.mark.parametrize("column", COLUMNS)
def test_undeclared_modem_is_for_a_person_in_the_water(declaration: Inventory, column: str) -> None:
    (step,) = COLUMNS[column](Cell(declaration, SITE, "eca-rov", column))
    assert (step.kind, step.phase, bool(step.do), bool(step.look_for)) == (ItemKind.PERSON, "in water", True, True)


@pytest.mark.parametrize("item", ["girona500/acoustic/message", "zarco/usbl/ping"])
def test_transmitting_step_asks_for_consent_in_the_water(declaration: Inventory, item: str) -> None:
    step = the_step(declaration, item)
    assert (step.kind, step.phase) == (ItemKind.ACTIVE, "in water")
    assert step.consent is not None
    assert "in the water" in step.consent.question
    assert "nobody dives" in step.consent.question


def _probe(declaration: Inventory, item: str) -> Probe:
    probe = the_step(declaration, item).probe
    assert probe is not None
    return probe
