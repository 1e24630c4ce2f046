"""The bill among the closing lines, in words and as JSON; what cost nothing has none."""

from typing import Any

from atlantis_netcfg.runs.report.drift import DriftReport
from atlantis_netcfg.runs.report.run import Pass, RunReport, consent_question, cost_lines

COST = {
    "bearer": "satellite",
    "declared": "satellite",
    "instead": None,
    "words": "over metered link satellite of coastal: about 64 kB, 0.52 EUR",
    "bill_words": "63 kB, 0.51 EUR; not counted by the router",
}
INSTEAD = {**COST, "declared": "wifi-ptp", "instead": "wifi-ptp is down"}


def result(**more: Any) -> dict[str, Any]:  # noqa: ANN401 - fields of a result
    return {
        "exit": 0,
        "message": "unchanged",
        "status": "unchanged",
        "hint": None,
        "planned": 0,
        "diff": "",
        "notes": ["a note"],
        "drift": [],
        "comparison": None,
        "round_trips": 3,
        "bytes": {"sent": 1000, "received": 2000},
        "seconds": 1.25,
        "version": "7.18.2",
        "board": "b",
        **more,
    }


def test_free_run_has_no_bill() -> None:
    assert list(cost_lines(result(), is_rehearsal=False)) == []
    assert "cost" not in RunReport("coastal", False, {"r": result()}).as_json()["devices"]["r"]


def test_run_shows_its_bill_and_rehearsal_the_consent_request() -> None:
    assert list(cost_lines(result(cost=COST), is_rehearsal=False)) == [f"cost over satellite: {COST['bill_words']}"]
    assert list(cost_lines(result(cost=COST), is_rehearsal=True)) == [
        f"a real run needs your consent: {COST['words']}",
        f"and costs: {COST['bill_words']}",
    ]


def test_link_change_precedes_the_price() -> None:
    assert consent_question(INSTEAD) == f"wifi-ptp is down; {COST['words']}"
    assert consent_question(COST) == COST["words"]


def test_run_report_shows_cost_per_device_and_per_pass() -> None:
    devices = {"r": result(cost=COST)}
    report = RunReport(
        "coastal", True, devices, (Pass("r", "lan", result()), Pass("r", "satellite", result(cost=COST)))
    )
    lines = [line.strip() for line in report.as_text().splitlines()]
    asks = [number for number, line in enumerate(lines) if line.startswith("a real run needs your consent")]
    assert asks == [1, 5]
    assert lines[3].startswith("second run over lan")
    assert lines[4].startswith("second run over satellite")
    told = report.as_json()["devices"]["r"]
    assert told["cost"] == COST
    assert [("cost" in one) for one in told["bearers"].values()] == [False, True]


def test_drift_report_shows_cost_too() -> None:
    report = DriftReport("coastal", is_rehearsal=False, devices={"r": result(cost=COST)})
    assert f"  cost over satellite: {COST['bill_words']}" in report.as_text().splitlines()
    assert report.as_json()["devices"]["r"]["cost"] == COST
    assert "cost" not in DriftReport("coastal", is_rehearsal=False, devices={"r": result()}).as_json()["devices"]["r"]
