"""`provision site=all --rehearse` as root: three sites joined by packets, one VPN, every link cut once."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import preforked
import pytest
from waiting import wait_until

from atlantis_netcfg.emulator.lab import why_no_namespace, why_not

CHECKOUT = Path(__file__).parents[4]
pytestmark = pytest.mark.slow


def rehearse(state: Path, *words: str) -> dict[str, Any]:
    if (reason := why_not() or why_no_namespace()) is not None:
        pytest.skip(reason)
    command = [*words, "--rehearse", "--yes", "--json"]
    done = preforked.run(command, env=os.environ | {"ATLANTIS_STATE": str(state)}, folder=CHECKOUT)
    assert done.returncode == 0, f"exit {done.returncode}\n{done.stdout[-3000:]}\n{done.stderr[-2000:]}"
    result: dict[str, Any] = json.loads(done.stdout)
    return result


def namespaces(owner: int) -> set[str]:
    """Return the namespaces of a process's labs; other rehearsals may run on this computer."""
    listing = subprocess.run(["ip", "netns", "list"], capture_output=True, text=True, check=True).stdout
    return {line.split()[0] for line in listing.splitlines() if line.startswith(f"yd{owner}-")}


@pytest.mark.timeout(1500)
def test_pilot_carries_data_over_each_link(tmp_path: Path) -> None:
    result = rehearse(tmp_path, "site=all")
    devices = result["devices"]
    moves = {name: devices[name]["link_cuts"] for name in ("coastal-router", "te4sea-router")}
    assert [section["differences"] for section in moves.values()] == [[], []]
    assert "wifi-ptp to 4g in" in moves["coastal-router"]["words"]
    assert "4g to satellite in" in moves["te4sea-router"]["words"]
    for name, links in (("coastal-gateway", ("wifi-ptp", "4g", "satellite")), ("te4sea-gateway", ("4g", "satellite"))):
        data = devices[name]["data"]
        assert data["differences"] == []
        assert [f"over {link}," in message for link, message in zip(links, data["messages"], strict=True)] == [
            True for _ in links
        ]
        assert "emulated" not in " ".join(data["messages"])
        assert "TEST_ROBOT is seen at the control centre" in data["words"]
        checklist = devices[name]["checklist"]
        assert f"{name.removesuffix('-gateway')}/site/data-reaches-scc" in checklist["by_machine"]
        assert not checklist["counts"].keys() & {"FAIL", "ERROR"}
    assert devices["scc-control"]["data"]["differences"] == []


@pytest.mark.timeout(900)
def test_single_site_has_its_links_cut_and_says_what_is_missing(tmp_path: Path) -> None:
    result = rehearse(tmp_path, "site=coastal", "device=coastal-router")
    router = result["devices"]["coastal-router"]
    assert "satellite to wifi-ptp in" in router["link_cuts"]["words"]
    assert "data, TEST_ROBOT and checklists with packets: rehearse site=all" in router["not_rehearsed"]


def leftovers(state: Path, owner: int) -> list[str]:
    """Return the processes of a rehearsal by its folder, and what its labs have mounted."""
    lines = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            words = (process / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
            is_ours = f"ATLANTIS_STATE={state}".encode() in (process / "environ").read_bytes()
        except OSError:
            continue
        if is_ours and int(process.name) != os.getpid():
            lines.append(words)
    mounts = Path("/proc/self/mountinfo").read_text(encoding="utf-8").splitlines()
    return [*lines, *(line for line in mounts if f"/run/atlantis/yards/yd{owner}-" in line), *namespaces(owner)]


@pytest.mark.timeout(1500)
@pytest.mark.parametrize(
    "words", [("site=coastal", "device=coastal-router"), pytest.param(("site=all",), marks=pytest.mark.campaign)]
)
@pytest.mark.parametrize("victim", ["command", "emulators"])
def test_kill_while_sites_are_joined_leaves_nothing_behind(tmp_path: Path, words: tuple[str, ...], victim: str) -> None:
    if (reason := why_not() or why_no_namespace()) is not None:
        pytest.skip(reason)
    command = [sys.executable, "-P", "-m", "atlantis_netcfg", *words, "--rehearse", "--yes"]
    environment = os.environ | {"ATLANTIS_STATE": str(tmp_path)}
    with subprocess.Popen(command, env=environment, cwd=CHECKOUT, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        assert any("Sites joined" in line for line in process.stderr)
        wait_until(lambda: any(name.endswith("-net") for name in namespaces(process.pid)))
        if victim == "command":
            process.kill()
        else:
            listing = subprocess.run(
                ["pgrep", "--parent", str(process.pid), "-f", "emulator.routeros"],
                capture_output=True,
                text=True,
                check=True,
            ).stdout
            os.kill(int(listing.split()[0]), signal.SIGKILL)
        process.communicate(timeout=300)
    wait_until(lambda: not leftovers(tmp_path, process.pid))
