"""A site's gateway in `provision`: a real Debian for root, planned, changed, run second run over every bearer."""

import json
import os
import subprocess
from pathlib import Path

import preforked
import pytest

from atlantis_netcfg.emulator.lab import NOT_REHEARSED, stubs, why_not

CHECKOUT = Path(__file__).parents[4]
HOST = "coastal-gateway"
pytestmark = pytest.mark.slow


def provision(state: Path, *words: str, code: int) -> subprocess.CompletedProcess[str]:
    if (reason := why_not()) is not None:
        pytest.skip(reason)
    done = preforked.run([*words, f"device={HOST}"], env=os.environ | {"ATLANTIS_STATE": str(state)}, folder=CHECKOUT)
    assert done.returncode == code, f"exit {done.returncode}\n{done.stdout[:2000]}\n{done.stderr[-2000:]}"
    return done


def test_gateway_converges_and_second_run_over_every_link_is_unchanged(tmp_path: Path) -> None:
    done = provision(tmp_path, "site=coastal", "--rehearse", "--json", code=0)
    told = json.loads(done.stdout)["devices"][HOST]
    assert (told["status"], told["second_pass"]) == ("changed", 0)
    assert told["planned"] == told["confirmed"] > 40
    assert set(told["bearers"]) == {"lan", "wifi-ptp", "4g", "satellite"}
    assert {one["planned"] for one in told["bearers"].values()} == {0}
    changes = "\n".join(told["changes"])
    for part in ("chrony.conf", "ros-foxy-ros-base", "build ", "/etc/atlantis/ros.env"):
        assert part in changes
    assert any("heard the talker" in note for note in told["notes"])
    assert set(stubs.NOT_REHEARSED) | set(NOT_REHEARSED[1:]) <= set(told["not_rehearsed"])
    assert "EXAMPLE-interop-token" not in done.stdout + done.stderr + "".join(
        path.read_text(errors="replace") for path in tmp_path.rglob("*") if path.is_file()
    )


def test_plan_shows_file_diffs_and_changes_nothing(tmp_path: Path) -> None:
    done = provision(tmp_path, "plan", "site=coastal", "--rehearse", code=2)
    assert "the emulated device is unchanged, byte for byte" in done.stdout
    assert "+PasswordAuthentication no" in done.stdout
    assert "package ros-foxy-ros-base" in done.stdout


def test_drift_of_a_fresh_computer_lists_all_changes_of_a_run(tmp_path: Path) -> None:
    told = json.loads(provision(tmp_path, "report", "drift", "site=coastal", "--rehearse", "--json", code=6).stdout)
    host = told["devices"][HOST]
    assert host["verdict"] == "FAIL"
    assert "file /etc/chrony/chrony.conf" in {one["subject"] for one in host["differences"]}
