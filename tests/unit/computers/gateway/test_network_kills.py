"""Killed at any moment, and the power cut at any moment: the computer always has a whole configuration."""

# ruff: noqa: F401, F811 - `box` is a fixture

import os
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import pytest
from network_box import PATHS, Box, Killed, box, made, moved, settled, wish

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils import network_guard
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.network_files import FOLDER

pytestmark = pytest.mark.parametrize("by", list(PATHS))
CALLS = ("replace", "unlink", "mkdir", "symlink", "fchmod")
"""Besides `fsync`, which the fixture counts, and every program that is run."""


@pytest.fixture(autouse=True)
def counted(box: Box, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each of these may be the last thing that the process does."""
    for name in CALLS:
        monkeypatch.setattr(f"os.{name}", counting(box, getattr(os, name)))


def counting(box: Box, call: Callable[..., Any]) -> Callable[..., Any]:
    def counted_call(*words: Any, **named: Any) -> Any:  # noqa: ANN401
        box.step()
        return call(*words, **named)

    return counted_call


def killed(box: Box, act: Callable[[], Any], at: int) -> bool:
    """Whether the act was killed at its n-th step, and not over before."""
    box.kill_at = at
    try:
        act()
    except Killed:
        return True
    finally:
        box.kill_at = -1
    return False


def each_step(box: Box, prepare: Callable[[], Callable[[], Any]], after: Callable[[], None]) -> int:
    """Kill what `prepare` gives at every step, and look at what is left; gives how many there were."""
    at = 1
    while killed(box, prepare(), at):
        after()
        at += 1
    after()
    return at - 1


def staged(box: Box, by: str) -> str:
    name = made(box, by, **moved(by)).stage()
    assert name is not None
    box.queued = False
    return name


def whole(box: Box, before: dict[str, Any], by: str) -> None:
    """As before, or as the change has it: files, addresses and routes of one and the same."""
    after = {
        "files": {**before["files"], PATHS[by]: moved(by)["content"]},
        "held": {**before["held"], "eth0": ["10.64.1.77/24"]},
        "routes": before["routes"],
    }
    assert box.state() in (before, after)
    assert box.text(f"{FOLDER}/pending") is None


ENDS = pytest.mark.parametrize("end", ["time", "power", "again"])


def ended(box: Box, by: str, end: str) -> None:
    """What comes after a kill: nothing but time, a power cut, or the technician who types the same again."""
    if end == "power":
        box.power_cut()
    elif end == "again":
        change = made(box, by)
        assert change.stage() is None
        assert change.changes == []
    box.time_passes()


@pytest.mark.smoke("time-netplan")
@ENDS
def test_kill_during_staging(box: Box, by: str, end: str) -> None:
    before = settled(box, by)

    def after() -> None:
        ended(box, by, end)
        assert box.state() == before
        if end == "power":
            assert box.text(f"{FOLDER}/pending") is None

    assert each_step(box, lambda: made(box, by, **moved(by)).stage, after) > 20


@pytest.mark.smoke("time-netplan")
@ENDS
def test_kill_during_apply(box: Box, by: str, end: str) -> None:
    before = settled(box, by)

    def prepare() -> Callable[[], Any]:
        staged(box, by)
        return lambda: network_guard.apply(box.computer)

    def after() -> None:
        ended(box, by, end)
        assert box.state() == before
        assert box.text(f"{FOLDER}/pending") is None

    assert each_step(box, prepare, after) > 5


@pytest.mark.smoke("time-netplan")
@ENDS
def test_kill_during_rollback(box: Box, by: str, end: str) -> None:
    before = settled(box, by)

    def prepare() -> Callable[[], Any]:
        staged(box, by)
        network_guard.apply(box.computer)
        return lambda: network_guard.roll_back(box.computer)

    def after() -> None:
        box.timer = True  # systemd starts a failed service anew
        ended(box, by, end)
        assert box.state() == before
        assert box.text(f"{FOLDER}/pending") is None

    assert each_step(box, prepare, after) > 5


@pytest.mark.smoke("time-netplan")
@pytest.mark.parametrize("end", ["time", "power"])
def test_kill_during_confirmation(box: Box, by: str, end: str) -> None:
    before = settled(box, by)

    def prepare() -> Callable[[], Any]:
        back = made(box, by)
        if (name := back.stage()) is not None:
            box.queued = False
            network_guard.apply(box.computer)
            assert back.confirm(name)["state"] == "confirmed"
        name = staged(box, by)
        network_guard.apply(box.computer)
        return lambda: made(box, by, **moved(by)).confirm(name)

    def after() -> None:
        ended(box, by, end)
        whole(box, before, by)

    assert each_step(box, prepare, after) > 5


@pytest.mark.smoke("netplan")
def test_power_cut_during_rollback_at_boot(box: Box, by: str) -> None:
    before = settled(box, by)

    def prepare() -> Callable[[], Any]:
        staged(box, by)
        network_guard.apply(box.computer)
        box.timer = False
        return lambda: network_guard.boot(box.computer)

    def after() -> None:
        box.power_cut()
        assert box.state() == before
        assert box.text(f"{FOLDER}/pending") is None

    assert each_step(box, prepare, after) > 2


@pytest.mark.smoke("netplan")
def test_killed_first_change_leaves_no_partial_network(box: Box, by: str) -> None:
    """The first change of all: what it takes back is nothing, and the last kill leaves it staged."""
    before = box.state()

    def after() -> None:
        box.time_passes()
        assert box.state() == before

    assert each_step(box, lambda: made(box, by).stage, after) > 20
    assert wish(by).content not in box.state()["files"].values()
