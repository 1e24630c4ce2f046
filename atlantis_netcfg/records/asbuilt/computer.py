"""Queries to a computer about itself, by read-only programs, and the parsing of their output.

All queries are sent in one SSH command, to the program of the checklist that runs programs of a closed list
(`checklist/probes/registry.py`). Only packages that the toolkit installs according to the inventory are queried.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist import probes
from atlantis_netcfg.core.errors import NetcfgError
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory.model import Gateway
from atlantis_netcfg.operations.computers import parts
from atlantis_netcfg.operations.computers._access import is_server
from atlantis_netcfg.records.asbuilt import record
from atlantis_netcfg.vpn.server import PACKAGES as SERVER_PACKAGES

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.operations.common.request import Request

_TREE, _DMI = "/proc/device-tree", "/sys/class/dmi/id"
_HOST_KEY = "/etc/ssh/ssh_host_ed25519_key.pub"
_PROGRAMS: Mapping[str, tuple[str, ...]] = {
    "os": ("cat", "/etc/os-release"),
    "kernel": ("uname", "-rm"),
    "board": ("cat", f"{_TREE}/model"),
    "board_serial": ("cat", f"{_TREE}/serial-number"),
    "product": ("cat", f"{_DMI}/product_name"),
    "product_serial": ("cat", f"{_DMI}/product_serial"),
    "links": ("ip", "-j", "link"),
    "neighbours": ("ip", "-j", "neigh"),
    "host_key": ("ssh-keygen", "-l", "-f", _HOST_KEY),
}
"""Commands by the fact that they provide; an ARM board has a device tree, a PC has firmware tables."""
_REQUIRED_FACTS = ("os", "kernel", "links")
PACKAGE_LINES = r"-f=${Package}=${Version}=${db:Status-Status}\n"
"""Output format of a package, for dpkg-query."""
NOT_INSTALLED = "not installed"
_PLACEHOLDERS = re.compile(r"|0+|none|default string|to be filled by o\.e\.m\.|not specified", re.IGNORECASE)
"""Values of firmware in which no number has been set."""


@dataclass(frozen=True, slots=True)
class ComputerFacts:
    """The facts that one computer reported."""

    facts: Mapping[str, record.Fact]
    ports: tuple[record.PortRecord, ...]
    packages: Mapping[str, str]
    missing: tuple[str, ...] = ()
    """Facts that were not reported, although every computer can report them."""


def declared_packages(inventory: Inventory, host: Host, request: Request) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return every package that a run would install on a computer, and notes on unknown ones."""
    if is_server(host):
        return tuple(sorted(SERVER_PACKAGES)), ()
    package_names: set[str] = set()
    notes = []
    for name, part in parts.PARTS.items():
        if name in {parts.ACCESS, parts.SERVER} or not parts.concerns(name, host):
            continue
        try:
            desired_packages = part(inventory, host, request).get("packages") or {}
        except NetcfgError as error:
            notes.append(msg(f"the packages of `{arg(name)}` are not known, so they were not queried: {arg(error)}"))
            continue
        package_names |= {str(package["name"]) for package in desired_packages.get("packages") or ()}
    return tuple(sorted(package_names)), tuple(notes)


def questions(host: Host, packages: Sequence[str]) -> list[tuple[str, probes.RunProgram]]:
    """Return all queries, sent together; a port's speed only if the inventory names its interface."""
    programs = dict(_PROGRAMS)
    if isinstance(host.device, Gateway) and host.device.network is not None:
        programs["speed"] = ("cat", f"/sys/class/net/{host.device.network.interface}/speed")
    if packages:
        programs["packages"] = ("dpkg-query", "-W", PACKAGE_LINES, *packages)
    return [(name, probes.RunProgram(name, probes.Place.GATEWAY, argv)) for name, argv in programs.items()]


def read(
    host: Host, answers: Mapping[str, probes.Answer], packages: Sequence[str], host_by_address: Mapping[str, str]
) -> ComputerFacts:
    """Parse the responses to `questions`; `host_by_address` maps MAC or IP address to its host."""
    outputs = {name: _output(answer) for name, answer in answers.items()}
    port = host.device.network.interface if isinstance(host.device, Gateway) and host.device.network else None
    return ComputerFacts(
        facts=_facts(outputs),
        ports=tuple(_ports(outputs, port, host_by_address)),
        packages=_versions(outputs.get("packages"), packages),
        missing=tuple(
            msg(f"{arg(' '.join(_PROGRAMS[name]))}: {arg(_failure_text(answers[name]))}")
            for name in _REQUIRED_FACTS
            if outputs[name] is None
        ),
    )


