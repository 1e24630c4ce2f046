"""From what a host shall be and what its image holds to the edits: a pure function, no file is touched."""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING

from atlantis_netcfg.image import _network
from atlantis_netcfg.image._accounts import PASSWD, SHADOW, SSHD, SSHD_PARTS, accounts
from atlantis_netcfg.image._errors import ImageRefused
from atlantis_netcfg.image.edits import Directory, File, Link, Remove

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.image.edits import Edit
    from atlantis_netcfg.image.wish import Seen, Wish

__all__ = ["BOOT_WORDS", "LISTED", "READ", "asked", "notes", "plan"]

_HOSTS = "/etc/hosts"
_MACHINE_ID, _DBUS_ID = "/etc/machine-id", "/var/lib/dbus/machine-id"
_SEED = "/var/lib/systemd/random-seed"
_UNITS = "/etc/systemd/system"
_WANTS = f"{_UNITS}/multi-user.target.wants"
_TIMESYNC, _CHRONY = "/etc/systemd/timesyncd.conf.d", "/etc/chrony/sources.d"
_SSH = "/etc/ssh"
_FOLDERS = ("/etc/systemd", "/usr/local", "/usr/local/sbin", "/etc/atlantis", _UNITS, _WANTS, _TIMESYNC)
_ZONES = "/usr/share/zoneinfo"
_CLOUD = "/etc/cloud"
_CLOUD_INIT = (_CLOUD, "/usr/bin/cloud-init")
"""What cloud-init is known by."""
_CLOUD_ON = f"{_CLOUD}/cloud-init.enabled"

READ = (PASSWD, SHADOW, "/etc/group", _HOSTS, SSHD)
"""The files whose texts the planner needs."""
LISTED = (_SSH, "/etc/netplan")
"""The directories whose names it needs."""
BOOT_WORDS = ("/etc/default/grub", "/boot/grub/grub.cfg", "/boot/extlinux/extlinux.conf", "/boot/cmdline.txt")
"""Files that hold the words of the kernel's command line; those of the FAT partition are read besides."""


def asked(request: Wish) -> tuple[str, ...]:
    """The paths of which it needs to know whether they exist."""
    zone = f"{_ZONES}/{request.time_zone}"
    return (
        *_network.PATHS,
        *_FOLDERS,
        SSHD_PARTS,
        _CHRONY,
        _DBUS_ID,
        _SEED,
        *_CLOUD_INIT,
        _CLOUD_ON,
        "/etc/localtime",
        zone,
    )


def plan(seen: Seen, request: Wish) -> tuple[Edit, ...]:
    """The edits, in the order in which they are carried out. Raises ImageRefused where the image cannot serve."""
    found = [
        *(Directory(path) for path in _FOLDERS if path not in seen.present),
        *_identity(seen, request),
        *accounts(seen, request),
        *_network.network(seen, request),
        *_time(seen, request),
        *_first_boot(request),
        *_no_cloud_init(seen),
    ]
    return tuple(dict.fromkeys(found))


def notes(seen: Seen, request: Wish) -> tuple[str, ...]:
    """What a person should know, although it does not stand in the way."""
    result = []
    if f"{_ZONES}/{request.time_zone}" not in seen.present:
        result.append(
            f"the image has no time zone data: its clock shows UTC until tzdata is installed ({request.time_zone})"
        )
    if _cloud_init(seen):
        result.append(
            "cloud-init of the image is switched off, and with it what it does at a first start, such as growing the "
            "file system"
        )
    return tuple(result)


def _identity(seen: Seen, request: Wish) -> Iterator[Edit]:
    """Host name; and no identity that other cards from this image have as well (machine-id(5))."""
    yield File("/etc/hostname", f"{request.host}\n".encode())
    kept = [line for line in seen.text(_HOSTS).splitlines() if line.split()[:1] != ["127.0.1.1"]]
    if not any(line.split()[:1] == ["127.0.0.1"] for line in kept):
        kept.insert(0, "127.0.0.1\tlocalhost")
    yield File(_HOSTS, "".join(f"{line}\n" for line in [*kept, f"127.0.1.1\t{request.host}"]).encode())
    yield File(_MACHINE_ID, b"", 0o444)
    for path in (_DBUS_ID, _SEED):
        if path in seen.present:
            yield Remove(path)
    yield from (Remove(f"{_SSH}/{name}") for name in seen.listed.get(_SSH, ()) if name.startswith("ssh_host_"))


def _time(seen: Seen, request: Wish) -> Iterator[Edit]:
    """Zone and servers; by address, because names do not resolve while the clock is wrong."""
    yield Link("/etc/localtime", f"{_ZONES}/{request.time_zone}")
    yield File("/etc/timezone", f"{request.time_zone}\n".encode())
    servers = " ".join(map(str, request.time_servers))
    yield File(f"{_TIMESYNC}/atlantis.conf", f"# Written by `provision image`.\n[Time]\nNTP={servers}\n".encode())
    if _CHRONY in seen.present:
        lines = "".join(f"server {server} iburst\n" for server in request.time_servers)
        yield File(f"{_CHRONY}/atlantis.sources", lines.encode())


def _cloud_init(seen: Seen) -> bool:
    return any(path in seen.present for path in _CLOUD_INIT)


def _no_cloud_init(seen: Seen) -> Iterator[Edit]:
    """At its first start it would give the computer an address, accounts, host keys and a name of its own.

    A file switches it off. Another file, and the kernel's command line, have precedence (its generator for systemd).
    """
    if not _cloud_init(seen):
        return
    for place, text in seen.boot_words.items():
        if re.search(r"^[^#\n]*\bcloud-init=enabled\b", text, re.MULTILINE):
            raise ImageRefused(
                f"{place} of the image tells the kernel `cloud-init=enabled`: address, accounts and host name would be "
                "written anew at the first start",
                hint="take an image of the vendor without it",
            )
    if _CLOUD not in seen.present:
        yield Directory(_CLOUD)
    if _CLOUD_ON in seen.present:
        yield Remove(_CLOUD_ON)
    yield File(f"{_CLOUD}/cloud-init.disabled", b"Written by `provision image`.\n")


_SCRIPT = """\
#!/bin/sh
# The first start of this card: what must not be the same on two cards. Written by `provision image`.
set -eu
ssh-keygen -A
[ -s /etc/machine-id ] || systemd-machine-id-setup
mkdir -p /var/lib/atlantis
uname -a >/var/lib/atlantis/first-boot-done
"""
_UNIT = """\
# Written by `provision image`.
[Unit]
Description=First start of an ATLANTIS gateway
ConditionPathExists=!/var/lib/atlantis/first-boot-done
After=local-fs.target
Before=ssh.service sshd.service

[Service]
Type=oneshot
RemainAfterExit=yes
ExecStart=/usr/local/sbin/atlantis-first-boot

[Install]
WantedBy=multi-user.target
"""


def _first_boot(request: Wish) -> Iterator[Edit]:
    yield File("/usr/local/sbin/atlantis-first-boot", _SCRIPT.encode(), 0o755)
    yield File(f"{_UNITS}/atlantis-first-boot.service", _UNIT.encode())
    yield Link(f"{_WANTS}/atlantis-first-boot.service", f"{_UNITS}/atlantis-first-boot.service")
    record = {"host": request.host, "site": request.site, "image": request.source}
    yield File("/etc/atlantis/image.json", f"{json.dumps(record, indent=1)}\n".encode())
