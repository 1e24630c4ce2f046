"""The role `gateway_base` on a whole computer, emulated by qemu: one whose clock, kernel and boot are its own.

A container has the clock and the kernel of this computer, so that only here the clock is really ten years off and set,
chrony leads it, and values of the kernel are taken. Building and booting takes minutes: `make campaign`.
"""

import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import pytest
from debian_trees import CLOCK
from gateway_role import NAME, Stand
from gateway_stand import (
    Key,
    technician,  # noqa: F401 - a fixture
)
from ports import held_port

from atlantis_netcfg.emulator.lab import Machine, TreeSpec, build_rootfs, why_not

pytestmark = [pytest.mark.campaign, pytest.mark.timeout(3600)]

LAN = "[Match]\nName=en* eth*\n[Network]\nAddress=10.64.1.10/24\nGateway=10.64.1.1\n"
WANTS = "etc/systemd/system/multi-user.target.wants"
OPTIONS = ("-accel", "tcg", "-m", "768", "-smp", "2", "-nographic", "-no-reboot")


@dataclass(frozen=True)
class Guest:
    """What the stand needs of a machine."""

    port: int
    host_key: str
    key: Path
    known: Path

    def run(self, command: str, *, check: bool = True) -> subprocess.CompletedProcess[str]:
        options = [
            "StrictHostKeyChecking=yes",
            f"UserKnownHostsFile={self.known}",
            "BatchMode=yes",
            "ConnectTimeout=30",
        ]
        words = [word for option in options for word in ("-o", option)]
        to = ["ssh", "-F", "none", "-i", str(self.key), "-p", str(self.port), *words, "root@127.0.0.1"]
        return subprocess.run([*to, command], check=check, capture_output=True, text=True)


def card(folder: Path, key: Key, spec: TreeSpec = CLOCK) -> tuple[Path, str]:
    """The disk of a board, and its host key."""
    root = folder / "root"
    subprocess.run(["cp", "-a", build_rootfs(spec), root], check=True)
    subprocess.run(
        ["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", root / "etc/ssh/ssh_host_ed25519_key"], check=True
    )
    (root / "root/.ssh").mkdir(mode=0o700, exist_ok=True)
    (root / "root/.ssh/authorized_keys").write_text(f"{key.public}\n")
    (root / "etc/systemd/network/20.network").write_text(LAN)
    (root / WANTS / "systemd-networkd.service").symlink_to("/lib/systemd/system/systemd-networkd.service")
    (root / "etc/fstab").write_text("/dev/vda / ext4 rw 0 1\n")
    (root / "etc/machine-id").write_text("")
    disk = folder / "disk.raw"
    with disk.open("wb") as file:
        file.truncate(3 * 10**9)
    subprocess.run(["mke2fs", "-q", "-t", "ext4", "-d", root, disk], check=True)
    return disk, (root / "etc/ssh/ssh_host_ed25519_key.pub").read_text().strip()


@contextmanager
def booted(folder: Path, disk: Path, host_key: str, key: Key, port: int) -> Iterator[Guest]:
    boot = folder / "root" / "boot"
    kernel, initrd = (next(boot.glob(name)) for name in ("vmlinuz-*", "initrd.img-*"))
    known = folder / "known_hosts"
    known.write_text(f"[127.0.0.1]:{port} {host_key}\n")
    lan = f"user,id=n0,restrict=on,net=10.64.1.0/24,host=10.64.1.1,hostfwd=tcp:127.0.0.1:{port}-10.64.1.10:22"
    command = ["qemu-system-x86_64", *OPTIONS, "-kernel", str(kernel), "-initrd", str(initrd)]
    command += ["-netdev", lan, "-device", "virtio-net-pci,netdev=n0", "-drive", f"file={disk},if=virtio,format=raw"]
    command += ["-append", "root=/dev/vda rw console=ttyS0 quiet"]
    with (
        (folder / "console").open("w") as console,
        subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=console, stderr=subprocess.STDOUT) as qemu,
    ):
        try:
            guest = Guest(port, host_key, key.file, known)
            while guest.run("true", check=False).returncode != 0:
                assert qemu.poll() is None, (folder / "console").read_text()[-3000:]
                time.sleep(1)
            yield guest
        finally:
            qemu.kill()


def test_clock_ten_years_off_is_corrected(technician: Key, tmp_path: Path) -> None:  # noqa: F811
    if (reason := why_not()) is not None:
        pytest.skip(reason)
    disk, host_key = card(tmp_path, technician)
    with held_port() as port, booted(tmp_path, disk, host_key, technician, port) as guest:
        (tmp_path / "stand").mkdir()
        stand = Stand(cast("Machine", guest), technician, tmp_path / "stand", ["gateway_base"])
        guest.run("systemctl stop chrony; date -s '2016-11-22 10:00:00'")
        planned = stand.run("--check")
        assert guest.run("date +%Y").stdout == "2016\n"
        done = stand.run()
        assert done["hint"] is None, done["message"]
        notes = [note for note in done["notes"] if "this machine has no radio" not in note]
        assert (planned["changes"][1:], notes) == (done["changes"][1:], [])
        assert done["changes"][0].startswith("clock set: it was 36")
        assert abs(int(guest.run("date +%s").stdout) - time.time()) < 300
        assert guest.run("cat /proc/sys/net/core/rmem_max /proc/sys/net/ipv4/ipfrag_time").stdout == "8388608\n3\n"
        assert guest.run("systemctl is-active chrony nftables").stdout == "active\nactive\n"
        assert stand.run()["changes"] == []
        stand.declare({"watchdog_s": 30}, f"host_vars/{NAME}.yml", "device")
        assert "this board has no watchdog" in stand.run()["message"]
        guest.run("sync")
    with held_port() as port, booted(tmp_path, disk, host_key, technician, port) as guest:
        assert "tcp dport 22 accept" in guest.run("nft list ruleset").stdout
        assert guest.run("cat /proc/sys/net/core/rmem_max").stdout == "8388608\n"
        assert guest.run("date +%Z").stdout in ("WET\n", "WEST\n")
        assert guest.run("systemctl is-active chrony").stdout == "active\n"
