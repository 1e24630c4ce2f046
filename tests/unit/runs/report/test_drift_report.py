"""Drift as text, JSON and JUnit: all of it from the same results."""

import xml.etree.ElementTree as ET
from dataclasses import replace
from typing import Any

import pytest

from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.runs.report.drift import DriftReport, junit

CONFIRMED = {"run": "RUN", "at": "2026-05-04T03:02:01+00:00"}


def difference(kind: str, menu: str = "/ip pool", *, counts: bool = True, subject: str = "p") -> dict[str, Any]:
    return {
        "menu": menu,
        "subject": subject,
        "kind": kind,
        "owner": "declared",
        "mark": "atlantis: lan",
        "row": "",
        "fields": [{"name": "ranges", "declared": "10.0.0.1", "found": ""}],
        "since": "unknown" if kind == "hidden" else "after",
        "why_unknown": "the device does not show it to our user" if kind == "hidden" else "",
        "history": {"by": "bob", "at": "noon", "action": "pool changed"} if kind == "changed" else None,
        "counts": counts,
    }


def result(code: ExitCode, *differences: dict[str, Any], **more: Any) -> dict[str, Any]:  # noqa: ANN401 - any field
    comparison = {"menus": ["/ip pool", "/ip dns"], "confirmed": CONFIRMED, "differences": list(differences)}
    return {
        "exit": int(code),
        "message": "as read",
        "hint": None,
        "notes": [],
        "comparison": comparison,
        "round_trips": 3,
        "bytes": {"sent": 1000, "received": 2000},
        "seconds": 1.25,
        "version": "7.18.2",
        "board": "b",
        **more,
    }


TERMINAL = result(
    ExitCode.DONE,
    comparison=None,
    status="declared",
    message="WARN: declared without evidence",
    notes=["WARN: not checked"],
    findings=[{"verdict": "WARN", "code": "terminal-not-looked-at", "message": "not checked", "hint": None}],
)
"""A satellite terminal, of which the declaration is compared with the evidence."""
LOST = result(ExitCode.FAILED, comparison=None, message="could not be read: no response", hint="check the cable")


def report(*results: dict[str, Any]) -> DriftReport:
    return DriftReport("coastal", False, {f"d{place}": one for place, one in enumerate(results)}, {"sat": "lte_router"})


def suites(*results: dict[str, Any]) -> list[ET.Element]:
    return list(ET.fromstring(junit(report(*results))))  # noqa: S314 - our own text


@pytest.mark.parametrize(
    ("codes", "worst"),
    [
        ([], ExitCode.NOTHING),
        ([0], ExitCode.DONE),
        ([0, 6], ExitCode.CHECKS_FAILED),
        ([6, 4, 0], ExitCode.FAILED),
        ([6, 5, 4], ExitCode.UNKNOWN),
        ([6, 1], ExitCode.OUR_FAULT),
    ],
)
def test_worst_device_determines_the_exit_code(codes: list[int], worst: ExitCode) -> None:
    told = report(*(result(ExitCode(code)) for code in codes))
    assert told.exit is worst
    assert told.as_json()["exit"] == worst


def test_text_report_shows_difference_owner_and_time() -> None:
    found = report(result(ExitCode.CHECKS_FAILED, difference("changed"), difference("hidden", counts=False)), LOST)
    going_on = {"d0": "provision recover resume site=coastal run=OPEN"}
    beside = replace(found, time_zone="Europe/Lisbon").as_text()
    assert "  last confirmed by run RUN of 2026-05-04 04:02 WEST (03:02 UTC)" in beside.splitlines()
    told = DriftReport(found.site, True, found.devices, found.not_handled, {"d0": "OPEN"}, going_on)
    assert told.as_text().splitlines() == [
        "d0: as read",
        "  last confirmed by run RUN of 2026-05-04 03:02 UTC",
        "  note: the outcome of run OPEN is open: `provision recover resume site=coastal run=OPEN` continues it",
        "  /ip pool",
        "    changed  p",
        "             ranges: inventory 10.0.0.1, device nothing",
        "             declared (atlantis: lan); changed after run RUN",
        "             history of the device: pool changed, by bob, noon by its clock",
        "    hidden   p",
        "             ranges: inventory 10.0.0.1, device nothing",
        "             declared (atlantis: lan); the device does not show it to our user",
        "",
        "d1: ERROR, could not be read: no response",
        "  check the cable",
        "",
        "sat: not supported yet (lte router)",
        "rehearsed on emulated devices as they are after `provision device adopt`: no real device was read",
    ]


