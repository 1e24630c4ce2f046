"""Customise a working copy: read the image, plan the edits, apply them, check.

The plan is a pure function. mtools reads and edits the FAT file system at its offset: no mount, no root.
"""

from __future__ import annotations

import json
import re
import subprocess
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.computers.image import ext4
from atlantis_netcfg.computers.image.facts import (
    Account,
    ImageDirectory,
    ImageError,
    ImageFacts,
    ImageFile,
    ImageLink,
    ImageRequest,
    Remove,
)
from atlantis_netcfg.core import temporary
from atlantis_netcfg.core.messages import arg, join, msg

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from atlantis_netcfg.computers.image.facts import Edit, StaticNetwork


PASSWD, SHADOW = "/etc/passwd", "/etc/shadow"
SSHD, SSHD_PARTS = "/etc/ssh/sshd_config", "/etc/ssh/sshd_config.d"
_OURS = f"{SSHD_PARTS}/00-atlantis.conf"
_INCLUDE = f"Include {SSHD_PARTS}/*.conf"
_SSHD_TEXT = """\
# Keys only: written by `provision gateway image`. The first value of an option counts (sshd_config(5)).
PasswordAuthentication no
KbdInteractiveAuthentication no
ChallengeResponseAuthentication no
PermitEmptyPasswords no
PermitRootLogin prohibit-password
PubkeyAuthentication yes
"""


def accounts(facts: ImageFacts, request: ImageRequest) -> Iterator[Edit]:
    """Yield edits for the technicians' keys, removed passwords and key-only SSH. Raises ImageError."""
    account = _account(facts.text(PASSWD), request.user)
    folder = f"{account.home.rstrip('/')}/.ssh"
    yield ImageDirectory(folder, 0o700, account.owner)
    keys = "".join(f"{key}\n" for key in request.keys)
    yield ImageFile(f"{folder}/authorized_keys", keys.encode(), 0o600, account.owner)
    yield from passwords(facts)
    if SSHD not in facts.files:
        raise ImageError(f"the image has no {arg(SSHD)}: nobody could log in", hint="use an image with an SSH server")
    if SSHD_PARTS not in facts.present:
        yield ImageDirectory(SSHD_PARTS)
    yield ImageFile(_OURS, _SSHD_TEXT.encode())
    text = facts.text(SSHD)
    first = next((line.split() for line in text.splitlines() if line.split() and not line.lstrip().startswith("#")), [])
    if first != _INCLUDE.split():
        yield ImageFile(SSHD, msg(f"{arg(_INCLUDE)}\n{arg(text)}").encode())


def _account(passwd: str, name: str) -> Account:
    rows = {row[0]: row for row in (line.split(":") for line in passwd.splitlines()) if len(row) == 7}  # noqa: PLR2004
    row = rows.get(name)
    if row is None:
        people = join(", ", (item for item, row in rows.items() if row[6].endswith("sh"))) or "none"
        raise ImageError(f"the image has no account `{arg(name)}`", hint=f"set `user`: the image has {arg(people)}")
    if row[6].endswith(("nologin", "false")):
        raise ImageError(f"account `{arg(name)}` of the image cannot log in: its shell is {arg(row[6])}")
    return Account(name, (int(row[2]), int(row[3])), row[5] or "/", row[6])


def open_accounts(shadow: str) -> tuple[str, ...]:
    """Return the accounts that open with a password, or with none."""
    rows = (line.split(":") for line in shadow.splitlines())
    return tuple(row[0] for row in rows if len(row) > 1 and not row[1].startswith(("!", "*")))


