"""`rollback`, `resume` and `backup` can be planned and rehearsed: the real device, its journal and its states stay."""

import os
import signal
import subprocess
from typing import Any

import pytest
from hints_said import advised
from quay import PROVISION, ROUTER, Quay, fresh_quay
from test_real_run import await_record, kill_workers
from waiting import wait_until

from atlantis_netcfg.runs import Store
from atlantis_netcfg.runs.records import RunEnd

pytestmark = [pytest.mark.slow, pytest.mark.namespace]
at = pytest.fixture(fresh_quay)


def untouched(at: Quay) -> tuple[str, list[dict[str, Any]]]:
    """What a plan and a rehearsal leave alone: the device, and the record of the real site."""
    return at.export(), at.runs()


@pytest.mark.smoke
def test_a_rollback_is_planned_rehearsed_and_done(at: Quay) -> None:
    before = at.export()
    at.configure()
    (row,) = at.runs()
    run, left = row["run"], untouched(at)

    planned = at.provision("recover", "rollback", "site=coastal", "run=latest", "--plan", code=2).stdout
    assert f"back to the state before run {run} (" in planned
    assert "~ name: coastal-router → MikroTik" in planned
    assert untouched(at) == left

    told = at.json("recover", "rollback", "site=coastal", "run=latest", "--rehearse", code=0)
    device = told["devices"][ROUTER]
    assert (told["rehearsed"], device["status"], device["second_pass"]) == (True, "changed", 0)
    assert set(device["bearers"]) == {"lan", "wifi-ptp", "4g", "satellite"}
    assert "- set name=coastal-router" in device["diff"]
    assert device["not_rehearsed"][0] == f"changes on coastal-router since run {run} verified it"
    assert untouched(at) == left

    at.provision("recover", "rollback", "site=coastal", "run=latest", "--yes", code=0)
    assert at.export() == before
    for name in (run, "latest"):
        again = at.json("recover", "rollback", "site=coastal", f"run={name}", "--plan", code=0)["devices"][ROUTER]
        assert again["planned"] == 0
    again = at.json("recover", "rollback", "site=coastal", f"run={run}", "--rehearse", code=0)["devices"][ROUTER]
    assert (again["status"], again["planned"]) == ("unchanged", 0)


def test_rehearsed_rollback_reports_its_starting_state(at: Quay) -> None:
    at.configure()
    (row,) = at.runs()
    said = at.provision("recover", "rollback", "site=coastal", "run=latest", "--rehearse", "--plan", code=2).stdout
    assert said.startswith("Rehearsal of coastal")
    words = " ".join(said.split())
    assert f"coastal-router: starts from the state verified by run {row['run']} at " in words
    assert "the emulated device is unchanged, byte for byte" in said
    for path in (at.state / "real/coastal/confirmed").iterdir():
        path.unlink()
    (journal,) = (at.state / "real/coastal/runs").glob("*/journal.jsonl")
    lines = journal.read_text(encoding="utf-8").splitlines(keepends=True)
    journal.write_text("".join(line for line in lines if "state-confirmed" not in line), encoding="utf-8")
    said = at.provision("recover", "rollback", "site=coastal", "run=latest", "--rehearse", "--verbose", code=0).stdout
    assert "coastal-router: never verified by a run: the inventory is applied first" in said
    assert "not rehearsed: current state of coastal-router: the inventory is used instead" in said


def test_rehearsal_detects_a_rollback_that_the_device_would_refuse(at: Quay) -> None:
    at.configure()
    store = Store(at.state)
    (run,) = store.runs("coastal")
    before = run.before(ROUTER)
    assert run.start_record is not None
    assert before is not None
    with store.start(run.start_record) as journal:
        journal.save(ROUTER, f"{before.text()}/ip address\nadd address=10.9.9.1/24 interface=ether99\n")
        journal.write(RunEnd(exit=0))
    left = untouched(at)
    told = at.json("recover", "rollback", "site=coastal", "run=latest", "--rehearse", code=4)
    assert "ether99" in told["devices"][ROUTER]["message"]
    assert untouched(at) == left


def test_rehearsal_needs_an_intact_starting_state(at: Quay) -> None:
    at.configure()
    for path in (at.state / "real/coastal/confirmed").iterdir():
        path.write_text(path.read_text(encoding="utf-8") + "\n# touched\n", encoding="utf-8")
    left = untouched(at)
    assert (
        "it was changed since"
        in at.provision("recover", "rollback", "site=coastal", "run=latest", "--rehearse", code=4).stderr
    )
    assert untouched(at) == left


