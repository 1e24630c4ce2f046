"""Desired configuration of an interface: whether it is in effect, and whether its tool accepts it.

Other files of the computer that configure the same interface are conflicts.
"""

# ruff: noqa: PTH103, PTH110, PTH113, PTH118, PTH119, PTH120, PTH123, PTH207, PTH208
# Paths are text on the gateways' side, where all modules share it.

from __future__ import annotations

import fnmatch
import glob
import ipaddress
import json
import os
import re
import socket
import tempfile
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Iterator, Mapping

from atlantis_netcfg.core.messages import arg, msg

from .errors import ModuleError
from .network_guard import addresses

if TYPE_CHECKING:
    from .network_files import NetworkComputer

_PLANS = ("/lib/netplan", "/etc/netplan", "/run/netplan")
"""Folders of netplan (netplan-generate(8)): a file hides one of the same name in a folder further left."""
_PARTS = ("/etc/systemd/network", "/run/systemd/network", "/usr/lib/systemd/network", "/lib/systemd/network")
"""systemd.network(5): the first file by name that matches is used, and no other."""
_NETPLAN = "/usr/sbin/netplan"
INTERFACES = "/etc/network/interfaces"
_PROFILES = "/etc/NetworkManager/system-connections"


def find_conflicting_files(
    computer: NetworkComputer, interface: str, local: str, removed_paths: frozenset[str]
) -> list[str]:
    """Return files that configure `interface`, except our own and those that the change removes."""
    ignored_paths = removed_paths | {local}
    conflicts = [
        *_of_netplan(computer, interface, ignored_paths),
        *_ifupdown_files(computer, interface, ignored_paths),
        *_of_networkd(computer, interface, local, ignored_paths),
        *_network_manager_files(computer, interface, ignored_paths),
    ]
    return sorted(set(conflicts))


def list_netplan_files(computer: NetworkComputer) -> list[str]:
    """Return the files that netplan reads."""
    path_by_name: dict[str, str] = {}
    for folder in _PLANS:
        path_by_name.update((os.path.basename(path), path) for path in _glob(computer, f"{folder}/*.yaml"))
    return [path_by_name[name] for name in sorted(path_by_name)]


def generate_netplan(computer: NetworkComputer, texts: dict[str, str]) -> tuple[str, list[str]]:
    """Run netplan on files of these names and texts; return its error output (empty if valid) and its result."""
    with tempfile.TemporaryDirectory(prefix="atlantis-netplan-") as root:
        os.makedirs(f"{root}/etc/netplan")
        for name, text in texts.items():
            with open(f"{root}/etc/netplan/{name}", "w", encoding="utf-8", opener=_open_private) as file:
                file.write(text)
        result = computer.run(("netplan", "generate", "--root-dir", root))
        network_texts = []
        for path in sorted(glob.glob(f"{root}/run/systemd/network/*.network")):
            with open(path, encoding="utf-8") as file:
                network_texts.append(file.read())
        message = result.output.replace(f"{root}/", "/") or msg(f"netplan exited with {arg(result.code)}")
        return (message if result.code else ""), network_texts


def matches_interface(computer: NetworkComputer, text: str, interface: str) -> bool:
    """Return whether [Match] of a .network file matches the interface; conditions that cannot be checked match."""
    section = re.search(r"^\[Match\]\s*$(.*?)(?=^\[|\Z)", text, re.MULTILINE | re.DOTALL)
    rows = re.findall(r"^\s*(\w+)\s*=\s*(.*?)\s*$", section.group(1), re.MULTILINE) if section else []
    mac = (computer.read(f"/sys/class/net/{interface}/address") or "").strip().lower()
    for key, value in rows:
        if key == "Name" and not _is_matching_name(interface, value.split()):
            return False
        if key in ("MACAddress", "PermanentMACAddress") and mac not in value.lower().replace("-", ":").split():
            return False
    return bool(rows)


def _is_matching_name(name: str, patterns: list[str]) -> bool:
    if patterns and patterns[0].startswith("!"):
        return not any(fnmatch.fnmatchcase(name, pattern.lstrip("!")) for pattern in patterns)
    return any(fnmatch.fnmatchcase(name, pattern) for pattern in patterns)


def _open_private(path: str, flags: int) -> int:
    return os.open(path, flags, 0o600)  # netplan complains of files that others can read


