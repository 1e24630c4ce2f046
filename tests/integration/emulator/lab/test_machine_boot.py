"""A machine is a real Debian with systemd at its declared address, which SSH reaches through a port here."""

import time
from pathlib import Path

import paramiko
import pytest
from machine_stand import ADDRESS, ROUTER, bare, client, gateway, ground, key, ssh

from atlantis_netcfg.emulator.lab import Lab, Machine, MachineError

__all__ = ["bare", "gateway", "ground", "key"]
pytestmark = [pytest.mark.slow, pytest.mark.namespace]
_SYS_TIME = 1 << 25
_READ_BOUNDING_SET = "grep CapBnd /proc/self/status"


@pytest.mark.smoke
def test_it_boots_without_a_failed_unit(gateway: Machine) -> None:
    assert gateway.state(wait_for_boot=True) == "running"
    assert gateway.run("systemctl --failed --plain --no-legend").stdout == ""
    assert gateway.run("hostname; cat /etc/hostname").stdout == "coastal-gateway\ncoastal-gateway\n"
    assert gateway.run("ip -br -4 address show eth0").stdout.split()[2] == ADDRESS
    assert gateway.run("ip route show default").stdout.split()[2] == ROUTER


@pytest.mark.smoke
def test_root_logs_in_with_the_key_at_the_pinned_host(gateway: Machine, key: paramiko.PKey) -> None:
    assert ssh(gateway, key, "id -un; hostname") == "root\ncoastal-gateway\n"
    assert gateway.traffic.connections == 1


def test_password_login_is_refused(gateway: Machine) -> None:
    gateway.run("chpasswd", input="root:odroid\n")
    with client(gateway) as one, pytest.raises(paramiko.BadAuthenticationType) as caught:
        one.connect("127.0.0.1", gateway.port, "root", "odroid", allow_agent=False, look_for_keys=False)
    assert caught.value.allowed_types == ["publickey"]


def test_link_delay_is_in_every_round_trip(gateway: Machine, key: paramiko.PKey) -> None:
    gateway.link(delay_s=0.05)
    begin = time.monotonic()
    assert ssh(gateway, key, "echo far") == "far\n"
    assert time.monotonic() - begin >= 5 * 2 * 0.05  # connection, version, key exchange, login, command


@pytest.mark.parametrize("way", ["ssh", "run"])
def test_machine_cannot_set_the_host_clock(gateway: Machine, key: paramiko.PKey, way: str) -> None:
    said = ssh(gateway, key, _READ_BOUNDING_SET) if way == "ssh" else gateway.run(_READ_BOUNDING_SET).stdout
    assert int(said.split()[1], 16) & _SYS_TIME == 0


def test_machine_may_forward_and_create_tunnels(gateway: Machine) -> None:
    assert gateway.run("sysctl -nw net.ipv4.ip_forward=1").stdout == "1\n"
    gateway.run("ip tuntap add mode tun name tun0 && ip link set tun0 up")
    assert gateway.run("ip -br link show tun0").stdout.startswith("tun0 ")


def test_commands_get_input_and_report_failure(gateway: Machine) -> None:
    gateway.put("/etc/atlantis/new folder/file", "text\n", mode="0600")
    assert gateway.run("cat", input="in\n").stdout == "in\n"
    assert gateway.run("stat -c %a '/etc/atlantis/new folder/file'").stdout == "600\n"
    assert gateway.run("exit 3", check=False).returncode == 3
    with pytest.raises(MachineError, match=r"coastal-gateway: ls /none: ended with 2: ls: cannot access '/none'"):
        gateway.run("ls /none")


def test_spare_interface_on_an_unconfigured_machine(ground: Lab, bare: Path, key: paramiko.PKey) -> None:
    keys = (f"{key.get_name()} {key.get_base64()}",)
    one = ground.start(
        *("robot", bare), address=ADDRESS, gateway=ROUTER, keys=keys, spare="eth1", is_configured=False, wait_s=None
    )
    while one.run("ls /run/sshd.pid", check=False).returncode:
        pass
    assert one.run("ip -br -4 address show eth0; ip -br -4 address show eth1").stdout == ""
    one.run(f"ip address add {ADDRESS} dev eth1 && ip link set eth1 up")
    one.wait_until_up()
    assert ssh(one, key, "ip -br link show eth1").startswith("eth1@")


def test_machines_and_servers_of_a_lab_reach_each_other(
    gateway: Machine, ground: Lab, bare: Path, tmp_path: Path
) -> None:
    other = ground.start("other", bare, address="10.64.2.10/24", gateway="10.64.2.1", wait_s=None)
    (tmp_path / "served").mkdir()
    (tmp_path / "served" / "key.asc").write_text("a key\n")
    address = ground.serve(tmp_path / "served")
    assert address.startswith(f"http://{ROUTER}:")
    assert ground.address == ROUTER
    other.wait_until_up()
    fetch = "python3 -c 'import urllib.request as u, sys; sys.stdout.write(u.urlopen(sys.argv[1]).read().decode())'"
    assert other.run(f"{fetch} {address}/key.asc").stdout == "a key\n"
    greeting = "import socket; print(socket.create_connection(('10.64.2.10', 22)).recv(4).decode())"
    assert gateway.run(f'python3 -c "{greeting}"').stdout == "SSH-\n"
    assert ground.command(("ip", "-br", "-4", "address", "show", "br0")).stdout.split()[2:] == [
        "10.64.1.1/24",
        "10.64.2.1/24",
    ]


def test_machine_name_is_unique(gateway: Machine, ground: Lab, bare: Path) -> None:
    with pytest.raises(MachineError, match=f"{gateway.name} stands in this yard already"):
        ground.start(gateway.name, bare, address=ADDRESS, gateway=ROUTER)
