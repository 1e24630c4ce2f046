"""The closing words of a run, and its exit code: the worst that happened to any device."""

from dataclasses import replace
from typing import Any

import pytest

from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.printable import plain
from atlantis_netcfg.runs.report.run import Pass, RunReport, _join_changes


def result(code: ExitCode, message: str = "done", planned: int = 0) -> dict[str, Any]:
    return {
        "exit": int(code),
        "message": message,
        "hint": None,
        "status": "read",
        "planned": planned,
        "diff": "",
        "estimate": None,
        "protection_words": "safe mode",
        "notes": [],
        "drift": [],
        "round_trips": 3,
        "bytes": {"sent": 1000, "received": 2000},
        "seconds": 1.25,
    }


@pytest.mark.parametrize(
    ("codes", "worst"),
    [
        ([], ExitCode.NOTHING),
        ([0], ExitCode.DONE),
        ([0, 2], ExitCode.CHANGES),
        ([2, 4, 0], ExitCode.FAILED),
        ([4, 5, 0], ExitCode.UNKNOWN),
        ([5, 1], ExitCode.OUR_FAULT),
        ([2, 6], ExitCode.CHECKS_FAILED),
        ([6, 0, 7], ExitCode.CHECKS_FAILED),
        ([7, 0], ExitCode.DONE),
    ],
)
def test_worst_device_determines_the_exit_code(codes: list[int], worst: ExitCode) -> None:
    report = RunReport("coastal", False, {f"d{place}": result(ExitCode(code)) for place, code in enumerate(codes)})
    assert report.exit is worst
    assert report.as_json()["exit"] == worst
    assert len(report.as_json()["errors"]) == sum(code in (1, 4, 5, 6) for code in codes)


@pytest.mark.parametrize(
    ("again", "worst"),
    [
        (result(ExitCode.DONE), ExitCode.DONE),
        (result(ExitCode.DONE, planned=2), ExitCode.FAILED),
        (result(ExitCode.UNKNOWN), ExitCode.UNKNOWN),
    ],
)
def test_rehearsal_passes_only_if_the_second_pass_does(again: dict[str, Any], worst: ExitCode) -> None:
    passes = (Pass("r", "lan", result(ExitCode.DONE)), Pass("r", "satellite", again))
    report = RunReport("coastal", True, {"r": result(ExitCode.DONE, planned=9)}, passes, not_rehearsed=("tides",))
    assert report.exit is worst
    told = report.as_json()["devices"]["r"]
    assert told["second_pass"] == again["planned"]
    assert list(told["bearers"]) == ["lan", "satellite"]
    assert told["not_rehearsed"] == ["tides"]


@pytest.mark.parametrize(
    ("removal", "addition", "line"),
    [
        ("- set name=MikroTik", "+ set name=r", "~ name: MikroTik → r"),
        ('- set note="" show=no', '+ set note="a b" show=yes', '~ note: "" → "a b", show: no → yes'),
        (
            "- set [ find name=e1 ] a=1 !b",
            "+ set [ find name=e1 ] a=2 b=3",
            "~ [ find name=e1 ] a: 1 → 2, b: unset → 3",
        ),
        ("- set api disabled=no", "+ set api disabled=yes", "~ api disabled: no → yes"),
    ],
)
def test_changed_values_are_one_line(removal: str, addition: str, line: str) -> None:
    assert list(_join_changes([removal, addition])) == [line]


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("- add address=10.0.0.1/24", "+ add address=10.0.0.2/24"),
        ("- set a=1", "+ set b=1"),
        ("- set [ find name=e1 ] a=1", "+ set [ find name=e2 ] a=2"),
        ("- set a=1", "- set a=2"),
    ],
)
def test_other_lines_of_a_plan_stay_apart(first: str, second: str) -> None:
    assert list(_join_changes([first, second])) == [first, second]