def _of_netplan(computer: NetworkComputer, interface: str, ignored_paths: frozenset[str]) -> Iterator[str]:
    """Yield netplan files with the interface, each generated alone; a file that netplan rejects is judged by name."""
    if not os.path.exists(computer.at(_NETPLAN)):
        return
    for path in list_netplan_files(computer):
        text = computer.read(path) or ""
        if path in ignored_paths:
            continue
        message, network_texts = generate_netplan(computer, {os.path.basename(path): text})
        is_named = re.search(rf"(?<![\w-]){re.escape(interface)}(?![\w-])", text) is not None
        if any(matches_interface(computer, item, interface) for item in network_texts) or (
            is_named and (message or not network_texts)
        ):
            yield path


def stanzas(computer: NetworkComputer) -> list[tuple[str, str]]:
    """Return file and name (or pattern) of every interface that ifupdown would configure."""
    row = r"^[ \t]*(?:iface[ \t]+(\S+)|(?:auto|allow-\S+)[ \t]+(.*))"
    return [
        (path, name)
        for path in _included_files(computer, INTERFACES)
        for iface, names in re.findall(row, computer.read(path) or "", re.MULTILINE)
        for name in [*iface.split(), *names.split()]
    ]


def _ifupdown_files(computer: NetworkComputer, interface: str, ignored_paths: frozenset[str]) -> Iterator[str]:
    return (
        path for path, name in stanzas(computer) if path not in ignored_paths and _is_matching_name(interface, [name])
    )


def _included_files(computer: NetworkComputer, path: str) -> Iterator[str]:
    """Yield a file of interfaces(5) and those that it includes."""
    text = computer.read(path)
    if text is None:
        return
    yield path
    for word, pattern in re.findall(r"^[ \t]*(source|source-directory)[ \t]+(\S+)", text, re.MULTILINE):
        full = os.path.join(os.path.dirname(path), pattern)
        for item in _glob(computer, full if word == "source" else f"{full}/*"):
            if word == "source" or re.fullmatch(r"[A-Za-z0-9_-]+", os.path.basename(item)):
                yield from _included_files(computer, item)


def _of_networkd(computer: NetworkComputer, interface: str, local: str, ignored_paths: frozenset[str]) -> Iterator[str]:
    """If networkd is enabled, yield the user's files for the interface, and vendor files that precede ours."""
    works = computer.run(("systemctl", "is-enabled", "systemd-networkd.service")).output.split("\n")[0]
    if not works.startswith("enabled") and not local.startswith(_PARTS[0]):
        return
    seen_names = set()
    for folder in _PARTS:
        for path in _glob(computer, f"{folder}/*.network"):
            name = os.path.basename(path)
            vendors = folder not in _PARTS[:2]
            if name in seen_names or path in ignored_paths or (folder == _PARTS[1] and "netplan" in name):
                continue
            seen_names.add(name)
            if vendors and name > os.path.basename(local):
                continue
            if matches_interface(computer, computer.read(path) or "", interface):
                yield path


def _network_manager_files(computer: NetworkComputer, interface: str, ignored_paths: frozenset[str]) -> Iterator[str]:
    for path in _glob(computer, f"{_PROFILES}/*.nmconnection"):
        row = rf"^interface-name={re.escape(interface)}\s*$"
        if path not in ignored_paths and re.search(row, computer.read(path) or "", re.MULTILINE):
            yield path


def _glob(computer: NetworkComputer, pattern: str) -> list[str]:
    return [path[len(computer.root) :] for path in sorted(glob.glob(computer.at(pattern))) if os.path.isfile(path)]


OURS = "# Written by `provision"
"""Start of every file that this toolkit writes, including those of `provision gateway image`."""
_PROGRAMS = {
    "netplan": ("/usr/sbin/netplan", "netplan.io"),
    "ifupdown": ("/sbin/ifup", "ifupdown"),
    "networkd": ("/lib/systemd/systemd-networkd", "systemd"),
}
_RESOLVERS = ("/lib/systemd/systemd-resolved", "/sbin/resolvconf", "/usr/sbin/resolvconf", "/usr/sbin/NetworkManager")
"""Programs that write /etc/resolv.conf themselves."""
_RESOLV = "/etc/resolv.conf"
_DISCARD = 9
"""Port without a listener: the datagram is sent only so that the kernel resolves the address by ARP (RFC 826)."""
_ANSWERS = ("REACHABLE", "STALE", "DELAY", "PROBE")
_PAUSE_S = 0.1


