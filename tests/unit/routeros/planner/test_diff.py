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
def test_the_diff_reads_as_written(case: str) -> None:
    planned = plan("r", read(text(f"{case}.desired.rsc")), observed(text(f"{case}.device.rsc")))
    assert planned.diff == text(f"{case}.diff")


def test_no_secret_is_in_a_plan_that_is_shown() -> None:
    planned = plan("r", read(text("rows.desired.rsc")), observed(text("rows.device.rsc")))
    shown = planned.diff + repr([action.get_masked_values() for action in planned.actions])
    assert not [secret for secret in ("ecret", "second", "old user", "password=old") if secret in shown]


def test_without_changes_there_is_no_text() -> None:
    assert (
        plan("r", read("/ip pool\nadd name=a ranges=1.1.1.1"), observed("/ip pool\nadd name=a ranges=1.1.1.1")).diff
        == ""
    )
