"""`--profile RUN`: there where emulated devices are started, and for rehearsals alone."""

from pathlib import Path

import pytest

from atlantis_netcfg.cli import main
from atlantis_netcfg.cli.base.commands import COMMANDS, load
from atlantis_netcfg.core.errors import ExitCode

_REPORTS = {name for name in COMMANDS if name.startswith("report ")} | {
    f"measure {each}" for each in ("show", "compare", "history")
}
_WITHOUT = {"device adopt", "recover resume", "recover rollback", "robot retrieve", "measure coverage", "recover"}
"""Their rehearsals go over the technician's cable, repeat an earlier one, hear another link at every place, or start no
emulated device: `robot retrieve` sends over the declared link alone."""


def test_profile_without_rehearsal_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("ATLANTIS_STATE", str(tmp_path))
    assert main(["links", "site=coastal", "--profile", "satellite-1"]) == ExitCode.USAGE
    assert "`--profile` applies to rehearsals only" in capsys.readouterr().err


def test_profile_of_a_missing_run_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("ATLANTIS_STATE", str(tmp_path))
    assert main(["links", "site=coastal", "--rehearse", "--profile", "satellite-1"]) == ExitCode.USAGE
    told = capsys.readouterr()
    assert "`--profile satellite-1`: coastal has no such run" in told.err
    assert "starting" not in told.out + told.err


def test_commands_that_rehearse_a_site_have_the_profile_flag() -> None:
    commands = {name: load(name, COMMANDS).command for name in COMMANDS}
    rehearse = {name for name, command in commands.items() if command.flag("rehearse") is not None}
    with_profile = {name for name, command in commands.items() if command.flag("profile") is not None}
    assert with_profile - {"report drift", "report as-built"} == rehearse - _WITHOUT - _REPORTS
    assert with_profile >= {"report drift", "report as-built"}
    assert rehearse > _WITHOUT