def test_json_distinguishes_drift_from_unreadable() -> None:
    told = report(result(ExitCode.CHECKS_FAILED, difference("changed")), result(ExitCode.DONE), LOST).as_json()
    assert [one["verdict"] for one in told["devices"].values()] == ["FAIL", "PASS", "ERROR", "SKIP"]
    assert told["errors"] == [{"device": "d2", "message": "could not be read: no response", "hint": "check the cable"}]
    assert told["devices"]["d2"]["differences"] == []


@pytest.mark.parametrize(
    ("verdict", "code", "child"), [("WARN", 0, "system-out"), ("PASS", 0, None), ("FAIL", 6, "failure")]
)
def test_terminal_verdict_follows_its_evidence(verdict: str, code: int, child: str | None) -> None:
    findings = [] if verdict == "PASS" else [{**TERMINAL["findings"][0], "verdict": verdict}]
    terminal = {**TERMINAL, "exit": code, "findings": findings, "notes": [], "message": f"{verdict}: declared"}
    told = report(terminal)
    assert told.as_text().splitlines()[0] == f"d0: {verdict}: declared"
    assert told.as_json()["devices"]["d0"]["verdict"] == verdict
    assert told.exit == code
    (case,) = suites(terminal)[0]
    assert case.get("name") == "the inventory agrees with the evidence"
    assert [one.tag for one in case] == ([] if child is None else [child])


def test_junit_has_a_suite_per_device_and_a_case_per_menu() -> None:
    drifted, lost, other = suites(result(ExitCode.CHECKS_FAILED, difference("changed"), difference("missing")), LOST)
    assert [suite.get("name") for suite in (drifted, lost, other)] == ["d0", "d1", "sat"]
    assert [case.get("name") for case in drifted] == ["the device can be read", "/ip pool", "/ip dns"]
    counts = [
        [suite.get(name) for name in ("tests", "failures", "errors", "skipped")] for suite in (drifted, lost, other)
    ]
    assert counts == [["3", "1", "0", "0"], ["1", "0", "1", "0"], ["1", "0", "0", "1"]]
    failure = drifted[1][0]
    assert (failure.tag, failure.get("type"), failure.get("message")) == ("failure", "changed, missing", "changed p")
    assert "ranges: inventory 10.0.0.1, device nothing" in (failure.text or "")
    assert lost[0][0].text == "could not be read: no response\ncheck the cable"


def test_the_totals_of_junit_are_the_sums() -> None:
    root = ET.fromstring(junit(report(result(ExitCode.CHECKS_FAILED, difference("added")), LOST)))  # noqa: S314
    assert [root.get(name) for name in ("tests", "failures", "errors", "skipped")] == ["5", "1", "1", "1"]


def test_foreign_rows_pass_and_uncomparable_ones_are_skipped() -> None:
    beside, hidden = difference("foreign", counts=False), difference("hidden", "/ip dns", counts=False)
    (suite, _) = suites(result(ExitCode.DONE, beside, hidden))
    assert [[child.tag for child in case] for case in suite] == [[], ["system-out"], ["skipped", "system-out"]]
    assert suite[2][0].get("message") == "could not be compared: ranges of p"


@pytest.mark.parametrize("bad", ["\x00", "\x1b[31m", "\x0b", "\ufffe", "\udc80"])
def test_invalid_xml_characters_are_escaped(bad: str) -> None:
    (suite, _) = suites(result(ExitCode.CHECKS_FAILED, difference("changed", subject=f"<{bad}&>\n")))
    assert f"<\\u{ord(bad[0]):04x}" in (suite[1][0].text or "")
    assert (suite[1][0].get("message") or "").startswith("changed <")


def test_equal_drift_gives_equal_files() -> None:
    drift = result(ExitCode.CHECKS_FAILED, difference("changed"))
    assert junit(report(drift)) == junit(report(drift))
