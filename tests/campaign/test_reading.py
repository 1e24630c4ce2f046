"""The campaign's own eyes: what it takes for advice, for a leftover, for a difference, and what a seed stands for."""

import os
import sys
from pathlib import Path
from typing import Any

import pytest

from atlantis_netcfg.cli.base.output import _reminder
from atlantis_netcfg.core.events import Event, Stage
from campaign import advice
from campaign.command import Command, Ended, end, living
from campaign.commands import COMMANDS
from campaign.faults import FAULTS, draw
from campaign.judge import Picture

FILTER = "ip/firewall/filter"


CTRL_C = """error: interrupted by Ctrl-C; the state of the devices is unknown
       `provision report runs` shows what was confirmed, and how to continue an unfinished run
"""
BUSY = """  scc-cpe            another run changes this bridge
                     wait until it has ended; if it has died:  provision recover resume
"""
OPEN = """  coastal-router     nothing was changed: interrupted by the user (6 round trips, 68.0 kB, 0.2 s)
                     what is in safe mode the device takes back by itself; then:  provision recover resume site=coastal
                     run=1
                     drift: not in the inventory, and not ours: left unchanged
"""
TYPED_BEFORE = """error: run 1 has left nothing pending on any device
       type its command again:  provision site=coastal device=scc-cpe inventory=/srv/pilot
"""
HELP = "       `provision recover resume --help` lists its arguments and options"
SAVED = """plan      1 row to add
next      provision plan apply /srv/saved.plan inventory=/srv/pilot
"""
ONE_HOST = "  wait for ten minutes, then:  provision report drift site=coastal device=scc-cpe"


@pytest.mark.parametrize(
    ("output", "typed", "waits"),
    [
        (SAVED, ("plan", "apply", "/srv/saved.plan"), False),
        (BUSY, ("recover", "resume", "site=coastal"), True),
        ("error: no run\n       `provision site=…` begins one", ("site=coastal",), False),
        (ONE_HOST, ("report", "drift", "site=coastal", "device=scc-cpe"), True),
        (OPEN, ("recover", "resume", "site=coastal", "run=1"), True),
        (TYPED_BEFORE, ("site=coastal", "device=scc-cpe"), False),
        ("  free disk space on the disk, then run the same command again", None, False),
    ],
)
def test_last_actionable_command_is_the_advice(
    output: str,
    typed: tuple[str, ...] | None,
    waits: bool,  # noqa: FBT001
) -> None:
    found = advice.read(output, "coastal")
    assert found is not None
    assert (found.typed, found.waits) == (typed, waits)


@pytest.mark.parametrize(
    "output", ["", "  coastal-router  unchanged\n", "       `provision report runs` lists all runs", CTRL_C, HELP]
)
def test_informational_output_gives_no_advice(output: str) -> None:
    assert advice.read(output, "coastal") is None


def picture(*rows: dict[str, Any], **menus: list[dict[str, Any]]) -> Picture:
    return Picture("router", {FILTER: list(rows), **{name.replace("_", "/"): each for name, each in menus.items()}})


def test_missing_extra_or_reordered_rule_differs_but_counters_do_not() -> None:
    first, second = {"chain": "input", "action": "accept", "bytes": 1}, {"chain": "input", "action": "drop", "bytes": 1}
    there = picture(first, second)
    assert picture({**first, "bytes": 9, ".id": "*7"}, second).differs(there) == []
    assert picture(second, first).differs(there) == [f"router {FILTER}: another order"]
    assert picture(first).differs(there) == [f"router {FILTER} - action=drop chain=input"]
    assert picture(first, second, {"chain": "output", "comment": "foreign"}).differs(there) == []


def test_leftovers_of_a_run_are_detected() -> None:
    jobs = [{"name": "atlantis-pair"}, {"name": "backup of the owner"}]
    left = Picture(
        "router",
        {
            "system/scheduler": jobs,
            "safe-mode": [{"enabled": True, "owner": "api:provision@10.0.0.2"}],
            "ip/firewall/address-list": [{"list": "atlantis-run", "comment": "run 1"}],
        },
    )
    assert left.armed == ["job atlantis-pair", "marker run 1", "safe mode is held by api:provision@10.0.0.2"]
    assert picture(safe_mode=[{"enabled": False}]).armed == []
    assert Picture("router", {"safe-mode": [{"enabled": True, "owner": "api:colleague@10.0.0.2"}]}).armed == []
    assert Picture("router", {"safe-mode": [{"enabled": True}]}).armed == ["safe mode is held by somebody"]


