from pathlib import Path

import pytest
from plan_world import observed

from atlantis_netcfg.routeros.desired import read
from atlantis_netcfg.routeros.planner import plan

GOLDEN = Path(__file__).parent / "golden"
CASES = sorted(path.name.removesuffix(".desired.rsc") for path in GOLDEN.glob("*.desired.rsc"))


def text(name: str) -> str:
    return (GOLDEN / name).read_text(encoding="utf-8")


@pytest.mark.parametrize("case", CASES)
def test_diff_matches_the_golden_text(case: str) -> None:
    planned = plan("r", read(text(f"{case}.desired.rsc")), observed(text(f"{case}.device.rsc")))
    assert planned.diff == text(f"{case}.diff")


def test_shown_plan_contains_no_secret() -> None:
    planned = plan("r", read(text("rows.desired.rsc")), observed(text("rows.device.rsc")))
    shown = planned.diff + repr([action.get_masked_values() for action in planned.actions])
    assert not [secret for secret in ("ecret", "second", "old user", "password=old") if secret in shown]


def test_plan_without_changes_has_an_empty_diff() -> None:
    assert (
        plan("r", read("/ip pool\nadd name=a ranges=1.1.1.1"), observed("/ip pool\nadd name=a ranges=1.1.1.1")).diff
        == ""
    )