def passwords(facts: ImageFacts) -> Iterator[Edit]:
    """Yield edits that remove all passwords; with `!` sshd without PAM sees a locked account, so `*` is used.

    The password age is removed as well: a password that must be changed at the first login would block the key.
    """
    shadow, passwd = facts.text(SHADOW), facts.text(PASSWD)
    rows = [line.split(":") for line in shadow.splitlines()]
    open_ones = set(open_accounts(shadow))
    for row in rows:
        if row[0] in open_ones:
            row[1] = "*"
        if len(row) > 2 and row[2] == "0":  # noqa: PLR2004 - the day of the last change: 0 forces one (shadow(5))
            row[2] = ""
    text = "".join(f"{':'.join(row)}\n" for row in rows)
    if SHADOW not in facts.files:
        raise ImageError(f"the image has no {arg(SHADOW)}: its passwords cannot be removed")
    if text != shadow:
        yield ImageFile(SHADOW, text.encode(), 0o640, (0, _group(facts, "shadow")))
    people = [line.split(":") for line in passwd.splitlines()]
    for row in people:
        if len(row) > 1 and row[1] != "x":
            row[1] = "x"  # a password, or none, in the file that everybody reads
    message = "".join(f"{':'.join(row)}\n" for row in people)
    if message != passwd:
        yield ImageFile(PASSWD, message.encode())


def _group(facts: ImageFacts, name: str) -> int:
    rows = (line.split(":") for line in facts.text("/etc/group").splitlines())
    return next((int(row[2]) for row in rows if row[0] == name and len(row) > 2), 0)  # noqa: PLR2004


NETPLAN, IFUPDOWN = "/usr/sbin/netplan", "/usr/sbin/ifup"
_IFUPDOWN_OLD = "/sbin/ifup"
NETWORK_MANAGER = "/usr/sbin/NetworkManager"
NETWORKD, SYSTEMD_RESOLVED = "/lib/systemd/systemd-networkd", "/lib/systemd/systemd-resolved"
_PLANS, _PROFILES = "/etc/netplan", "/etc/NetworkManager/system-connections"
_PLAN = "10-atlantis.yaml"
_PARTS = "/etc/systemd/network"
_UNITS_OF_BOOT = "/etc/systemd/system/multi-user.target.wants"
_RESOLV = "/etc/resolv.conf"
PATHS = (
    NETPLAN,
    IFUPDOWN,
    _IFUPDOWN_OLD,
    NETWORK_MANAGER,
    NETWORKD,
    SYSTEMD_RESOLVED,
    _PLANS,
    _PROFILES,
    _PARTS,
    _UNITS_OF_BOOT,
    _RESOLV,
)
"""Paths whose existence the planner must know."""
_HEADER = "# Written by `provision gateway image`."


def network(facts: ImageFacts, request: ImageRequest) -> Iterator[Edit]:
    """Yield edits for one wired interface, fixed address or DHCP. Raises ImageError if nothing configures it."""
    if NETPLAN in facts.present:
        others = (name for name in facts.names_by_folder.get(_PLANS, ()) if name.endswith(".yaml") and name != _PLAN)
        yield from (Remove(f"{_PLANS}/{name}") for name in others)
        yield from _folder(facts, _PLANS)
        yield ImageFile(f"{_PLANS}/{_PLAN}", _netplan(request).encode(), 0o600)
    elif {IFUPDOWN, _IFUPDOWN_OLD} & facts.present:
        if not request.interface:
            raise ImageError(
                "the image configures its network by ifupdown, which needs the interface's name",
                hint="set `interface` of the host's image, for example eth0",
            )
        yield ImageFile("/etc/network/interfaces", _interfaces(request).encode())
    elif NETWORK_MANAGER in facts.present:
        yield from _folder(facts, _PROFILES)
        yield ImageFile(f"{_PROFILES}/atlantis.nmconnection", _profile(request).encode(), 0o600)
    elif NETWORKD in facts.present:
        yield from _folder(facts, _PARTS)
        yield from _folder(facts, _UNITS_OF_BOOT)
        yield ImageFile(f"{_PARTS}/05-atlantis.network", _networkd(request).encode())
        yield ImageLink(
            f"{_UNITS_OF_BOOT}/systemd-networkd.service",
            f"{NETWORKD.rpartition('/')[0]}/system/systemd-networkd.service",
        )
    else:
        raise ImageError(
            "nothing in the image would set its address: no netplan, ifupdown, NetworkManager or systemd-networkd"
        )
    if request.static is not None and SYSTEMD_RESOLVED not in facts.present and NETWORK_MANAGER not in facts.present:
        yield ImageFile(
            _RESOLV, f"{_HEADER}\nsearch {request.static.domain}\nnameserver {request.static.gateway}\n".encode()
        )


