"""A run that dies between two pieces leaves its sign on the router: whatever a person types then leads out of it."""

import json
import os
import re
import signal
import subprocess
from pathlib import Path
from typing import Any

import preforked
import pytest
from hints_said import advised
from quay import PROVISION, ROUTER, Quay, fresh_quay
from waiting import wait_until

pytestmark = [pytest.mark.slow, pytest.mark.namespace]
RUN = ("site=coastal", f"device={ROUTER}", "--yes")
at = pytest.fixture(fresh_quay)


def killed_between_pieces(at: Quay) -> str:
    """Kill a run once its first piece is permanent, with all its processes; the run's name."""
    at.do("link", delay_s=0.15)
    with subprocess.Popen(
        [PROVISION, *RUN, f"inventory={at.inventory}"],
        env=at.environment(),
        start_new_session=True,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    ) as running:
        found = wait_until(
            lambda: [path for path in _journals(at) if '"kind":"released"' in path.read_text()], every_s=0.005
        )
        holder = (at.state / "real/coastal/lock").read_text(encoding="utf-8")
        for process in {running.pid, json.loads(holder)["pid"]}:
            os.kill(process, signal.SIGKILL)
    at.do("link", delay_s=0.0)
    assert _signs(at), "the run was over"
    return found[0].parent.name


def _journals(at: Quay) -> list[Path]:
    return sorted(at.state.glob("real/coastal/runs/*/journal.jsonl"))


def _signs(at: Quay) -> str:
    """What stands in the list of signs on the router."""
    told = str(at.do("console", words=["/ip/firewall/address-list/print"]))
    return told if "atlantis-run" in told else ""


def laptop(at: Quay, name: str, *typed: str) -> tuple[int, dict[str, Any]]:
    """Type a command on another laptop, which shares nothing with the first one."""
    words = [*dict.fromkeys([*typed, "--json", f"inventory={at.inventory}"])]
    done = preforked.run(words, env=at.laptop(name))
    assert done.stdout, done.stderr
    told: dict[str, Any] = json.loads(done.stdout)
    return done.returncode, told


def whole(at: Quay) -> None:
    """The router is as declared, nothing is left on it, and no run is open."""
    assert not _signs(at)
    assert at.json("plan", *RUN[:2], code=0)["devices"][ROUTER]["planned"] == 0
    assert not any(row["unfinished"] for row in at.runs())


@pytest.mark.smoke
def test_repeated_command_continues_the_killed_run(at: Quay) -> None:
    killed_between_pieces(at)
    assert at.json(*RUN, code=0)["devices"][ROUTER]["status"] == "changed"
    whole(at)


def test_command_advised_by_runs_continues_the_killed_run(at: Quay) -> None:
    run = killed_between_pieces(at)
    (row,) = at.runs()
    (command,) = advised(row["next"])
    assert command == ["recover", "resume", "site=coastal", f"run={run}", f"inventory={at.inventory}"]
    assert at.json(*command, code=0)["devices"][ROUTER]["status"] == "changed"
    whole(at)


def test_second_laptop_is_told_how_to_take_over_the_run(at: Quay) -> None:
    run = killed_between_pieces(at)
    code, told = laptop(at, "second", *RUN)
    assert code == 4
    told = told["devices"][ROUTER]
    assert (told["status"], f"run {run} of " in told["message"]) == ("left-as-found", True)
    assert "or was interrupted there" in told["message"]
    assert re.search(r"the marker of an interrupted run disappears by itself within (29|30)m", told["hint"])
    (command,) = advised(told["hint"])
    assert command == ["recover", "resume", "site=coastal", f"run={run}", f"inventory={at.inventory}"]
    code, told = laptop(at, "second", *command)
    assert (code, told["devices"][ROUTER]["status"]) == (0, "changed")
    assert not _signs(at)
    assert [row["unfinished"] for row in at.runs()] == [True]


def test_resume_on_a_laptop_without_the_journal_leads_to_take_over(at: Quay) -> None:
    run = killed_between_pieces(at)
    code, told = laptop(at, "second", "recover", "resume", "site=coastal")
    assert code == 4
    (command,) = advised(told["devices"][ROUTER]["hint"])
    assert command == ["recover", "resume", "site=coastal", f"run={run}", f"inventory={at.inventory}"]
    code, told = laptop(at, "second", *command)
    assert (code, told["devices"][ROUTER]["status"]) == (0, "changed")
    assert not _signs(at)
