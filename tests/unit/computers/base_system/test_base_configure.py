"""Module `configure`: files, steps and units become what is declared, and the second run finds nothing to do."""

import errno
import fcntl
import os
import re
from pathlib import Path
from typing import Any

import pytest
from base_computer import ME, Computer, FakeUnit

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.errors import ModuleError
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.programs import ProgramResult
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.modules.configure import Module

CONF = "/etc/daemon/daemon.conf"
GOOD = ["sh", "-c", 'grep -q good "$1" || { echo "$1: line 1: bad"; exit 3; }', "sh", "%s"]


@pytest.fixture
def computer(tmp_path: Path) -> Computer:
    return Computer(tmp_path, units={"daemon": FakeUnit(conf=CONF)})


WISHES: dict[str, Any] = {
    "directories": [{"path": "/srv/own", "mode": "0700"}],
    "files": [
        {"path": CONF, "content": "good = 1\n", "validate": GOOD},
        {"path": "/etc/systemd/system/daemon.service.d/own.conf", "content": "[Service]\n"},
    ],
    "links": [{"path": "/etc/localtime", "target": "/usr/share/zoneinfo/Europe/Lisbon"}],
    "absent": ["/etc/daemon/old.conf"],
    "steps": [{"name": "take it", "run": ["take", "it"], "after": [CONF]}],
    "units": [{"name": "daemon", "enabled": True, "active": True, "after": [CONF]}],
}
DONE = [
    "directory /srv/own",
    f"file {CONF}",
    "file /etc/systemd/system/daemon.service.d/own.conf",
    "link /etc/localtime -> /usr/share/zoneinfo/Europe/Lisbon",
    "absent /etc/daemon/old.conf",
    "systemd has reloaded its unit files",
    "step take it",
    "unit daemon enabled",
    "unit daemon started",
]


def test_configure_is_idempotent(computer: Computer) -> None:
    computer.put("/etc/daemon/old.conf", "old")
    before = computer.snapshot()
    assert computer.converge(check=True, **WISHES) == DONE
    assert computer.snapshot() == before
    assert computer.ran == []
    assert computer.converge(**WISHES) == DONE
    assert computer.ran == [
        ["systemctl", "daemon-reload"],
        ["take", "it"],
        ["systemctl", "enable", "daemon"],
        ["systemctl", "start", "daemon"],
    ]
    assert computer.text(CONF) == "good = 1\n"
    assert computer.slept_s > 0
    computer.ran.clear()
    assert computer.converge(**WISHES) == []
    assert computer.converge(check=True, **WISHES) == []
    assert computer.ran == []


def file(content: str = "x", **row: Any) -> dict[str, Any]:  # noqa: ANN401 - as the module has it
    return {"files": [{"path": "/a/b", "content": content, **row}]}


CASES: list[tuple[str, str, dict[str, Any], list[str]]] = [
    ("mode", "0600", file(), ["file /a/b mode 0600 -> 0644"]),
    ("mode asked for", "0644", file(mode="0400"), ["file /a/b mode 0644 -> 0400"]),
    ("set-user-ID", "4644", file(), ["file /a/b mode 4644 -> 0644"]),
    ("content", "0600", file("y"), ["file /a/b"]),
    ("same", "0644", file(), []),
    ("secret", "0644", {"files": [{"path": "/a/b", "secret_content": "y"}]}, ["file /a/b"]),
    ("gone", "0644", {"absent": ["/a/b"]}, ["absent /a/b"]),
    ("a link in its place", "0644", {"links": [{"path": "/a/b", "target": "c"}]}, ["link /a/b -> c"]),
    ("directory", "0644", {"directories": [{"path": "/a", "mode": "0711"}]}, ["directory /a mode 0755 -> 0711"]),
]


@pytest.mark.parametrize(("mode", "told", "changes"), [case[1:] for case in CASES], ids=[case[0] for case in CASES])
def test_single_changes(computer: Computer, mode: str, told: dict[str, Any], changes: list[str]) -> None:
    computer.put("/a/b", "x", int(mode, 8))
    (computer.root / "a").chmod(0o755)
    assert computer.converge(check=True, **told) == changes
    assert computer.converge(**told) == changes
    assert computer.converge(**told) == []


def test_owner_is_corrected(computer: Computer, monkeypatch: pytest.MonkeyPatch) -> None:
    told = []
    monkeypatch.setattr(os, "chown", lambda *arguments, **_: told.append(arguments[1:]))
    computer.put("/a/b", "x")
    assert computer.converge(**file(owner="61234")) == [f"file /a/b owner -> 61234:{ME['group']}"]
    assert told == [(61234, os.getegid())]


