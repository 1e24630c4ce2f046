"""The last lines of a run: one verdict, counts that add up, the device that needs a person first, and what to do."""

from typing import Any

import pytest

from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.core.printable import Style, StyledText, plain
from atlantis_netcfg.runs.report.run import Pass, RunReport
from atlantis_netcfg.runs.report.summary import DeviceEnd, ending, rows_of_plan, warnings

WARNING = "WARN: nobody has looked at the terminal (open its pages)"


def result(code: int, status: str, message: str = "words", hint: str | None = None, **more: Any) -> dict[str, Any]:  # noqa: ANN401 - fields of a result
    return {
        "exit": code,
        "status": status,
        "message": message,
        "hint": hint,
        "planned": 0,
        "diff": "",
        "estimate": None,
        "protection_words": "",
        "notes": [],
        "drift": [],
        "round_trips": 0,
        "bytes": {"sent": 0, "received": 0},
        "seconds": 0.0,
        **more,
    }


CHANGED = result(0, "changed")
SAME = result(0, "unchanged")
WARNED = result(0, "declared", notes=[WARNING])
SILENT = result(4, "left-as-found", "could not be read: no response", reached=False)


def last(devices: dict[str, dict[str, Any]], *, rehearsed: bool = False, **more: Any) -> list[str]:  # noqa: ANN401 - fields of a report
    report = RunReport("coastal", rehearsed, devices, **more)
    return [plain(row) for row in report.summary().rows_for_screen()]


@pytest.mark.parametrize(
    ("found", "end"),
    [
        (CHANGED, DeviceEnd.CHANGED),
        (SAME, DeviceEnd.UNCHANGED),
        (WARNED, DeviceEnd.DECLARED),
        (SILENT, DeviceEnd.NOT_REACHED),
        (result(4, "left-as-found"), DeviceEnd.FAILED),
        (result(4, "refused"), DeviceEnd.REFUSED),
        (result(4, "rolled-back"), DeviceEnd.ROLLED_BACK),
        (result(5, "unknown"), DeviceEnd.UNKNOWN),
        (result(2, "planned"), DeviceEnd.TO_CHANGE),
        (result(6, "changed"), DeviceEnd.NOT_PROVED),
        (result(6, "drifted"), DeviceEnd.DIFFERENT),
        (result(7, "unchanged"), DeviceEnd.NOT_CHECKED),
        (result(1, "left-as-found"), DeviceEnd.FAILED),
        (result(3, "left-as-found"), DeviceEnd.FAILED),
        (result(3, "left-as-found", reached=False), DeviceEnd.FAILED),
    ],
)
def test_device_has_one_outcome(found: dict[str, Any], end: DeviceEnd) -> None:
    assert ending(found) is end


@pytest.mark.parametrize(
    ("devices", "more", "verdict"),
    [
        ({"r": CHANGED}, {}, "[OK] DONE: changed to match the inventory, and read back"),
        ({"r": {**CHANGED, "changes": ["a"]}}, {}, "[OK] DONE: changed to match the inventory"),
        ({"r": SAME}, {}, "[OK] NOTHING TO CHANGE: read, no differences from the inventory"),
        ({"r": CHANGED, "s": WARNED}, {}, "[!] DONE, WITH WARNINGS: changed to match the inventory, and read back"),
        (
            {"r": CHANGED},
            {"not_handled": {"c": "control_centre"}},
            "[!] DONE IN PART: 1 of 2 devices took part; changed to match the inventory, and read back",
        ),
        ({"r": SILENT, "s": SAME}, {}, "[FAIL] NOT REACHED: no session with r, which was not changed"),
        ({"r": SILENT, "s": SILENT}, {}, "[FAIL] NOT REACHED: no session with 2 devices, which were not changed"),
        ({"r": result(4, "refused"), "s": CHANGED}, {}, "[FAIL] REFUSED: r was not changed"),
        ({"r": result(4, "rolled-back")}, {}, "[FAIL] ROLLED BACK: r is as it was before"),
        ({"r": result(4, "rolled-back"), "s": result(5, "unknown")}, {}, "[?] UNKNOWN: the state of s is not known"),
        ({"r": result(6, "changed")}, {}, "[FAIL] NOT PROVED: work is left to do on r"),
        (
            {"r": result(2, "planned"), "s": SAME},
            {"purpose": "plan"},
            "[~] PLANNED: 1 device would change; nothing was changed",
        ),
        ({"r": SAME}, {"purpose": "backup"}, "[OK] SAVED: nothing was changed"),
        ({}, {}, "[FAIL] NOTHING DONE: no device took part"),
        ({}, {"left_out": {"g": "not root"}}, "[FAIL] NOTHING DONE: no device took part"),
        (
            {"r": CHANGED, "s": result(4, "left-as-found")},
            {"stopped_by": "SIGINT"},
            "[FAIL] STOPPED by Ctrl-C: changes that were read back stay, nothing else was changed",
        ),
        (
            {"r": result(4, "left-as-found")},
            {"stopped_by": "SIGHUP", "purpose": "plan"},
            "[FAIL] STOPPED by SIGHUP: nothing was changed",
        ),
        (
            {"r": CHANGED},
            {"stopped_by": "SIGINT"},
            "[!] STOPPED by Ctrl-C: changes that were read back stay, nothing else was changed",
        ),
        (
            {"r": result(5, "unknown")},
            {"stopped_by": "SIGTERM"},
            "[?] STOPPED by SIGTERM: the state of a device is not known",
        ),
    ],
)
def test_summary_verdict_is_the_worst_one(
    devices: dict[str, dict[str, Any]], more: dict[str, Any], verdict: str
) -> None:
    report = RunReport("coastal", False, devices, **more)
    assert [plain(row) for row in report.summary().rows_for_screen(200)][1] == verdict
    assert ("[OK]" in verdict) <= (report.exit is ExitCode.DONE)


