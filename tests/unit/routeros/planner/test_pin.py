from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml
from plan_world import facts

from atlantis_netcfg.links.lte import Registration
from atlantis_netcfg.links.lte.routeros import read as read_unit
from atlantis_netcfg.routeros import desired
from atlantis_netcfg.routeros._types import Observation
from atlantis_netcfg.routeros.pin import PinSim, pending, sim_of
from atlantis_netcfg.routeros.planner import CannotPlan, plan

CASES: list[dict[str, Any]] = yaml.safe_load((Path(__file__).parent / "pin_cases.yml").read_text(encoding="utf-8"))
UNITS: list[dict[str, Any]] = yaml.safe_load(
    (Path(__file__).parents[2] / "links" / "common" / "lte_routeros_cases.yml").read_text(encoding="utf-8")
)
TEXT = "/interface lte\nset [ find default-name=lte1 ] comment=x pin=73951846\n"


def ident(case: dict[str, Any]) -> str:
    return str(case["name"])


def world(case: dict[str, Any]) -> Observation:
    row = {".id": "*9", "default-name": "lte1", "name": "lte1", "comment": "x", "pin": case["held"]}
    return Observation(facts(), {"/interface/lte": (row,)}, modem=case["monitor"])


@pytest.mark.parametrize("case", CASES, ids=ident)
def test_pin_is_sent_only_where_requested(case: dict[str, Any]) -> None:
    wanted = replace(desired.read(TEXT), pin_refusal=case.get("spent", ""))
    if "refused" in case:
        with pytest.raises(CannotPlan) as caught:
            plan("box", wanted, world(case))
        assert str(caught.value) == f"box: text, line 2: {case['refused']}"
        return
    found = plan("box", wanted, world(case))
    assert [dict(action.values) for action in found.actions] == ([{"pin": "73951846"}] if case["sent"] else [])
    assert list(found.notes) == ([case["note"]] if "note" in case else [])
    assert "73951846" not in found.diff + repr([action.get_masked_values() for action in found.actions])


@pytest.mark.parametrize("case", CASES, ids=ident)
def test_an_empty_pin_is_an_ordinary_value(case: dict[str, Any]) -> None:
    found = plan("box", desired.read('/interface lte\nset [ find default-name=lte1 ] pin=""\n'), world(case))
    assert [dict(action.values) for action in found.actions] == ([{"pin": ""}] if case["held"] else [])


@pytest.mark.parametrize(
    ("monitor", "held", "waits"),
    [
        ({"pin-status": "SIM PIN required"}, "73951846", True),
        ({}, "73951846", True),
        ({"pin-status": "wrong PIN"}, "73951846", False),
        ({"pin-status": "ok"}, "73951846", False),
        ({"pin-status": "SIM PIN required"}, "", False),
        ({"pin-status": "SIM PIN required"}, "4711", False),
    ],
)
def test_pending_pin_states(monitor: dict[str, str], held: str, waits: bool) -> None:  # noqa: FBT001 - an expectation
    assert pending(desired.read(TEXT), world({"held": held, "monitor": monitor})) is waits
    assert not pending(desired.read("/system identity\nset name=x\n"), world({"held": held, "monitor": monitor}))


@pytest.mark.parametrize("case", [case for case in UNITS if (case["monitor"] or {}).get("pin-status")], ids=ident)
def test_engine_and_link_reader_agree_on_the_sim_state(case: dict[str, Any]) -> None:
    unit, sim = read_unit(case["monitor"]), sim_of(case["monitor"])
    assert (unit.state is Registration.SIM_PUK_REQUIRED) == (sim is PinSim.PUK)
    assert (unit.state is Registration.SIM_PIN_REQUIRED) == (sim in {PinSim.ASKS, PinSim.WRONG_PIN})
    assert bool(unit.pin_refused) == (sim is PinSim.WRONG_PIN)