def has_same_settings(item: str | None, other: str | None) -> bool:
    """Return whether two files have the same settings, ignoring comments."""
    return _settings(item) == _settings(other)


def _settings(text: str | None) -> list[str] | None:
    rows = None if text is None else [row.rstrip() for row in text.splitlines()]
    return None if rows is None else [row for row in rows if row and not row.lstrip().startswith(("#", ";"))]


@dataclass(frozen=True)
class DesiredNetwork:
    """Desired configuration of one interface."""

    by: str
    """Tool that configures the network: netplan, ifupdown or networkd."""
    interface: str
    address: str
    """Address with prefix length; with DHCP, the address reserved at the site's router."""
    gateway: str
    path: str
    content: str
    mode: int
    resolver: str | None
    """Text of /etc/resolv.conf if no program on the computer writes that file."""
    replaces: tuple[str, ...]
    rollback_s: int

    @classmethod
    def of(cls, parameters: Mapping[str, Any]) -> DesiredNetwork:
        """Parse a module's parameters. Raises `ModuleError` for an address that its tool would reject or misread."""
        values = {name: parameters[name] for name in cls.__dataclass_fields__}
        values.update(mode=int(parameters["mode"], 8), replaces=tuple(parameters["replaces"]))
        result = cls(**values)
        result._check_addresses()
        return result

    def _check_addresses(self) -> None:
        """Check the addresses: netplan requires a prefix length, ifupdown assumes /8 without one; both fail late."""
        try:
            interface, gateway = ipaddress.IPv4Interface(self.address), ipaddress.IPv4Address(self.gateway)
        except ValueError as error:
            raise ModuleError(
                f"the address of {arg(self.interface)} is not valid: {arg(error)}",
                "an address looks like 10.64.1.10/24",
            ) from None
        if "/" not in self.address:
            raise ModuleError(
                f"the address {arg(self.address)} has no prefix length", f"an address looks like {arg(self.address)}/24"
            )
        if gateway not in interface.network or gateway == interface.ip:
            raise ModuleError(
                f"{arg(self.gateway)} cannot be the gateway of {arg(self.address)}: it is not another address of"
                f" {arg(interface.network)}",
                "check `lan` of the site",
            )

    @property
    def ip(self) -> str:
        """Address without the prefix length."""
        return self.address.partition("/")[0]

    def files(self, computer: NetworkComputer) -> dict[str, str | None]:
        """Return path -> text of every file of the configuration; None: the file must not exist."""
        result: dict[str, str | None] = {path: None for path in self.replaces if path != self.path}
        result[self.path] = self.content
        is_managed = any(os.path.exists(computer.at(path)) for path in _RESOLVERS)
        if self.resolver is not None and not is_managed:
            result[_RESOLV] = self.resolver
        return result

    def list_deviations(self, computer: NetworkComputer) -> list[str]:
        """Return what is not in effect; empty if the interface is in the desired state."""
        current = addresses(computer).get(self.interface, [])
        missing = (
            []
            if self.address in current
            else [msg(f"{arg(self.interface)} does not have the address {arg(self.address)}")]
        )
        reply = computer.run(("ip", "-json", "-4", "route", "show", "default"))
        routes = json.loads(reply.output or "[]") if reply.code == 0 else []
        if not any(route.get("gateway") == self.gateway and route.get("dev") == self.interface for route in routes):
            missing.append(msg(f"there is no default route via {arg(self.gateway)} on {arg(self.interface)}"))
        return missing

    def wait_until_reachable(self, computer: NetworkComputer, patience_s: float) -> list[str]:
        """Return what is not in effect, or that the gateway does not respond; wait until neither or the timeout."""
        end = time.monotonic() + patience_s
        while True:
            missing = self.list_deviations(computer) or self._gateway_problems(computer)
            if not missing or time.monotonic() >= end:
                return missing
            time.sleep(_PAUSE_S)

    def _gateway_problems(self, computer: NetworkComputer) -> list[str]:
        self._trigger_arp()
        text = computer.run(("ip", "-json", "-4", "neighbour", "show", self.gateway, "dev", self.interface)).output
        neighbours = json.loads(text or "[]")
        if any("lladdr" in item and set(item.get("state", ())) & set(_ANSWERS) for item in neighbours):
            return []
        return [msg(f"the gateway address {arg(self.gateway)} does not respond on {arg(self.interface)}")]

    def _trigger_arp(self) -> None:
        """Send a packet so that the kernel resolves the gateway's hardware address into the neighbour table."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            try:
                sock.setsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, self.interface.encode())
                sock.sendto(b"", (self.gateway, _DISCARD))
            except OSError:
                return  # no such interface, or no route: then the table knows nobody either

    def require_applicable(self, computer: NetworkComputer) -> None:
        """Raise `ModuleError` if the change cannot succeed, before anything is touched."""
        program, package = _PROGRAMS[self.by]
        if not os.path.exists(computer.at(program)):
            raise ModuleError(
                f"the inventory configures the network with {arg(self.by)}, which is not installed on this computer",
                f"`apt-get install {arg(package)}` there, or set another `network: {{by: …}}`",
            )
        there = sorted(os.listdir(computer.at("/sys/class/net")))
        if self.interface not in there:
            others = ", ".join(name for name in there if name != "lo") or "none"
            raise ModuleError(
                f"interface {arg(self.interface)} does not exist; existing interfaces: {arg(others)}",
                "correct `network: {interface: …}`",
            )
        complaint = {"netplan": self._by_netplan, "ifupdown": self._check_with_ifupdown, "networkd": self._by_networkd}[
            self.by
        ]
        if text := complaint(computer):
            raise ModuleError(f"{arg(self.by)} rejects the new configuration: {arg(text)}", "nothing was changed")

    def require_no_conflicts(self, computer: NetworkComputer) -> None:
        """Raise `ModuleError` if another file also configures the interface, even if ours exists already."""
        others = find_conflicting_files(computer, self.interface, self.path, frozenset(self.replaces))
        if others:
            path_list = ", ".join(others)
            hint = msg(f"to remove them with this change, set `replaces: [{arg(path_list)}]` in `network` of the host")
            what = msg(f"other files configure {arg(self.interface)}, too, and would conflict: {arg(path_list)}")
            raise ModuleError(what, hint)
        if self.path == INTERFACES and INTERFACES not in self.replaces:
            self._require_no_other_stanzas(computer)

    def _require_no_other_stanzas(self, computer: NetworkComputer) -> None:
        """Raise `ModuleError` rather than overwrite other people's entries in the single /etc/network/interfaces."""
        if OURS in (computer.read(INTERFACES) or ""):
            return
        there = [(path, name) for path, name in stanzas(computer) if path not in self.replaces and name != "lo"]
        if there:
            lost_entries = dict.fromkeys(f"{name} ({path})" for path, name in there)
            raise ModuleError(
                f"{arg(INTERFACES)} is not ours; these interfaces would lose their entries: "
                f"{arg(', '.join(lost_entries))}",
                f"if that is intended: `replaces: [{arg(INTERFACES)}]` in `network` of the host; otherwise set `by: "
                "networkd`",
            )

    def _by_netplan(self, computer: NetworkComputer) -> str:
        """Return netplan's errors for all its files together, with ours in its desired state."""
        remaining_paths = [path for path in list_netplan_files(computer) if path not in self.replaces]
        texts = {os.path.basename(path): computer.read(path) or "" for path in remaining_paths}
        text, network_texts = generate_netplan(computer, {**texts, os.path.basename(self.path): self.content})
        if text or any(matches_interface(computer, item, self.interface) for item in network_texts):
            return text
        return msg(
            f"it configures nothing for {arg(self.interface)}; does another file in /etc/netplan set a `renderer`?"
        )

    def _check_with_ifupdown(self, computer: NetworkComputer) -> str:
        with tempfile.NamedTemporaryFile("w", prefix="atlantis-interfaces-", encoding="utf-8") as file:
            file.write(self.content)
            file.flush()
            result = computer.run(("ifup", "--no-act", "--force", f"--interfaces={file.name}", self.interface))
            return result.output.replace(file.name, self.path) if result.code else ""

    def _by_networkd(self, computer: NetworkComputer) -> str:
        """Return an error unless our file matches the interface; networkd has no check of its own."""
        return (
            ""
            if matches_interface(computer, self.content, self.interface)
            else msg(f"it does not match {arg(self.interface)}")
        )