def _output(answer: probes.Answer) -> str | None:
    """Return a program's output, None if it failed; dpkg-query exits with 1 if only some packages are missing."""
    if not isinstance(answer, probes.CommandResult) or answer.trouble is not None:
        return None
    text = answer.out.replace("\0", "").strip()
    return text if answer.rc == 0 or text else None


def _failure_text(answer: probes.Answer) -> str:
    last = next((line for line in reversed(getattr(answer, "err", "").splitlines()) if line), "")
    return answer.words or last or "no output"


def _facts(outputs: Mapping[str, str | None]) -> dict[str, record.Fact]:
    key = re.search(r"SHA256:[A-Za-z0-9+/]{43}", outputs["host_key"] or "")
    model = _real_value(outputs["board"]) or _real_value(outputs["product"])
    serial = _real_value(outputs["board_serial"]) or _real_value(outputs["product_serial"])
    return {
        "model": _fact(model, "its firmware reports no model"),
        "serial": _fact(serial, "its firmware reports no serial number"),
        "os": _fact(_release(outputs["os"] or ""), "its system does not report it"),
        "kernel": _fact(outputs["kernel"], "its system does not report it"),
        "host_key": _fact(key[0] if key else None, msg(f"it has no {arg(_HOST_KEY)}")),
    }


def _fact(value: str | None, why_not: str) -> record.Fact:
    return (
        record.Fact(value=value, origin=record.Origin.READ)
        if value
        else record.Fact(value=None, origin=record.Origin.NOT_READ, note=why_not)
    )


def _real_value(text: str | None) -> str | None:
    return None if text is None or _PLACEHOLDERS.fullmatch(text) else text


def _release(text: str) -> str | None:
    match = re.search(r'^PRETTY_NAME="?([^"\n]+)"?$', text, re.MULTILINE)
    return match[1] if match else None


def _versions(text: str | None, packages: Sequence[str]) -> dict[str, str]:
    """Return the version of every queried package; one that dpkg does not list as installed is not installed."""
    if text is None:
        return {}
    rows = [line.split("=") for line in text.splitlines() if line.count("=") >= 2]  # noqa: PLR2004 - three fields
    version_by_name = {row[0]: "=".join(row[1:-1]) for row in rows if row[-1] == "installed"}
    return {name: version_by_name.get(name, NOT_INSTALLED) for name in packages}


def _ports(
    outputs: Mapping[str, str | None], interface: str | None, host_by_address: Mapping[str, str]
) -> Iterator[record.PortRecord]:
    """Yield the network cards; the kernel's virtual interfaces (`lo`, tunnels) have another link type."""
    for row in _rows(outputs["links"]):
        name, mac = str(row.get("ifname", "")), str(row.get("address", "")).upper()
        if row.get("link_type") != "ether" or not name or _is_virtual(name):
            continue
        state = {"UP": record.CableState.UP, "DOWN": record.CableState.DOWN}.get(
            str(row.get("operstate")), record.CableState.UNKNOWN
        )
        speed = outputs.get("speed") if name == interface else None
        yield record.PortRecord(
            name=name,
            mac=mac or None,
            link=state,
            speed=msg(f"{arg(speed)} Mbit/s") if speed is not None and speed.isdecimal() else None,
            belongs="LAN of the site" if name == interface else None,
            neighbours=tuple(_neighbours(outputs["neighbours"], name, host_by_address)),
        )


def _is_virtual(name: str) -> bool:
    return name.startswith(("docker", "br-", "veth", "virbr", "tap", "dummy", "bond"))


def _neighbours(text: str | None, port: str, host_by_address: Mapping[str, str]) -> Iterator[record.PortNeighbour]:
    """Yield each MAC once, with the first of its addresses."""
    seen_macs: set[str] = set()
    for row in _rows(text):
        mac, address = str(row.get("lladdr", "")).upper(), str(row.get("dst", ""))
        state = row.get("state")
        if row.get("dev") != port or not mac or mac in seen_macs or (isinstance(state, list) and "FAILED" in state):
            continue
        seen_macs.add(mac)
        host = host_by_address.get(mac) or host_by_address.get(address)
        yield record.PortNeighbour(mac=mac, by=("ARP",), address=address, declared=host)


def _rows(text: str | None) -> list[dict[str, object]]:
    try:
        data = json.loads(text or "[]")
    except ValueError:
        return []
    return [row for row in data if isinstance(row, dict)] if isinstance(data, list) else []
