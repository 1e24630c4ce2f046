"""The control centre in a rehearsal: its server really runs, with an authority that was made for it."""

import json
import os
from pathlib import Path

import preforked
import pytest

from atlantis_netcfg.emulator.lab import why_not

CHECKOUT = Path(__file__).parents[4]
HOST = "scc-vpn"
pytestmark = pytest.mark.slow


def provision(state: Path, *words: str, code: int, **more: str) -> dict[str, object]:
    typed = [*words, f"device={HOST}", "--json"]
    done = preforked.run(typed, env=os.environ | {"ATLANTIS_STATE": str(state), **more}, folder=CHECKOUT)
    assert done.returncode == code, f"exit {done.returncode}\n{done.stdout[:2000]}\n{done.stderr[-2000:]}"
    assert "PRIVATE KEY" not in done.stdout + done.stderr
    told: dict[str, object] = json.loads(done.stdout)["devices"][HOST]
    return told


@pytest.mark.smoke
def test_rehearsal_runs_the_real_server_and_leaves_nothing(tmp_path: Path) -> None:
    if (reason := why_not()) is not None:
        pytest.skip(reason)
    told = provision(tmp_path, "site=scc", "--rehearse", code=0)
    assert (told["status"], told["second_pass"]) == ("changed", 0)
    changes = str(told["changes"])
    for part in ("unit openvpn-server@atlantis.service started", "ccd/coastal-router", "/etc/atlantis/vpn.nft"):
        assert part in changes
    assert "its members are made for the rehearsal" in str(told["not_rehearsed"])
    assert not (tmp_path / "vpn").exists(), "the operator's own authority is none of its business"


def test_missing_machines_are_reported_as_not_rehearsed(tmp_path: Path) -> None:
    told = provision(tmp_path, "site=scc", "--rehearse", code=7, ATLANTIS_NO_MACHINES="tests")
    assert told["status"] == "not rehearsed"
