"""What our modules cost on a gateway's link: the tool goes over once, and each call a few kB after that."""

import threading
from collections.abc import Callable
from pathlib import Path

import pytest
from gateway_role import NAME, Stand
from gateway_stand import FREE_CLOCK, Key, Start, ground, machine, technician  # noqa: F401 - fixtures
from waiting import wait_until

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.plugin_utils.zipapp_action import FOLDER
from atlantis_netcfg.core.processes.remote_bundle import build

pytestmark = [pytest.mark.namespace, pytest.mark.slow]

CONNECTION = 10_000
"""Bytes up of a new SSH connection, at most."""
ACCOUNT = "odroid"


def stood(machine: Start, technician: Key, folder: Path, *roles: str, disk_mb: int | None = None) -> Stand:  # noqa: F811 - fixtures
    made = Stand(machine(NAME, disk_mb=disk_mb), technician, folder, roles)
    made.gateway.put("/etc/systemd/system/chrony.service.d/test.conf", FREE_CLOCK)
    made.gateway.run("systemctl daemon-reload")
    return made


def sent(stand: Stand, run: Callable[[], object]) -> int:
    """Bytes up of a run."""
    before = stand.gateway.traffic.up_bytes
    run()
    return stand.gateway.traffic.up_bytes - before


def tools(stand: Stand) -> list[str]:
    """What lies in the folder of the tool."""
    return stand.gateway.run(f"ls -A {FOLDER}", check=False).stdout.split()


def test_tool_is_sent_once_and_again_if_incomplete(
    machine: Start,  # noqa: F811 - a fixture
    technician: Key,  # noqa: F811 - a fixture
    tmp_path: Path,
) -> None:
    stand = stood(machine, technician, tmp_path, "gateway_base", "gateway_dds")
    planned = stand.run("--check")
    done = stand.run()
    assert done["hint"] is None, done["message"]
    assert planned["changes"] == done["changes"] != []
    made = build()
    (name,) = tools(stand)
    assert name == f"{made.sha256}.pyz"

    def again() -> None:
        assert stand.run()["changes"] == []

    nothing = sent(stand, again)
    assert nothing < 60_000
    assert nothing < len(made.payload) + CONNECTION, "the tool went over"
    whole = f"{FOLDER}/{name}"
    for harm in (f"rm {whole}", f"truncate -s 1000 {whole}", f"printf x | dd conv=notrunc bs=1 seek=99 of={whole}"):
        stand.gateway.run(f"{harm}; touch {FOLDER}/{'0' * 64}.pyz {FOLDER}/.new-1")
        cost = sent(stand, again)
        assert nothing + 0.9 * len(made.payload) < cost < nothing + len(made.payload) + 2 * CONNECTION
        assert tools(stand) == [name]
        stand.gateway.run(f"echo '{made.sha256}  {whole}' | sha256sum --check --status")
    assert sent(stand, again) < nothing + CONNECTION
    left = stand.gateway.run("ls -A /root /tmp").stdout
    assert ".ansible" not in left, "nothing but the tool is made"


def test_an_ordinary_account_becomes_root_by_sudo(
    machine: Start,  # noqa: F811 - a fixture
    technician: Key,  # noqa: F811 - a fixture
    tmp_path: Path,
) -> None:
    stand = stood(machine, technician, tmp_path, "gateway_dds")
    stand.gateway.run(f"useradd -m -s /bin/sh {ACCOUNT} && cp -r /root/.ssh /home/{ACCOUNT}/")
    stand.gateway.run(f"chown -R {ACCOUNT} /home/{ACCOUNT}/.ssh")
    stand.gateway.put(f"/home/{ACCOUNT}/.profile", "echo Welcome aboard\n")
    stand.variables |= {"ansible_user": ACCOUNT}
    refused = stand.run()
    assert "cannot change" in refused["message"]
    assert "allow the account to use sudo" in refused["hint"]

    stand.gateway.put("/etc/sudoers.d/test", f"{ACCOUNT} ALL=(ALL) NOPASSWD: ALL\n", mode="0440")
    stand.variables |= {"ansible_become": True}
    done = stand.run("-vvv")
    assert done["hint"] is None, done["message"]
    assert "file /etc/atlantis/ros.env" in done["changes"]
    assert stand.gateway.run(f"stat -c '%U %a' {FOLDER}/*").stdout == "root 644\n"
    again = stand.run("-vvv")
    assert again["changes"] == []
    text = (stand.folder / "said").read_text()
    assert "module_args" not in text
    assert text.count("SSH: EXEC") == len(("configure", "env_conflicts")), "one command a call, and no other"


def test_power_cut_during_tool_transfer_is_repaired_by_a_repeat(
    machine: Start,  # noqa: F811 - a fixture
    technician: Key,  # noqa: F811 - a fixture
    tmp_path: Path,
) -> None:
    stand = stood(machine, technician, tmp_path, "gateway_dds")
    stand.gateway.link(rate_up_bps=80_000)

    def cut() -> None:
        wait_until(lambda: stand.gateway.traffic.up_bytes >= 30_000)
        stand.gateway.power_cut()
        stand.gateway.link()

    beside = threading.Thread(target=cut)
    beside.start()

    # Without word from the far end it would wait through the gap of a satellite.
    usual = dict(stand.variables)
    stand.variables |= {"ansible_ssh_args": "-o ControlMaster=no -o ServerAliveInterval=1 -o ServerAliveCountMax=2"}
    lost = stand.run()
    beside.join()
    stand.variables = usual  # a computer that boots on a busy machine is silent for two seconds, too
    assert lost["status"] == "left-as-found", lost["message"]
    assert "could not be sent" in lost["message"] or "not responding" in lost["message"]
    stand.gateway.power_on()
    assert tools(stand) in ([], [".new-1"])
    done = stand.run()
    assert done["hint"] is None, done["message"]
    assert tools(stand) == [f"{build().sha256}.pyz"]
    assert stand.run()["changes"] == []


def test_full_disk_and_missing_python_are_reported(
    machine: Start,  # noqa: F811 - a fixture
    technician: Key,  # noqa: F811 - a fixture
    tmp_path: Path,
) -> None:
    stand = stood(machine, technician, tmp_path, "gateway_dds", disk_mb=64)
    stand.gateway.fill_disk(leave_kb=100)
    full = stand.run()
    assert "is full" in full["message"]
    assert "kB are free" in full["message"]
    assert "free space" in full["hint"]
    assert tools(stand) == []
    stand.gateway.free_disk()

    stand.variables |= {"ansible_python_interpreter": "/usr/bin/python9"}
    without = stand.run()
    assert "has no Python where it is looked for" in without["message"]
    assert "/usr/bin/python9" in without["message"]
    assert "apt-get install python3" in without["hint"]
    del stand.variables["ansible_python_interpreter"]
    assert stand.run()["hint"] is None
    assert stand.run()["changes"] == []
