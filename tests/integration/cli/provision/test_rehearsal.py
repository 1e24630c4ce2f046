"""`provision site=S --rehearse`, as a technician types it."""

import json
import os
import subprocess
from pathlib import Path
from typing import Any

import preforked
import pytest
from quay import PROVISION

from atlantis_netcfg.emulator.routeros import NOT_REHEARSED
from atlantis_netcfg.routeros.assumptions import summarize_assumptions
from atlantis_netcfg.runs import SiteLock

ROUTERS = {"scc": "scc-router", "coastal": "coastal-router", "te4sea": "te4sea-router"}
BEARERS = {
    "scc": ["lan", "uplink"],
    "coastal": ["lan", "wifi-ptp", "4g", "satellite"],
    "te4sea": ["lan", "4g", "satellite"],
}


def provision(state: Path, *typed: str, code: int, program: bool = False) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "ATLANTIS_STATE": str(state)}
    if program:
        line = [PROVISION, *typed]
        done = subprocess.run(
            line, env=environment, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False
        )
    else:
        done = preforked.run(typed, env=environment)
    assert done.returncode == code, f"exit {done.returncode}\n{done.stdout}\n{done.stderr}"
    return done


@pytest.mark.smoke("coastal")
@pytest.mark.slow
@pytest.mark.parametrize("site", ROUTERS)
def test_site_converges_and_second_pass_changes_nothing(site: str, tmp_path: Path) -> None:
    typed = (f"site={site}", "--rehearse", "--yes", "--json")
    with SiteLock(tmp_path / "rehearsal" / site / "lock", site, "a rehearsal of an earlier version"):
        told: dict[str, Any] = json.loads(provision(tmp_path, *typed, code=0, program=site == "coastal").stdout)
    router = told["devices"][ROUTERS[site]]
    assert (told["site"], told["rehearsed"], told["exit"], told["errors"]) == (site, True, 0, [])
    assert router["status"] == "changed"
    assert router["planned"] == router["confirmed"] > 100
    assert router["second_pass"] == 0
    assert list(router["bearers"]) == BEARERS[site]
    assert all(again["round_trips"] == 5 for again in router["bearers"].values())
    assert router["round_trips"] <= 22
    assert router["not_rehearsed"][: len(NOT_REHEARSED) + 1] == [*NOT_REHEARSED, summarize_assumptions()]
    others = {name: told for name, told in told["devices"].items() if name != ROUTERS[site]}
    assert others
    assert {told["status"] for told in others.values()} <= {"not rehearsed", "changed", "declared"}
    terminals = {name: told for name, told in others.items() if told["status"] == "declared"}
    assert list(terminals) == [name for name in (f"{site}-sat",) if site != "scc"]
    for told in terminals.values():
        assert (told["exit"], told["planned"]) == (0, 0)
        assert [finding["code"] for finding in told["findings"]] == ["terminal-not-looked-at"]


@pytest.mark.slow
def test_rehearsed_plan_shows_the_diff_and_changes_nothing(tmp_path: Path) -> None:
    done = provision(tmp_path, "plan", "site=coastal", "--rehearse", code=2)
    assert "+ add address=10.64.1.1/24" in done.stdout
    assert "the emulated device is unchanged, byte for byte" in done.stdout
    assert "round trips" in done.stdout
    assert "EXAMPLE-vpn-coastal" not in done.stdout + done.stderr


def test_mistyped_site_gets_a_suggestion(tmp_path: Path) -> None:
    done = provision(tmp_path, "site=costal", "--rehearse", code=7)
    assert "did you mean `coastal`?" in done.stderr


@pytest.mark.parametrize("host", ["coastal-gateway", "scc-control"])
def test_computer_without_an_emulator_is_reported_as_not_rehearsed(host: str, tmp_path: Path) -> None:
    done = provision(tmp_path, f"site={host.partition('-')[0]}", f"device={host}", "--rehearse", code=7)
    assert f"{host:<18} not rehearsed: ATLANTIS_NO_MACHINES is set" in done.stdout


def test_terminal_alone_gets_a_warning_only(tmp_path: Path) -> None:
    done = provision(tmp_path, "site=coastal", "device=coastal-sat", "--rehearse", code=0)
    assert "WARN: terminal coastal-sat not inspected yet" in done.stdout
    assert "not supported yet" not in done.stdout


def test_example_values_are_for_rehearsals_only(tmp_path: Path) -> None:
    done = provision(tmp_path, "site=coastal", "--yes", code=3)
    assert "example values" in done.stderr
