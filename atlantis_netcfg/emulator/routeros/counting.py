"""What the router's own pings leave in the counters: of the filter's rules, and of the port that they take.

Nothing else passes through a twin, so its rules count nothing else.
"""

from __future__ import annotations

from ipaddress import IPv4Address
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.firewall import Packet, Verdict, walk
from atlantis_netcfg.emulator.routeros.path import route_to

if TYPE_CHECKING:
    from atlantis_netcfg.emulator.routeros.core import Core

__all__ = ["ECHO_BYTES", "count_echoes"]

ECHO_BYTES = 84
"""An echo request or its answer as an IP packet, with 56 bytes of data."""
_FILTER = "/ip/firewall/filter"


def count_echoes(core: Core, target: IPv4Address, source: str | None, number: int, *, answered: bool) -> None:
    """Count echo requests on their way out, and their answers on their way in; one that is dropped is not sent."""
    topology = core.topology
    src = IPv4Address(source) if source else None
    way = route_to(topology, target, src)
    if way is None:
        return
    own = src or target
    port = topology.interfaces[way].name
    if _met(core, "output", Packet(own, target, "new", "icmp", out_interface=way), number) is Verdict.DROP:
        return
    core.count(port, received=False, size=number * ECHO_BYTES)
    if answered:
        core.count(port, received=True, size=number * ECHO_BYTES)
        _met(core, "input", Packet(target, own, "established", "icmp", in_interface=way), number)


def _met(core: Core, chain: str, packet: Packet, number: int) -> Verdict:
    rules: list[int] = []
    verdict = walk(core.topology, _FILTER, chain, packet, met=rules)
    for rule in rules:
        core.met[rule] = core.met.get(rule, 0) + number
    return verdict
