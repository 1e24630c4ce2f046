"""The closing words of a run, and its exit code: the worst that happened to any device."""

from __future__ import annotations

from typing import Any

import pytest

from atlantis_netcfg.errors import ExitCode
from atlantis_netcfg.report.run import Pass, RunReport


def result(code: ExitCode, message: str = "done", planned: int = 0) -> dict[str, Any]:
    return {
        "exit": int(code),
        "message": message,
        "hint": None,
        "planned": planned,
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
    ],
)
def test_the_worst_device_decides(codes: list[int], worst: ExitCode) -> None:
    report = RunReport("coastal", False, {f"d{place}": result(ExitCode(code)) for place, code in enumerate(codes)})
    assert report.exit is worst
    assert report.as_json()["exit"] == worst
    assert len(report.as_json()["errors"]) == sum(code in (1, 4, 5) for code in codes)


@pytest.mark.parametrize(
    ("again", "worst"),
    [
        (result(ExitCode.DONE), ExitCode.DONE),
        (result(ExitCode.DONE, planned=2), ExitCode.FAILED),
        (result(ExitCode.UNKNOWN), ExitCode.UNKNOWN),
    ],
)
def test_a_rehearsal_is_only_done_when_the_second_pass_is(again: dict[str, Any], worst: ExitCode) -> None:
    passes = (Pass("r", "lan", result(ExitCode.DONE)), Pass("r", "satellite", again))
    report = RunReport("coastal", True, {"r": result(ExitCode.DONE, planned=9)}, passes, not_rehearsed=("tides",))
    assert report.exit is worst
    told = report.as_json()["devices"]["r"]
    assert told["second_pass"] == again["planned"]
    assert list(told["bearers"]) == ["lan", "satellite"]
    assert told["not_rehearsed"] == ["tides"]


def test_a_person_reads_cost_passes_and_what_is_left_out() -> None:
    passes = (Pass("r", "lan", result(ExitCode.DONE, planned=2)),)
    report = RunReport(
        "coastal",
        True,
        {"r": result(ExitCode.DONE, "9 actions kept")},
        passes,
        {"sat": "satellite_terminal"},
        ("tides",),
    )
    assert report.as_text().splitlines() == [
        "  r                  9 actions kept (3 round trips, 3.0 kB, 1.2 s)",
        "                     again over lan: 2 changes LEFT (3 round trips, 3.0 kB, 1.2 s)",
        "  sat                not handled yet (satellite terminal)",
        "  not rehearsed: tides",
    ]


def test_a_person_reads_why_a_device_was_not_rehearsed() -> None:
    report = RunReport("coastal", True, {"r": result(ExitCode.DONE, "kept")}, left_out={"gw": "not root"})
    assert "  gw                 not rehearsed: not root" in report.as_text().splitlines()
    assert report.as_json()["devices"]["gw"] == {"status": "not rehearsed", "message": "not root"}
    assert report.exit is ExitCode.DONE
