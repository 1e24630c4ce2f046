"""Which items the column makes of a declaration."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from atlantis_netcfg.checklist.probes import Cell, Place, Step
from atlantis_netcfg.checklist.probes.rc_rf import RcExpectation, RcHeard, SticksMoved, steps
from atlantis_netcfg.checklist.report import ItemKind, Phase
from atlantis_netcfg.declaration import Declaration, load
from atlantis_netcfg.declaration.model import Endpoints

ROOT = Path(__file__).parents[4]


@pytest.fixture(scope="module")
def declaration() -> Declaration:
    return load(ROOT / "inventory")


def of(declaration: Declaration, vehicle: str, endpoints: dict[str, object] | None = None) -> tuple[Step, ...]:
    if endpoints is not None:
        one = declaration.vehicles[vehicle].model_copy(update={"endpoints": Endpoints.model_validate(endpoints)})
        declaration = replace(declaration, vehicles={**declaration.vehicles, vehicle: one})
    return steps(Cell(declaration, "coastal", vehicle, "rc_rf"))


def told(made: tuple[Step, ...]) -> list[tuple[str, ItemKind, Phase]]:
    return [(step.name, step.kind, step.phase) for step in made]


def test_a_stream_is_listened_to_sticks_need_consent_and_the_rest_is_a_persons(declaration: Declaration) -> None:
    made = of(declaration, "stork")
    assert told(made) == [
        ("", ItemKind.AUTOMATIC, Phase.BENCH),
        ("sticks", ItemKind.ACTIVE, Phase.BENCH),
        ("failsafe", ItemKind.PERSON, Phase.BENCH),
        ("range", ItemKind.PERSON, Phase.QUAY),
    ]
    wanted = RcExpectation("Stork", "coastal-gateway", 14550, address="10.64.1.24")
    assert [step.probe for step in made[:2]] == [RcHeard(wanted, Place.GATEWAY), SticksMoved(wanted, Place.GATEWAY)]
    assert [step.concerns for step in made] == [("coastal-gateway",), ("coastal-gateway",), (), ()]
    consent = made[1].consent
    assert consent is not None
    assert "the propellers are off Stork, or it is disarmed and secured" in consent.question
    assert consent.prompt.startswith("ask the pilot of Stork to move both sticks")


def test_a_vehicle_without_a_stream_has_a_persons_steps_only(declaration: Declaration) -> None:
    made = of(declaration, "stork", {})
    assert told(made) == [
        ("", ItemKind.PERSON, Phase.BENCH),
        ("failsafe", ItemKind.PERSON, Phase.BENCH),
        ("range", ItemKind.PERSON, Phase.QUAY),
    ]
    assert all(step.do and step.look_for for step in made)
    assert "30 m" in made[-1].do


def test_the_declared_values_are_those_of_the_probe(declaration: Declaration) -> None:
    made = of(declaration, "stork", {"rc_rf": {"port": 14560, "system_id": 7, "rssi_low": 90, "seen_from": "laptop"}})
    wanted = RcExpectation("Stork", "this computer", 14560, 7, 90, "10.64.1.24")
    assert made[0].probe == RcHeard(wanted, Place.LAPTOP)
    assert made[0].concerns == ()