def test_text_report_shows_cost_passes_and_limits() -> None:
    passes = (Pass("r", "lan", result(ExitCode.DONE, planned=2)),)
    whole = RunReport(
        "coastal",
        True,
        {"r": result(ExitCode.DONE, "9 actions kept")},
        passes,
        {"sat": "satellite_terminal"},
        ("tides",),
        verbose=True,
    )
    lines = [
        "  r                  9 actions kept (3 round trips, 3.0 kB, 1.2 s)",
        "                     second run over lan: 2 changes LEFT (3 round trips, 3.0 kB, 1.2 s)",
        "  sat                not supported yet (satellite terminal)",
        "  not rehearsed: tides",
        "",
        "[FAIL] FAILED: r ended with an error",
        "devices   2: 0 changed, 0 unchanged, 1 failed, 0 not reached, 1 not supported",
        "          yet",
        "check     r: a second run over lan still finds 2 changes",
        "do        remove the cause, then run the same command again",
    ]
    assert whole.as_text().splitlines() == lines
    assert [plain(row) for row in whole.rows(40)][:2] == ["  r 9 actions kept (3 round trips, 3.0", "    kB, 1.2 s)"]
    brief = replace(whole, verbose=False).as_text().splitlines()
    assert brief == [*lines[:3], *lines[4:], "limits    1 limit of this rehearsal (`--verbose` lists it)"]


def test_successful_rehearsal_on_a_terminal_shows_one_line_per_device() -> None:
    passes = (Pass("r", "lan", result(ExitCode.DONE)),)
    devices = {"r": {**result(ExitCode.DONE, "9 actions kept"), "notes": ["a note"]}}
    report = RunReport("coastal", True, devices, passes, left_out={"gw": "not root"})
    assert [plain(row) for row in report.rows(80)][:4] == [
        "  r                  9 actions kept",
        "  gw                 not rehearsed: not root",
        "  costs, repeated runs and notes: type --verbose, too",
        "",
    ]
    whole = [plain(row) for row in replace(report, verbose=True).rows(80)]
    assert any("second run over lan" in line for line in whole)
    assert any("a note" in line for line in whole)


def test_text_report_shows_why_a_device_was_not_rehearsed() -> None:
    report = RunReport("coastal", True, {"r": result(ExitCode.DONE, "kept")}, left_out={"gw": "not root"})
    assert "  gw                 not rehearsed: not root" in report.as_text().splitlines()
    assert report.as_json()["devices"]["gw"] == {"status": "not rehearsed", "message": "not root"}
    assert report.exit is ExitCode.DONE


def test_unreachable_device_has_no_plan() -> None:
    silent = {**result(ExitCode.FAILED, "could not be read: no response"), "status": "left-as-found"}
    read = {**result(ExitCode.DONE, "no changes needed"), "status": "unchanged"}
    report = RunReport("coastal", False, {"silent": silent, "read": read})
    assert report.plan_as_text().splitlines() == ["read:", "  nothing to change", ""]
    assert RunReport("coastal", False, {"silent": silent}).plan_as_text() == ""


def test_refused_plan_is_shown_with_its_changes() -> None:
    refused = {**result(ExitCode.FAILED, "refused", planned=1), "diff": "+ add a", "status": "refused"}
    report = RunReport("coastal", False, {"r": refused})
    assert report.plan_as_text().splitlines()[:2] == ["r:", "+ add a"]


def test_plan_shows_its_cost() -> None:
    estimate = {"round_trips": 9, "bytes": 60_000, "seconds": 12.3, "bearer": "lan"}
    planned = {**result(ExitCode.CHANGES, planned=3), "diff": "+ add a\n", "estimate": estimate, "status": "planned"}
    declared = {**result(ExitCode.DONE, "WARN: declared"), "status": "declared"}
    report = RunReport("coastal", False, {"r": planned, "sat": declared})
    assert report.plan_as_text().splitlines() == [
        *("r:", "+ add a", "  3 changes over lan: 9 round trips, 60 kB, about 12 s", "  protection: safe mode", ""),
        *("sat:", "  WARN: declared", ""),
    ]