def _folder(facts: ImageFacts, path: str) -> Iterator[Edit]:
    if path not in facts.present:
        yield ImageDirectory(path)


def _netplan(request: ImageRequest) -> str:
    rows = [
        _HEADER,
        "network:",
        "  version: 2",
        "  ethernets:",
        "    lan:",
        f"      match: {{name: {_match(request)}}}",
        "      accept-ra: false",
    ]
    if request.static is None:
        rows.append("      dhcp4: true")
    else:
        rows += [
            "      dhcp4: false",
            f"      addresses: [{request.static.address}]",
            f"      routes: [{{to: 0.0.0.0/0, via: {request.static.gateway}}}]",
            f"      nameservers: {{addresses: [{request.static.gateway}], search: [{request.static.domain}]}}",
        ]
    return "".join(f"{row}\n" for row in rows)


def _match(request: ImageRequest) -> str:
    return request.interface or '"e*"'


_NO_ADVERTISEMENTS = "    pre-up sysctl -qew net/ipv6/conf/$IFACE/accept_ra=0 || true\n"
"""Ignores routes from router advertisements; ifupdown has an option for that only where IPv6 is configured."""


def _interfaces(request: ImageRequest) -> str:
    name = request.interface
    start = f"{_HEADER}\nauto lo\niface lo inet loopback\n\nallow-hotplug {name}\n"
    if request.static is None:
        return f"{start}iface {name} inet dhcp\n{_NO_ADVERTISEMENTS}"
    return (
        f"{start}iface {name} inet static\n"
        f"    address {request.static.address}\n    gateway {request.static.gateway}\n"
        f"    dns-nameservers {request.static.gateway}\n    dns-search {request.static.domain}\n"
        f"{_NO_ADVERTISEMENTS}"
    )


def _profile(request: ImageRequest) -> str:
    name = f"interface-name={request.interface}\n" if request.interface else ""
    head = f"{_HEADER}\n[connection]\nid=atlantis\ntype=ethernet\nautoconnect-priority=100\n"
    return f"{head}{name}\n{_ipv4(request.static)}\n[ipv6]\nmethod=link-local\n"


def _ipv4(static: StaticNetwork | None) -> str:
    if static is None:
        return "[ipv4]\nmethod=auto\n"
    return (
        f"[ipv4]\nmethod=manual\naddress1={static.address},{static.gateway}\n"
        f"dns={static.gateway};\ndns-search={static.domain};\n"
    )


def _networkd(request: ImageRequest) -> str:
    start = f"{_HEADER}\n[Match]\nName={request.interface or 'e*'}\n\n[Network]\n"
    start += "IPv6AcceptRA=no\nLLMNR=no\nMulticastDNS=no\n"
    if request.static is None:
        return f"{start}DHCP=ipv4\n"
    address, gateway, domain = request.static.address, request.static.gateway, request.static.domain
    return f"{start}Address={address}\nGateway={gateway}\nDNS={gateway}\nDomains={domain}\n"


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
"""Paths by which cloud-init is detected."""
_CLOUD_ON = f"{_CLOUD}/cloud-init.enabled"

READ = (PASSWD, SHADOW, "/etc/group", _HOSTS, SSHD)
"""The files whose texts the planner needs."""
LISTED_FOLDERS = (_SSH, "/etc/netplan")
"""Directories whose names of files the planner needs."""
BOOT_WORDS = ("/etc/default/grub", "/boot/grub/grub.cfg", "/boot/extlinux/extlinux.conf", "/boot/cmdline.txt")
"""Files that may contain the kernel command line; those on the FAT partition are read in addition."""