def test_symlink_in_place_of_a_file_is_replaced(computer: Computer) -> None:
    computer.put("/a/theirs", "theirs")
    (computer.root / "a" / "b").symlink_to("theirs")
    assert computer.converge(**file()) == ["file /a/b"]
    assert not (computer.root / "a" / "b").is_symlink()
    assert computer.text("/a/theirs") == "theirs"
    assert computer.converge(**file()) == []


@pytest.mark.parametrize(
    ("told", "said"),
    [
        (file(), "/a/b is a directory, but must be a file"),
        ({"absent": ["/a/b"]}, "/a/b is a directory, but must be a file"),
        ({"links": [{"path": "/a/b", "target": "c"}]}, "/a/b is a directory, but must be a file"),
        ({"files": [{"path": "/a/c", "content": "x"}]}, "/a/c is a device or a socket"),
        ({"directories": [{"path": "/a/f"}]}, "/a/f is a file, but must be a directory"),
        ({"files": [{"path": "/a/f/x", "content": "x"}]}, "one of its parents is a file"),
        (
            {"files": [{"path": "/a/new", "content": "x", "owner": "nobody-here"}]},
            "account `nobody-here` does not exist",
        ),
        ({"files": [{"path": "/a/new", "content": "x", "group": "nobody-here"}]}, "group `nobody-here` does not exist"),
        ({"files": [{"path": "/a/new", "content": "x", "mode": "rw"}]}, "`rw` is not a valid mode"),
        ({"files": [{"path": "a/new", "content": "x"}]}, "`a/new` is not an absolute path"),
        ({"files": [{"path": "/a/../new", "content": "x"}]}, "`/a/../new` is not an absolute path"),
        ({"files": [{"path": "/a/new"}]}, "has no content"),
        ({"files": [{"path": "/a/new", "content": "x", "validate": ["true"]}]}, "its validator has no %s"),
        ({"files": [{"path": "/a/f", "content": "x"}], "absent": ["/a/f"]}, "path /a/f is defined twice"),
    ],
)
def test_obstructed_path_is_refused_and_nothing_changed(computer: Computer, told: dict[str, Any], said: str) -> None:
    (computer.root / "a" / "b").mkdir(parents=True)
    os.mkfifo(computer.root / "a" / "c")
    computer.put("/a/f", "x")
    before = sorted(computer.root.rglob("*"))
    for check in (True, False):
        with pytest.raises(ModuleError, match=re.escape(said)):
            computer.converge(check=check, **{"links": [{"path": "/z/z", "target": "z"}], **told})
    assert [path for path in sorted(computer.root.rglob("*")) if "run" not in path.parts] == before


def test_rejected_file_prevents_all_changes(computer: Computer) -> None:
    computer.put("/etc/first", "old")
    before = computer.snapshot()
    told: dict[str, Any] = {
        **WISHES,
        "files": [{"path": "/etc/first", "content": "new"}, {**WISHES["files"][0], "content": "evil\n"}],
    }
    for check in (True, False):
        with pytest.raises(ModuleError, match=rf"sh does not accept the new {CONF}.*\n{CONF}: line 1: bad"):
            computer.converge(check=check, **told)
        assert computer.snapshot() == before
    assert computer.ran == []


def test_secret_is_not_shown(computer: Computer) -> None:
    computer.put("/a/b", "hush, old\n")
    told: dict[str, Any] = {"files": [{"path": "/a/b", "secret_content": "hush, new\n", "validate": GOOD}]}
    with pytest.raises(ModuleError) as caught:
        computer.converge(**told)
    assert "hush" not in caught.value.message
    assert "bad" not in caught.value.message
    told["files"][0]["secret_content"] = "good hush"
    configure = computer.configure(**told)
    configure.converge({})
    assert (configure.changes, configure.diff) == (["file /a/b"], [])


def test_missing_validator_is_reported(computer: Computer) -> None:
    told = file(validate=["no-such-program", "%s"])
    assert computer.converge(check=True, **told) == ["file /a/b"]
    with pytest.raises(ModuleError, match="`no-such-program`, which must accept /a/b, is not installed"):
        computer.converge(**told)
    assert computer.snapshot() == {}


def test_diffs_are_shown_for_text_files_only(computer: Computer) -> None:
    computer.put("/a/b", "x\n")
    (computer.root / "a" / "c").write_bytes(b"\xff\xfe")
    told: dict[str, Any] = {"files": [*file("y\n")["files"], {"path": "/a/c", "content": "text"}], "absent": ["/a/d"]}
    configure = computer.configure(**told)
    configure.converge({})
    assert configure.diff == [{"before_header": "/a/b", "after_header": "/a/b", "before": "x\n", "after": "y\n"}]


