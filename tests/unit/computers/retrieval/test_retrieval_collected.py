"""A robot's recordings: what the gateway's program collects, and what it says where that cannot be."""

import json
import os
import shutil
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from retrieval_programs import GATEWAY, KEY, ROBOT, program, with_retrieval

from atlantis_netcfg.computers.retrieval import line_for_robot, retrieval
from atlantis_netcfg.core.errors import ExitCode, UsageError
from atlantis_netcfg.inventory.model import RetrievalRobot
from atlantis_netcfg.operations.retrieve import RetrievalStatus, plan, source_at

NOW = 1_764_000_000
program("retrieval")
MODULE: Any = sys.modules["retrieval_robot"]
"""As the gateway's program imports it."""
SETTINGS = {"source": "sparus", "key": "key", "budget": 10_000, "robot_user": "recorder", "robot_port": 22}
DECLARED = with_retrieval(robots=[ROBOT], sources=[{"host": GATEWAY}])


class Rsync:
    """In the place of rsync: copies from a folder; what it is to spoil, to refuse or to lose it does so."""

    def __init__(self, robot: Path) -> None:
        self.robot, self.spoils = robot, 0
        self.fails: list[tuple[int, str]] = []
        self.calls: list[str] = []
        self.lies: list[str] = []

    def run(self, words: list[str], data: bytes, _within_s: float, **_: Any) -> tuple[int, bytes, bytes]:  # noqa: ANN401
        if self.fails:
            code, text = self.fails.pop()
            return code, b"", text.encode()
        listed = [path.decode() for path in data.split(b"\0") if path]
        if "--list-only" in words:
            self.calls.append("list")
            return 0, self._rows().encode(), b""
        target = Path(words[-1])
        if "--dry-run" in words:
            self.calls.append("compare")
            differs = [path for path in listed if (self.robot / path).read_bytes() != (target / path).read_bytes()]
            return 0, "".join(f"{path}\n" for path in differs).encode(), b""
        self.calls.append("fetch")
        lost = [path for path in listed if not (self.robot / path).exists()]
        for path in set(listed) - set(lost):
            (target / path).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(self.robot / path, target / path)
            if self.spoils:
                self.spoils -= 1
                state = (target / path).stat()
                (target / path).write_bytes(b"X" * state.st_size)
                os.utime(target / path, ns=(state.st_atime_ns, state.st_mtime_ns))
        return 23 if lost else 0, b"", b"some were not sent"

    def _rows(self) -> str:
        lines = [
            "drwxr-xr-x          4,096 2026/11/26 05:57:43 .",
            "lrwxrwxrwx             10 2026/11/26 05:57:43 link",
            *self.lies,
        ]
        for path in sorted(self.robot.rglob("*")):
            if path.is_file():
                when = time.strftime("%Y/%m/%d %H:%M:%S", time.gmtime(path.stat().st_mtime))
                lines.append(f"-rw-r--r-- {path.stat().st_size:14d} {when} {path.relative_to(self.robot)}")
        return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    ("script", "words"),
    [
        ("while :; do printf x; sleep 0.02; done", "has not ended within 1 s"),
        ("exec cat /dev/zero >&2", "tells more than 16 MB"),
        ("exec cat /dev/zero", "tells more than 16 MB"),
        ("exec sleep 600", "has not ended within 1 s"),
    ],
)
def test_program_with_too_much_output_or_no_end_is_killed(script: str, words: str) -> None:
    with pytest.raises(MODULE.TooMuch, match=words):
        MODULE.bounded(["sh", "-c", script], b"", None if "zero" in script else 0.6)


def test_output_is_complete_and_errors_are_truncated() -> None:
    script = "cat; head -c 300000 /dev/zero >&2; exit 7"
    assert MODULE.bounded(["sh", "-c", script], b"a" * 200_000) == (7, b"a" * 200_000, bytes(65536))


def test_hanging_robot_is_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "rsync").write_text("#!/bin/sh\nwhile :; do echo at work >&2; sleep 0.02; done\n")
    (tmp_path / "rsync").chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    monkeypatch.setattr(MODULE, "LIST_S", 0.6)
    robot = MODULE.Robot({**SETTINGS, "folder": str(tmp_path / "here"), "robot_address": "192.0.2.1"})
    with pytest.raises(MODULE.Refused, match="sparus has not ended within 1 s, and is left out"):
        robot.list()


