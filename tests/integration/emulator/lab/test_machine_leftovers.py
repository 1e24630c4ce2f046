"""Nothing of a yard is left on this computer, however its owner ends."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
from debian_trees import BARE
from machine_stand import ADDRESS, ROUTER, bare, gateway, ground, key, left
from waiting import HANG_S, wait_until

from atlantis_netcfg.emulator.lab import Lab, Machine, build_rootfs, open_lab

__all__ = ["bare", "gateway", "ground", "key"]
pytestmark = [pytest.mark.slow, pytest.mark.namespace]
OWNER = """\
import os, sys, time
from pathlib import Path
from atlantis_netcfg.emulator.lab import open_lab
with open_lab(Path(sys.argv[1])) as ground:
    ground.start("robot", Path(sys.argv[2]), address=sys.argv[3], gateway=sys.argv[4])
    worker = os.fork() if sys.argv[5:] else None
    if worker != 0:
        print(ground.name, worker, flush=True)
    time.sleep(600)
"""


class Owner:
    """A process that has a yard with a running machine."""

    def __init__(self, folder: Path, tree: Path, *more: str) -> None:
        words = (sys.executable, "-c", OWNER, str(folder), str(tree), ADDRESS, ROUTER, *more)
        self.process = subprocess.Popen(
            words,
            stdout=subprocess.PIPE,
            text=True,
            # Tests that a shell runs in the background hand on that Ctrl+C is ignored.
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # noqa: PLW1509 - no thread of ours forks
        )
        assert self.process.stdout is not None
        self.yard, self.worker = self.process.stdout.readline().split()

    def reaper(self) -> int:
        pid = self.process.pid
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
        return next(int(child) for child in children if "reaper.py" in Path(f"/proc/{child}/cmdline").read_text())

    def end(self, number: signal.Signals) -> None:
        self.process.send_signal(number)
        self.process.wait(HANG_S)


@pytest.fixture
def owner(bare: Path, tmp_path: Path) -> Iterator[Owner]:
    made = Owner(tmp_path / "owner", bare)
    yield made
    with suppress(ProcessLookupError):
        made.process.kill()
    made.process.communicate()


def _await_nothing(name: str) -> None:
    wait_until(lambda: not left(name), lambda: left(name))


def test_failing_block_leaves_nothing_behind(bare: Path, tmp_path: Path) -> None:
    names = []

    def fail() -> None:
        with open_lab(tmp_path / "yard") as ground:
            ground.start("robot", bare, address=ADDRESS, gateway=ROUTER)
            names.append(ground.name)
            assert len(left(ground.name)) > 5
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert left(names[0]) == []
    assert (tmp_path / "yard" / "robot.log").is_file()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_terminated_owner_leaves_nothing_behind(owner: Owner, number: signal.Signals) -> None:
    owner.end(number)
    _await_nothing(owner.yard)


def test_killed_owner_with_a_living_fork_leaves_nothing_behind(bare: Path, tmp_path: Path) -> None:
    owner = Owner(tmp_path / "owner", bare, "with a worker")
    try:
        owner.end(signal.SIGKILL)
        _await_nothing(owner.yard)
        assert Path("/proc", owner.worker).exists()
    finally:
        os.kill(int(owner.worker), signal.SIGKILL)
        owner.process.communicate()


def test_next_lab_removes_leftovers_of_a_killed_owner_and_reaper(owner: Owner, tmp_path: Path) -> None:
    assert left(owner.yard)
    os.kill(owner.reaper(), signal.SIGKILL)
    owner.end(signal.SIGKILL)
    with open_lab(tmp_path / "next"):
        _await_nothing(owner.yard)  # another test's yard may have begun to sweep it before ours


def test_labs_of_other_owners_are_left_alone(owner: Owner, gateway: Machine, ground: Lab, tmp_path: Path) -> None:
    with open_lab(tmp_path / "third") as third:
        names = {owner.yard, ground.name, third.name}
        assert len(names) == 3
        assert all(left(name) for name in names)
        assert gateway.run("hostname").stdout == "coastal-gateway\n"
    assert left(third.name) == []
    assert gateway.state(wait_for_boot=True) == "running"
    assert owner.process.poll() is None


def test_killed_build_is_discarded_but_not_files_mounted_in_it(
    bare: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert bare.is_dir()  # machines run here
    half, ours = tmp_path / "a cache" / f"{BARE.key()}.half", tmp_path / "ours"
    (half / "proc").mkdir(parents=True)
    ours.mkdir()
    (ours / "kept").write_text("kept\n")
    subprocess.run(["mount", "--bind", ours, half / "proc"], check=True)
    (tmp_path / "mmdebstrap").write_text(f"#!/bin/sh\nmkdir '{half}'\n")
    (tmp_path / "mmdebstrap").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    made = build_rootfs(BARE, tmp_path / "a cache")
    assert list(made.iterdir()) == []
    assert (ours / "kept").read_text() == "kept\n"
    assert str(ours) not in Path("/proc/self/mountinfo").read_text()


def test_stopped_machine_is_removed_before_its_lab(gateway: Machine, ground: Lab) -> None:
    gateway.stop()
    running = subprocess.run(["ip", "netns", "pids", ground.name], capture_output=True, text=True, check=True)
    assert running.stdout == ""
    assert not gateway.runs
    assert not Path(f"/run/netns/{ground.name}-m0").exists()
