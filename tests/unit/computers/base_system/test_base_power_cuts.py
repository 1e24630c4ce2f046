"""Module `configure`: the power fails before each single call to the system, and the next run completes everything."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from base_computer import Computer, FakeUnit

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.programs import ProgramResult

CONF = "/etc/daemon/daemon.conf"
CALLS = ("open", "write", "fsync", "fchmod", "replace", "unlink", "mkdir", "rmdir", "chmod", "chown", "symlink")
WISHES: dict[str, Any] = {
    "files": [
        {"path": CONF, "content": "new"},
        {"path": "/etc/systemd/system/daemon.service", "content": "new"},
        {"path": "/etc/kept", "content": "kept", "mode": "0600"},
    ],
    "links": [{"path": "/etc/localtime", "target": "Europe/Lisbon"}],
    "absent": ["/etc/daemon/old.conf"],
    "steps": [{"name": "take it", "run": ["take", "it"], "after": [CONF]}],
    "units": [{"name": "daemon", "enabled": True, "active": True, "after": [CONF]}],
}


class PowerCut(BaseException):
    """Nothing happens on the computer after it."""


class Supply:
    """Lets so many calls through, and none after them."""

    def __init__(self, calls: int) -> None:
        self.calls = calls
        self.cut = False

    def guard(self, call: Callable[..., Any]) -> Callable[..., Any]:
        def guarded(*arguments: Any, **named: Any) -> Any:  # noqa: ANN401 - of any call
            if self.cut or self.calls == 0:
                self.cut = True
                raise PowerCut
            self.calls -= 1
            return call(*arguments, **named)

        return guarded


class Daemon(Computer):
    """Its step takes what is in the file, as the unit does when it starts."""

    taken = ""

    def run(self, argv: list[str]) -> ProgramResult:
        done = super().run(argv)
        if argv[0] == "take":
            self.taken = self.text(CONF)
        return done


def made(root: Path) -> Daemon:
    computer = Daemon(root, units={"daemon": FakeUnit(conf=CONF, active="active", loaded="old", stale=True)})
    for path in (CONF, "/etc/daemon/old.conf", "/etc/systemd/system/daemon.service"):
        computer.put(path, "old")
    computer.put("/etc/kept", "kept")
    old = {**WISHES, "files": [{**row, "content": "old"} for row in WISHES["files"][:2]], "links": [], "absent": []}
    computer.converge(**old)
    return computer


def cut_after(calls: int, computer: Daemon, monkeypatch: pytest.MonkeyPatch) -> bool:
    """Run until the power fails; False if the run came to its end before."""
    supply = Supply(calls)
    with monkeypatch.context() as patched:
        for name in CALLS:
            patched.setattr(os, name, supply.guard(getattr(os, name)))
        patched.setattr(computer, "run", supply.guard(computer.run))
        try:
            computer.converge(**WISHES)
        except PowerCut:
            return True
    return False


def test_every_power_cut_is_completed_by_the_next_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    right = made(tmp_path / "right")
    right.converge(**WISHES)
    wanted, calls = right.snapshot(), 0
    while True:
        computer = made(tmp_path / str(calls))
        before = computer.snapshot()
        cut = cut_after(calls, computer, monkeypatch)
        for path in (CONF, "/etc/kept"):
            assert computer.text(path) in ("old", "new", "kept"), calls
        assert computer.snapshot().keys() >= before.keys() - {"etc/daemon/old.conf"}, calls
        computer.converge(**WISHES)
        assert computer.snapshot() == wanted, calls
        assert (computer.taken, computer.units["daemon"].loaded) == ("new", "new"), calls
        assert ["systemctl", "daemon-reload"] in computer.ran, calls
        assert computer.converge(**WISHES) == [], calls
        if not cut:
            break
        calls += 1
    assert calls > 40


def test_file_is_synced_before_it_is_put_in_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    computer = made(tmp_path)
    told: list[str] = []

    def noting(name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def noted(*arguments: Any, **named: Any) -> Any:  # noqa: ANN401 - of any call
            told.append(name)
            return call(*arguments, **named)

        return noted

    for name in ("write", "fsync", "replace"):
        monkeypatch.setattr(os, name, noting(name, getattr(os, name)))
    monkeypatch.setattr(computer, "run", noting("run", computer.run))
    computer.converge(files=[{"path": CONF, "content": "newer"}], steps=WISHES["steps"])
    begun, done = ["write", "fsync", "replace", "fsync"], ["write", "fsync", "replace", "fsync"]
    assert told == ["write", "fsync", "replace", "fsync", *begun, "run", *done]