def test_seed_determines_the_round() -> None:
    assert draw(65).as_dict() == {
        "seed": 65,
        "state": "drifted",
        "version": "7.18.2",
        "command": "apply FILE",
        "json": False,
        "faults": ["state full for 6 s at line 9"],
    }
    assert {draw(seed).command for seed in range(300)} == set(COMMANDS)
    assert {fault.name for seed in range(300) for fault in draw(seed).faults} == set(FAULTS)


def test_process_that_outlives_its_command_is_reported_and_killed(tmp_path: Path) -> None:
    script = tmp_path / "atlantis_netcfg.py"
    script.write_text(
        "import subprocess, sys\n"
        "child = subprocess.Popen(['sleep', '60'], start_new_session=True, stdout=-3, stderr=-3)\n"
        "print(child.pid, flush=True)\n",
        encoding="utf-8",
    )
    command = Command((), {"PYTHONPATH": str(tmp_path), "PATH": os.environ["PATH"]}, tmp_path)
    command.start(sys.executable)
    command.process.wait()
    ended = command.finish()
    pid = int(ended.out)
    assert ended.code == 0
    assert ended.orphans == [pid]
    assert [words.partition(" ")[0] for words in end(ended.orphans)] == [str(pid)]
    assert living(command.mark, 5.0) == [], "it was not ended"


def test_reminder_resets_the_quiet_timer_but_not_the_idle_timer(tmp_path: Path) -> None:
    """A driver that took it for news would put no time forward at the devices, and wait for hours."""
    told = _reminder([(Event("router", Stage.WAITING, ""), 20.0)], 20.0)
    (tmp_path / "atlantis_netcfg.py").write_text(f"print({told!r})\n", encoding="utf-8")
    command = Command((), {"PYTHONPATH": str(tmp_path), "PATH": os.environ["PATH"]}, tmp_path)
    command.start(sys.executable)
    assert command.finish().out == f"{told}\n"
    assert command.idle_s > command.quiet_s


LOST = """  coastal-router     nothing was changed: its certificate is unknown here
                     `provision device trust site=coastal` on a terminal shows who responds, and asks you; or set it in
                     the inventory
"""


def test_repeated_line_does_not_reset_the_idle_timer(tmp_path: Path) -> None:
    program = "import time\nfor _ in range(9):\n    print('waiting', flush=True)\n    time.sleep(0.05)\n"
    (tmp_path / "atlantis_netcfg.py").write_text(program, encoding="utf-8")
    command = Command((), {"PYTHONPATH": str(tmp_path), "PATH": os.environ["PATH"]}, tmp_path)
    command.start(sys.executable)
    assert command.finish().out == "waiting\n" * 9
    assert command.idle_s - command.quiet_s >= 0.3


def test_advice_requires_a_terminal_only_if_it_says_so() -> None:
    said, unsaid = advice.read(LOST, "coastal"), advice.read(LOST.replace(" on a terminal", ""), "coastal")
    assert said is not None
    assert unsaid is not None
    assert said.typed == unsaid.typed == ("device", "trust", "site=coastal")
    assert (said.on_terminal, unsaid.on_terminal) == (True, False)


def test_command_that_needs_a_terminal_gets_a_pty(tmp_path: Path) -> None:
    script = "import sys\nprint(sys.stdin.isatty() and [input(), input()])\n"
    (tmp_path / "atlantis_netcfg.py").write_text(script, encoding="utf-8")
    environment = {"PYTHONPATH": str(tmp_path), "PATH": os.environ["PATH"]}
    told = []
    for answer in ("yes", ""):
        command = Command((), environment, tmp_path, answer=answer)
        command.start(sys.executable)
        command.process.wait()
        told.append(command.finish().out)
    assert told == ["['yes', 'yes']\n", "False\n"]


def test_upgrade_output_yields_run_id_and_device() -> None:
    told = '{"device": "coastal-router", "status": "changed", "run": "20261128T135453Z", "message": "", "hint": null}\n'
    text = "  coastal-router     RouterOS 7.18.2 -> 7.18.3\n  recorded as 20261128T135453Z\n"
    for out in (told, text):
        ended = Ended(("upgrade",), 0, out, "", 1.0, 1.0, [])
        assert list(ended.results)[:1] == ["coastal-router"]
        assert ended.runs == ["20261128T135453Z"]
        assert not ended.changed_nothing
