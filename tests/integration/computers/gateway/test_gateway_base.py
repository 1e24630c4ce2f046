"""The role `gateway_base` on a real Debian with systemd, by SSH: what comes of it, and what cannot go wrong."""

import subprocess
import threading
from pathlib import Path
from typing import Any

import pytest
from gateway_role import NAME, Stand
from gateway_stand import FREE_CLOCK, Key, Start, ground, machine, ssh, technician  # noqa: F401 - fixtures
from waiting import wait_until

from atlantis_netcfg.emulator.lab import Lab

pytestmark = [pytest.mark.namespace, pytest.mark.slow]

CONF = "/etc/chrony/chrony.conf"


@pytest.fixture
def stand(machine: Start, technician: Key, tmp_path: Path) -> Stand:  # noqa: F811 - fixtures
    return made(machine, technician, tmp_path)


def made(machine: Start, technician: Key, folder: Path, **how: Any) -> Stand:  # noqa: ANN401, F811 - of the machine
    stand = Stand(machine(NAME, **how), technician, folder, ["gateway_base"])
    stand.gateway.put("/etc/systemd/system/chrony.service.d/test.conf", FREE_CLOCK)
    stand.gateway.run("systemctl daemon-reload")
    return stand


def said(stand: Stand, command: str) -> str:
    return stand.gateway.run(command).stdout.strip()


def logs_in(stand: Stand, folder: Path) -> bool:
    """Whether a new session by key is let in."""
    words = [*ssh(stand.gateway, stand.key, folder), "-o", "ConnectTimeout=5", "true"]
    return subprocess.run(words, check=False, capture_output=True).returncode == 0


@pytest.mark.smoke
def test_computer_is_configured_as_a_gateway(stand: Stand, ground: Lab, tmp_path: Path) -> None:  # noqa: F811 - fixtures
    planned = stand.run("--check")
    assert said(stand, "cat /etc/timezone") == "Etc/UTC"
    done = stand.run()
    assert done["hint"] is None, done["message"]
    assert planned["changes"] == done["changes"]
    assert {f"file {CONF}", "step generate the locale", "unit chrony.service started"} <= {*done["changes"]}
    again = stand.run()
    assert (again["changes"], again["status"]) == ([], "unchanged")

    assert "en_US.utf8" in said(stand, "locale -a").split()
    assert said(stand, "hostname; hostname --fqdn").split() == [NAME, f"{NAME}.coastal.example.org"]
    assert said(stand, "date +%Z") in ("WET", "WEST")
    assert "10.64.1.1" in said(stand, "chronyc -n sources")
    held = said(stand, "sshd -T -C user=root,host=x,addr=10.64.1.1").splitlines()
    assert {"passwordauthentication no", "permitrootlogin without-password", "usedns no"} <= {*held}
    assert said(stand, "systemctl is-enabled nftables chrony") == "enabled\nenabled"
    assert said(stand, "ls /etc/cloud") == "cloud-init.disabled"
    assert "SystemMaxUse=200M" in said(stand, "systemd-analyze cat-config systemd/journald.conf")
    assert said(stand, "ls -d /var/log/journal/*")
    assert 'Automatic-Reboot "false"' in said(stand, "apt-config dump | grep -i Unattended-Upgrade::Automatic-Reboot ")
    assert any("net.core.rmem_max" in note for note in done["notes"])

    stand.gateway.power_cut()
    stand.gateway.power_on()
    assert "tcp dport 22 accept" in said(stand, "nft list ruleset")
    assert logs_in(stand, tmp_path)
    assert who_answers(ground, stand) == {"22": True, "7401": True, "8000": False}


def who_answers(ground: Lab, stand: Stand) -> dict[str, bool]:  # noqa: F811 - a fixture
    """Of ports on which a program listens, as the LAN sees it: TCP, but for the one of DDS."""
    stand.gateway.run(
        "for port in 8000; do setsid python3 -m http.server $port >/dev/null 2>&1 </dev/null & done; "
        "setsid python3 -c 'import socket; s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM); "
        's.bind(("", 7401)); s.sendto(b"", s.recvfrom(9)[1])\' >/dev/null 2>&1 </dev/null &'
    )
    wait_until(lambda: ":8000" in said(stand, "ss -lnt") and ":7401" in said(stand, "ss -lnu"))
    tcp = "import socket; socket.create_connection(('{}', {}), 2)"
    udp = (
        "import socket; s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM); s.settimeout(2); "
        "s.sendto(b'x', ('{}', {})); s.recv(9)"
    )
    return {
        port: ground.command(["python3", "-c", program.format(stand.gateway.address, port)], check=False).returncode
        == 0
        for port, program in (("22", tcp), ("7401", udp), ("8000", tcp))
    }


