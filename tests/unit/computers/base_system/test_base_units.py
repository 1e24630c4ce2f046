"""Module `configure`, units: each runs what is in its files now, and whatever keeps it from running is told."""

from pathlib import Path
from typing import Any

import pytest
from base_computer import Computer, FakeUnit

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.errors import ModuleError

CONF = "/etc/daemon.conf"


@pytest.fixture
def computer(tmp_path: Path) -> Computer:
    return Computer(tmp_path, units={"daemon": FakeUnit(conf=CONF)})


def wishes(content: str = "1", **unit: Any) -> dict[str, Any]:  # noqa: ANN401 - as the module has it
    return {
        "files": [{"path": CONF, "content": content}],
        "units": [{"name": "daemon", "active": True, "after": [CONF], **unit}],
    }


def test_unit_is_restarted_or_reloaded_after_file_changes(computer: Computer) -> None:
    daemon = computer.units["daemon"]
    daemon.active = "active"  # started by its package, with its own file
    assert computer.converge(**wishes()) == [f"file {CONF}", "unit daemon restarted"]
    assert computer.converge(**wishes()) == []
    assert computer.converge(**wishes("2", reload=True)) == [f"file {CONF}", "unit daemon reloaded"]
    assert daemon.loaded == "2"
    daemon.active = "inactive"
    assert computer.converge(check=True, **wishes("2")) == ["unit daemon started"]
    assert computer.converge(**wishes("2")) == ["unit daemon started"]
    assert [argv[1] for argv in computer.ran] == ["restart", "reload-or-restart", "start"]


def test_unit_without_a_desired_state_is_restarted_only_if_it_runs(computer: Computer) -> None:
    told = wishes(active=None)
    assert computer.converge(**told) == [f"file {CONF}"]
    computer.units["daemon"].active = "active"
    assert computer.converge(**told) == []
    assert computer.converge(**wishes("2", active=None)) == [f"file {CONF}", "unit daemon restarted"]
    assert computer.converge(**wishes("2", active=None)) == []


def test_two_roles_can_manage_one_unit(computer: Computer) -> None:
    other: dict[str, Any] = {
        "files": [{"path": "/etc/daemon.d/own.conf", "content": "own"}],
        "units": [{"name": "daemon", "active": True, "after": ["/etc/daemon.d/own.conf"]}],
    }
    computer.converge(**wishes())
    assert computer.converge(**other) == ["file /etc/daemon.d/own.conf", "unit daemon restarted"]
    assert computer.converge(**wishes()) == []
    assert computer.converge(**other) == []


def test_unit_is_stopped_and_disabled(computer: Computer) -> None:
    computer.units["daemon"].file = "enabled"
    computer.units["daemon"].active = "active"
    told: dict[str, Any] = {
        "units": [{"name": "daemon", "enabled": False, "active": False}, {"name": "none", "active": False}]
    }
    changes = ["unit daemon disabled", "unit daemon stopped"]
    assert computer.converge(check=True, **told) == changes
    assert computer.converge(**told) == changes
    assert computer.converge(**told) == []


@pytest.mark.parametrize("state", ["static", "generated", "alias", "indirect"])
def test_unit_that_cannot_be_enabled_is_left_alone(computer: Computer, state: str) -> None:
    computer.units["daemon"].file = state
    assert computer.converge(units=[{"name": "daemon", "enabled": True}]) == []


def test_missing_unit_is_reported(computer: Computer) -> None:
    told: dict[str, Any] = {"units": [{"name": "chrony", "enabled": True, "active": True}]}
    assert computer.converge(check=True, **told) == ["unit chrony enabled", "unit chrony started"]
    with pytest.raises(ModuleError, match="unit chrony does not exist on this computer") as caught:
        computer.converge(**told)
    assert "not installed" in caught.value.hint


@pytest.mark.parametrize(
    ("unit", "said"),
    [
        (FakeUnit(load="masked", file="masked"), "unit daemon is masked"),
        (FakeUnit(dies=True), "unit daemon does not keep running: it is failed .failed.:\nit said why"),
        (FakeUnit(condition=False), "a condition of its unit file is not met on this computer"),
    ],
)
def test_failed_unit_is_reported(computer: Computer, unit: FakeUnit, said: str) -> None:
    computer.units["daemon"] = unit
    with pytest.raises(ModuleError, match=said):
        computer.converge(**wishes())
    computer.units["daemon"] = FakeUnit(active="active")  # mended by hand, with a file of whatever time
    assert computer.converge(**wishes()) == ["unit daemon restarted"]


def test_no_wait_for_a_unit_that_waits(computer: Computer) -> None:
    computer.units["daemon"] = FakeUnit(waits=True)
    assert computer.converge(**wishes(wait=False)) == [f"file {CONF}", "unit daemon started"]
    assert computer.converge(**wishes(wait=False)) == []


def test_changed_unit_files_are_reloaded(computer: Computer) -> None:
    computer.units["daemon"].stale = True
    assert computer.converge(check=True, **wishes())[1:] == [
        "systemd has reloaded its unit files",
        "unit daemon started",
    ]
    assert computer.converge(**wishes())[1:] == ["systemd has reloaded its unit files", "unit daemon started"]
