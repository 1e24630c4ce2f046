"""The vocabulary of drift: what is declared, what is on the device, what it was, and every word said about it."""

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
import yaml
from plan_world import POLICIES, observed
from row_subtests import for_each_row

from atlantis_netcfg.routeros import snapshot
from atlantis_netcfg.routeros.desired import read
from atlantis_netcfg.routeros.drift import Comparison, Difference, DriftHistory, DriftKind, Owner, Past, Since, compare
from atlantis_netcfg.routeros.planner import plan
from atlantis_netcfg.runs.report.drift import drift_lines

CASES = yaml.safe_load((Path(__file__).parent / "drift_cases.yml").read_text(encoding="utf-8"))
AT = datetime(2026, 5, 4, 3, 2, 1, tzinfo=UTC)


def compared(case: dict[str, Any]) -> Comparison:
    """`confirmed` is what the device was, when `declared_then` (or what is declared now) was declared."""
    desired = read(case["desired"])
    device = observed(case["device"], policies=POLICIES - {"sensitive"} if case.get("insensitive") else POLICIES)
    past = None
    if "confirmed" in case:
        then = read(case.get("declared_then", case["desired"]))
        past = Past.read("RUN", AT, snapshot.write("r", then, observed(case["confirmed"])))
    return compare(desired, device, plan("r", desired, device), past, DriftHistory(case.get("history", ())))


@for_each_row("case", CASES, ids=lambda case: case["name"])
def test_drift_lines_match_the_case(case: dict[str, Any]) -> None:
    found = compared(case)
    assert drift_lines(found.as_dict()) == case.get("told", "").splitlines()
    assert len(found.drift) == case.get("drifted", 0)


def test_confirmed_run_is_reported_with_its_time() -> None:
    found = compared({"desired": "/ip pool\n", "device": "", "confirmed": ""}).as_dict()
    assert found == {
        "menus": ["/ip pool"],
        "confirmed": {"run": "RUN", "at": "2026-05-04T03:02:01+00:00"},
        "differences": [],
    }


def test_plan_repairs_exactly_the_drift_except_foreign_and_hidden() -> None:
    """What `compare` says of a plan and what the plan does are the same rows, in every case."""
    for case in CASES:
        desired = read(case["desired"])
        device = observed(case["device"], policies=POLICIES - {"sensitive"} if case.get("insensitive") else POLICIES)
        planned = plan("r", desired, device)
        told = [one for one in compared(case).differences if one.kind not in (DriftKind.FOREIGN, DriftKind.HIDDEN)]
        assert bool(told) == bool(planned.actions), case["name"]
        assert {one.menu for one in told} == {"/" + each.menu[1:].replace("/", " ") for each in planned.actions}


@pytest.mark.parametrize(
    ("kind", "since", "counts"),
    [
        (DriftKind.MISSING, Since.ALREADY, True),
        (DriftKind.CHANGED, Since.UNKNOWN, True),
        (DriftKind.ADDED, Since.AFTER, True),
        (DriftKind.ORDER, Since.AFTER, True),
        (DriftKind.FOREIGN, Since.AFTER, True),
        (DriftKind.FOREIGN, Since.UNKNOWN, True),
        (DriftKind.FOREIGN, Since.ALREADY, False),
        (DriftKind.HIDDEN, Since.UNKNOWN, False),
    ],
)
def test_difference_kinds_that_count_as_drift(kind: DriftKind, since: Since, counts: bool) -> None:  # noqa: FBT001 - a column
    assert Difference("/ip pool", "p", kind, Owner.DECLARED, since=since).counts is counts