def test_technician_is_not_locked_out(machine: Start, technician: Key, ground: Lab, tmp_path: Path) -> None:  # noqa: F811
    """The technician works from 192.0.2.1, which the site does not admit, as root or by sudo; then sshd is odd."""
    ground.add_address("192.0.2.1/24")
    stand = made(machine, technician, tmp_path, address="192.0.2.10/24", gateway="192.0.2.1")
    stand.gateway.run("useradd -m odroid && cp -r /root/.ssh /home/odroid/ && chown -R odroid: /home/odroid/.ssh")
    stand.gateway.put("/etc/sudoers.d/odroid", "odroid ALL=(ALL) NOPASSWD: ALL\n", mode="0440")
    before = said(stand, "nft list ruleset; cat /etc/hostname /etc/hosts /etc/locale.gen")
    for stand.variables, words in (({}, ["--check"]), ({"ansible_user": "odroid", "ansible_become": True}, [])):
        refused = stand.run(*words)
        assert refused["status"] == "left-as-found"
        assert "you work from 192.0.2.1, which could not log in afterwards" in refused["message"]
        assert "site.management.admit" in refused["hint"]
    assert said(stand, "nft list ruleset; cat /etc/hostname /etc/hosts /etc/locale.gen") == before
    assert logs_in(stand, tmp_path)

    admitted = ["10.64.101.0/24", "10.80.0.0/24", "192.0.2.0/28"]
    admit = {"management": {"network": "10.64.101.0/24", "technician": "10.64.101.10", "admit": admitted}}
    stand.declare(admit, "group_vars/coastal.yml", "site")
    stand.gateway.run("sed -i.was /Include/d /etc/ssh/sshd_config")
    refused = stand.run()
    assert "begin /etc/ssh/sshd_config with the line\nInclude /etc/ssh/sshd_config.d/*.conf" in refused["message"]
    stand.gateway.run("mv /etc/ssh/sshd_config.was /etc/ssh/sshd_config")
    stand.run()
    assert stand.run()["changes"] == []
    assert logs_in(stand, tmp_path)


def test_kernel_without_nftables_gets_everything_else_and_fails(stand: Stand) -> None:
    """Stands for a vendor's kernel 4.9 without nf_tables: nft says what it says there."""
    words = "netlink: Error: cache initialization failed: Operation not supported"
    stand.gateway.put("/usr/local/sbin/nft", f"#!/bin/sh\necho '{words}' >&2; exit 1\n", mode="0755")
    before = said(stand, "cat /etc/nftables.conf")
    planned, done, again = stand.run("--check"), stand.run(), stand.run()
    assert planned["changes"] == done["changes"]
    assert {f"file {CONF}", "step generate the locale", "unit chrony.service started"} <= {*done["changes"]}
    assert not [change for change in done["changes"] if "nftables" in change]
    assert again["changes"] == []
    for one in (planned, done, again):
        assert "finding: the firewall of the inventory is not active: nft does not accept" in one["message"]
        assert words in one["message"]
        assert "the kernel of this computer lacks nf_tables" in one["hint"]
    assert [one["exit"] for one in (planned, done, again)] == [2, 6, 6]
    assert said(stand, "cat /etc/timezone") == "Europe/Lisbon"
    assert said(stand, "cat /etc/nftables.conf") == before

    stand.gateway.run("rm /usr/local/sbin/nft")
    mended = stand.run()
    assert mended["changes"][0] == "file /etc/nftables.conf"
    assert (mended["exit"], stand.run()["exit"]) == (0, 0)
    assert "tcp dport 22 accept" in said(stand, "nft list ruleset")


def test_full_disk_leaves_the_gateway_unchanged(machine: Start, technician: Key, tmp_path: Path) -> None:  # noqa: F811
    stand = made(machine, technician, tmp_path, disk_mb=64)
    before = said(stand, "find /etc /var/lib -type f | sort")
    stand.gateway.fill_disk()
    refused = stand.run()
    assert "is full: 0 kB are free" in refused["message"]
    assert "apt-get clean" in refused["hint"]
    assert said(stand, "find /etc /var/lib -type f | sort") == before
    stand.gateway.free_disk()
    assert stand.run()["changes"][0] == "directory /etc/atlantis/radios"
    assert stand.run()["changes"] == []


def test_a_power_cut_in_the_middle_is_repaired_by_the_next_run(stand: Stand) -> None:
    """It comes while the locale is made: the files are there, no unit has read them."""
    stand.gateway.put("/usr/local/sbin/locale-gen", "#!/bin/sh\n: > /root/begun\nexec sleep 600\n", mode="0755")
    stand.variables = {"ansible_ssh_args": "-o ControlMaster=no -o ServerAliveInterval=1 -o ServerAliveCountMax=3"}
    cut: dict[str, Any] = {}
    running = threading.Thread(target=lambda: cut.update(stand.run()))
    running.start()
    wait_until(lambda: stand.gateway.run("test -e /root/begun", check=False).returncode == 0)
    stand.gateway.power_cut()
    running.join()
    assert cut["exit"] != 0
    stand.variables = {}
    stand.gateway.power_on()
    stand.gateway.run("rm /usr/local/sbin/locale-gen")
    repaired = stand.run()["changes"]
    assert "step generate the locale" in repaired
    assert {"unit nftables.service enabled", "unit nftables.service started"} <= {*repaired}
    assert "en_US.utf8" in said(stand, "locale -a").split()
    assert stand.run()["changes"] == []