@pytest.fixture
def rsync(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Rsync:
    (tmp_path / "bags").mkdir()
    made = Rsync(tmp_path / "bags")
    monkeypatch.setattr(MODULE, "bounded", made.run)
    return made


@pytest.fixture
def robot(rsync: Rsync, tmp_path: Path) -> Any:  # noqa: ANN401 - a program, no module of ours
    assert not rsync.calls
    return MODULE.Robot({**SETTINGS, "robot_address": "192.0.2.1", "folder": str(tmp_path / "robots/sparus")})


def record(rsync: Rsync, path: str, data: bytes = b"bag") -> None:
    place = rsync.robot / path
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_bytes(data)
    os.utime(place, (NOW, NOW))


def test_files_are_listed_from_rsync_output(rsync: Rsync, robot: Any) -> None:  # noqa: ANN401 - as above
    record(rsync, "dive 1/a.db3", b"x" * 1_234)
    record(rsync, "odd\\#012name")
    listed = robot.list()
    assert ["dive 1/a.db3", 1_234, NOW * 10**9] in listed
    assert len(listed) == 2, "no folder, no link"
    with pytest.raises(UnicodeEncodeError):
        next(row for row in listed if "odd" in row[0])[0].encode()


@pytest.mark.parametrize("path", ["../../../etc/passwd", "bag/../../secret", "/etc/passwd", "bag//a", "./a"])
def test_robot_listing_paths_outside_its_folder_is_refused(
    rsync: Rsync,
    robot: Any,  # noqa: ANN401 - as above
    path: str,
) -> None:
    record(rsync, "bag/a")
    rsync.lies = [f"-rw-r--r--          3 2026/11/26 05:57:43 {path}"]
    with pytest.raises(MODULE.Refused, match="sparus names a file outside of its folder"):
        robot.list()


def test_file_is_stored_only_after_comparison(rsync: Rsync, robot: Any) -> None:  # noqa: ANN401 - as above
    record(rsync, "bag/a", b"x" * 100)
    rsync.spoils = 1
    rows = robot.list()
    assert robot.collect(rows) == {"changed": [], "unread": [], "differ": []}
    assert rsync.calls == ["list", "fetch", "compare", "fetch", "compare"], (
        "what differs is fetched again, and compared"
    )
    assert Path(robot.folder, "bag/a").read_bytes() == b"x" * 100
    assert robot.here(rows[0])
    record(rsync, "bag/b")
    assert robot.collect(robot.list()[1:]) == {"changed": [], "unread": [], "differ": []}
    assert rsync.calls[5:] == ["list", "fetch", "compare"]
    robot.collect(rows)
    assert len(rsync.calls) == 8, "what is here is not fetched again"


def test_differing_files_are_reported_and_not_stored(rsync: Rsync, robot: Any) -> None:  # noqa: ANN401 - as above
    for name in ("differs", "goes", "grows"):
        record(rsync, name, b"x" * 10)
    rows = robot.list()
    (rsync.robot / "goes").unlink()
    (rsync.robot / "grows").write_bytes(b"y" * 20)
    rsync.spoils = 9
    assert robot.collect(rows) == {"changed": ["grows"], "unread": ["goes"], "differ": ["differs"]}
    assert list(Path(robot.folder).iterdir()) == []


def test_missing_space_accounts_for_budget_and_partial_files(rsync: Rsync, robot: Any) -> None:  # noqa: ANN401 - as above
    record(rsync, "a", b"x" * 8_000)
    record(rsync, "b", b"x" * 4_000)
    rows = robot.list()
    assert robot.lacking(rows) == 2_000
    Path(robot.partial, "a").write_bytes(b"x" * 7_000)
    assert robot.lacking(rows) == 2_000, "what was begun of a file is a part of it"
    Path(robot.partial, "gone").write_bytes(b"x" * 500)
    assert robot.lacking(rows) == 2_500
    robot.forget({"a", "b"})
    assert robot.lacking(rows) == 2_000
    assert robot.lacking(rows[:1]) == 0


@pytest.mark.parametrize(
    ("code", "text", "kind", "words"),
    [
        (255, "recorder@192.0.2.1: Permission denied (publickey).", "key", "does not admit the SSH host key"),
        (255, "Host key verification failed.", "host_key", "has not its declared SSH host key"),
        (255, "No ED25519 host key is known for sparus", "host_key", "has not its declared SSH host key"),
        (12, "bash: line 1: rrsync: command not found", "program", "has no rrsync"),
        (23, 'rsync: [sender] opendir "/bags/x" failed: Permission denied (13)', "unread", "read all of the folder"),
        (11, "rsync: write failed: No space left on device (28)", "disk", "the disk of this gateway is full"),
        (255, "ssh: connect to host 192.0.2.1 port 22: No route to host", "", "sparus does not answer"),
        (30, "rsync error: timeout in data send/receive", "", "sparus does not answer"),
    ],
)
def test_rsync_failures_are_explained(code: int, text: str, kind: str, words: str) -> None:
    found = MODULE.meaning("sparus", code, text.encode())
    assert type(found).__name__ == ("Refused" if kind else "Away")
    assert (getattr(found, "kind", ""), words in str(found)) == (kind, True)


@pytest.fixture
def sender(tmp_path: Path, rsync: Rsync, monkeypatch: pytest.MonkeyPatch) -> Any:  # noqa: ANN401 - as above
    assert not rsync.calls
    made = program("retrieval")
    monkeypatch.setattr(made.time, "sleep", lambda _seconds: None)
    for name in ("JOB", "STATUS", "COUNTS", "KEPT", "HASHES"):
        monkeypatch.setattr(made, name, tmp_path / f"{name}.json")
    return made


def settings(folder: Path) -> dict[str, Any]:
    return {**SETTINGS, "robot_address": "192.0.2.1", "folder": str(folder / "robots/sparus")}


WISH = {"pattern": "*", "again": False, "before": NOW + 600}


def job(sender: Any, rows: list[Any]) -> dict[str, Any]:  # noqa: ANN401 - as above
    made = {"source": "sparus", "files": rows, "silence_s": 120}
    sender.JOB.write_text(json.dumps(made))
    return made


def left() -> dict[str, list[str]]:
    return {"changed": [], "gone": [], "differ": [], "unread": [], "robot": []}


def test_copy_is_deleted_after_delivery_and_not_collected_again(
    sender: Any,  # noqa: ANN401 - as above
    rsync: Rsync,
    tmp_path: Path,
) -> None:
    record(rsync, "bag/a", b"x" * 100)
    declared = settings(tmp_path)
    look = sender.listed(declared, WISH)
    assert (look["files"], look["robot"]["state"]) == (1, "answers")
    why = left()
    rows = sender.collected(declared, job(sender, look["rows"]), why)
    assert (rows, why) == (look["rows"], left())
    sender.keep(declared, [[*rows[0][:2], "digest", rows[0][2]]])
    assert not (tmp_path / "robots/sparus/bag").exists()
    assert sender.collected(declared, json.loads(sender.JOB.read_text()), left()) == [], "nor in the same transfer"
    assert (sender.listed(declared, WISH)["files"], sender.listed(declared, WISH)["kept"]) == (0, 1)
    assert sender.listed(declared, {**WISH, "again": True})["compared"] == 1
    assert (rsync.robot / "bag/a").exists()


def test_lost_robot_is_awaited_then_collected_files_are_sent(
    sender: Any,  # noqa: ANN401 - as above
    rsync: Rsync,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(MODULE, "BATCH_FILES", 1)
    for name in ("a", "b"):
        record(rsync, name)
    declared = settings(tmp_path)
    rows = sender.listed(declared, WISH)["rows"]
    rsync.fails = [(255, "No route to host")] * 3
    why = left()
    assert sender.collected(declared, job(sender, rows), why) == rows, "three times away, then back"
    assert why == left()
    shutil.rmtree(tmp_path / "robots")
    wait = iter([False, False, True] + [True] * 99)
    real = rsync.run
    monkeypatch.setattr(
        MODULE,
        "bounded",
        lambda *words, **how: (255, b"", b"No route to host") if next(wait) else real(*words, **how),
    )
    assert [row[0] for row in sender.collected(declared, job(sender, rows), why)] == ["a"]
    assert why == {**left(), "robot": ["b"]}
    assert json.loads(sender.JOB.read_text())["robot_gone"] is True, "it is not waited for again in this transfer"
    away = sender.listed(declared, WISH)
    assert (away["robot"]["state"], [row[0] for row in away["rows"]]) == ("away", ["a"])
    assert "No route to host" in away["robot"]["why"]


def test_insufficient_space_is_refused_before_copying(sender: Any, rsync: Rsync, tmp_path: Path) -> None:  # noqa: ANN401 - as above
    record(rsync, "a", b"x" * 12_000)
    declared = settings(tmp_path)
    rows = sender.listed(declared, WISH)["rows"]
    with pytest.raises(Exception, match="no room: 2000 bytes are missing for sparus on this gateway"):
        sender.collected(declared, job(sender, rows), left())
    assert rsync.calls == ["list"]


def test_gateway_knows_the_robot_and_the_owner_gets_one_key_line() -> None:
    files = {file.path: file.content for file in retrieval(DECLARED, DECLARED.hosts[GATEWAY]).files}
    assert json.loads(files["/etc/atlantis/retrieval.json"])["sources"]["sparus"] == {
        "folder": "/var/lib/atlantis/robots/sparus",
        "budget": 100_000_000,
        "robot_address": "10.64.1.22",
        "robot_port": 22,
        "robot_user": "recorder",
    }
    assert f"sparus {ROBOT['host_key']}\n" in files["/etc/atlantis/retrieval.known_hosts"]
    source, host = source_at(DECLARED, "coastal", "sparus")
    assert host.name == GATEWAY
    assert isinstance(source, RetrievalRobot)
    line = line_for_robot(DECLARED, source)
    assert line == f'restrict,command="rrsync -ro /home/recorder/bags" {KEY} {GATEWAY}'
    keys = {file.path: file.content for file in retrieval(DECLARED, DECLARED.hosts["scc-control"]).files}
    assert f"retrieval_receive.py {GATEWAY},sparus /srv/recordings" in keys["/etc/atlantis/retrieval.keys"]


def test_plan_shows_the_robot_and_an_unreachable_one_is_not_green() -> None:
    source, _ = source_at(DECLARED, "coastal", "sparus")
    robot = {"state": "answers", "files": 2, "bytes": 5_000_000, "lacking": 0}
    look = {"files": 3, "bytes": 6_000_000, "compared": 0, "kept": 0, "writing": 0, "unnamed": 0, "before": 1.0}
    made = plan(DECLARED, source, "4g", {**look, "robot": robot})
    assert f"2 files on sparus, 5.0 MB: {GATEWAY} collects these first" in made.lines()
    away = plan(DECLARED, source, "4g", {**look, "robot": {**robot, "state": "away", "why": "sparus does not answer"}})
    assert "sparus was not searched: sparus does not answer" in away.lines()
    told = {"state": "done", "files": 1, "arrived": 1, "running": False, "job": False, "wire_bytes": 1, "link": "4g"}
    assert RetrievalStatus(told, None, "sparus").exit is ExitCode.DONE
    for more in ({"unseen": "sparus does not answer"}, {"left": {"robot": ["b"]}, "why": "sparus does not answer"}):
        found = RetrievalStatus({**told, **more}, None, "sparus")
        assert found.exit is ExitCode.CHECKS_FAILED
        assert any("sparus does not answer" in line for line in found.lines("coastal"))
    goes_on = {**told, "state": "collecting", "running": True, "collected": 1, "collect": 3, "collected_bytes": 7}
    assert RetrievalStatus(goes_on, None, "sparus").progress().startswith("collecting from sparus, 1 of 3 files")


def test_ambiguous_source_lists_the_choices() -> None:
    with pytest.raises(UsageError, match="has recordings of several computers") as caught:
        source_at(DECLARED, "coastal", None)
    assert caught.value.hint == f"choose one of these: `from={GATEWAY}`, `from=sparus`"
