"""Pass one packet through one chain (Manual, Packet Flow; Manual, Filter).

A matcher that depends on traffic or content (`limit`, `content`, `layer7-protocol`, ...) cannot be evaluated here. Its
rule is assumed to behave in the worst way: it matches if it would drop, and does not match if it would accept.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from ipaddress import IPv4Address, IPv4Network
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.values import references, spell

if TYPE_CHECKING:
    from atlantis_netcfg.emulator.routeros.network.topology import Topology
    from atlantis_netcfg.emulator.routeros.store import StoredItem, Table


_DEEPEST = 16
_CLOSING = ("drop", "reject", "tarpit", "dst-nat", "redirect", "netmap", "same", "socksify")
"""Actions that keep a packet from its destination, by blocking it or redirecting it to another host."""
_PASSING = ("accept", "fasttrack-connection")
_NUMBERS = {"icmp": "1", "tcp": "6", "udp": "17"}


class PacketVerdict(Enum):
    """Result of a chain for a packet; FALL: no rule decided."""

    ACCEPT = "accept"
    DROP = "drop"
    FALL = "fall"


@dataclass(frozen=True, slots=True)
class Packet:
    """A packet at the router. Interfaces are ids; both a bridge and its port may be known."""

    src: IPv4Address
    dst: IPv4Address
    state: str
    protocol: str = "tcp"
    src_port: int | None = None
    dst_port: int | None = None
    in_interface: int | None = None
    in_port: int | None = None
    out_interface: int | None = None
    out_port: int | None = None
    dscp: str = "0"


def walk(  # noqa: PLR0913 - one packet, and where it is
    topology: Topology, path: str, chain: str, packet: Packet, depth: int = 0, *, matched_ids: list[int] | None = None
) -> PacketVerdict:
    """Evaluate a chain and its jumps; ids of matched rules are appended to `matched_ids`."""
    table = topology.store.table(path)
    for item in table.items:
        if not _is_in_force(topology, table, item, chain) or not _matches(topology, table, item, packet):
            continue
        if matched_ids is not None:
            matched_ids.append(item.id)
        action = topology.store.text(table, item, "action")
        if action in _CLOSING:
            return PacketVerdict.DROP
        if action in _PASSING:
            return PacketVerdict.ACCEPT
        if action == "return":
            return PacketVerdict.FALL
        if action == "jump" and depth < _DEEPEST:
            target = topology.store.text(table, item, "jump-target") or ""
            verdict = walk(topology, path, target, packet, depth + 1, matched_ids=matched_ids)
            if verdict is not PacketVerdict.FALL:
                return verdict
    return PacketVerdict.FALL


def _is_in_force(topology: Topology, table: Table, item: StoredItem, chain: str) -> bool:
    store = topology.store
    return store.text(table, item, "chain") == chain and store.text(table, item, "disabled") != "yes"


def _matches(topology: Topology, table: Table, item: StoredItem, packet: Packet) -> bool:
    closing = topology.store.text(table, item, "action") in _CLOSING
    for name, stored_value in item.values.items():
        if name not in _MATCHERS:
            continue
        verdict = _decide(topology, name, stored_value, packet)
        if not (closing if verdict is None else verdict):
            return False
    return True


def _decide(topology: Topology, name: str, stored_value: str, packet: Packet) -> bool | None:
    """Return whether a matcher applies; None: unknown."""
    is_negated, plain = stored_value.startswith("!"), stored_value.removeprefix("!")
    value = spell(plain, topology.store)
    verdict = _decide_plain(topology, name, plain, value, packet)
    return None if verdict is None else verdict != is_negated


def _decide_plain(topology: Topology, name: str, stored_value: str, value: str, packet: Packet) -> bool | None:
    if name in _FIELDS:
        field = getattr(packet, _FIELDS[name])
        if name in _INTERFACES:
            return _is_interface(topology, stored_value, field)
        if name in _INTERFACE_LISTS:
            return _is_in_list(topology, stored_value, field)
        return _of_packet(topology, name, value, field)
    if name in _PORT_MATCHERS:
        return any(_is_port_in(getattr(packet, which), value) for which in _PORT_MATCHERS[name])
    if name in _MARKS:
        return value == "no-mark"
    return False if name == "connection-nat-state" else None


def _of_packet(topology: Topology, name: str, value: str, field: IPv4Address | str) -> bool:
    """Compare state, protocol or an address of the packet."""
    if isinstance(field, str):
        return field in value.split(",") or _NUMBERS.get(field) == value
    if name in _ADDRESSES:
        return _is_within(field, value)
    if name in _ADDRESS_LISTS:
        return _in_address_list(topology, value, field)
    return _type(topology, field) in value.split(",")


_ADDRESSES = {"src-address": "src", "dst-address": "dst"}
_ADDRESS_LISTS = {"src-address-list": "src", "dst-address-list": "dst"}
_ADDRESS_TYPES = {"src-address-type": "src", "dst-address-type": "dst"}
_INTERFACES = {
    "in-interface": "in_interface",
    "out-interface": "out_interface",
    "in-bridge-port": "in_port",
    "out-bridge-port": "out_port",
}
_INTERFACE_LISTS = {
    "in-interface-list": "in_interface",
    "out-interface-list": "out_interface",
    "in-bridge-port-list": "in_port",
    "out-bridge-port-list": "out_port",
}
_PORT_MATCHERS = {
    "src-port": ("src_port",),
    "dst-port": ("dst_port",),
    "port": ("src_port", "dst_port"),
}
_FIELDS = {
    "connection-state": "state",
    "dscp": "dscp",
    "protocol": "protocol",
    **_ADDRESSES,
    **_ADDRESS_LISTS,
    **_ADDRESS_TYPES,
    **_INTERFACES,
    **_INTERFACE_LISTS,
}
_MARKS = ("connection-mark", "packet-mark", "routing-mark")
_UNDECIDABLE = (
    "connection-bytes",
    "connection-limit",
    "connection-rate",
    "connection-type",
    "content",
    "dst-limit",
    "fragment",
    "hotspot",
    "icmp-options",
    "ingress-priority",
    "ipsec-policy",
    "ipv4-options",
    "layer7-protocol",
    "limit",
    "nth",
    "p2p",
    "packet-size",
    "per-connection-classifier",
    "priority",
    "psd",
    "random",
    "realm",
    "src-mac-address",
    "tcp-flags",
    "tcp-mss",
    "time",
    "tls-host",
    "tos",
    "ttl",
)
_MATCHERS = frozenset({"connection-nat-state", *_FIELDS, *_PORT_MATCHERS, *_MARKS, *_UNDECIDABLE})


def _is_within(address: IPv4Address, value: str) -> bool:
    first, dash, last = value.partition("-")
    if dash:
        return IPv4Address(first) <= address <= IPv4Address(last)
    return address in IPv4Network(value)


def _in_address_list(topology: Topology, name: str, address: IPv4Address) -> bool:
    """Return whether an address is in a list; DNS names match nothing, because nothing is resolved."""
    store, table = topology.store, topology.store.table("/ip/firewall/address-list")
    for item in table.items:
        value = store.text(table, item, "address") or ""
        live = store.text(table, item, "list") == name and store.text(table, item, "disabled") != "yes"
        if live and value[:1].isdecimal() and _is_within(address, value):
            return True
    return False


def _type(topology: Topology, address: IPv4Address) -> str:
    if topology.is_local(address):
        return "local"
    if address.is_multicast:
        return "multicast"
    broadcasts = {local.network.broadcast_address for local in topology.locals if local.works}
    return "broadcast" if address in broadcasts else "unicast"


def _is_interface(topology: Topology, stored_value: str, interface: int | None) -> bool:
    if stored_value.startswith("all-"):
        item = topology.interfaces.get(interface or 0)
        return item is not None and stored_value == "all-ethernet" and item.menu == "/interface/ethernet"
    return interface is not None and interface in {number for _, number in references(stored_value)}


def _is_in_list(topology: Topology, stored_value: str, interface: int | None) -> bool:
    return interface is not None and any(
        topology.is_in_list(number, interface) for _, number in references(stored_value)
    )


def _is_port_in(port: int | None, value: str) -> bool:
    if port is None:
        return False
    for part in value.split(","):
        low, _, high = part.partition("-")
        if int(low) <= port <= int(high or low):
            return True
    return False
