"""Which files of this computer configure an interface, besides ours: two configurations of one interface fight."""

# ruff: noqa: PTH103, PTH110, PTH113, PTH118, PTH119, PTH120, PTH123, PTH207
# Paths are those of a computer, below a root: what is joined to it is a string.

from __future__ import annotations

import fnmatch
import glob
import os
import re
import tempfile
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from typing import Iterator

    from .network_files import Computer

__all__ = ["INTERFACES", "claims", "matched", "merged", "plans", "stanzas"]

_PLANS = ("/lib/netplan", "/etc/netplan", "/run/netplan")
"""netplan-generate(8): a file hides one of the same name in a folder further left; all are read, sorted by name."""
_PARTS = ("/etc/systemd/network", "/run/systemd/network", "/usr/lib/systemd/network", "/lib/systemd/network")
"""systemd.network(5): the first file by name that matches is used, and no other."""
_NETPLAN = "/usr/sbin/netplan"
INTERFACES = "/etc/network/interfaces"
_PROFILES = "/etc/NetworkManager/system-connections"


def claims(computer: Computer, interface: str, local: str, gone: frozenset[str]) -> list[str]:
    """Files that configure `interface`, but `own` and those that the change takes away."""
    spared = gone | {local}
    found = [
        *_of_netplan(computer, interface, spared),
        *_of_ifupdown(computer, interface, spared),
        *_of_networkd(computer, interface, local, spared),
        *_of_network_manager(computer, interface, spared),
    ]
    return sorted(set(found))


def plans(computer: Computer) -> list[str]:
    """The files that netplan reads."""
    found: dict[str, str] = {}
    for folder in _PLANS:
        found.update((os.path.basename(path), path) for path in _glob(computer, f"{folder}/*.yaml"))
    return [found[name] for name in sorted(found)]


def merged(computer: Computer, texts: dict[str, str]) -> tuple[str, list[str]]:
    """What netplan says to files of these names and texts, empty if it takes them, and what it makes of them."""
    with tempfile.TemporaryDirectory(prefix="atlantis-netplan-") as root:
        os.makedirs(f"{root}/etc/netplan")
        for name, text in texts.items():
            with open(f"{root}/etc/netplan/{name}", "w", encoding="utf-8", opener=_closed) as file:
                file.write(text)
        done = computer.run(("netplan", "generate", "--root-dir", root))
        made = []
        for path in sorted(glob.glob(f"{root}/run/systemd/network/*.network")):
            with open(path, encoding="utf-8") as file:
                made.append(file.read())
        message = done.said.replace(f"{root}/", "/") or f"netplan ended with {done.code}"
        return (message if done.code else ""), made


def matched(computer: Computer, text: str, interface: str) -> bool:
    """Whether the section [Match] of a .network file takes the interface; what it cannot tell, it takes for yes."""
    section = re.search(r"^\[Match\]\s*$(.*?)(?=^\[|\Z)", text, re.MULTILINE | re.DOTALL)
    rows = re.findall(r"^\s*(\w+)\s*=\s*(.*?)\s*$", section.group(1), re.MULTILINE) if section else []
    mac = (computer.read(f"/sys/class/net/{interface}/address") or "").strip().lower()
    for key, value in rows:
        if key == "Name" and not _among(interface, value.split()):
            return False
        if key in ("MACAddress", "PermanentMACAddress") and mac not in value.lower().replace("-", ":").split():
            return False
    return bool(rows)


def _among(name: str, patterns: list[str]) -> bool:
    if patterns and patterns[0].startswith("!"):
        return not any(fnmatch.fnmatchcase(name, pattern.lstrip("!")) for pattern in patterns)
    return any(fnmatch.fnmatchcase(name, pattern) for pattern in patterns)


def _closed(path: str, flags: int) -> int:
    return os.open(path, flags, 0o600)  # netplan complains of files that others can read


def _of_netplan(computer: Computer, interface: str, spared: frozenset[str]) -> Iterator[str]:
    """Each file by itself: netplan is asked what it makes of it. One that it refuses is judged by the name in it."""
    if not os.path.exists(computer.at(_NETPLAN)):
        return
    for path in plans(computer):
        text = computer.read(path) or ""
        if path in spared:
            continue
        message, made = merged(computer, {os.path.basename(path): text})
        named = re.search(rf"(?<![\w-]){re.escape(interface)}(?![\w-])", text) is not None
        if any(matched(computer, item, interface) for item in made) or (named and (message or not made)):
            yield path


def stanzas(computer: Computer) -> list[tuple[str, str]]:
    """File and name, a pattern perhaps, of every interface that ifupdown would configure."""
    row = r"^[ \t]*(?:iface[ \t]+(\S+)|(?:auto|allow-\S+)[ \t]+(.*))"
    return [
        (path, name)
        for path in _sourced(computer, INTERFACES)
        for iface, names in re.findall(row, computer.read(path) or "", re.MULTILINE)
        for name in [*iface.split(), *names.split()]
    ]


def _of_ifupdown(computer: Computer, interface: str, spared: frozenset[str]) -> Iterator[str]:
    return (path for path, name in stanzas(computer) if path not in spared and _among(interface, [name]))


def _sourced(computer: Computer, path: str) -> Iterator[str]:
    """A file of interfaces(5) and those that it names."""
    text = computer.read(path)
    if text is None:
        return
    yield path
    for word, pattern in re.findall(r"^[ \t]*(source|source-directory)[ \t]+(\S+)", text, re.MULTILINE):
        full = os.path.join(os.path.dirname(path), pattern)
        for item in _glob(computer, full if word == "source" else f"{full}/*"):
            if word == "source" or re.fullmatch(r"[A-Za-z0-9_-]+", os.path.basename(item)):
                yield from _sourced(computer, item)


def _of_networkd(computer: Computer, interface: str, local: str, spared: frozenset[str]) -> Iterator[str]:
    """Where networkd works: what a person has written, and of the vendor's what comes before ours."""
    works = computer.run(("systemctl", "is-enabled", "systemd-networkd.service")).said.split("\n")[0]
    if not works.startswith("enabled") and not local.startswith(_PARTS[0]):
        return
    seen = set()
    for folder in _PARTS:
        for path in _glob(computer, f"{folder}/*.network"):
            name = os.path.basename(path)
            vendors = folder not in _PARTS[:2]
            if name in seen or path in spared or (folder == _PARTS[1] and "netplan" in name):
                continue
            seen.add(name)
            if vendors and name > os.path.basename(local):
                continue
            if matched(computer, computer.read(path) or "", interface):
                yield path


def _of_network_manager(computer: Computer, interface: str, spared: frozenset[str]) -> Iterator[str]:
    for path in _glob(computer, f"{_PROFILES}/*.nmconnection"):
        row = rf"^interface-name={re.escape(interface)}\s*$"
        if path not in spared and re.search(row, computer.read(path) or "", re.MULTILINE):
            yield path


def _glob(computer: Computer, pattern: str) -> list[str]:
    return [path[len(computer.root) :] for path in sorted(glob.glob(computer.at(pattern))) if os.path.isfile(path)]
