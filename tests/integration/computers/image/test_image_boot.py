"""A real Debian, customised, written to a loop device, read back, and booted from there in qemu.

Debian stands in for Ubuntu, which cannot be had here; the kernel is handed to qemu, so that U-Boot's part (the gap,
boot.ini) is not proved. Building the Debian takes minutes: `make campaign` runs this for amd64, `make test-arm64` for
arm64, the ODROID's, and CI looks into smaller images (`test_image_customise.py`). ATLANTIS_TEST_ROOTFS names a root
file system that is there already (a tar).
"""

import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from ipaddress import IPv4Address, IPv4Interface
from pathlib import Path

import paramiko
import pytest
from blocks_fake import Tree, loop
from image_made import ROOT_AT, disk, run
from ports import held_port
from waiting import HANG_S

from atlantis_netcfg.computers.image.blocks import require_writable_disk
from atlantis_netcfg.computers.image.ext4 import LAYOUTS, Ext4
from atlantis_netcfg.computers.image.facts import ImageRequest, StaticNetwork
from atlantis_netcfg.computers.image.plan import customise
from atlantis_netcfg.computers.image.source import expand, segments
from atlantis_netcfg.computers.image.writer import Card, write

pytestmark = pytest.mark.timeout(5400)

PASSWORD = "odroid"
PACKAGES = "systemd,systemd-sysv,dbus,udev,openssh-server,iproute2,tzdata,e2fsprogs"


@dataclass(frozen=True)
class Machine:
    """What a card is booted in, emulated instruction by instruction."""

    architecture: str
    kernel: str
    root_mib: int
    qemu: tuple[str, ...]
    console: str

    @property
    def marks(self) -> pytest.MarkDecorator:
        return pytest.mark.campaign if self.architecture == "amd64" else pytest.mark.arm64


MACHINES = (
    Machine("amd64", "linux-image-cloud-amd64", 900, ("qemu-system-x86_64",), "ttyS0"),
    Machine("arm64", "linux-image-arm64", 1300, ("qemu-system-aarch64", "-M", "virt", "-cpu", "cortex-a72"), "ttyAMA0"),
)
READY = """\
[Unit]
Description=Tell this test, over the serial line, that SSH was started
After=ssh.service systemd-networkd.service

[Service]
Type=oneshot
ExecStart=/bin/sh -c 'echo; echo THE-GUEST-IS-READY >/dev/console'
"""
CARD = 2 * 10**9 // 512 * 512


@pytest.fixture(params=[pytest.param(one, marks=one.marks, id=one.architecture) for one in MACHINES])
def machine(request: pytest.FixtureRequest) -> Machine:
    made: Machine = request.param
    return made


@pytest.fixture
def debian(machine: Machine, tmp_path: Path) -> Path:
    """The root file system of a Debian with the vendor's habits: a known password, and SSH that takes it."""
    folder = tmp_path / "debian"
    folder.mkdir()
    tar = Path(os.environ.get("ATLANTIS_TEST_ROOTFS") or folder / "rootfs.tar")
    if not tar.exists():
        hook = f'echo root:{PASSWORD} | chroot "$1" chpasswd; : > "$1/etc/resolv.conf"; rm -f "$1/etc/hostname"'
        options = ["--variant=minbase", f"--include={PACKAGES},{machine.kernel}", f"--customize-hook={hook}"]
        # Whether this computer runs programs of arm64 is seen when they are run: `arch-test` is a package more.
        options += [f"--architectures={machine.architecture}", "--skip=check/qemu"]
        run("mmdebstrap", *options, "bookworm", str(tar))
    root = folder / "root"
    root.mkdir()
    run("tar", "-C", str(root), "-xf", str(tar))
    (root / "etc" / "ssh" / "sshd_config.d" / "50-vendor.conf").write_text(
        "PermitRootLogin yes\nPasswordAuthentication yes\n"
    )
    units = root / "etc" / "systemd" / "system"
    (units / "ready.service").write_text(READY)
    (units / "multi-user.target.wants" / "ready.service").symlink_to("/etc/systemd/system/ready.service")
    (root / "etc" / "fstab").write_text("/dev/vda2 / ext4 rw 0 1\n")
    return root


