"""The role with a declared retrieval, on either end: it converges twice, admits gateways, and takes itself away."""

from pathlib import Path
from typing import Any

import pytest
from gateway_role import Stand
from gateway_stand import FREE_CLOCK, Key, Start, ground, machine, technician  # noqa: F401 - fixtures
from retrieval_stand import CENTRE, GATEWAY

from atlantis_netcfg.computers.retrieval import PROGRAM, SERVICE

pytestmark = [pytest.mark.slow, pytest.mark.namespace]
DECLARED: dict[str, Any] = {"to": CENTRE, "budget_mb": 1000, "sources": [{"host": GATEWAY}]}


def stand(machine: Start, technician: Key, folder: Path, name: str, lan: str) -> Stand:  # noqa: F811 - fixtures
    computer = machine(name, address=f"{lan}.11/24", gateway=f"{lan}.1")
    computer.put("/etc/systemd/system/chrony.service.d/rehearsal.conf", FREE_CLOCK)
    computer.run("systemctl daemon-reload")
    made = Stand(computer, technician, folder, ["gateway_base"], name=name)
    for host in (GATEWAY, CENTRE):
        made.declare({"ssh": {"host_key": computer.host_key.strip()}}, f"host_vars/{host}.yml", "device")
    made.declare({"services": None}, f"host_vars/{CENTRE}.yml", "device")
    made.declare({"retrieval": DECLARED})
    return made


def test_the_control_centre_converges_twice_and_admits_the_gateway(
    machine: Start,  # noqa: F811 - fixtures
    technician: Key,  # noqa: F811 - fixtures
    tmp_path: Path,
) -> None:
    made = stand(machine, technician, tmp_path / "stand", CENTRE, "10.64.0")
    result = made.run()
    assert (result["status"], result["exit"]) == ("changed", 0), result["message"]
    assert made.run()["changes"] == []
    obeyed = made.gateway.run("sshd -T -C user=svc-retrieval,host=x,addr=10.80.0.21,laddr=10.80.0.2,lport=22").stdout
    assert "authorizedkeysfile /etc/atlantis/retrieval.keys" in obeyed
    assert made.gateway.run("stat -c '%U %a' /srv/recordings").stdout.strip() == "svc-retrieval 750"
    others = made.gateway.run("sshd -T -C user=root,host=x,addr=10.80.0.21,laddr=10.80.0.2,lport=22").stdout
    assert "authorizedkeysfile .ssh/authorized_keys .ssh/authorized_keys2" in others, "other accounts are as before"


@pytest.mark.campaign
def test_gateway_converges_and_removed_retrieval_is_cleaned_up(
    machine: Start,  # noqa: F811 - fixtures
    technician: Key,  # noqa: F811 - fixtures
    tmp_path: Path,
) -> None:
    made = stand(machine, technician, tmp_path / "stand", GATEWAY, "10.64.1")
    result = made.run()
    assert (result["status"], result["exit"]) == ("changed", 0), result["message"]
    assert f"unit {SERVICE} enabled" in result["changes"]
    assert made.run()["changes"] == []
    assert made.gateway.run(f"systemctl is-active {SERVICE}", check=False).stdout.strip() == "inactive"
    assert '"state": "none"' in made.gateway.run(f"python3 -I {PROGRAM} status", input="{}").stdout
    made.declare({"retrieval": None})
    assert made.run()["exit"] == 0
    left = made.gateway.run("ls /etc/atlantis /usr/local/lib/atlantis; find /etc/systemd -name '*retrieval*'").stdout
    assert "retrieval" not in left
    assert made.run()["changes"] == []
