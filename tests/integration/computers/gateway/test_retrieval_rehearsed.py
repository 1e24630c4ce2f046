"""`provision robot retrieve --rehearse`: both programs and a real rsync over an emulated link, without root."""

from __future__ import annotations

import json
import shutil
from typing import TYPE_CHECKING, Any

import pytest
from retrieval_programs import GATEWAY, ROBOT, with_retrieval

from atlantis_netcfg.cli import main
from atlantis_netcfg.operations import retrieve_rehearsal

if TYPE_CHECKING:
    from pathlib import Path

    from atlantis_netcfg.inventory import Inventory

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("rsync") is None, reason="no rsync: `make test` installs it"),
]


@pytest.fixture(autouse=True)
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ATLANTIS_STATE", str(tmp_path / "state"))


def test_rehearsed_retrieval_survives_an_outage(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["robot", "retrieve", "site=coastal", "--rehearse", "link=wifi-ptp"]) == 0
    printed = capsys.readouterr().out
    for words in (
        f"the inventory has no recordings to retrieve: this is an example, from {GATEWAY} to scc-control",
        "3 files: the same SHA-256 at both ends",
        "and the connection was lost",
        "this computer compared both folders: they are identical",
        "limits of this rehearsal (`--json` lists them)",
    ):
        assert words in printed


def test_robot_is_collected_first_and_a_damaged_copy_fails(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    declared: Inventory = with_retrieval(robots=[ROBOT], sources=[{"host": GATEWAY}])
    monkeypatch.setattr("atlantis_netcfg.inventory.load", lambda *_, **__: declared)
    monkeypatch.setattr(retrieve_rehearsal, "_MOST_BYTES", 400_000)
    kept: list[dict[str, str]] = []
    real = retrieve_rehearsal._digests

    def digests(folder: Path) -> dict[str, str]:
        if folder.name == ROBOT["robot"]:
            kept.append(real(folder))
            next(folder.rglob("*.db3")).write_bytes(b"spoilt")
        return real(folder)

    monkeypatch.setattr(retrieve_rehearsal, "_digests", digests)
    assert main(["robot", "retrieve", "site=coastal", "from=sparus", "--rehearse", "--json"]) == 6
    document: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert (document["whole"], document["same"], document["from"]) == (True, False, "sparus")
    assert sorted(kept[0]) == ["bag-1/bag-1_0.db3", "bag-1/metadata.yaml", "bag-2/bag-2_0.db3"]
    assert any("the robot" in line for line in document["not_rehearsed"])
