"""The management path: whether a packet of the technician arrives, and its response returns.

It is written from the packet flow of the manual (Manual, Packet Flow), independently of the planner, so that it can
check the planner's assumptions. It is cautious: an address on a bridge port does not respond, and NAT rules that
redirect the packet close the path.
"""

from __future__ import annotations

from ipaddress import IPv4Address, IPv4Network
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.network import firewall
from atlantis_netcfg.emulator.routeros.network.topology import MAIN, Topology

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.emulator.routeros.core import Core
    from atlantis_netcfg.emulator.routeros.store import StoredItem, Table


_CLIENT_PORT = 50000
_FILTER, _RAW, _NAT = "/ip/firewall/filter", "/ip/firewall/raw", "/ip/firewall/nat"


def path_open(  # noqa: PLR0913 - one packet's two ends
    core: Core, caller: str, local: str, service: str, *, is_established: bool, plug: str | None = None
) -> bool:
    """Return whether a packet and its response pass; for a new session also the packets that follow.

    `plug`: factory name of the port of the caller's cable; by default the management port.
    """
    topology = core.topology
    port = _service_port(core, service)
    entry = _port(core, plug or core.spec.management.port)
    if port is None or entry is None or not topology.up(entry):
        return False
    interface = topology.interfaces[entry].master or entry
    src, dst = IPv4Address(caller), IPv4Address(local)
    if not is_established and not _on(core, service):
        return False
    if not _receives(core, entry, interface, dst):
        return False
    states = ("established",) if is_established else ("new", "established")
    return all(
        _can_round_trip(
            topology,
            firewall.Packet(
                src, dst, state, src_port=_CLIENT_PORT, dst_port=port, in_interface=interface, in_port=entry
            ),
        )
        for state in states
    )


def _port(core: Core, plug: str) -> int | None:
    """Return the interface with this factory name, even if renamed."""
    interface = core.topology.factory(plug)
    return None if interface is None else interface.id


def _service_port(core: Core, service: str) -> int | None:
    table = core.store.table("/ip/service")
    for item in table.items:
        if core.store.text(table, item, "name") == service:
            return int(core.store.text(table, item, "port") or 0)
    return None


def _on(core: Core, service: str) -> bool:
    """Return whether the service is enabled; its `address=` is checked only after the packet has arrived."""
    table = core.store.table("/ip/service")
    item = next(item for item in table.items if core.store.text(table, item, "name") == service)
    return core.store.text(table, item, "disabled") != "yes" and core.store.target(table, item, "vrf") in (None, MAIN)


def _receives(core: Core, entry: int, interface: int, dst: IPv4Address) -> bool:
    """Return whether packets from `entry` reach the address on that interface, and ARP is answered there."""
    topology = core.topology
    here = [local for local in topology.locals if local.works and local.address.ip == dst and local.on == interface]
    return (
        bool(here) and _has_arp(topology, interface) and (entry == interface or _reaches_bridge(core, entry, interface))
    )


def _has_arp(topology: Topology, interface: int) -> bool:
    table = topology.store.table(topology.interfaces[interface].menu)
    item = table.find(interface)
    return item is not None and topology.store.text(table, item, "arp") in ("enabled", "proxy-arp", "local-proxy-arp")


def _reaches_bridge(core: Core, entry: int, bridge: int) -> bool:
    """Return whether untagged frames pass from the port to the bridge itself."""
    store = core.store
    bridges = store.table("/interface/bridge")
    bridge_item = bridges.find(bridge)
    if bridge_item is None or store.text(bridges, bridge_item, "vlan-filtering") != "yes":
        return True
    ports = store.table("/interface/bridge/port")
    port = next((item for item in ports.items if entry in core.topology.port_members(item)), None)
    if port is None or store.text(ports, port, "frame-types") == "admit-only-vlan-tagged":
        return False
    return store.text(ports, port, "pvid") == store.text(bridges, bridge_item, "pvid")