@pytest.mark.parametrize(
    ("number", "said"),
    [
        (errno.ENOSPC, r"the file system of /etc/second is full: \d+ kB are free"),
        (errno.EDQUOT, "is full"),
        (errno.EROFS, "is read-only"),
        (errno.EPERM, "cannot change"),
        (errno.EIO, "read or write errors"),
        (errno.ENXIO, "/etc/second: "),
    ],
)
def test_full_disk_leaves_everything_unchanged(
    computer: Computer, monkeypatch: pytest.MonkeyPatch, number: int, said: str
) -> None:
    computer.put("/etc/first", "old")
    before = computer.snapshot()
    write = os.write
    written: list[int] = []

    def full(handle: int, data: Any) -> int:  # noqa: ANN401 - as os.write has it
        written.append(handle)
        if len(written) > 1:
            raise OSError(number, os.strerror(number))
        return write(handle, data)

    files = [{"path": f"/etc/{name}", "content": "new"} for name in ("first", "second")]
    with monkeypatch.context() as patched:
        patched.setattr(os, "write", full)
        with pytest.raises(ModuleError, match=said):
            computer.converge(**{**WISHES, "files": files})
    assert computer.snapshot() == before
    assert computer.converge(files=files) == ["file /etc/first", "file /etc/second"]


def test_partial_write_is_continued(computer: Computer, monkeypatch: pytest.MonkeyPatch) -> None:
    write = os.write
    monkeypatch.setattr(os, "write", lambda handle, data: write(handle, bytes(data)[:1]))
    computer.converge(**file("a text of some length\n"))
    assert computer.text("/a/b") == "a text of some length\n"


def test_concurrent_run_is_refused(computer: Computer) -> None:
    lock = computer.root / "run" / "lock" / "atlantis-configure"
    lock.parent.mkdir(parents=True)
    lock.write_text("process 77, started from 192.0.2.7")
    with lock.open() as holder:
        fcntl.flock(holder, fcntl.LOCK_EX)
        assert computer.converge(check=True, **file()) == ["file /a/b"]
        with pytest.raises(ModuleError, match=r"another run is active .*: process 77, started from 192\.0\.2\.7"):
            computer.converge(**file())
    assert computer.converge(**file(), environment={"SSH_CONNECTION": "192.0.2.9 5 192.0.2.1 22"}) == ["file /a/b"]
    assert lock.read_text() == f"process {os.getpid()}, started from 192.0.2.9"


def test_failed_step_shows_its_last_lines_and_is_repeated(computer: Computer) -> None:
    told = {**file(), "steps": [{"name": "make", "run": ["make"], "after": ["/a/b"]}]}
    computer.converge(**told)
    computer.answers["make"] = ProgramResult(2, "".join(f"line {number}\n" for number in range(40)))
    told["files"] = file("y")["files"]
    with pytest.raises(ModuleError, match=r"step `make` failed \(exit 2\):\nline 32\n(line 3\d\n)+line 39$"):
        computer.converge(**told)
    computer.answers["make"] = ProgramResult(0, "note: by the way\nnothing\n")
    told["files"] = file("x")["files"]  # what it had succeeded with before it failed
    configure = computer.configure(**told)
    configure.converge({})
    assert (configure.changes, configure.notes) == (["file /a/b", "step make"], ["by the way"])
    assert computer.converge(**told) == []


def test_step_runs_once_or_when_its_inputs_change(computer: Computer) -> None:
    step: dict[str, Any] = {"name": "a/../b", "run": ["once"]}
    assert computer.converge(steps=[step]) == ["step a/../b"]
    assert computer.converge(steps=[step]) == []
    assert computer.converge(steps=[{**step, "run": ["twice"]}]) == ["step a/../b"]
    gone = {**step, "name": "gone", "after": ["/a/b"]}
    assert computer.converge(absent=["/a/b"], steps=[gone]) == []
    assert computer.converge(**file(), steps=[gone]) == ["file /a/b", "step gone"]
    assert computer.converge(absent=["/a/b"], steps=[gone]) == ["absent /a/b", "step gone"]
    assert computer.converge(absent=["/a/b"], steps=[gone]) == []
    assert [argv[0] for argv in computer.ran] == ["once", "twice", "once", "once"]


def test_damaged_stamp_repeats_the_step(computer: Computer) -> None:
    told: dict[str, Any] = {**file(), "steps": [{"name": "make", "run": ["make"], "after": ["/a/b"]}]}
    computer.converge(**told)
    computer.put("/var/lib/atlantis/applied/make", '{"half')
    assert computer.converge(**told) == ["step make"]
    assert computer.converge(**told) == []


