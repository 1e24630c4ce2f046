"""What a role has found amiss on a gateway, and could not mend, stops nothing; no run that ends with it is green."""

from typing import Any

import pytest

from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.operations.common.request import Mode
from atlantis_netcfg.operations.computers._watch import ComputerResult
from atlantis_netcfg.routeros.apply import Status
from atlantis_netcfg.runs.report.drift import DriftReport

FINDING = "the firewall of the inventory is not active"
FOUND = {"changed": False, "findings": [FINDING], "hint": "take a newer image"}
CHANGED: dict[str, Any] = {"changed": True, "changes": ["file /etc/hosts"]}


def told(mode: Mode, *tasks: dict[str, Any]) -> ComputerResult:
    result = ComputerResult("coastal-gateway", mode, "coastal")
    for task in tasks:
        result.ok("a task", task)
    return result


@pytest.mark.parametrize(
    ("mode", "tasks", "code", "message"),
    [
        (Mode.APPLY, (FOUND,), ExitCode.CHECKS_FAILED, f"nothing to change; finding: {FINDING}"),
        (Mode.APPLY, (FOUND, CHANGED), ExitCode.CHECKS_FAILED, f"1 change made; finding: {FINDING}"),
        (Mode.APPLY, (CHANGED,), ExitCode.DONE, "1 change made"),
        (Mode.PLAN, (FOUND,), ExitCode.CHECKS_FAILED, f"nothing to change; finding: {FINDING}"),
        (Mode.PLAN, (CHANGED, FOUND), ExitCode.CHANGES, f"1 change to make; finding: {FINDING}"),
        (Mode.DRIFT, (FOUND,), ExitCode.CHECKS_FAILED, f"1 difference; finding: {FINDING}"),
        (Mode.DRIFT, (CHANGED, FOUND), ExitCode.CHECKS_FAILED, f"2 differences; finding: {FINDING}"),
        (Mode.DRIFT, ({"changed": False},), ExitCode.DONE, "matches the inventory, nothing to change"),
    ],
)
def test_finding_is_not_green(mode: Mode, tasks: tuple[dict[str, Any], ...], code: ExitCode, message: str) -> None:
    result = told(mode, *tasks)
    assert (result.exit, result.as_dict()["message"]) == (code, message)
    assert result.as_dict()["hint"] == ("take a newer image" if FOUND in tasks else None)


def test_drift_lists_the_finding() -> None:
    comparison = told(Mode.DRIFT, CHANGED, FOUND).as_dict()["comparison"]
    assert [one["subject"] for one in comparison["differences"]] == ["file /etc/hosts", FINDING]
    report = DriftReport(
        site="coastal", is_rehearsal=False, devices={"coastal-gateway": told(Mode.DRIFT, FOUND).as_dict()}
    )
    assert FINDING in report.as_text()
    assert report.exit is ExitCode.CHECKS_FAILED


def test_later_failure_does_not_hide_a_finding() -> None:
    result = told(Mode.APPLY, FOUND)
    result.fail("another task", {"msg": "no room", "hint": "make some"}, Status.LEFT_AS_FOUND)
    assert (result.exit, result.hint) == (ExitCode.FAILED, "make some")
    assert result.message == f"another task: no room; finding: {FINDING}"
    drifted = told(Mode.DRIFT, FOUND)
    drifted.fail("a task", {"msg": "away"}, Status.LEFT_AS_FOUND)
    drifted.recover()
    assert drifted.exit is ExitCode.CHECKS_FAILED
