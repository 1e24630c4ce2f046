"""The process is killed at every record of its journal, or its disk is full: nothing is lost, and `resume` goes on."""

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from engine_bench import PASSWORD, TEXT, leases, without_header
from waiting import wait_until

from atlantis_netcfg.emulator.routeros import EmulatorSpec, RouterSpec, RunningSite, SiteSpec, User
from atlantis_netcfg.runs import Run, Store

pytestmark = pytest.mark.slow

CHILD = Path(__file__).with_name("child_run.py")
RECORDS = 14
"""What a run of one piece writes after its start, and some more."""
LONG = TEXT + leases(70)


@dataclass
class Quay:
    """A twin in a thread, and runs against it in processes."""

    site: RunningSite
    folder: Path
    text: str
    console: bool = False
    patience: dict[str, float] = field(default_factory=dict)

    def run(self, mode: str = "apply", **asked: Any) -> subprocess.CompletedProcess[str]:  # noqa: ANN401 - JSON
        text = self.folder / "desired.rsc"
        text.write_text(self.text, encoding="utf-8")
        ready = self.site.ready["router"]
        endpoint = {"host": ready["host"], "port": ready["api_ssl"], "pin": ready["pin"], "password": PASSWORD}
        if self.console:
            endpoint |= {"ssh": ready["ssh"], "host_key": ready["host_key"]}
        request = {
            **endpoint,
            "patience": self.patience,
            "state": str(self.folder / "state"),
            "text": str(text),
            "mode": mode,
            **asked,
        }
        arguments = [sys.executable, str(CHILD), json.dumps(request)]
        return subprocess.run(arguments, capture_output=True, text=True, check=False)

    def export(self) -> str:
        return without_header(str(self.site.do("router", "export", show_sensitive=True)))

    def settled(self) -> str:
        """The export once the router has noticed that its client has died."""
        wait_until(lambda: "=enabled=true" not in str(self.site.do("router", "console", words=["/safe-mode/print"])))
        return self.export()

    @property
    def journal(self) -> Run:
        (run,) = Store(self.folder / "state").runs("coastal")
        return run


@contextmanager
def quay(folder: Path, text: str = TEXT, **spec: Any) -> Iterator[Quay]:  # noqa: ANN401 - fields of RouterSpec
    users = (User(name="provision", password=PASSWORD), User(name="watch", password="w"))
    router = RouterSpec(name="router", users=users, unroll_delay_s=0.05, **spec)
    (folder / "twins").mkdir()
    with RunningSite(SiteSpec(name="coastal", emulators=(EmulatorSpec(router=router),)), folder / "twins") as site:
        yield Quay(site, folder, text)


def kill_and_resume(folder: Path, record: int, moment: str, text: str = TEXT) -> bool:
    """Kill a run at a record, then resume it; False if the run ended before."""
    with quay(folder, text) as there:
        before = there.export()
        killed = there.run(record=record, moment=moment)
        if killed.returncode == 0:
            return False
        assert killed.returncode == -signal.SIGKILL, killed.stderr
        between = there.settled()
        if not there.journal.unsettled_devices:
            assert there.journal.outcomes["router"].status == "changed"
            return True
        assert there.journal.log.has_torn_end == (moment == "torn")
        resumed = there.run("resume")
        assert resumed.returncode == 0, resumed.stderr
        result = json.loads(resumed.stdout)
        after = there.export()
        again = json.loads(there.run().stdout)
    # Harmless rows that went ahead of safe mode may be there; `resume` completes them.
    assert between in (before, after) or text != TEXT
    assert result["status"] == ("unchanged" if between == after else "changed")
    assert (again["status"], again["planned"]) == ("unchanged", 0)
    run = Store(folder / "state").runs("coastal")[0]
    assert run.settled_devices == {"router"}
    return True


@pytest.mark.smoke("1", "7", "13")
@pytest.mark.parametrize("record", range(1, RECORDS))
def test_killed_at_each_record(tmp_path: Path, record: int) -> None:
    went_on = kill_and_resume(tmp_path, record, "after")
    assert went_on == (record <= 12)


@pytest.mark.smoke("before")
@pytest.mark.parametrize("moment", ["before", "torn"])
def test_killed_while_a_script_is_acknowledged(tmp_path: Path, moment: str) -> None:
    assert kill_and_resume(tmp_path, 6, moment)


@pytest.mark.campaign
@pytest.mark.parametrize("moment", ["before", "torn", "after"])
@pytest.mark.parametrize("text", [TEXT, LONG], ids=["short", "long"])
def test_killed_at_each_record_at_each_moment(tmp_path: Path, moment: str, text: str) -> None:
    record = 0
    went_on = True
    while went_on:
        record += 1
        folder = tmp_path / str(record)
        folder.mkdir()
        went_on = kill_and_resume(folder, record, moment, text)
    assert record > RECORDS - 2


def kill_below_safe_mode(folder: Path, record: int, *, console: bool) -> bool:
    """Kill a run on a router before 7.18, then resume it; False if the run ended before."""
    with quay(folder, version="7.16") as there:
        there.console = console
        there.patience = {"dead_man_s": 63.0, "undo_s": 3.0}  # a job is not trusted in its last minute
        before = there.export()
        killed = there.run(record=record, moment="after")
        if killed.returncode == 0:
            return False
        assert killed.returncode == -signal.SIGKILL, killed.stderr
        if not there.journal.unsettled_devices:
            return True
        resumed = there.run("resume")
        assert resumed.returncode == 0, resumed.stderr
        result = json.loads(resumed.stdout)
        again = json.loads(there.run().stdout)
        after = there.export()
    assert result["status"] in ("changed", "unchanged"), result["message"]
    assert after != before
    assert "/system scheduler" not in after
    assert (again["status"], again["planned"]) == ("unchanged", 0), again["message"]
    return True


@pytest.mark.campaign
@pytest.mark.parametrize("console", [True, False], ids=["console", "job"])
@pytest.mark.parametrize("record", [3, 4, 5, 6, 7, 8, 9])
def test_run_killed_on_a_router_without_safe_mode_is_resumed(tmp_path: Path, record: int, console: bool) -> None:  # noqa: FBT001
    """The router returns by itself before the resumed run begins; in real time, a minute each."""
    assert kill_below_safe_mode(tmp_path, record, console=console)


def test_killed_before_a_job_is_armed(tmp_path: Path) -> None:
    assert kill_below_safe_mode(tmp_path, 3, console=False)


@pytest.mark.smoke("0")
@pytest.mark.parametrize("share", [0, 0.05, 0.5, 0.8, 0.9, 0.97])
def test_full_disk_leaves_an_intact_journal(tmp_path: Path, share: float) -> None:
    """The file system takes so much of what a whole run writes."""
    for name in ("whole", "full"):
        (tmp_path / name).mkdir()
    with quay(tmp_path / "whole") as there:
        there.run()
        size = int(share * (there.journal.directory / "journal.jsonl").stat().st_size)
    with quay(tmp_path / "full") as there:
        before = there.export()
        ended = there.run(bytes=size)
        assert ended.returncode == 0, ended.stderr
        now = there.settled()
    result = json.loads(ended.stdout)
    assert (now != before) == (result["status"] == "changed")
    assert "cannot be written: File too large" in f"{result['message']} {result['notes']}"
    assert not there.journal.log.damage
    assert not there.journal.log.has_torn_end