def test_rollback_to_latest_needs_a_run_with_a_saved_state(at: Quay) -> None:
    refused = at.provision("recover", "rollback", "site=coastal", "run=latest", "--plan", code=7).stderr
    assert "no run of coastal has a saved state of coastal-router" in refused
    (listing,) = advised(refused)
    assert "provision site=NAME" in at.start(listing).stderr
    at.configure()
    assert "coastal-router changed" in at.start(listing).stdout
    at.configure()
    first, second = at.runs()
    said = at.provision("recover", "rollback", "site=coastal", "run=latest", "--plan", code=2).stdout
    assert first["run"] in said
    assert second["run"] not in said


def killed(at: Quay, typed: list[str], run: int = 0) -> None:
    """Type a command, and kill it and its workers as soon as it has sent something; the router takes that back."""
    before = at.export()
    at.do("link", delay_s=0.15)
    with subprocess.Popen(
        [PROVISION, *typed, f"device={ROUTER}", "--yes", f"inventory={at.inventory}"],
        env=at.environment(),
        start_new_session=True,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    ) as running:
        await_record(at.state, '"kind":"layer-sent"', run=run)
        os.killpg(running.pid, signal.SIGKILL)
        kill_workers(at.state)
    at.do("link", delay_s=0.0)
    wait_until(lambda: not connected(at) and (at.export() == before or run > 0))


def connected(at: Quay) -> bool:
    """Whether the router still has a connection: what the dead one has sent may not have come to it yet."""
    at.do("reset")
    return bool(at.do("connections"))


def test_resumed_run_is_planned_rehearsed_and_done(at: Quay) -> None:
    killed(at, ["site=coastal"])
    (row,) = at.runs()
    assert row["unfinished"] is True
    left = untouched(at)

    said = at.provision("recover", "resume", "site=coastal", "--plan", code=2).stdout
    assert f"run {row['run']}: provision site=coastal" in said
    assert "~ name: MikroTik → coastal-router" in said
    assert untouched(at) == left

    told = at.json("recover", "resume", "site=coastal", "--rehearse", code=0)
    device = told["devices"][ROUTER]
    assert (told["rehearsed"], device["status"], device["second_pass"]) == (True, "changed", 0)
    assert device["not_rehearsed"][0].startswith(f"what run {row['run']} left pending or kept on coastal-router")
    assert untouched(at) == left

    assert at.json("recover", "resume", "site=coastal", code=0)["devices"][ROUTER]["status"] == "changed"
    assert (
        "coastal has no unfinished run"
        in at.provision("recover", "resume", "site=coastal", "--rehearse", code=7).stderr
    )
    # The bridge of the site is not at this quay: the devices are looked at, and some are not reached.
    said = at.provision("recover", "resume", "site=coastal", "--plan", code=4).stdout
    assert said.startswith("coastal has no unfinished run; checking its devices\n  coastal-router     no changes")


def test_resumed_rollback_is_rehearsed_towards_the_saved_state(at: Quay) -> None:
    at.configure()
    (row,) = at.runs()
    killed(at, ["recover", "rollback", "site=coastal", f"run={row['run']}"], run=1)
    said = at.provision("recover", "resume", "site=coastal", "--rehearse", code=0).stdout
    assert f"it continues towards the saved state of run {row['run']}" in said
    assert f"coastal-router: starts from the state before run {at.runs()[-1]['run']}" in said
    device = at.json("recover", "resume", "site=coastal", "--rehearse", code=0)["devices"][ROUTER]
    assert "+ set name=MikroTik" in device["diff"]
    assert at.runs()[-1]["unfinished"] is True


def test_a_backup_is_rehearsed(at: Quay) -> None:
    at.configure()
    left = untouched(at)
    for _ in range(2):
        told = at.json("device", "backup", "site=coastal", "--rehearse", code=0)
        assert (told["rehearsed"], told["devices"][ROUTER]["status"]) == (True, "unchanged")
        (name,) = told["runs"]
        saved = at.state / "rehearsal/coastal/runs" / name / "before" / f"{ROUTER}.rsc"
        text = saved.read_text(encoding="utf-8")
        assert "address=10.64.101.1" in text
        assert "coastal-router" not in text  # fresh from its adoption, and not as the real one is now
    assert at.provision("device", "backup", "site=coastal", "--rehearse", code=0).stdout.startswith(
        "Rehearsal of coastal"
    )
    assert untouched(at) == left
