"""A packet walk over rendered rows, written from the manual (Firewall: Filter, NAT); shares no code with the package.

A matcher or action that this walk does not know is an error, so that a new rule cannot pass unexamined.
"""

from dataclasses import dataclass
from ipaddress import ip_address, ip_network
from typing import TYPE_CHECKING

from atlantis_netcfg.routeros.rsc import Export, Statement

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

_LOOKS = frozenset({"action", "chain", "comment", "jump-target", "limit", "log-prefix", "reject-with"})
_BUILT_IN = ("input", "forward", "output", "dstnat", "srcnat")


@dataclass(frozen=True)
class Packet:
    src: str
    dst: str
    in_interface: str = ""
    out_interface: str = ""
    protocol: str = "udp"
    dst_port: int = 0
    state: str = "new"
    nat_state: frozenset[str] = frozenset()
    src_port: int = 0
    flags: frozenset[str] = frozenset({"syn"})
    """Of TCP; of an answer `ack` is among them."""
    is_beyond_limit: bool = False
    """More of its source than a rule admits in a second have come before."""
    dscp: int = 0


class Walk:
    def __init__(self, export: Export) -> None:
        self.rows = [row for row in export.statements if row.menu == "/ip/firewall/filter"]
        self.nat = [row for row in export.statements if row.menu == "/ip/firewall/nat"]
        self._members = _grouped(export, "/interface/list/member", "interface")
        self._addresses = _grouped(export, "/ip/firewall/address-list", "address")

    def verdict(self, chain: str, packet: Packet) -> tuple[str, str]:
        """Return accept, drop or reject, and the comment of the row that decided; no row means accept."""
        return self._chain(self.rows, chain, packet) or ("accept", "end of chain")

    def accepts(self, chain: str, packet: Packet) -> bool:
        return self.verdict(chain, packet)[0] == "accept"

    def translation(self, chain: str, packet: Packet) -> tuple[str, str] | None:
        """Return the action and the new address (empty for masquerade) of the first NAT row that matches."""
        for row in self.nat:
            if row.get("chain") == chain and self._matches(row, packet):
                return str(row.get("action")), row.get("to-addresses") or ""
        return None

    def _chain(self, rows: list[Statement], chain: str, packet: Packet) -> tuple[str, str] | None:
        for row in rows:
            if row.get("chain") != chain or not self._matches(row, packet):
                continue
            action = row.get("action")
            if action in ("accept", "drop", "reject"):
                return action, str(row.get("comment"))
            if action == "return":
                return None
            if action == "jump":
                decided = self._chain(rows, str(row.get("jump-target")), packet)
                if decided:
                    return decided
                continue
            assert action == "log", f"unknown action {action}"
        assert chain in _BUILT_IN or chain.startswith(("to-", "from-")), f"unknown chain {chain}"
        return None

    def _matches(self, row: Statement, packet: Packet) -> bool:
        assert row.get("limit") is None or row.get("action") == "log", "a limit must not decide"
        return all(
            self._match(name, value, packet)
            for name, value in row.values
            if value is not None and name not in _LOOKS and name != "to-addresses"
        )

    def _match(self, name: str, value: str, packet: Packet) -> bool:
        wanted = value.removeprefix("!")
        known: Mapping[str, Callable[[], bool]] = {
            "src-address": lambda: _inside(packet.src, wanted),
            "dst-address": lambda: _inside(packet.dst, wanted),
            "src-address-list": lambda: self._listed(packet.src, wanted),
            "dst-address-list": lambda: self._listed(packet.dst, wanted),
            "in-interface": lambda: packet.in_interface == wanted,
            "out-interface": lambda: packet.out_interface == wanted,
            "in-interface-list": lambda: packet.in_interface in self._members.get(wanted, ()),
            "out-interface-list": lambda: packet.out_interface in self._members.get(wanted, ()),
            "protocol": lambda: packet.protocol == wanted,
            "dst-port": lambda: packet.protocol in ("tcp", "udp") and _among(packet.dst_port, wanted),
            "src-port": lambda: packet.protocol in ("tcp", "udp") and _among(packet.src_port, wanted),
            "tcp-flags": lambda: packet.flags.issuperset(wanted.split(",")),
            "connection-state": lambda: packet.state in wanted.split(","),
            "dst-limit": lambda: not packet.is_beyond_limit,
            "connection-nat-state": lambda: wanted in packet.nat_state,
            "dscp": lambda: packet.dscp == int(wanted),
        }
        assert name in known, f"the walk does not know the matcher {name}"
        return known[name]() != value.startswith("!")

    def _listed(self, address: str, name: str) -> bool:
        return any(_inside(address, entry) for entry in self._addresses.get(name, ()))


def _among(port: int, ports: str) -> bool:
    """Whether a port is one of a list of ports and ranges."""
    ends = [one.partition("-") for one in ports.split(",")]
    return any(int(first) <= port <= int(last or first) for first, _, last in ends)


def _inside(address: str, network: str) -> bool:
    return ip_address(address) in ip_network(network)


def _grouped(export: Export, menu: str, column: str) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for row in export.statements:
        if row.menu == menu:
            found.setdefault(str(row.get("list")), []).append(str(row.get(column)))
    return found
