"""What is said of hosts of which no result has come: no more, and no less, than what the journal proves."""

from pathlib import Path
from typing import Any

import pytest

from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.inventory import Inventory
from atlantis_netcfg.operations import Mode, Request
from atlantis_netcfg.operations.common.play_control import other_ends, results_from_journal
from atlantis_netcfg.runs import ActionConfirmation, DeviceObservation, LayerSent, Outcome, RunResume, RunStart, Store
from atlantis_netcfg.runs.records import Record

KILLED = "the process working on it was killed"
NAME = "coastal-router"
READ = DeviceObservation(device=NAME, version="7.18.2", identity="router", state="")
SENT = LayerSent(device=NAME, layer="policy", actions=(1, 2))
KEPT = ActionConfirmation(device=NAME, actions=(1, 2))
RESUMED = RunResume(revision="", tool="", command="provision recover resume")


def ended(status: str, code: int, *, still_open: bool = False) -> Outcome:
    return Outcome(device=NAME, status=status, exit=code, message=f"it is {status}", open=still_open)


def said(declaration: Inventory, state: Path, *records: Record, mode: Mode = Mode.APPLY) -> dict[str, Any]:
    """What is said of the router after a run that has written these."""
    started = RunStart(site="coastal", revision="", tool="", hosts=(NAME,), rehearsed=False, command="provision")
    with Store(state).start(started) as journal:
        for record in records:
            journal.write(record)
    request = Request(state=state, mode=mode, command="provision")
    return results_from_journal(
        [NAME], [NAME], declaration, request, {"coastal": {"routers": journal.run}}, KILLED, ""
    )[NAME]


@pytest.mark.parametrize(
    ("records", "status", "code", "resumes"),
    [
        ((READ,), "left-as-found", ExitCode.FAILED, False),
        ((READ, SENT), "unknown", ExitCode.UNKNOWN, True),
        ((READ, SENT, ended("unknown", 5)), "unknown", ExitCode.UNKNOWN, True),
        ((READ, SENT, ended("left-as-found", 4, still_open=True)), "unknown", ExitCode.UNKNOWN, True),
        ((READ, SENT, KEPT, ended("changed", 0)), "changed", ExitCode.CHECKS_FAILED, False),
        ((READ, ended("unchanged", 0)), "unchanged", ExitCode.CHECKS_FAILED, False),
        ((READ, SENT, ended("rolled-back", 4)), "rolled-back", ExitCode.FAILED, False),
        ((READ, SENT, ended("rolled-back", 4), RESUMED, SENT), "unknown", ExitCode.UNKNOWN, True),
        ((READ, SENT, ended("unknown", 5), RESUMED, ended("changed", 0)), "changed", ExitCode.CHECKS_FAILED, False),
    ],
)
def test_journal_state_is_reported_with_resume_when_useful(  # noqa: PLR0913, PLR0917
    declaration: Inventory,
    tmp_path: Path,
    records: tuple[Record, ...],
    status: str,
    code: ExitCode,
    resumes: bool,  # noqa: FBT001
) -> None:
    result = said(declaration, tmp_path, *records)
    assert (result["status"], result["exit"]) == (status, code)
    assert KILLED in result["message"]
    (run,) = Store(tmp_path).runs("coastal")
    assert (f"provision recover resume site=coastal run={run.id}" in result["hint"]) == resumes
    assert resumes or result["hint"] == "run the same command again"
    assert (NAME in run.unsettled_devices) or not resumes, "resume has nothing to do"


def test_confirmed_actions_are_counted(declaration: Inventory, tmp_path: Path) -> None:
    result = said(declaration, tmp_path, READ, SENT, KEPT, ended("changed", 0))
    assert result["confirmed"] == 2
    assert result["message"] == f"it is changed; then: {KILLED}"


def test_missing_journal_gives_status_unknown(declaration: Inventory, tmp_path: Path) -> None:
    request = Request(state=tmp_path, command="provision")
    result = results_from_journal(
        [NAME], [NAME], declaration, request, {"coastal": {"routers": "20260101T000000Z"}}, KILLED, ""
    )[NAME]
    assert (result["status"], result["exit"]) == ("unknown", ExitCode.UNKNOWN)


def test_4g_unit_has_its_own_run(declaration: Inventory, tmp_path: Path) -> None:
    """Beside the routers of its site, whose run says nothing of it."""
    router, unit, request = "te4sea-router", "te4sea-4g", Request(state=tmp_path, command="provision")
    runs = {}
    for kind, host in (("routers", router), ("4g", unit)):
        started = RunStart(site="te4sea", revision="", tool="", hosts=(host,), rehearsed=False, command="provision")
        with Store(tmp_path).start(started) as journal:
            runs[kind] = journal.run
            if host == unit:
                journal.write(LayerSent(device=unit, layer="lte", actions=(1,)))
    asked = [router, unit]
    result = results_from_journal(asked, asked, declaration, request, {"te4sea": runs}, KILLED, "")
    assert (result[unit]["status"], result[unit]["exit"]) == ("unknown", ExitCode.UNKNOWN)
    assert result[unit]["hint"] == f"provision recover resume site=te4sea run={runs['4g']}"
    assert result[router]["status"] == "left-as-found"


def test_far_bridge_end_is_resumed_from_the_requested_site(declaration: Inventory, tmp_path: Path) -> None:
    far, request = "scc-cpe", Request(state=tmp_path, command="provision")
    started = RunStart(site="scc", revision="", tool="", hosts=(far,), rehearsed=False, command="provision")
    with Store(tmp_path).start(started) as journal:
        journal.write(LayerSent(device=far, layer="policy", actions=(1,)))
    runs = {site: {"routers": journal.run} for site in ("coastal", "scc")}
    for asked, site in (("coastal-cpe", "coastal"), (far, "scc")):
        result = results_from_journal([far], [asked], declaration, request, runs, KILLED, "")[far]
        assert result["hint"].endswith(f"provision recover resume site={site} run={journal.run}")


def test_both_ends_of_a_bridge_have_a_result(declaration: Inventory, tmp_path: Path) -> None:
    request = Request(state=tmp_path, command="provision")
    ends = other_ends([NAME, "coastal-cpe"], declaration, request)
    assert ends == {"coastal-cpe": "scc-cpe", "scc-cpe": "coastal-cpe"}
    results = results_from_journal(["scc-cpe"], ["coastal-cpe"], declaration, request, {}, KILLED, "")
    assert (results["scc-cpe"]["status"], results["scc-cpe"]["other_end"]) == ("left-as-found", "coastal-cpe")
