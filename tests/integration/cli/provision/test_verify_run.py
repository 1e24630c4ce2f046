"""`provision device verify` typed: rehearsed, and against a router that stands at its declared address."""

import json
from pathlib import Path

import pytest
from quay import Quay, fresh_quay

from atlantis_netcfg.cli import main
from atlantis_netcfg.operations.lte import assumptions as rutos
from atlantis_netcfg.routeros.assumptions import ASSUMPTIONS, READS

IDS = [each.id for each in ASSUMPTIONS]


@pytest.mark.slow
def test_rehearsed_verify_tests_assumptions_and_writes_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("ATLANTIS_STATE", str(tmp_path / "state"))
    assert main(["device", "verify", "device=coastal-router", "--rehearse", "--try", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [row["id"] for row in told["assumptions"]] == IDS
    assert {row["verdict"] for row in told["assumptions"]} == {"PASS", "SKIP"}
    assert all(row["evidence"] for row in told["assumptions"])
    assert (told["rehearsed"], told["tried"], told["file"], told["exit"]) == (True, True, None, 0)
    assert not (tmp_path / "state" / "verify").exists()


@pytest.mark.slow
def test_rutos_unit_is_read_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("ATLANTIS_STATE", str(tmp_path / "state"))
    assert main(["device", "verify", "device=te4sea-4g", "--rehearse", "--json"]) == 0
    text = capsys.readouterr().out
    told = json.loads(text)
    verdicts = {row["id"]: row["verdict"] for row in told["assumptions"]}
    assert verdicts == {each.id: "PASS" if each.proof == READS else "SKIP" for each in rutos.ASSUMPTIONS}
    assert (told["round_trips"], told["tried"], told["file"]) == (5, False, None)
    assert "100.64." not in text
    assert main(["device", "verify", "device=te4sea-4g", "--rehearse"]) == 0
    assert capsys.readouterr().out.startswith("te4sea-4g: emulated Teltonika unit, RutOS\n  8 assumptions; holds: 5, ")
    assert main(["device", "verify", "device=te4sea-4g", "--rehearse", "--try"]) == 3
    refused = capsys.readouterr().err
    assert "te4sea-4g runs RutOS and can only be read" in refused
    assert "remove `--try` and `--silence`" in refused


def test_unsupported_or_unknown_device_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("ATLANTIS_STATE", str(tmp_path / "state"))
    assert main(["device", "verify", "device=coastal-gateway", "--rehearse"]) == 3
    assert "coastal-gateway is a gateway, not a RouterOS device" in capsys.readouterr().err
    assert main(["device", "verify", "device=coastal-ruter", "--rehearse"]) == 3
    assert "did you mean `device=coastal-router`?" in capsys.readouterr().err


at = pytest.fixture(fresh_quay)


@pytest.mark.smoke
@pytest.mark.slow
@pytest.mark.namespace
def test_router_is_verified_unchanged_and_result_is_saved(at: Quay) -> None:
    before = at.export()
    dear = at.provision("device", "verify", "device=coastal-router", "via=4g", code=4)
    assert "the cost was not accepted, so nothing was sent: over metered link 4g" in dear.stderr
    read = at.json("device", "verify", "device=coastal-router", code=0)
    assert (read["tried"], read["rehearsed"]) == (False, False)
    tried = at.json("device", "verify", "device=coastal-router", "--try", code=0)
    verdicts = {row["id"]: row["verdict"] for row in tried["assumptions"]}
    assert verdicts["safe-mode-undoes-scripts"] == "PASS"
    assert "FAIL" not in verdicts.values()
    assert at.export().splitlines() == before.splitlines()
    files = sorted((at.state / "verify").iterdir())
    assert tried["file"] in map(str, files)
    kept = files[-1].read_text(encoding="utf-8")
    assert json.loads(kept)["assumptions"] == tried["assumptions"]
    assert "10.64." not in kept.replace(str(at.state), "")


@pytest.mark.slow
@pytest.mark.namespace
@pytest.mark.parametrize("version", ["7.16", "7.17.1"])
def test_router_without_safe_mode_is_only_read(at: Quay, version: str) -> None:
    at.replace("old", version=version)
    at.adopt()
    before = at.export()
    refused = at.provision("device", "verify", "device=coastal-router", "--try", code=4)
    assert refused.stdout == ""
    assert "nothing was tried: this device has no safe mode over the API" in refused.stderr
    assert "it exists since RouterOS 7.18; without `--try` the device is only read" in refused.stderr
    assert "Traceback" not in refused.stderr
    assert not (at.state / "verify").exists()
    told = at.json("device", "verify", "device=coastal-router", "--try", code=4)
    assert (told["exit"], [error["message"][:21] for error in told["errors"]]) == (4, ["nothing was tried: th"])
    read = at.json("device", "verify", "device=coastal-router", code=0)
    assert read["version"].startswith(f"{version} ")
    assert "PASS" in {row["verdict"] for row in read["assumptions"]}
    assert at.export() == before
