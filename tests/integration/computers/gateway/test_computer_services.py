"""Declared services on a real Debian: opened to exactly whom it says, run within bounds, seen, and taken away again."""

from pathlib import Path
from typing import Any

import pytest
from gateway_role import Stand
from gateway_stand import FREE_CLOCK, Key, Start, ground, machine, technician  # noqa: F401 - fixtures

from atlantis_netcfg.emulator.lab import Machine
from atlantis_netcfg.emulator.lab.stubs import service_program

pytestmark = [pytest.mark.slow, pytest.mark.namespace]
UNIT = "atlantis-service-backend.service"
BACKEND: dict[str, Any] = {
    "name": "backend",
    "port": 18082,
    "open_to": ["lan"],
    "program": {"command": "/opt/partner/backend --quiet", "memory_mb": 64},
}


@pytest.fixture
def stand(machine: Start, technician: Key, tmp_path: Path) -> Stand:  # noqa: F811 - fixtures
    gateway = machine()
    gateway.put("/etc/systemd/system/chrony.service.d/rehearsal.conf", FREE_CLOCK)
    gateway.put("/opt/partner/backend", service_program("tcp", 18082), mode="0755")
    gateway.run("systemctl daemon-reload")
    made = Stand(gateway, technician, tmp_path / "stand", ["gateway_base"])
    declare(made, BACKEND)
    return made


def declare(stand: Stand, *services: dict[str, Any]) -> None:
    stand.declare({"services": list(services)}, "host_vars/coastal-gateway.yml", "device")


def hears(gateway: Machine, source: str) -> bool:
    """Whether somebody with this address reaches the port: a namespace of its own asks."""
    script = f"""
        ip netns add asker && ip link add a0 type veth peer name a1 netns asker || exit 2
        ip address add 192.0.2.1/24 dev a0; ip link set a0 up
        ip -n asker link set a1 up; ip -n asker address add {source}/32 dev a1
        ip route add {source}/32 dev a0
        ip -n asker route add 192.0.2.1/32 dev a1
        ip netns exec asker timeout 2 python3 -c 'import socket
s = socket.create_connection(("192.0.2.1", 18082), 1, ("{source}", 0)); print(s.recv(100))'
    """
    done = gateway.run(script, check=False)
    gateway.run("ip netns delete asker; ip link delete a0", check=False)
    assert done.returncode != 2, done.stderr
    return "stand-in" in done.stdout


def test_service_runs_is_reachable_as_declared_and_is_removed(stand: Stand) -> None:
    told = stand.run()
    assert (told["status"], told["exit"]) == ("changed", 0), told["message"]
    assert stand.run()["changes"] == [], "nothing is left"
    gateway = stand.gateway
    assert gateway.run(f"systemctl show --property User --value {UNIT}").stdout.strip() == "svc-backend"
    assert gateway.run("stat -c '%U %a' /var/lib/svc-backend").stdout.strip() == "svc-backend 750"
    assert [hears(gateway, source) for source in ("10.64.1.77", "10.80.0.2", "10.64.2.77")] == [True, False, False]
    declare(stand, {**BACKEND, "open_to": ["vpn"], "partners": ["iqua"]})
    assert stand.run()["exit"] == 0
    heard = [hears(gateway, source) for source in ("10.64.1.77", "10.80.0.2", "10.80.17.3", "10.80.16.3")]
    assert heard == [False, True, True, False]
    declare(stand)
    assert stand.run()["exit"] == 0
    assert gateway.run(f"systemctl is-active {UNIT}", check=False).stdout.strip() == "inactive"
    assert gateway.run(f"ls /etc/systemd/system/{UNIT}", check=False).returncode != 0
    assert not hears(gateway, "10.80.0.2")
    assert stand.run()["changes"] == []


def test_service_that_does_not_listen_is_a_finding(stand: Stand) -> None:
    stand.run()
    gateway = stand.gateway
    finding = "the service `backend` does not listen on tcp port 18082"
    gateway.put("/opt/partner/backend", "#!/bin/sh\nexec sleep 1000\n", mode="0755")
    gateway.run(f"systemctl restart {UNIT}")
    told = stand.run()
    assert finding in told["message"]
    assert told["exit"] == 6
    gateway.run(f"systemctl stop {UNIT}; rm /opt/partner/backend")
    gateway.put("/root/stranger", service_program("tcp", 18082), mode="0755")
    gateway.run("systemd-run --unit stranger /root/stranger")
    told = stand.run()
    assert finding in told["message"], "a stranger at the port is not the service"
    assert any("/opt/partner/backend of the service `backend` is missing" in note for note in told["notes"])
    gateway.run("systemctl stop stranger")
    gateway.put("/opt/partner/backend", service_program("tcp", 18082), mode="0755")
    told = stand.run()
    assert (finding in told["message"], told["exit"]) == (False, 0), "brought, it starts by itself"


def test_check_mode_on_a_fresh_computer_starts_nothing(stand: Stand) -> None:
    told = stand.run("--check")
    assert f"unit {UNIT} started" in told["changes"]
    assert stand.gateway.run(f"systemctl is-active {UNIT}", check=False).stdout.strip() == "inactive"
