"""Commands that are cut at one system call, repeated, and looked at."""

import os
import re
import shutil
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import authority_witness as witness
from authority_child import SAID, place, run, traced

from atlantis_netcfg.vpn.authority.authority import Authority

__all__ = ["FAULTS", "SCENARIOS", "UNTOUCHED", "Cut", "Cutting"]

CALLS = (
    "openat,write,pwrite64,fsync,fdatasync,rename,renameat,renameat2,link,linkat,symlink,unlink,unlinkat,mkdir,mkdirat,"
    "rmdir,ftruncate,truncate,utimensat,fchmod,chmod,fchmodat,flock,close"
)
UNTOUCHED = {"flock", "close"}
"""Calls that are cut, but do not fail: a lock is waited for, and a descriptor is closed whatever is answered."""


@dataclass(frozen=True)
class Scenario:
    """What was done before, the command that is cut, and how many certificates each member has in the end."""

    before: tuple[str, ...]
    command: str
    admitted: tuple[tuple[str, int], ...]


SCENARIOS = {
    "init": Scenario((), "init", ()),
    "issue": Scenario(("issue a",), "issue b c", (("a", 1), ("b", 1), ("c", 1))),
    "issue-after-a-kill": Scenario(("issue a", "killed"), "issue b c", (("a", 1), ("b", 1), ("c", 1))),
    "renew": Scenario(("issue a", "renew iqua-a"), "renew iqua-a", (("a", 2),)),
    "renew-first": Scenario(("issue a", "seen iqua-a"), "renew iqua-a", (("a", 2),)),
    "revoke": Scenario(("issue a b c", "renew iqua-a"), "revoke iqua-a iqua-b", (("a", 0), ("b", 0), ("c", 1))),
    "publish": Scenario(("issue a", "renew iqua-a", "seen iqua-a.2"), "publish", (("a", 1),)),
    "serve": Scenario(("issue a",), "serve", (("a", 1),)),
    "seen": Scenario(("issue a", "renew iqua-a"), "seen iqua-a.2", (("a", 2),)),
}
FAULTS = {"kill": "signal=KILL", "full": "error=ENOSPC", "broken": "error=EIO", "quota": "error=EDQUOT"}


@dataclass(frozen=True)
class Cut:
    """The system call that is cut."""

    call: str
    number: int


LOST = (255, "")


class Cutting:
    """One scenario with its state before the command, and the system calls of the command."""

    def __init__(self, name: str, at: Path) -> None:
        self.scenario = SCENARIOS[name]
        self._at = at
        self._before = at / "before"
        self._prepare()
        self.cuts = self._trace(self.scenario.command)

    def cut(self, cut: Cut, fault: str) -> None:
        """Cut the command there, look, repeat it, look, repeat it once more."""
        work, ended = self._tried(cut, fault)
        folder = work / "vpn"
        before = self._before / "vpn"
        listed = witness.listed(before).number if (before / "crl.pem").exists() else 0
        self._ended(ended, fault)
        if (folder / "ledger.jsonl").exists():
            listed = _sound(folder, listed)
        for _ in range(2):
            run(work, self.scenario.command)
            self._right(folder, listed)
        shutil.rmtree(work)

    def _tried(self, cut: Cut, fault: str) -> tuple[Path, tuple[int, str]]:
        """Cut it, anew where strace has lost sight of what it killed and ends with a code of its own and no word."""
        for number in range(3):
            work = self._copy(f"{fault}-{cut.call}-{cut.number}-{number}")
            ended = _cut(work, self.scenario.command, cut, FAULTS[fault])
            if ended != LOST:
                break
            shutil.rmtree(work)
        return work, ended

    def _ended(self, ended: tuple[int, str], fault: str) -> None:
        code, said = ended
        if fault == "kill":
            assert code == -9, said
        elif code:
            # Refused in words, with a way on; 0: an error that did no harm.
            assert code == 4, said
            assert re.match(r"\w+: .+\nhint: \w.+\n$", said), said

    def _right(self, folder: Path, listed: int) -> None:
        _sound(folder, listed)
        assert Authority.open(folder).check() == []
        witness.private_and_clean(folder)
        admitted = {name: len(some) for name, some in witness.admitted(folder).items()}
        assert admitted == {f"iqua-{name}": count for name, count in self.scenario.admitted}

    def _prepare(self) -> None:
        self._before.mkdir()
        if self.scenario.command != "init":
            place(self._before)
        for step in self.scenario.before:
            if step == "killed":
                # It had handed out both, and had recorded neither.
                last = max(cut.number for cut in self._trace("issue b c") if cut.call == "rename")
                assert _cut(self._before, "issue b c", Cut("rename", last), FAULTS["kill"])[0] == -9
            else:
                run(self._before, step)

    def _trace(self, command: str) -> list[Cut]:
        work = self._copy("traced")
        trace = work / "trace"
        code, said = traced(work, command, "-o", str(trace), "-e", f"trace={CALLS}")
        assert code == 0, said
        cuts = list(_cuts(trace.read_text()))
        shutil.rmtree(work)
        return cuts

    def _copy(self, name: str) -> Path:
        work = self._at / name
        shutil.copytree(self._before, work)
        (work / SAID).unlink(missing_ok=True)
        return work


def _cut(work: Path, command: str, cut: Cut, fault: str) -> tuple[int, str]:
    injected = f"inject={cut.call}:{fault}:when={cut.number}"
    return traced(work, command, "-o", os.devnull, "-e", f"trace={cut.call}", "-e", injected)


def _cuts(trace: str) -> Iterator[Cut]:
    seen: Counter[str] = Counter()
    for found in re.finditer(r"^\d+ +(\w+)\(", trace, re.MULTILINE):
        seen[found[1]] += 1
        yield Cut(found[1], seen[found[1]])


def _sound(folder: Path, listed: int) -> int:
    """What holds at every moment."""
    witness.nothing_outside_the_record(folder)
    witness.issued(folder)
    number = witness.listed(folder).number
    assert number >= listed
    return number
