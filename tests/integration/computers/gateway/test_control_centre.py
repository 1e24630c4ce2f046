"""The control centre and an operator station in a rehearsal: real Debians for root, run twice over each link."""

import json
import os
import shutil
from pathlib import Path
from typing import Any

import preforked
import pytest

from atlantis_netcfg.emulator.lab import why_not

CHECKOUT = Path(__file__).parents[4]
pytestmark = pytest.mark.slow
STATION = """\
---
device:
  kind: operator_station
  address: 10.64.0.30
  vpn_address: 10.80.0.30
  network: {by: networkd, interface: host0}
"""


def rehearsed(state: Path, host: str, *words: str) -> dict[str, Any]:
    if (reason := why_not()) is not None:
        pytest.skip(reason)
    typed = ["site=scc", "--rehearse", "--json", f"device={host}", *words]
    done = preforked.run(typed, env=os.environ | {"ATLANTIS_STATE": str(state)}, folder=CHECKOUT)
    assert done.returncode == 0, f"exit {done.returncode}\n{done.stdout[:2000]}\n{done.stderr[-2000:]}"
    told: dict[str, Any] = json.loads(done.stdout)["devices"][host]
    return told


def test_the_control_centre_converges_and_its_services_listen(tmp_path: Path) -> None:
    told = rehearsed(tmp_path, "scc-control")
    assert (told["status"], told["second_pass"]) == ("changed", 0)
    assert {name: again["planned"] for name, again in told["bearers"].items()} == {"lan": 0, "uplink": 0}
    changes = "\n".join(told["changes"])
    for part in ("/etc/nftables.conf", "/etc/atlantis/ros.env", "openvpn-client@atlantis.service started"):
        assert part in changes
    assert "/etc/systemd/system/atlantis-qualify.service" in changes
    assert "unit atlantis-qualify.service started" not in changes, "a measurement opens its port"
    assert "unit atlantis-service-example-backend.service started" in changes
    assert "ros-foxy" not in changes, "ROS 2 is installed by choice"
    assert any("stand-ins listen at the declared ports" in line for line in told["not_rehearsed"])


def test_operator_station_changes_only_its_vpn_membership(tmp_path: Path) -> None:
    inventory = shutil.copytree(CHECKOUT / "inventory", tmp_path / "inventory")
    (inventory / "host_vars/scc-desk1.yml").write_text(STATION)
    hosts = inventory / "hosts.yml"
    text = hosts.read_text().replace("            scc-control:\n", "            scc-control:\n            scc-desk1:\n")
    empty = "    operator_stations:\n      hosts: {} # none in this example\n"
    assert text.count(empty) == 1
    hosts.write_text(text.replace(empty, "    operator_stations:\n      hosts:\n        scc-desk1:\n"))
    told = rehearsed(tmp_path / "state", "scc-desk1", f"inventory={inventory}")
    assert (told["status"], told["second_pass"]) == ("changed", 0)
    assert {again["planned"] for again in told["bearers"].values()} == {0}
    assert any("a machine keeps the one that it was started with" in line for line in told["not_rehearsed"])
    changes = "\n".join(told["changes"])
    assert "openvpn-client@atlantis.service started" in changes
    for part in ("nftables", "sshd_config", "chrony", "hostname", "/etc/atlantis/dds"):
        assert part not in changes
