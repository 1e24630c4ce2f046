"""Real runs, without `--rehearse`: the devices are twins that the test keeps, and the state of the laptop counts."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from quay import CHECKOUT, PROVISION, ROUTER, Quay, fresh_quay
from waiting import wait_until

pytestmark = [pytest.mark.slow, pytest.mark.namespace]
at = pytest.fixture(fresh_quay)


@pytest.mark.smoke
def test_a_run_is_recorded_backed_up_and_rolled_back(at: Quay) -> None:
    before = at.export()
    first = at.json("site=coastal", "--yes", code=0)
    assert first["devices"][ROUTER]["status"] == "changed"
    after = at.export()
    assert after != before
    assert at.json("site=coastal", "--yes", code=0)["devices"][ROUTER]["status"] == "unchanged"
    assert at.json("plan", "site=coastal", code=0)["devices"][ROUTER]["planned"] == 0

    listed = at.runs()
    assert [row["exit"] for row in listed] == [0, 0]
    assert at.json("device", "backup", "site=coastal", code=0)["devices"][ROUTER]["status"] == "unchanged"
    at.provision("recover", "rollback", "site=coastal", f"run={listed[0]['run']}", "--yes", code=0)
    assert at.export().splitlines() == before.splitlines()


def test_without_consent_nothing_is_changed(at: Quay) -> None:
    before = at.export()
    done = at.provision("site=coastal", code=3)
    assert "--yes" in done.stderr
    assert at.export().splitlines() == before.splitlines()


def test_plan_of_an_unreachable_router_reports_only_that(at: Quay) -> None:
    at.door.port = 0
    done = at.provision("plan", "site=coastal", code=4)
    assert done.stdout.startswith(f"  {ROUTER}     could not be read: 10.64.101.1:8729 ")
    assert not re.search("nothing to change|no estimate|protection", done.stdout)


def test_site_checks_fail_before_and_pass_after_a_run(at: Quay) -> None:
    found = _checks(at)
    assert found.returncode == 1
    assert re.search(r"1\d\d differences from the inventory", found.stdout)
    at.provision("site=coastal", "--yes", code=0)
    found = _checks(at)
    assert (found.returncode, "1 passed" in found.stdout) == (0, True), found.stdout


def test_checks_of_a_mistyped_site_are_not_green(at: Quay) -> None:
    found = _checks(at, site="costal")
    assert found.returncode not in (0, 1)
    assert "did you mean `coastal`?" in found.stdout + found.stderr


def _checks(at: Quay, site: str = "coastal") -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "pytest", "checks/", "--site", site, "--inventory", str(at.inventory), "-k", ROUTER],
        cwd=CHECKOUT,
        env=at.environment(),
        capture_output=True,
        text=True,
        check=False,
    )


def test_interactive_consent_applies_the_change_and_the_rollback(at: Quay) -> None:
    before = at.export()
    said_no = at.typed("site=coastal", answer="no", code=4)
    assert "~ name: MikroTik → coastal-router" in said_no
    assert "not confirmed; nothing was changed" in said_no
    assert at.export() == before
    assert " actions applied and verified" in at.typed("site=coastal", answer="yes", code=0)
    (run, *_) = at.runs()
    back = at.typed("recover", "rollback", "site=coastal", f"run={run['run']}", answer="yes", code=0)
    assert "~ name: coastal-router → MikroTik" in back
    assert at.export().splitlines() == before.splitlines()


@pytest.mark.smoke
def test_a_killed_run_is_resumed(at: Quay) -> None:
    at.twins.do(ROUTER, "link", delay_s=0.15)
    with subprocess.Popen(
        [PROVISION, "site=coastal", f"device={ROUTER}", "--yes", f"inventory={at.inventory}"],
        env=at.environment(),
        start_new_session=True,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    ) as running:
        journal = await_record(at.state, '"kind":"layer-sent"')
        os.killpg(running.pid, signal.SIGKILL)
        kill_workers(at.state)
    assert journal
    at.twins.do(ROUTER, "link", delay_s=0.0)
    (row,) = at.runs()
    assert row["unfinished"] is True
    told = at.json("recover", "resume", "site=coastal", code=0)
    assert told["devices"][ROUTER]["status"] in {"changed", "unchanged"}
    assert at.json("plan", "site=coastal", code=0)["devices"][ROUTER]["planned"] == 0
    assert [row["unfinished"] for row in at.runs()][:1] == [False]


@pytest.mark.parametrize("kind", ["layer-sent", "releasing", "released"])
def test_state_folder_deleted_during_a_run_is_an_error(at: Quay, kind: str) -> None:
    """Before the release the change is taken back; after it the router is as declared, and nobody could know."""
    before = at.export()
    at.do("link", delay_s=0.15)
    with subprocess.Popen(
        [PROVISION, "site=coastal", f"device={ROUTER}", "--yes", f"inventory={at.inventory}"],
        env=at.environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as running:
        await_record(at.state, f'"kind":"{kind}"')
        shutil.rmtree(at.state)
        out, err = running.communicate()
    assert running.returncode in {4, 6}, out + err
    assert "\nrecord " not in out
    assert "; not recorded" in out
    assert "the folder of the run was deleted or replaced during the run" in out
    assert (at.export() == before) == (running.returncode == 4)


def await_record(state: Path, wanted: str, run: int = 0) -> str:
    """Wait until a journal, of that run or a later one, has such a record; give it."""

    def found() -> str:
        journals = sorted(state.glob("real/coastal/runs/*/journal.jsonl"))
        texts = (path.read_text(encoding="utf-8") for path in journals[run:])
        return next((text for text in texts if wanted in text), "")

    return wait_until(found, lambda: wanted, 0.01)


def kill_workers(state: Path) -> None:
    """Ansible's worker is in a session of its own: the lock names it."""
    holder = (state / "real/coastal/lock").read_text(encoding="utf-8")
    if holder:
        os.kill(json.loads(holder)["pid"], signal.SIGKILL)


def test_second_technician_is_told_who_holds_the_lock(at: Quay) -> None:
    at.twins.do(ROUTER, "link", delay_s=0.2)
    with subprocess.Popen(
        [PROVISION, "site=coastal", f"device={ROUTER}", "--yes", f"inventory={at.inventory}"],
        env=at.environment(),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    ) as running:
        await_record(at.state, '"kind":"run-started"')
        second = at.provision("site=coastal", "--yes", code=4)
        assert "coastal is locked by" in second.stderr
        assert running.wait() == 0


def test_plain_ansible_and_check_mode_agree_with_provision(at: Quay) -> None:
    before = at.export()
    checked = _ansible(at, "--check", "--diff")
    assert checked.returncode == 0, checked.stdout + checked.stderr
    assert "add address=10.64.1.1/24" in checked.stdout
    assert at.export().splitlines() == before.splitlines()
    done = _ansible(at)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "changed=1" in done.stdout
    again = _ansible(at)
    assert "changed=0" in again.stdout
    assert "WARN: terminal coastal-sat not inspected yet" in " ".join((again.stdout + again.stderr).split())


def _ansible(at: Quay, *flags: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [
            *(sys.executable, "-m", "ansible", "playbook", "-i", str(at.inventory)),
            *(str(CHECKOUT / "playbooks/site.yml"), "--limit", "coastal:!cpes:!lte_routers:!gateways", *flags),
        ],
        cwd=CHECKOUT,
        env=at.environment(),
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
