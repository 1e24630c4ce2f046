"""The process is killed at a record of its journal: both ends return, or both are new; `resume` goes on."""

import json
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from pair_bench import PASSWORD, PairBench, Words, text, without_job

from atlantis_netcfg.emulator.routeros import Air, RunningSite
from atlantis_netcfg.runs import Store

pytestmark = pytest.mark.slow

CHILD = Path(__file__).with_name("pair_child.py")
NEW = Words(ssid="new name", key="a new key for both ends")
TIMEOUT_S = 6.0
ENDS = ("near", "far")
Exports = tuple[str, str]


class Quay:
    """Both twins in a thread, and runs against them in processes."""

    def __init__(self, folder: Path, site: RunningSite, bench: PairBench) -> None:
        self.folder = folder
        self.site = site
        self.bench = bench

    def run(self, mode: str = "apply", **asked: Any) -> subprocess.CompletedProcess[str]:  # noqa: ANN401 - JSON
        request = {
            **{name: self._end(name) for name in ENDS},
            "state": str(self.folder / "state"),
            "password": PASSWORD,
            "mode": mode,
            "timeout_s": TIMEOUT_S,
            **asked,
        }
        arguments = [sys.executable, str(CHILD), json.dumps(request)]
        return subprocess.run(arguments, capture_output=True, text=True, check=False)

    def _end(self, name: str) -> Mapping[str, object]:
        ready = self.site.ready[name]
        words = text(self.bench.family, self.bench.mode(name), NEW)
        return {
            "host": ready["host"],
            "port": ready["api_ssl"],
            "pin": ready["pin"],
            "address": ready["address"],
            "text": words,
        }

    def exports(self) -> Exports:
        near, far = (str(self.site.do(name, "export", show_sensitive=True)) for name in ENDS)
        return without_clock(near), without_job(without_clock(far))

    def alike(self, wanted: tuple[Exports, ...]) -> Exports:
        """Both exports once they are one of those that are allowed, and nobody holds safe mode any more."""
        until = time.monotonic() + 3 * TIMEOUT_S + 5
        while (found := self.exports()) not in wanted or self.held():
            assert time.monotonic() < until, found
        return found

    def held(self) -> bool:
        words = ["/safe-mode/print"]
        return any("=enabled=true" in str(self.site.do(name, "console", words=words)) for name in ENDS)


def without_clock(export: str) -> str:
    """Leave out the header, and join lines: where they break depends on the length of the words."""
    lines = (line for line in export.splitlines(keepends=True) if not line.startswith("#"))
    return "".join(lines).replace("\\\n    ", "")


def kill_and_resume(folder: Path, record: int) -> bool:
    """Kill a run at a record, see what the ends become, then resume it; False if the run ended before."""
    spec = {"unroll_delay_s": 0.05, "silent_timeout_s": 12.0}
    bench = PairBench(folder, air=Air(dfs_wait_s=0.0, association_s=0.3), spec=spec)
    (folder / "flash").mkdir(parents=True)
    with RunningSite(bench.site.spec, folder / "flash") as site:
        quay = Quay(folder, site, bench)
        before = quay.exports()
        killed = quay.run(record=record)
        if killed.returncode == 0:
            return False
        assert killed.returncode == -signal.SIGKILL, killed.stderr
        after = wanted(before)
        quay.alike((before, after))
        unsettled = Store(folder / "state").runs("quay")[-1].unsettled_devices
        if unsettled:
            resumed = quay.run("resume")
            assert resumed.returncode == 0, resumed.stderr
            assert {result["status"] for result in json.loads(resumed.stdout)} <= {"changed", "unchanged"}, (
                resumed.stdout
            )
        assert quay.alike((after,)) == after
        again = json.loads(quay.run().stdout)
        assert [result["status"] for result in again] == ["unchanged", "unchanged"]
    return True


def wanted(before: Exports) -> Exports:
    old, new = Words(), NEW
    near, far = (each.replace(old.ssid, new.ssid).replace(old.key, new.key) for each in before)
    return near, far


@pytest.mark.smoke("13")
@pytest.mark.parametrize("record", [7, 13, 17, 19])
def test_killed_at_a_record(tmp_path: Path, record: int) -> None:
    assert kill_and_resume(tmp_path, record)


@pytest.mark.campaign
@pytest.mark.timeout(1800)
def test_killed_at_each_record(tmp_path: Path) -> None:
    record = 1
    while kill_and_resume(tmp_path / str(record), record):
        record += 1
    assert record > 20
