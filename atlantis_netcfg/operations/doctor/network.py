"""This laptop's network as the kernel reports it: ports, addresses, routes; read-only, without contacting anyone.

The outputs of `ip -json` (iproute2) and files of /sys are reduced to `NetworkFacts` by `facts_of`, which is pure.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from contextlib import suppress
from dataclasses import dataclass
from ipaddress import IPv4Address, IPv4Interface
from pathlib import Path
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.core.messages import arg, msg

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence


_PATIENCE_S = 5.0
"""Timeout in seconds for a program that only queries the kernel."""
_STAND_INS = frozenset({"veth", "dummy", "vlan", "bond", "team", "macvlan"})
"""Interface kinds that count as a network card if there is none: in containers and tests."""


@dataclass(frozen=True, slots=True)
class LaptopPort:
    """A network interface of this laptop."""

    name: str
    up: bool
    carrier: bool
    is_wired: bool
    """Whether it is a wired network card, or counts as one."""
    card: bool
    wireless: bool
    speed_mbps: int | None
    addresses: tuple[IPv4Interface, ...]
    is_managed: bool = False
    """Whether NetworkManager would remove manual settings."""


@dataclass(frozen=True, slots=True)
class KernelRoute:
    """A row of the routing table, or the result of `ip route get`."""

    target: str
    port: str
    gateway: str | None
    source: str | None


@dataclass(frozen=True, slots=True)
class NetworkFacts:
    """The kernel's network state, with its route to one address."""

    ports: tuple[LaptopPort, ...]
    best_route: KernelRoute | None
    """Route that a packet to the address takes; None: there is no route."""
    matching: tuple[KernelRoute, ...]
    """Routes of the main table that match the address, including default routes."""
    defaults: tuple[KernelRoute, ...]

    def port(self, name: str) -> LaptopPort | None:
        """Return the port of that name; None if there is none."""
        return next((port for port in self.ports if port.name == name), None)


class NetworkUnreadable(Exception):
    """The kernel's network state could not be read; the message gives the reason."""


@dataclass(frozen=True, slots=True)
class CardFacts:
    """The properties of an interface from /sys."""

    wireless: bool = False
    speed_mbps: int | None = None


@dataclass(frozen=True, slots=True)
class IpPrints:
    """The outputs of `ip -json`."""

    links: str
    addresses: str
    defaults: str
    best_route: str = "[]"
    matching: str = "[]"


def facts_of(prints: IpPrints, cards: Mapping[str, CardFacts], managed_ports: frozenset[str]) -> NetworkFacts:
    """Reduce the outputs to network facts; raise NetworkUnreadable."""
    try:
        addresses = {row["ifname"]: tuple(_addresses(row)) for row in _rows(prints.addresses)}
        ports = tuple(_port(row, addresses.get(row["ifname"], ()), cards, managed_ports) for row in _rows(prints.links))
        best_routes = [_route(row) for row in _rows(prints.best_route)]
        return NetworkFacts(
            ports=ports,
            best_route=best_routes[0] if best_routes else None,
            matching=tuple(map(_route, _rows(prints.matching))),
            defaults=tuple(map(_route, _rows(prints.defaults))),
        )
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise NetworkUnreadable("`ip -json` returned unknown output") from error


def _rows(text: str) -> list[dict[str, Any]]:
    data = json.loads(text or "[]")
    if not isinstance(data, list):
        raise TypeError(text)
    return [row for row in data if row]


def _addresses(row: Mapping[str, Any]) -> Iterator[IPv4Interface]:
    for entry in row.get("addr_info", ()):
        if entry.get("family") == "inet":
            yield IPv4Interface(f"{entry['local']}/{entry['prefixlen']}")


def _port(
    row: Mapping[str, Any],
    addresses: tuple[IPv4Interface, ...],
    cards: Mapping[str, CardFacts],
    managed_ports: frozenset[str],
) -> LaptopPort:
    name, kind = str(row["ifname"]), row.get("linkinfo", {}).get("info_kind")
    card = cards.get(name, CardFacts())
    usable = row.get("link_type") == "ether" and not card.wireless and "master" not in row
    return LaptopPort(
        name=name,
        up="UP" in row["flags"],
        carrier="LOWER_UP" in row["flags"],
        is_wired=usable and (kind is None or kind in _STAND_INS),
        card=usable and kind is None,
        wireless=card.wireless,
        speed_mbps=card.speed_mbps,
        addresses=addresses,
        is_managed=name in managed_ports,
    )


def _route(row: Mapping[str, Any]) -> KernelRoute:
    return KernelRoute(str(row.get("dst", "")), str(row["dev"]), row.get("gateway"), row.get("prefsrc"))


def read_network(address: IPv4Address | None) -> NetworkFacts:
    """Read the network state from the kernel; raise NetworkUnreadable."""
    if shutil.which("ip") is None:
        raise NetworkUnreadable("`ip` is not installed on this laptop")
    towards = (
        {}
        if address is None
        else {"best_route": _get_route(address), "matching": _ip("route", "show", "match", address)}
    )
    prints = IpPrints(
        links=_ip("link", "show", details=True),
        addresses=_ip("address", "show"),
        defaults=_ip("route", "show", "default"),
        **towards,
    )
    return facts_of(prints, _read_cards(), _managed_ports())


def _run(words: Sequence[str]) -> subprocess.CompletedProcess[str]:
    try:
        return subprocess.run(  # noqa: S603 - our own words
            words,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=_PATIENCE_S,
            check=False,
            env={**os.environ, "LC_ALL": "C"},
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise NetworkUnreadable(msg(f"`{arg(words[0])}` did not respond: {arg(error)}")) from error


def _ip(*words: object, details: bool = False) -> str:
    family = ("-details",) if details else ("-4",)
    process = _run(["ip", "-json", *family, *map(str, words)])
    if process.returncode:
        raise NetworkUnreadable(msg(f"`ip {arg(words[0])}` failed: {arg(process.stderr.strip())}"))
    return process.stdout


def _get_route(address: IPv4Address) -> str:
    """Return `ip route get` as JSON; an empty list if the kernel has no route, which is a valid result."""
    process = _run(["ip", "-json", "-4", "route", "get", str(address)])
    if process.returncode and "RTNETLINK answers" not in process.stderr:
        raise NetworkUnreadable(msg(f"`ip route get` failed: {arg(process.stderr.strip())}"))
    return "[]" if process.returncode else process.stdout


def _read_cards() -> dict[str, CardFacts]:
    result = {}
    with suppress(OSError):
        for folder in Path("/sys/class/net").iterdir():
            result[folder.name] = CardFacts((folder / "phy80211").exists(), _speed(folder / "speed"))
    return result


def _speed(file: Path) -> int | None:
    """Return the speed in Mbit/s; None if the kernel knows none: no cable, or no card."""
    try:
        speed = int(file.read_text(encoding="ascii"))
    except (OSError, ValueError):
        return None
    return speed if speed > 0 else None


def _managed_ports() -> frozenset[str]:
    """Return the interfaces that NetworkManager manages."""
    if shutil.which("nmcli") is None:
        return frozenset()
    with suppress(NetworkUnreadable):
        output = _run(["nmcli", "--terse", "--fields", "DEVICE,STATE", "device"]).stdout
        return managed_of(output)
    return frozenset()


def managed_of(output: str) -> frozenset[str]:
    """Return the managed interfaces from the output of `nmcli --terse --fields DEVICE,STATE device`."""
    rows = (line.rpartition(":") for line in output.splitlines())
    return frozenset(name for name, _, state in rows if name and not state.startswith("unmanaged"))