@dataclass
class Guest:
    """A booted machine; `console` is what it has said since its start."""

    port: int
    console: str

    def login(self, *, pkey: paramiko.PKey | None = None, password: str | None = None) -> paramiko.SSHClient:
        client = paramiko.SSHClient()
        client.set_missing_host_key_policy(paramiko.AutoAddPolicy())  # noqa: S507 - the guest has just made it
        client.connect(
            "127.0.0.1",
            self.port,
            "root",
            password,
            pkey,
            look_for_keys=False,
            allow_agent=False,
            timeout=HANG_S,
            banner_timeout=HANG_S,
        )
        return client


@contextmanager
def booted(machine: Machine, device: Path, root: Path, port: int) -> Iterator[Guest]:
    """Start qemu on a device, in the declared LAN, and wait until it says that SSH was started."""
    kernel, initrd = (next((root / "boot").glob(name)) for name in ("vmlinuz-*", "initrd.img-*"))
    lan = "user,id=n0,restrict=on,net=10.64.1.0/24,host=10.64.1.1,dhcpstart=10.64.1.50"
    lan += f",hostfwd=tcp:127.0.0.1:{port}-10.64.1.10:22"
    command = [*machine.qemu, "-accel", "tcg", "-m", "512", "-smp", "1", "-nographic", "-no-reboot"]
    command += ["-kernel", str(kernel), "-initrd", str(initrd), "-netdev", lan, "-device", "virtio-net-pci,netdev=n0"]
    command += ["-append", f"root=/dev/vda2 rw console={machine.console} net.ifnames=0 systemd.show_status=1"]
    command += ["-drive", f"file={device},if=virtio,format=raw"]
    with subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        encoding="utf-8",
        errors="replace",
    ) as qemu:
        try:
            said = ""
            assert qemu.stdout is not None
            for line in qemu.stdout:
                said += line
                if "THE-GUEST-IS-READY" in line:
                    break
            assert "THE-GUEST-IS-READY" in said, said[-3000:]
            yield Guest(port, said)
        finally:
            qemu.kill()


def test_card_boots_with_declared_name_and_keys_and_without_password(
    machine: Machine, debian: Path, tmp_path: Path
) -> None:
    key = paramiko.ECDSAKey.generate()
    public = f"{key.get_name()} {key.get_base64()} technician"
    vendors = disk(tmp_path / "vendor.img", debian, machine.root_mib)
    assert b"root:$" in (Ext4(vendors, ROOT_AT).read("/etc/shadow") or b"")
    wish = ImageRequest(
        host="coastal-gateway",
        site="coastal",
        user="root",
        keys=(public,),
        static=StaticNetwork(IPv4Interface("10.64.1.10/24"), IPv4Address("10.64.1.1"), "coastal.example.org"),
        interface="eth0",
        time_zone="Europe/Lisbon",
        time_servers=(IPv4Address("192.0.2.123"),),
        source="vendor.img",
    )
    expanded = expand(vendors, tmp_path / "copy", None, lambda _done, _total: None)
    vendors.unlink()
    assert customise(expanded.path, LAYOUTS["odroid-n2"], wish) == ()
    with loop(tmp_path / "behind", CARD) as behind:
        tree = Tree(tmp_path / "tree")
        tree.disk(behind.number, size=CARD).serial("S1")
        card = Card(behind.device, require_writable_disk(tree.blocks, behind.device), tree.blocks)
        written = write(expanded.path, segments(expanded.path, expanded.size), card, lambda _progress: None)
        assert written.compared == expanded.size
        with held_port() as port, booted(machine, behind.device, debian, port) as guest:
            _look(guest, key)


def _look(guest: Guest, key: paramiko.PKey) -> None:
    with guest.login(pkey=key) as client:
        answers = {}
        for asked in (
            "hostname",
            "readlink /etc/localtime",
            "test -s /etc/machine-id && echo own",
            "ls /var/lib/atlantis",
            "systemctl is-enabled atlantis-first-boot",
            "ip -4 -o address show eth0 | grep -o 10.64.1.10/24",
            "ls /etc/ssh/ssh_host_*_key.pub | wc -l",
        ):
            _, out, _ = client.exec_command(asked)
            answers[asked.split()[0] + asked[-4:]] = out.read().decode().strip()
    assert list(answers.values()) == [
        *("coastal-gateway", "/usr/share/zoneinfo/Europe/Lisbon", "own", "first-boot-done", "enabled"),
        *("10.64.1.10/24", "3"),
    ]
    with pytest.raises(paramiko.AuthenticationException):
        guest.login(password=PASSWORD)


def test_required_programs_are_installed(machine: Machine) -> None:
    assert all(shutil.which(name) for name in ("mmdebstrap", machine.qemu[0]))
