"""Small real images: partition table, FAT and ext4, with the ODROID N2's layout, made without root."""

import subprocess
from pathlib import Path

BOOT_AT, ROOT_AT = 2048 * 512, 264192 * 512
KEY = "ssh-ed25519 AAAAC3NzaC1lZDI1NTE5AAAAIOzMkrV3HHY+skvjB+3Dgsy6+gi2Qp9FkJyNvsHCouP1 EXAMPLE-technician"
SHADOW = (
    "root:$6$salt$hash:0:0:99999:7:::\ndaemon:*:19000:0:99999:7:::\nodroid:$6$s$h:19000:0:99999:7:::\nguest::1::::::\n"
)
ROOT = {
    "etc/passwd": "root:x:0:0:root:/root:/bin/bash\ndaemon:x:1:1::/:/usr/sbin/nologin\n"
    "odroid:x:1000:1000::/home/odroid:/bin/sh\nguest::1001:1001::/home/guest:/bin/sh\n",
    "etc/shadow": SHADOW,
    "etc/group": "root:x:0:\nshadow:x:42:\n",
    "etc/hosts": "127.0.0.1\tlocalhost\n127.0.1.1\todroid\n",
    "etc/hostname": "odroid\n",
    "etc/machine-id": "0123456789abcdef0123456789abcdef\n",
    "etc/ssh/sshd_config": "PermitRootLogin yes\nPasswordAuthentication yes\n",
    "etc/ssh/ssh_host_ed25519_key": "the vendor's\n",
    "etc/netplan/01-netcfg.yaml": "network: {version: 2}\n",
    "usr/sbin/netplan": "#!/bin/sh\n",
    "usr/share/zoneinfo/Europe/Lisbon": "TZif2",
    "var/lib/systemd/random-seed": "seed",
}


def run(*command: str) -> None:
    subprocess.run(command, check=True, capture_output=True)


def tree(folder: Path, files: dict[str, str] | None = None) -> Path:
    """A root file system as far as customising looks at it."""
    for name, text in (ROOT if files is None else files).items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    (folder / "root").mkdir(parents=True, exist_ok=True)
    (folder / "usr" / "local" / "sbin").mkdir(parents=True, exist_ok=True)
    return folder


def disk(image: Path, root: Path, root_mib: int = 24, features: str = "") -> Path:
    """MBR with a boot code gap, FAT16, and ext4 with the files of `root`, owned by root."""
    size = ROOT_AT + root_mib * 2**20
    with image.open("wb") as file:
        file.truncate(size)
        file.seek(512)
        file.write(b"U-BOOT" * 5000)  # the gap that the N2 boots from
    table = "label: dos\n2048,262144,c,*\n264192,,83\n"
    subprocess.run(["sfdisk", "-q", str(image)], input=table, text=True, check=True, capture_output=True)
    run("mkfs.vfat", "-F", "16", "-n", "BOOT", "--offset", "2048", str(image), "131072")
    options = f"offset={ROOT_AT},root_owner=0:0"
    more = ("-O", features) if features else ()
    run("mke2fs", "-q", "-t", "ext4", *more, "-E", options, "-d", str(root), str(image), f"{root_mib * 1024}k")
    note = image.with_suffix(".boot-ini")
    note.write_text("ODROIDN2-UBOOT-CONFIG\n")
    run("mcopy", "-i", f"{image}@@{BOOT_AT}", str(note), "::boot.ini")
    return image