def _can_round_trip(topology: Topology, packet: firewall.Packet) -> bool:
    if firewall.walk(topology, _RAW, "prerouting", packet) is firewall.PacketVerdict.DROP:
        return False
    if packet.state == "new" and _is_redirected(topology, packet):
        return False
    if firewall.walk(topology, _FILTER, "input", packet) is firewall.PacketVerdict.DROP:
        return False
    way = route_to(topology, packet.src, packet.dst)
    if way != packet.in_interface:
        return False
    answer = firewall.Packet(
        packet.dst,
        packet.src,
        "established",
        src_port=packet.dst_port,
        dst_port=packet.src_port,
        out_interface=way,
        out_port=packet.in_port,
    )
    return all(
        firewall.walk(topology, table, "output", answer) is not firewall.PacketVerdict.DROP for table in (_RAW, _FILTER)
    )


def _is_redirected(topology: Topology, packet: firewall.Packet) -> bool:
    """Return whether dstnat redirects the first packet."""
    return firewall.walk(topology, _NAT, "dstnat", packet) is firewall.PacketVerdict.DROP


def route_to(topology: Topology, dst: IPv4Address, src: IPv4Address | None) -> int | None:
    """Return the outgoing interface for `dst`, by routing rules and tables; None: no route."""
    rules = topology.store.table("/routing/rule")
    for item in _in_order(topology, rules):
        if item is None:
            way = _first_hop(topology, dst, MAIN, -1)
            if way is not None:
                return way
            continue
        if not _rule_applies(topology, rules, item, dst, src):
            continue
        action = topology.store.text(rules, item, "action")
        if action in ("drop", "unreachable"):
            return None
        table = topology.store.target(rules, item, "table")
        least = topology.store.text(rules, item, "min-prefix")
        way = _first_hop(topology, dst, MAIN if table is None else table, -1 if least is None else int(least))
        if way is not None or action == "lookup-only-in-table":
            return way
    return None


def _in_order(topology: Topology, rules: Table) -> Iterator[StoredItem | None]:
    """Yield rules in the chain order of `policy-rules` (from 7.22 on); None is table main."""
    # Table main has its turn, too. Assumption: routing-rule-chains
    store = topology.store
    table = store.table("/routing/settings")
    chains = "user,main"
    if "policy-rules" in table.args:
        chains = next((store.text(table, item, "policy-rules") for item in table.items), None) or chains
    for chain in chains.split(","):
        yield from (item for item in rules.items if (store.text(rules, item, "chain") or "user") == chain)
        if chain == "main":
            yield None


def _rule_applies(
    topology: Topology, rules: Table, item: StoredItem, dst: IPv4Address, src: IPv4Address | None
) -> bool:
    store = topology.store
    if store.text(rules, item, "disabled") == "yes" or "interface" in item.values or "routing-mark" in item.values:
        return False
    wanted_src, wanted_dst = store.text(rules, item, "src-address"), store.text(rules, item, "dst-address")
    src_fits = wanted_src is None or (src is not None and src in IPv4Network(wanted_src))
    return src_fits and (wanted_dst is None or dst in IPv4Network(wanted_dst))


def _first_hop(topology: Topology, dst: IPv4Address, table: int, least: int) -> int | None:
    best = topology.lookup(dst, table, least_prefix=least)
    return next((interface for route in best for _, interface in route.hops), None)


def answers(core: Core, target: IPv4Address, source: str | None) -> bool:
    """Return whether an echo request reaches a responding host, and the response passes."""
    if core.topology.is_local(target):
        return True
    return str(target) in core.spec.answering and receives(core, target, source)


def receives(core: Core, target: IPv4Address, source: str | None) -> bool:
    """Return whether an echo request and its response pass, assuming that every non-silent host responds."""
    topology = core.topology
    if target in core.silent:
        return False
    src = IPv4Address(source) if source else None
    way = route_to(topology, target, src)
    if way is None:
        return False
    address = src or next(
        (local.address.ip for local in topology.locals if local.works and local.actual == way), target
    )
    request = firewall.Packet(address, target, "new", "icmp", out_interface=way)
    reply = firewall.Packet(target, address, "established", "icmp", in_interface=way)
    out = firewall.walk(topology, _FILTER, "output", request) is not firewall.PacketVerdict.DROP
    return out and firewall.walk(topology, _FILTER, "input", reply) is not firewall.PacketVerdict.DROP
