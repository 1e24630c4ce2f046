"""Packet counters of a router: its own pings, and traffic carried by others.

No LAN packet passes through an emulated router. Code that carries packets (a relay of a rehearsal) reports them; the
router applies its routing rules and increases the counters of its rows, even where the rules lead elsewhere.
"""

from __future__ import annotations

from ipaddress import IPv4Address
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.emulator.routeros.network import firewall
from atlantis_netcfg.emulator.routeros.network.path import route_to

if TYPE_CHECKING:
    from atlantis_netcfg.emulator.routeros.core import Core

ECHO_BYTES = 84
"""Size of an echo request or response as an IP packet, with 56 bytes of data."""
_FILTER, _MANGLE = "/ip/firewall/filter", "/ip/firewall/mangle"


def count_echoes(core: Core, target: IPv4Address, source: str | None, number: int, *, has_answer: bool) -> None:
    """Count echo requests and their responses; dropped ones are not sent."""
    topology = core.topology
    src = IPv4Address(source) if source else None
    way = route_to(topology, target, src)
    if way is None:
        return
    address = src or target
    port = topology.interfaces[way].name
    octets = number * ECHO_BYTES
    request = firewall.Packet(address, target, "new", "icmp", out_interface=way)
    if _count_matches(core, _FILTER, "output", request, number, octets) is firewall.PacketVerdict.DROP:
        return
    core.count(port, is_received=False, size=octets)
    if has_answer:
        core.count(port, is_received=True, size=octets)
        reply = firewall.Packet(target, address, "established", "icmp", in_interface=way)
        _count_matches(core, _FILTER, "input", reply, number, octets)


def carry(  # noqa: PLR0913, PLR0917 - a flow, and what passed of it
    core: Core,
    source: str,
    source_port: int,
    target: str,
    target_port: int,
    up: tuple[int, int],
    down: tuple[int, int],
) -> dict[str, Any]:
    """Count a UDP flow of the LAN, packets and octets each way; return its port, and whether it passed.

    Mangle is before the filter, so that dropped packets are counted there too. The filter is evaluated for the first
    packet and for a response: whether NAT applies to later ones is not known.
    """
    topology = core.topology
    src, dst = IPv4Address(source), IPv4Address(target)
    way, entry = route_to(topology, dst, src), route_to(topology, src, None)
    if way is None or entry is None:
        return {"port": None, "passed": False}
    out = firewall.Packet(
        src, dst, "new", "udp", src_port=source_port, dst_port=target_port, in_interface=entry, out_interface=way
    )
    back = firewall.Packet(
        dst,
        src,
        "established",
        "udp",
        src_port=target_port,
        dst_port=source_port,
        in_interface=way,
        out_interface=entry,
    )
    name = topology.interfaces[way].name
    _count_matches(core, _MANGLE, "forward", out, *up)
    if _count_matches(core, _FILTER, "forward", out, *up) is not firewall.PacketVerdict.ACCEPT:
        return {"port": name, "passed": False}
    core.count(name, is_received=False, size=up[1])
    _count_matches(core, _MANGLE, "forward", back, *down)
    core.count(name, is_received=True, size=down[1])
    has_passed = _count_matches(core, _FILTER, "forward", back, *down) is firewall.PacketVerdict.ACCEPT
    return {"port": name, "passed": has_passed}


def _count_matches(  # noqa: PLR0913, PLR0917 - packets in a chain
    core: Core, table: str, chain: str, packet: firewall.Packet, number: int, octets: int
) -> firewall.PacketVerdict:
    rules: list[int] = []
    verdict = firewall.walk(core.topology, table, chain, packet, matched_ids=rules)
    for rule in rules:
        packets, bytes_met = core.met.get((table, rule), (0, 0))
        core.met[table, rule] = packets + number, bytes_met + octets
    return verdict
