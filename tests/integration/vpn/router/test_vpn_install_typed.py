"""`provision vpn install` as it is typed, against an emulated router."""

import json
from pathlib import Path

import pytest

from atlantis_netcfg.cli import main
from atlantis_netcfg.core.errors import ExitCode

LINE = ["vpn", "install", "device=coastal-router"]


@pytest.fixture(autouse=True)
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ATLANTIS_STATE", str(tmp_path / "state"))


def test_installation_can_be_rehearsed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*LINE, "--rehearse", "--plan", "--json"]) == ExitCode.CHANGES
    planned = json.loads(capsys.readouterr().out)
    assert main([*LINE, "--rehearse", "--json"]) == ExitCode.DONE
    done = json.loads(capsys.readouterr().out)
    assert (planned["exit"], done["exit"], planned["errors"], done["errors"]) == (2, 0, [], [])
    assert (planned["status"], done["status"], done["rehearsed"]) == ("planned", "changed", True)
    assert len(planned["changes"]) == len(done["changes"]) == 2


def test_nobody_is_contacted_without_an_identity(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(LINE) == ExitCode.USAGE
    assert "provision vpn onboard device=coastal-router" in capsys.readouterr().err
