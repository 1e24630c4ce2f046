"""Runs that are repeated, not resumed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from atlantis_netcfg.cli.resume import _engine_only
from atlantis_netcfg.errors import UsageError
from atlantis_netcfg.journal import Run, RunStarted, Store

if TYPE_CHECKING:
    from pathlib import Path


def broken(state: Path, command: str) -> Run:
    started = RunStarted(site="quay", revision="", tool="", hosts=("router",), rehearsed=False, command=command)
    with Store(state).start(started) as journal:
        pass
    return Store(state).run("quay", journal.run)


@pytest.mark.parametrize(
    ("command", "what"),
    [
        ("provision adopt site=quay device=router", "a first contact"),
        ("provision upgrade site=quay device=router packages=x.npk", "an upgrade"),
    ],
)
def test_the_command_to_repeat_is_told(tmp_path: Path, command: str, what: str) -> None:
    with pytest.raises(UsageError, match=f"was {what}") as refused:
        _engine_only(broken(tmp_path, command))
    assert refused.value.hint == f"repeat it: `{command}`"


def test_a_run_of_the_engine_goes_on(tmp_path: Path) -> None:
    run = broken(tmp_path, "provision site=quay")
    _engine_only(run)
    assert run.unsettled == ("router",)
