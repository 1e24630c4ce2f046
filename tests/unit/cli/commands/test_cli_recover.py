"""`provision recover` lists what earlier runs have left open, and runs the command that is chosen."""

import builtins
import json
from dataclasses import replace
from pathlib import Path

import pytest
from hints_said import advised

from atlantis_netcfg.cli import main
from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.runs import Journal, Outcome, RunStart, Store

ROUTER = "coastal-router"
START = RunStart(
    site="coastal", revision="", tool="", hosts=(ROUTER,), rehearsed=False, command="provision site=coastal"
)


@pytest.fixture
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("ATLANTIS_STATE", str(tmp_path))
    monkeypatch.setattr("sys.stdin.isatty", lambda: False, raising=False)
    return tmp_path


def start_run(state: Path, *, saves: bool = True, is_rehearsal: bool = False) -> Journal:
    with Store(state, is_rehearsal=is_rehearsal).start(replace(START, rehearsed=is_rehearsal)) as journal:
        if saves:
            journal.save(ROUTER, "/system identity set name=before\n")
        journal.write(Outcome(device=ROUTER, status="unknown", exit=ExitCode.UNKNOWN, message=""))
    return journal


def test_unfinished_run_can_be_resumed_or_rolled_back(state: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = start_run(state).run
    assert main(["recover"]) == ExitCode.DONE
    assert capsys.readouterr().out == (
        f"coastal: run {run} is unfinished on {ROUTER}\n  1: provision recover resume site=coastal run={run}\n  "
        f"2: provision recover rollback site=coastal run={run}\n"
    )


def test_run_without_a_saved_state_can_only_be_resumed(state: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = start_run(state, saves=False).run
    assert main(["recover", "site=coastal", "--json"]) == ExitCode.DONE
    (row,) = json.loads(capsys.readouterr().out)["unfinished"]
    commands = [f"provision recover resume site=coastal run={run}"]
    assert row == {"site": "coastal", "run": run, "devices": [ROUTER], "commands": commands}


def test_rehearsals_are_listed_apart(state: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = start_run(state, is_rehearsal=True).run
    assert main(["recover"]) == ExitCode.DONE
    assert capsys.readouterr().out == "no unfinished runs\n"
    assert main(["recover", "--rehearse"]) == ExitCode.DONE
    assert f"  2: provision recover rollback site=coastal run={run} --rehearse\n" in capsys.readouterr().out


def test_advised_rollback_can_be_typed(state: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with Store(state).start(START) as journal:
        journal.save(ROUTER, "/system identity set name=before\n")
        journal.write(Outcome(device=ROUTER, status="changed", exit=ExitCode.DONE, message=""))
    assert main(["recover"]) == ExitCode.DONE
    said = capsys.readouterr().out
    assert said.startswith("no unfinished runs\n  to undo the newest run: ")
    (words,) = advised(said)
    assert main(words) == ExitCode.USAGE
    assert "it is for rehearsals only" in capsys.readouterr().err


def test_unknown_site_is_not_reported_as_finished(state: Path, capsys: pytest.CaptureFixture[str]) -> None:
    start_run(state)
    assert main(["recover", "site=costal"]) == ExitCode.NOTHING
    printed = capsys.readouterr()
    assert (printed.out, "no runs of `costal`" in printed.err) == ("", True)


@pytest.mark.parametrize(("answer", "code"), [("2", ExitCode.USAGE), ("", ExitCode.DONE), ("3", ExitCode.DONE)])
def test_chosen_command_is_run(
    state: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], answer: str, code: ExitCode
) -> None:
    """The shipped inventory has example values, so that a real rollback is refused before a device is contacted."""
    start_run(state)
    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    monkeypatch.setattr(builtins, "input", lambda _: answer)
    assert main(["recover"]) == code
    assert ("it is for rehearsals only" in capsys.readouterr().err) is (code is ExitCode.USAGE)
