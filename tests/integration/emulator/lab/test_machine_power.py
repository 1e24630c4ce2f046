"""Power cuts, full disks, and a machine that does not come up."""

import socket

import paramiko
import pytest
from machine_stand import bare, gateway, ground, key, ssh
from waiting import HANG_S

from atlantis_netcfg.emulator.lab import Machine, MachineError

__all__ = ["bare", "gateway", "ground", "key"]
pytestmark = [pytest.mark.slow, pytest.mark.namespace]
_SYNCED = "import os; f = open('/root/kept', 'w'); f.write('kept\\n'); f.flush(); os.fsync(f.fileno())"
_WRITE = "import errno; f = open('/root/more', 'w')\ntry: f.write('x' * 100000); f.flush()\nexcept OSError as e: print(errno.errorcode[e.errno])"  # noqa: E501 - one program


def test_synced_files_survive_a_power_cut_and_processes_do_not(gateway: Machine, key: paramiko.PKey) -> None:
    host, card = gateway.host_key, gateway.run("cat /etc/machine-id /sys/class/net/eth0/address").stdout
    gateway.run(f'python3 -c "{_SYNCED}"')
    gateway.run("systemd-run --quiet --unit=busy sleep infinity")
    gateway.power_cut()
    assert not gateway.runs
    with pytest.raises(MachineError, match="coastal-gateway is off"):
        gateway.run("true")
    gateway.put("/root/by-hand", "on the bench\n")
    gateway.power_on()
    assert ssh(gateway, key, "cat /root/kept /root/by-hand") == "kept\non the bench\n"
    assert gateway.run("systemctl is-active busy", check=False).stdout == "inactive\n"
    assert gateway.run("cat /etc/machine-id /sys/class/net/eth0/address").stdout == card
    assert gateway.host_key == host


def test_power_cut_closes_no_connection(gateway: Machine) -> None:
    """The end of a connection would be read before the reset that the machine answers with once it is up again."""
    with socket.create_connection(("127.0.0.1", gateway.port), HANG_S) as caller:
        assert caller.recv(4) == b"SSH-"
        while b"\n" not in caller.recv(1024):
            pass
        gateway.power_cut()
        gateway.power_on()
        caller.sendall(b"SSH-2.0-late\r\n")
        with pytest.raises(ConnectionResetError):
            caller.recv(1024)


def test_reboot_stops_the_machine_until_power_on(gateway: Machine) -> None:
    gateway.run("systemctl reboot", check=False)
    while gateway.runs:
        pass
    gateway.power_on()
    assert gateway.state(wait_for_boot=True) == "running"
    with pytest.raises(MachineError, match="coastal-gateway runs already"):
        gateway.power_on()


def test_a_full_disk_is_full_until_it_is_freed(gateway: Machine) -> None:
    gateway.fill_disk()
    assert gateway.run(f'python3 -c "{_WRITE}"').stdout == "ENOSPC\n"
    gateway.free_disk()
    assert gateway.run(f'python3 -c "{_WRITE}"').stdout == ""
    gateway.fill_disk(leave_kb=1024)
    gateway.run("head -c 500000 /dev/zero > /root/half")
    assert gateway.run("head -c 1000000 /dev/zero > /root/all", check=False).returncode != 0


def test_disk_has_the_requested_size(gateway: Machine) -> None:
    assert gateway.run("df --output=size -m / | tail -1").stdout.strip() == "64"
    assert gateway.run("head -c 70000000 /dev/zero > /root/big", check=False).returncode != 0


def test_boot_failure_is_reported_with_the_console(gateway: Machine) -> None:
    gateway.power_cut()
    gateway.put("/sbin/init", "not a program\n", mode="0755")
    with pytest.raises(MachineError, match=r"machine coastal-gateway ended while it booted; its console \(.*\):\n  "):
        gateway.power_on()