def paths_to_check(request: ImageRequest) -> tuple[str, ...]:
    """Return the paths whose existence the planner must know."""
    zone = f"{_ZONES}/{request.time_zone}"
    return (
        *PATHS,
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


def plan(facts: ImageFacts, request: ImageRequest) -> tuple[Edit, ...]:
    """Return the edits in order of execution. Raises ImageError if the image cannot be used."""
    edits = [
        *(ImageDirectory(path) for path in _FOLDERS if path not in facts.present),
        *_identity(facts, request),
        *accounts(facts, request),
        *network(facts, request),
        *_time(facts, request),
        *_first_boot(request),
        *_no_cloud_init(facts),
    ]
    return tuple(dict.fromkeys(edits))


def notes(facts: ImageFacts, request: ImageRequest) -> tuple[str, ...]:
    """Return hints that do not prevent using the image."""
    result = []
    if f"{_ZONES}/{request.time_zone}" not in facts.present:
        result.append(
            msg(
                "the image has no time zone data: its clock shows UTC until tzdata is installed "
                f"({arg(request.time_zone)})"
            )
        )
    if _has_cloud_init(facts):
        result.append(
            "cloud-init of the image is disabled, including its first-start tasks, such as growing the file system"
        )
    return tuple(result)


def _identity(facts: ImageFacts, request: ImageRequest) -> Iterator[Edit]:
    """Yield edits for the host name, and remove identities shared by other cards of this image (machine-id(5))."""
    yield ImageFile("/etc/hostname", f"{request.host}\n".encode())
    host_lines = [line for line in facts.text(_HOSTS).splitlines() if line.split()[:1] != ["127.0.1.1"]]
    if not any(line.split()[:1] == ["127.0.0.1"] for line in host_lines):
        host_lines.insert(0, "127.0.0.1\tlocalhost")
    yield ImageFile(_HOSTS, "".join(f"{line}\n" for line in [*host_lines, f"127.0.1.1\t{request.host}"]).encode())
    yield ImageFile(_MACHINE_ID, b"", 0o444)
    for path in (_DBUS_ID, _SEED):
        if path in facts.present:
            yield Remove(path)
    yield from (
        Remove(f"{_SSH}/{name}") for name in facts.names_by_folder.get(_SSH, ()) if name.startswith("ssh_host_")
    )


def _time(facts: ImageFacts, request: ImageRequest) -> Iterator[Edit]:
    """Yield edits for time zone and time servers; by address, because names do not resolve while the clock is wrong."""
    yield ImageLink("/etc/localtime", f"{_ZONES}/{request.time_zone}")
    yield ImageFile("/etc/timezone", f"{request.time_zone}\n".encode())
    servers = " ".join(map(str, request.time_servers))
    yield ImageFile(
        f"{_TIMESYNC}/atlantis.conf", f"# Written by `provision gateway image`.\n[Time]\nNTP={servers}\n".encode()
    )
    if _CHRONY in facts.present:
        lines = "".join(f"server {server} iburst\n" for server in request.time_servers)
        yield ImageFile(f"{_CHRONY}/atlantis.sources", lines.encode())


def _has_cloud_init(facts: ImageFacts) -> bool:
    return any(path in facts.present for path in _CLOUD_INIT)


def _no_cloud_init(facts: ImageFacts) -> Iterator[Edit]:
    """Disable cloud-init, which would set its own address, accounts, host keys and host name.

    A file disables it. Another file, and the kernel's command line, have precedence (its generator for systemd).
    """
    if not _has_cloud_init(facts):
        return
    for place, text in facts.boot_words.items():
        if re.search(r"^[^#\n]*\bcloud-init=enabled\b", text, re.MULTILINE):
            raise ImageError(
                f"{arg(place)} of the image enables cloud-init (`cloud-init=enabled`): address, accounts and host name "
                "would be overwritten at the first start",
                hint="use an image from the vendor without it",
            )
    if _CLOUD not in facts.present:
        yield ImageDirectory(_CLOUD)
    if _CLOUD_ON in facts.present:
        yield Remove(_CLOUD_ON)
    yield ImageFile(f"{_CLOUD}/cloud-init.disabled", b"Written by `provision gateway image`.\n")


_SCRIPT = """\
#!/bin/sh
# The first start of this card: what must not be the same on two cards. Written by `provision gateway image`.
set -eu
ssh-keygen -A
[ -s /etc/machine-id ] || systemd-machine-id-setup
mkdir -p /var/lib/atlantis
uname -a >/var/lib/atlantis/first-boot-done
"""
_UNIT = """\
# Written by `provision gateway image`.
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


def _first_boot(request: ImageRequest) -> Iterator[Edit]:
    yield ImageFile("/usr/local/sbin/atlantis-first-boot", _SCRIPT.encode(), 0o755)
    yield ImageFile(f"{_UNITS}/atlantis-first-boot.service", _UNIT.encode())
    yield ImageLink(f"{_WANTS}/atlantis-first-boot.service", f"{_UNITS}/atlantis-first-boot.service")
    record = {"host": request.host, "site": request.site, "image": request.source}
    yield ImageFile("/etc/atlantis/image.json", f"{json.dumps(record, indent=1)}\n".encode())


@dataclass(frozen=True, slots=True)
class Fat:
    """One FAT file system; file names are 8.3 names in its root folder."""

    image: Path
    offset: int

    def read(self, name: str) -> bytes | None:
        """Return a file's bytes, or None if it does not exist."""
        process = self._run("mcopy", "-n", f"::{name}", "-")
        return process.stdout if process.returncode == 0 else None

    def write(self, name: str, content: bytes) -> None:
        """Replace a file and read it back. Raises ImageError."""
        with temporary.folder("fat") as scratch:
            file = scratch / name
            file.write_bytes(content)
            process = self._run("mcopy", "-o", str(file), f"::{name}")
        if process.returncode or self.read(name) != content:
            why = process.stderr.decode(errors="replace").strip() or "the data read back differs"
            raise ImageError(f"{arg(name)} could not be written to the image's FAT partition: {arg(why)}")

    def _run(self, program: str, *arguments: str) -> subprocess.CompletedProcess[bytes]:
        return subprocess.run(  # noqa: S603 - a program of the system, and arguments that are ours
            [ext4.tool(program), "-i", f"{self.image}@@{self.offset}", *arguments],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            check=False,
            env={"LC_ALL": "C", "MTOOLS_SKIP_CHECK": "1", "MTOOLSRC": "/dev/null"},
        )


NOTE = "ATLANTIS.TXT"
"""Note on the FAT partition for a person who opens the card on a laptop."""
_BOOT_FILES = ("cmdline.txt", "boot.ini")
"""Files on the FAT partition with the kernel command line, for Raspberry Pi and ODROID boards."""


def read_facts(root: ext4.Ext4, request: ImageRequest, boot: Fat | None = None) -> ImageFacts:
    """Read the facts that the planner needs. Raises ImageError if a link replaces an expected file."""
    root.require_no_symlink((*READ, *LISTED_FOLDERS))
    files = {path: data.decode(errors="surrogateescape") for path in READ if (data := root.read(path)) is not None}
    present = frozenset(path for path in paths_to_check(request) if root.exists(path))
    words = {path: root.read(path) for path in BOOT_WORDS}
    if boot is not None:
        words |= {msg(f"{arg(name)} on the FAT partition"): boot.read(name) for name in _BOOT_FILES}
    values = {place: data.decode(errors="replace") for place, data in words.items() if data is not None}
    return ImageFacts(files, present, {path: root.names(path) for path in LISTED_FOLDERS}, values)


def customise(image: Path, layout: ext4.DiskLayout, request: ImageRequest) -> tuple[str, ...]:
    """Edit the working copy; return hints for a person. Raises ImageError. Can be repeated."""
    places = ext4.find(image, layout)
    boot = None if places.boot is None else Fat(image, places.boot.offset)
    root = ext4.Ext4(image, places.root)
    root.recover()
    root.require_editable()
    facts = read_facts(root, request, boot)
    root.apply(plan(facts, request))
    if boot is not None:
        text = f"This card was made for {request.host} of site {request.site}\r\nfrom {request.source}\r\n"
        boot.write(NOTE, text.encode())
    return notes(facts, request)
