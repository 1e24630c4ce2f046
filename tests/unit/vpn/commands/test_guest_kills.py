"""`guest add` and `guest end`, killed before each change of a file: the other command leaves nothing of the guest."""

import os
import shutil
import signal
import subprocess
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from vpn_desk import PASSPHRASE, founded, over_a_pipe
from waiting import HANG_S

from atlantis_netcfg.cli import main
from atlantis_netcfg.cli.vpn import _common
from atlantis_netcfg.core.paths import checkout
from atlantis_netcfg.operations import guests
from atlantis_netcfg.operations.vpn.server import NoPush
from atlantis_netcfg.vpn.authority.authority import Authority

KILLER = """\
import os, signal, sys
folder, last, count = sys.argv[1], int(sys.argv[2]), 0
CHANGES = {"os.rename", "os.remove", "os.link", "os.mkdir", "os.rmdir", "os.truncate"}
def watch(event, arguments):
    global count
    writes = event == "open" and isinstance(arguments[2], int) and arguments[2] & (os.O_WRONLY | os.O_RDWR)
    if (writes or event in CHANGES) and str(arguments[0]).startswith(folder):
        count += 1
        if count == last:
            os.kill(os.getpid(), signal.SIGKILL)
from atlantis_netcfg.cli import main
sys.addaudithook(watch)
code = main(sys.argv[3:])
sys.stderr.write(f"changes {count}")
sys.exit(code)
"""
"""Kills itself before its change number `last` of a file below the folder."""
UNTIL = (datetime.now(UTC).date() + timedelta(days=20)).isoformat()
ADD = ("robot", "invite", "name=lauv", "partner=udg", "kind=auv", "site=coastal", "cells=gps", f"until={UNTIL}")
END = ("robot", "dismiss", "name=lauv", "--yes")


class Pier:
    """An inventory and an authority, and a person who types the commands of a guest."""

    def __init__(self, folder: Path, base: Path) -> None:
        self.folder = folder
        shutil.copytree(checkout() / "inventory", folder / "inventory")
        shutil.copytree(founded(base) / "vpn", folder / "vpn")
        self.before = self.inventory()

    def inventory(self) -> dict[str, bytes]:
        root = self.folder / "inventory"
        return {str(path.relative_to(root)): path.read_bytes() for path in root.rglob("*") if path.is_file()}

    def sign(self) -> int:
        """Put the record in order, as it is advised."""
        with over_a_pipe(PASSPHRASE) as number:
            return main(["vpn", "sync", "--sign", f"authority={self.folder / 'vpn'}", "--passphrase-fd", number])

    def type(self, words: tuple[str, ...], last: int = 0) -> "subprocess.CompletedProcess[str]":
        places = (f"inventory={self.folder / 'inventory'}", f"authority={self.folder / 'vpn'}")
        with over_a_pipe(PASSPHRASE) as number:
            program = (sys.executable, "-P", "-c", KILLER, str(self.folder), str(last))
            return subprocess.run(
                [*program, *words, *places, "--no-push", "--passphrase-fd", number],
                pass_fds=(int(number),),
                env={**os.environ, "ATLANTIS_STATE": str(self.folder / "state")},
                stdin=subprocess.DEVNULL,
                capture_output=True,
                text=True,
                timeout=HANG_S,
                check=False,
            )

    def changes(self, words: tuple[str, ...]) -> int:
        done = self.type(words)
        assert done.returncode in {0, 5}, done.stdout + done.stderr
        return int(done.stderr.rpartition("changes ")[2])

    def is_empty(self) -> None:
        """Nothing of the guest is left, and the record is whole."""
        authority = Authority.open(self.folder / "vpn")
        if problems := list(authority.check()):
            assert "the next one that signs repairs it" in problems[0], problems
            assert self.sign() in {0, 5}
        assert list(authority.check()) == []
        assert self.inventory() == self.before
        assert [member for member in guests.members_of(authority, "lauv") if member.good] == []
        assert not [*(self.folder / "vpn").glob("handouts/*/*.age")]


@pytest.mark.parametrize(
    "points",
    [
        pytest.param(2, marks=pytest.mark.slow),
        pytest.param(0, marks=pytest.mark.campaign),
    ],
)
@pytest.mark.parametrize("command", ["add", "end"])
def test_kill_at_any_step_is_completed_or_undone_by_the_next_command(
    tmp_path: Path,
    tmp_path_factory: pytest.TempPathFactory,
    monkeypatch: pytest.MonkeyPatch,
    command: str,
    points: int,
) -> None:
    monkeypatch.setattr(_common, "server", lambda *_: NoPush())
    monkeypatch.setenv("ATLANTIS_STATE", str(tmp_path / "state"))
    base = tmp_path_factory.getbasetemp()
    trial = Pier(tmp_path / "trial", base)
    number = trial.changes(ADD)
    if command == "end":
        number = trial.changes(END)
    assert number > 10
    for last in range(1, number + 1, max(1, number // points) if points else 1):
        pier = Pier(tmp_path / str(last), base)
        if command == "end":
            assert pier.type(ADD).returncode == 0
        killed = pier.type(ADD if command == "add" else END, last)
        assert killed.returncode == -signal.SIGKILL, killed.stdout + killed.stderr
        if command == "add" and last % 2:
            again = pier.type(ADD)
            assert again.returncode == 0, (last, again.stdout + again.stderr)
        ended = pier.type(END)
        assert ended.returncode in {0, 5, 7}, (last, ended.stdout + ended.stderr)
        pier.is_empty()
        shutil.rmtree(pier.folder)
