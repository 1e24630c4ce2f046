"""What `ip -j` says of the way to a neighbour: by which interface, and which network card answers there.

Asked as `ip -j route get ADDRESS`, `ip -j addr show dev INTERFACE` and `ip -j neigh show to ADDRESS` (iproute2).
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.bearers import Finding
from atlantis_netcfg.checklist.probes.not_run import PLACES
from atlantis_netcfg.checklist.probes.requests import Run
from atlantis_netcfg.checklist.probes.results import Ran
from atlantis_netcfg.core.verdicts import Verdict

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.checklist.probes.requests import Place
    from atlantis_netcfg.checklist.probes.results import Answer

__all__ = [
    "Card",
    "Way",
    "ask_card",
    "ask_neighbour",
    "ask_way",
    "own_address",
    "read_card",
    "read_neighbour",
    "read_way",
]

_LOOPBACK = "lo"


@dataclass(frozen=True, slots=True)
class Way:
    """How packets to an address leave."""

    interface: str
    by: str | None = None
    """The next hop; None: the address is in a network of that interface."""


@dataclass(frozen=True, slots=True)
class Card:
    """An interface."""

    up: bool
    """Switched on."""
    carrier: bool
    """Whether it has a link; of Wi-Fi: whether it is associated."""
    master: str | None = None
    """The bridge that it is a port of."""


def ask_way(place: Place, address: str) -> Run:
    """Give the question; its answer's name is `route`."""
    return Run("route", place, ("ip", "-j", "route", "get", address))


def ask_card(place: Place, interface: str) -> Run:
    """Give the question; its answer's name is `addr`."""
    return Run("addr", place, ("ip", "-j", "addr", "show", "dev", interface))


def ask_neighbour(place: Place, address: str) -> Run:
    """Give the question; its answer's name is `neigh`, and it is asked after a ping that stands before it."""
    return Run("neigh", place, ("ip", "-j", "neigh", "show", "to", address), turn=address)


def read_way(answer: Answer | None, address: str) -> Way | None:
    """Read a route; None: there is none, or it is not understood."""
    for row in _rows(answer):
        if isinstance(row.get("dev"), str) and row.get("dst") == address:
            by = row.get("gateway")
            return Way(row["dev"], by if isinstance(by, str) else None)
    return None


def read_card(answer: Answer | None) -> Card | None:
    """Read an interface; None: there is none, or it is not understood."""
    for row in _rows(answer):
        flags = row.get("flags")
        if isinstance(flags, list):
            master = row.get("master")
            return Card("UP" in flags, "LOWER_UP" in flags, master if isinstance(master, str) else None)
    return None


def read_neighbour(answer: Answer | None, address: str) -> str | None:
    """Read which card has answered for an address, in upper case; None: none of late, which proves nothing."""
    for row in _rows(answer):
        known = isinstance(row.get("lladdr"), str) and row.get("dst") == address
        if known and "FAILED" not in (row.get("state") or ()):
            return str(row["lladdr"]).upper()
    return None


def own_address(place: Place, name: str, address: str, way: Way | None) -> Iterator[Finding]:
    """Say that an address is that of the computer that asks, whose own answers tell nothing of anybody else."""
    if way is not None and way.interface == _LOOPBACK:
        message = f"{PLACES[place]} itself has the address of {name}, {address}: its pings never leave it"
        hint = "take the address away there, or correct the one that is declared: `ip -br addr` shows them"
        yield Finding(Verdict.FAIL, "own-address", message, hint)


def _rows(answer: Answer | None) -> list[dict[str, Any]]:
    if not isinstance(answer, Ran) or answer.trouble is not None or answer.rc:
        return []
    try:
        result = json.loads(answer.out or "[]")
    except (ValueError, RecursionError):
        return []
    return [row for row in result if isinstance(row, dict)] if isinstance(result, list) else []