def test_journal_contains_no_file_contents() -> None:
    module, told = object.__new__(Module), list[str]()
    module.params = {"files": [{"path": "/a/b", "secret_content": "first hush\nsecond hush\n"}]}
    module.log = told.append
    module._log_invocation()
    assert told == ["Invoked for /a/b"]


def test_missing_file_to_be_supplied_is_noted_and_changes_nothing(computer: Computer) -> None:
    brought = [{"path": "/etc/daemon/key", "note": "daemon has no key: bring one"}]
    for check in (True, False):
        asked = computer.configure(check=check, brought=brought)
        asked.converge({})
        assert (asked.changes, asked.notes) == ([], ["daemon has no key: bring one"])
    computer.put("/etc/daemon/key", "secret", 0o600)
    asked = computer.configure(brought=brought)
    asked.converge({})
    assert (asked.changes, asked.notes) == ([], [])


FINDING = "the firewall of the inventory is not active"
OPTIONAL: dict[str, Any] = {
    "files": [
        {"path": CONF, "content": "good = 1\n"},
        {"path": "/etc/wall.conf", "content": "bad\n", "validate": GOOD, "hint": "mend it", "finding": FINDING},
    ],
    "steps": [
        {"name": "load the wall", "run": ["load"], "after": ["/etc/wall.conf"]},
        {"name": "take it", "run": ["take"], "after": [CONF]},
    ],
    "units": [
        {"name": "wall", "enabled": True, "active": True, "after": ["/etc/wall.conf"]},
        {"name": "daemon", "enabled": True, "active": True, "after": [CONF]},
    ],
}


@pytest.mark.parametrize("before", [None, "an older one\n"])
def test_rejected_optional_file_is_a_finding_and_the_rest_is_done(computer: Computer, before: str | None) -> None:
    computer.units["wall"] = FakeUnit(active="failed")
    if before is not None:
        computer.put("/etc/wall.conf", before, 0o600)
    expected = [f"file {CONF}", "step take it", "unit daemon enabled", "unit daemon started"]
    planned = computer.configure(check=True, **OPTIONAL)
    planned.converge({})
    done = computer.configure(**OPTIONAL)
    done.converge({})
    assert planned.changes == done.changes == expected
    again = computer.configure(**OPTIONAL)
    again.converge({})
    assert again.changes == []
    for one in (planned, done, again):
        ((words, hint),) = one.findings
        assert words.startswith(f"{FINDING}: sh does not accept the new /etc/wall.conf, which is unchanged:\n")
        assert words.endswith("/etc/wall.conf: line 1: bad")
        assert hint == "mend it"
    assert ["load"] not in computer.ran
    assert computer.units["wall"].active == "failed"
    left = {name: found for name, found in computer.snapshot().items() if "wall" in name}
    assert {name: text for name, (_, text) in left.items()} == ({} if before is None else {"etc/wall.conf": before})


def test_unchanged_file_that_is_now_rejected_is_a_finding(computer: Computer) -> None:
    """The kernel was exchanged for one without nf_tables: the file is there, and its unit cannot start any more."""
    computer.units["wall"] = FakeUnit()
    switch = ["sh", "-c", f"test -e {computer.root}/nf_tables # %s"]
    told = {**OPTIONAL, "files": [OPTIONAL["files"][0], {**OPTIONAL["files"][1], "validate": switch}]}
    computer.put("/nf_tables", "")
    first = computer.configure(**told)
    first.converge({})
    assert first.findings == []
    assert "unit wall started" in first.changes
    (computer.root / "nf_tables").unlink()
    computer.units["wall"].active = "failed"
    later = computer.configure(**told)
    later.converge({})
    assert later.changes == []
    assert later.findings[0][0].startswith(FINDING)


def test_rejected_mandatory_file_still_stops_everything(computer: Computer) -> None:
    told = {**OPTIONAL, "files": [*OPTIONAL["files"], {"path": "/etc/must.conf", "content": "bad\n", "validate": GOOD}]}
    before = computer.snapshot()
    with pytest.raises(ModuleError, match=r"sh does not accept the new /etc/must\.conf, so nothing was changed"):
        computer.converge(**told)
    assert computer.snapshot() == before


def test_check_runs_every_time_and_changes_nothing(computer: Computer) -> None:
    checks = [{"run": ["look", "there"], "finding": "it is not bounded", "hint": "take another"}]
    for code, found in (
        (0, []),
        (1, [("it is not bounded", "take another")]),
        (127, [("it is not bounded", "take another")]),
    ):
        computer.answers["look"] = ProgramResult(code, "")
        for check in (True, False):
            one = computer.configure(check=check, checks=checks)
            one.converge({})
            assert (one.changes, one.findings) == ([], found)
