"""What the commands of runs advise is typed as it was printed, in the situation in which it is given."""

import subprocess
import sys
from pathlib import Path

import pytest
from hints_said import advised
from quay import PROVISION, ROUTER, Quay, fresh_quay

from atlantis_netcfg.cli import main

pytestmark = [pytest.mark.slow, pytest.mark.namespace]
RUN = ("site=coastal", f"device={ROUTER}", "--yes")
at = pytest.fixture(fresh_quay)


def follow(at: Quay, command: list[str], code: int = 0) -> str:
    """Type what was advised; `runs` takes no inventory, and a run here is of the router alone."""
    words = [word.replace("NAME", "coastal") for word in command]
    if words[:2] == ["report", "runs"]:
        done = at.start(words)
        assert done.returncode == code, done.stderr
        return done.stdout + done.stderr
    yes = ("--yes",) if words[0].startswith("site=") and "--yes" not in words else ()
    done = at.provision(*words, *yes, code=code)
    return done.stdout + done.stderr


def test_resume_without_any_run_leads_to_the_first_run(
    at: Quay, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """From the first dead end of a newcomer to the first run: each answer leads to the next."""
    monkeypatch.setenv("ATLANTIS_STATE", str(tmp_path / "empty"))
    assert main(["recover", "resume", "site=coastal"]) == 7
    (listing,) = advised(capsys.readouterr().err)
    assert main(listing) == 7
    (first,) = advised(capsys.readouterr().err)
    assert first == ["site=NAME"]
    assert "applied and verified" in follow(at, first)
    assert "exit code 0" in follow(at, listing)


def test_missing_or_damaged_confirmed_state_leads_to_a_next_command(at: Quay) -> None:
    refused = at.provision("device", "restore", f"device={ROUTER}", "run=latest", "--plan", code=7).stderr
    run, listing = advised(refused)
    assert (run, listing) == (["site=coastal", f"inventory={at.inventory}"], ["report", "runs"])
    follow(at, run)
    assert (
        at.json("device", "restore", f"device={ROUTER}", "run=latest", "--plan", code=0)["devices"][ROUTER]["planned"]
        == 0
    )
    with next(at.inventory.rglob("*.yml")).open("a", encoding="utf-8") as file:
        file.write("\n# another revision\n")
    declared, *_ = advised(at.provision("device", "restore", f"device={ROUTER}", "run=latest", "--plan", code=0).stdout)
    assert declared == ["site=coastal"]
    follow(at, declared)
    for path in (at.state / "real/coastal/confirmed").iterdir():
        path.unlink()
    refused = at.provision("device", "restore", f"device={ROUTER}", "run=latest", "--yes", code=4).stderr
    (listing,) = advised(refused)
    assert "exit code 0" in follow(at, listing)


def test_resume_of_a_finished_run_leads_to_a_next_run(at: Quay) -> None:
    at.provision(*RUN, code=0)
    (row,) = at.runs()
    refused = at.provision("recover", "resume", "site=coastal", f"run={row['run']}", code=7).stderr
    (command,) = advised(refused)
    assert [word for word in command if word in RUN] == list(RUN)
    assert "no changes needed" in follow(at, [word for word in command if not word.startswith("inventory=")])


def test_rollback_to_a_run_without_saved_state_leads_to_the_list(at: Quay) -> None:
    at.configure()
    at.configure()
    run = at.runs()[-1]["run"]
    refused = at.provision("recover", "rollback", "site=coastal", f"run={run}", "--yes", code=7).stderr
    (listing,) = advised(refused)
    assert run in follow(at, listing)


def test_damaged_journal_is_reported_and_rollback_still_works(at: Quay) -> None:
    before = at.export()
    at.configure()
    (row,) = at.runs()
    journal = at.state / "real/coastal/runs" / row["run"] / "journal.jsonl"
    whole = journal.read_bytes()
    back = ("recover", "rollback", "site=coastal", "run=latest", "--yes")
    journal.write_bytes(whole.replace(b'"kind":"state-saved"', b'"kind":"state-sawed"'))
    (listing,) = advised(at.provision(*back, code=4).stderr)
    assert f"DAMAGED JOURNAL: line 6 ({ROUTER}) is damaged" in " ".join(follow(at, listing).split())
    assert f"line 6 ({ROUTER}) is damaged" in at.provision("plan", "site=coastal", code=0).stderr
    journal.write_bytes(whole.replace(b'"kind":"outcome"', b'"kind":"outcame"'))
    named = ("recover", "rollback", "site=coastal", f"run={row['run']}", f"device={ROUTER}", "--yes")
    assert f"({ROUTER}) is damaged" in at.provision(*named, code=0).stderr
    assert at.export().splitlines() == before.splitlines()


def test_link_lost_before_the_first_change_leads_to_resume(at: Quay) -> None:
    at.do("arm", fault={"do": "drop", "match": "/safe-mode/take", "when": "after"})
    told = at.json(*RUN, code=4)["devices"][ROUTER]
    assert told["status"] == "left-as-found"
    (row,) = at.runs()
    (command,) = advised(told["hint"])
    assert command == ["recover", "resume", "site=coastal", f"run={row['run']}", f"inventory={at.inventory}"]
    follow(at, command)
    assert at.json("plan", *RUN[:2], code=0)["devices"][ROUTER]["planned"] == 0
    assert [each["unfinished"] for each in at.runs()] == [False]


READ = """
import sys
from types import SimpleNamespace
from atlantis_netcfg.cli import main
from atlantis_netcfg.cli.base.session import CommandSession
from atlantis_netcfg.core.errors import ExitCode
CommandSession.perform = lambda *_words, **_more: SimpleNamespace(devices={}, exit=ExitCode.CHANGES)
sys.exit(main())
"""
"""The command line, all of whose devices were read and differ from the declaration: nobody else is at work there."""


def test_resume_without_open_work_leads_to_a_new_run(at: Quay) -> None:
    """Somebody was at work there and has ended meanwhile: there is nothing to wait for and nothing to go on with."""
    typed = [sys.executable, "-c", READ, "recover", "resume", "site=coastal", f"inventory={at.inventory}"]
    done = subprocess.run(typed, env=at.environment(), capture_output=True, text=True, check=False)
    assert done.returncode == 7, done.stderr
    assert "no change is pending on its devices, but they differ from the inventory" in done.stderr
    (again,) = advised(done.stderr)
    assert again == ["site=coastal", f"inventory={at.inventory}"]
    assert "applied and verified" in follow(at, again)


def test_resume_waits_for_safe_mode_held_by_someone_else(at: Quay) -> None:
    """`resume` waits for the router, though no run of this laptop is open."""
    at.do("console", words=["/safe-mode/take"])
    told = at.json(*RUN, code=4)["devices"][ROUTER]
    assert "holds safe mode" in told["message"]
    (command,) = advised(told["hint"])
    assert command == ["recover", "resume", "site=coastal", f"inventory={at.inventory}"]
    with subprocess.Popen(
        [PROVISION, *command], env=at.environment(), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    ) as running:
        assert running.stderr is not None
        assert any("holds safe mode: waiting" in line for line in running.stderr)
        at.do("console", words=["/safe-mode/release"])
        running.stderr.read()
        assert running.wait() == 0
    assert at.json("plan", *RUN[:2], code=0)["devices"][ROUTER]["planned"] == 0