def test_late_stop_shows_how_to_continue() -> None:
    assert last({"r": CHANGED}, stopped_by="SIGINT")[-1] == "do        run the same command again to continue"


def test_rehearsal_summary_shows_the_result_of_second_runs() -> None:
    passes = (Pass("r", "lan", SAME), Pass("r", "satellite", SAME))
    lines = last({"r": CHANGED}, rehearsed=True, passes=passes)
    assert lines[1] == "[OK] REHEARSED: repeated over 2 links: no further changes"
    lines = last({"r": CHANGED}, rehearsed=True, passes=(Pass("r", "lan", {**SAME, "planned": 2}),))
    assert lines[1] == "[FAIL] FAILED: r ended with an error"
    assert lines[3] == "check     r: a second run over lan still finds 2 changes"
    lines = last({"r": CHANGED}, rehearsed=True, passes=passes, left_out={"g": "not root"})
    assert lines[1:3] == [
        "[!] REHEARSED IN PART: 1 of 2 devices took part; repeated over 2 links: no",
        "    further changes",
    ]
    assert lines[-1] == "check     g: not rehearsed: not root"


def test_every_device_is_counted_once() -> None:
    devices = {"a": CHANGED, "b": SAME, "c": SILENT, "d": WARNED, "e": result(5, "unknown")}
    lines = last(devices, left_out={"f": "not root"}, not_handled={"g": "control_centre"})
    counts = " ".join(" ".join(lines[2:4]).split())
    assert counts == (
        "devices 7: 1 changed, 1 unchanged, 0 failed, 1 not reached, 1 unknown, 1 inventory only, 1 not "
        "rehearsed, 1 not supported yet, 1 with a warning"
    )
    total, _, rest = counts.removeprefix("devices ").partition(": ")
    assert int(total) == sum(int(part.split()[0]) for part in rest.split(", ")[:-1])


def test_the_worst_device_is_named_with_its_whole_reason_and_its_hint() -> None:
    failed = result(4, "refused", "refused: " + "a long reason " * 20, "provision plan site=coastal")
    lines = last({"r": SAME, "s": failed})
    assert [line[:10].strip() for line in lines[3:] if line[:10].strip()] == ["check", "do"]
    assert " ".join(" ".join(lines[3:-1]).split()) == f"check s: refused: {'a long reason ' * 20}".strip()
    assert lines[-1] == "do        provision plan site=coastal"
    assert all(len(line) <= 80 for line in lines)


def test_path_longer_than_a_line_is_not_broken() -> None:
    path = "/srv/" + "long-name/" * 16
    lines = last({"s": result(4, "refused", f"refused: {path}x", f"look at {path}")})
    assert {f"{path}x", path} <= {line.strip() for line in lines}


def test_a_warning_is_named_where_nothing_is_worse() -> None:
    assert (
        last({"r": CHANGED, "sat": WARNED})[-1] == "check     sat: nobody has looked at the terminal (open its pages)"
    )
    drifted = {**SAME, "drift": [{"message": "r has 2 rows of others"}]}
    assert last({"r": drifted})[-1] == "check     r has 2 rows of others"


def test_green_requires_a_complete_run_without_warnings() -> None:
    def style(devices: dict[str, dict[str, Any]], **more: Any) -> Style:  # noqa: ANN401 - fields of a report
        (_, verdict, *_) = RunReport("coastal", False, devices, **more).summary().rows_for_screen()
        assert isinstance(verdict, StyledText)
        return verdict.style

    assert style({"r": CHANGED}) is Style.GOOD
    assert style({"r": WARNED}) is Style.WARNING
    assert style({"r": CHANGED}, not_handled={"c": "control_centre"}) is Style.WARNING
    assert style({"r": CHANGED}, left_out={"c": "not root"}) is Style.WARNING
    assert style({"r": result(4, "refused")}) is Style.BAD
    assert style({"r": CHANGED}, stopped_by="SIGINT") is Style.WARNING
    assert style({"r": CHANGED, "s": result(4, "left-as-found")}, stopped_by="SIGINT") is Style.BAD


def test_a_plan_counts_rows_as_its_text_shows_them() -> None:
    router = "  /a\n- set x=1\n+ set x=2\n+ add y=1\n  # 3 rows as they are\n- add z=1\n  /b\n- set a\n+ set b\n"
    computer = {"diff": "  would do this\n--- before\n+++ after\n+ line", "planned": 4, "changes": ["a", "b", "c", "d"]}
    assert rows_of_plan([{"diff": router, "planned": 4}]) == (1, 2, 1)
    assert rows_of_plan([{"diff": router, "planned": 4}, computer]) == (1, 6, 1)
    lines = last({"r": result(2, "planned", diff=router)}, purpose="plan", next_command="provision site=coastal")
    assert lines[3:] == ["plan      1 rows to add, 2 to change, 1 to remove", "next      provision site=coastal"]


@pytest.mark.parametrize("note", [msg(f"WARN: {arg('x')} is old"), msg(f"{arg('WARN')}: {arg('x')} is old")])
def test_a_warning_is_shown_without_its_verdict(note: str) -> None:
    (words,) = warnings({"notes": [note, "an ordinary note"]})
    assert words == "x is old"
