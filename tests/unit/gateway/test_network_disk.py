"""A disk that is full while the network is changed: told before, and no trap in the window."""

# ruff: noqa: F401, F811 - `box` is a fixture

from __future__ import annotations

import errno
from typing import Any

import pytest
from network_box import PATHS, Box, box, made, moved, settled

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils import network_guard
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.errors import ModuleError
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.network_files import (
    FOLDER,
    NetworkComputer,
)


def full(monkeypatch: pytest.MonkeyPatch, path: str) -> None:
    """No room for one file."""
    write = NetworkComputer.write

    def refuse(self: NetworkComputer, name: str, *words: Any) -> None:  # noqa: ANN401
        if name.endswith(path):
            raise OSError(errno.ENOSPC, "No space left on device", name)
        write(self, name, *words)

    monkeypatch.setattr(NetworkComputer, "write", refuse)


def test_a_full_disk_is_told_and_nothing_is_changed(box: Box, monkeypatch: pytest.MonkeyPatch) -> None:
    before = settled(box, "ifupdown")
    full(monkeypatch, "wanted.json")
    with pytest.raises(ModuleError, match="is full"):
        made(box, "ifupdown", **moved("ifupdown")).stage()
    assert box.state() == before
    assert box.text(f"{FOLDER}/pending") is None


@pytest.mark.parametrize("by", list(PATHS))
def test_a_disk_that_fills_in_the_window_keeps_the_way_in(box: Box, by: str, monkeypatch: pytest.MonkeyPatch) -> None:
    before = settled(box, by)
    change = made(box, by, **moved(by))
    name = change.stage()
    assert name is not None
    box.queued = False
    network_guard.apply(box.computer)
    with monkeypatch.context() as filled:
        full(filled, PATHS[by])
        with pytest.raises(OSError, match="No space left"):
            box.time_passes()
        assert (box.held, box.routes) == (before["held"], before["routes"])
        assert change.look(name, 0.0)["state"] == "pending"
    network_guard.back(box.computer)
    assert box.state() == before
    assert change.look(name, 0.0)["state"] == "rolled back"
