"""A router's firewall rows as nftables, rule by rule.

Both sit on the same hooks of Linux' netfilter with the same connection tracking, so that a chain, a jump, a return and
a state mean the same (Manual, Packet Flow; nft(8)). One row becomes one rule, with its comment and a counter, but for
these: `connection-nat-state` is two bits of `ct status`, an address list is a set, an interface list an anonymous set,
and packet marks and routing marks share the mark of Linux, each in bits of its own.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.core.errors import NetcfgError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

FILTER, NAT, MANGLE, RAW = (f"/ip/firewall/{name}" for name in ("filter", "nat", "mangle", "raw"))
MENUS: Final = (RAW, MANGLE, NAT, FILTER)
TABLE: Final = "atlantis"
_HOOKS: Final = {
    (RAW, "prerouting"): "type filter hook prerouting priority raw",
    (RAW, "output"): "type filter hook output priority raw",
    (MANGLE, "prerouting"): "type filter hook prerouting priority mangle",
    (MANGLE, "input"): "type filter hook input priority mangle",
    (MANGLE, "forward"): "type filter hook forward priority mangle",
    (MANGLE, "output"): "type route hook output priority mangle",
    (MANGLE, "postrouting"): "type filter hook postrouting priority mangle",
    (NAT, "dstnat"): "type nat hook prerouting priority dstnat",
    (NAT, "srcnat"): "type nat hook postrouting priority srcnat",
    (FILTER, "input"): "type filter hook input priority filter",
    (FILTER, "forward"): "type filter hook forward priority filter",
    (FILTER, "output"): "type filter hook output priority filter",
}
"""RouterOS' chains, and the hooks that they are (Manual, Packet Flow)."""
_NAT_BITS: Final = {"srcnat": "0x10", "dstnat": "0x20"}
"""IPS_SRC_NAT and IPS_DST_NAT of linux/netfilter/nf_conntrack_common.h."""
ROUTING_MARKS: Final = 0x00FF
"""Bits of the packet's mark that hold its routing mark: the number of a routing table in Linux."""
_PACKET_MARKS: Final = 0xFF00
_NO_DEVICE: Final = "no device"
_NO_WORD: Final = re.compile(r"\W")
_SILENT: Final = frozenset(
    {
        *("action", "chain", "comment", "disabled", "jump-target", "log", "log-prefix", "reject-with", "passthrough"),
        *(
            "to-addresses",
            "to-ports",
            "new-mss",
            "new-packet-mark",
            "new-connection-mark",
            "new-routing-mark",
            "new-dscp",
        ),
    }
)
"""Properties that do not say which packets a row applies to."""


class UntranslatableRow(NetcfgError, ValueError):
    """A row whose matcher or action Linux does not have, or that is not known here."""


@dataclass(frozen=True, slots=True)
class FirewallRow:
    """One row of the firewall, in the words of an export."""

    menu: str
    values: Mapping[str, str]
    item: int = 0
    """The row's id on the router."""

    def get(self, name: str) -> str:
        """Return a property; empty if it is not set."""
        return self.values.get(name, "")


@dataclass(frozen=True, slots=True)
class NftRule:
    """One rule of nftables: what it matches, word for word, and what it does."""

    menu: str
    chain: str
    matches: tuple[str, ...]
    action: str
    comment: str
    item: int = 0
    """Id of the row."""

    def text(self) -> str:
        """Return the rule as `nft` reads it."""
        remark = self.comment.replace('"', "'")[:120]
        return " ".join([*self.matches, "counter", self.action, f'comment "{remark}"' if remark else ""]).strip()


@dataclass(frozen=True, slots=True)
class RowReferences:
    """What the rows refer to: devices of Linux, lists, marks."""

    devices: Mapping[str, str] = field(default_factory=dict)
    """Name of an interface to its device; default: the same name."""
    interface_lists: Mapping[str, Sequence[str]] = field(default_factory=dict)
    """Members of each list, nested ones included."""
    address_lists: Mapping[str, Sequence[str]] = field(default_factory=dict)
    tables: Mapping[str, int] = field(default_factory=dict)
    """Routing mark to the number of its routing table."""

    def device(self, name: str) -> str:
        """Return the device of an interface, quoted."""
        return f'"{self.devices.get(name, name)}"'


@dataclass(frozen=True, slots=True)
class NftRuleset:
    """All rules and sets; `limits`: rows that are missing in it, with the reason."""

    rules: tuple[NftRule, ...]
    sets: Mapping[str, tuple[str, ...]]
    meters: Mapping[str, str] = field(default_factory=dict)
    """Sets that count packets for each address, and after how long they forget one."""
    limits: tuple[str, ...] = ()

    def counters(self) -> tuple[tuple[str, str, int], ...]:
        """Return chain of nftables, menu and id of each row with a rule, by chains and then in their order."""
        places = [(_chain(rule.menu, rule.chain), rule.menu, rule.item) for rule in self.rules]
        return tuple(sorted(places, key=lambda place: place[0]))

    def text(self, extra: Sequence[str] = ()) -> str:
        """Return a table for `nft -f`, which replaces the one that is there; `extra`: lines of the caller's own."""
        head = f"table ip {TABLE}"
        lines = [head, f"delete {head}", f"{head} {{"]
        for name, addresses in self.sets.items():
            elements = f"elements = {{ {', '.join(addresses)} }};" if addresses else ""
            lines.append(f"set {name} {{ type ipv4_addr; flags interval; auto-merge; {elements} }}")
        for name, forget in self.meters.items():
            lines.append(f"set {name} {{ type ipv4_addr; size 65535; flags dynamic,timeout; timeout {forget}; }}")
        # Nothing can jump to a chain that is not there yet.
        chains = dict.fromkeys([*_HOOKS, *((rule.menu, rule.chain) for rule in self.rules), *self._targets()])
        lines += [f"chain {_chain(*chain)} {{ }}" for chain in chains if chain not in _HOOKS]
        for chain in chains:
            hook = [f"{_HOOKS[chain]}; policy accept;"] if chain in _HOOKS else []
            rules = [rule.text() for rule in self.rules if (rule.menu, rule.chain) == chain]
            lines += [f"chain {_chain(*chain)} {{", *hook, *rules, "}"]
        return "\n".join([*lines, *extra, "}", ""])

    def _targets(self) -> Iterator[tuple[str, str]]:
        prefixes = {menu: _chain(menu, "") for menu in MENUS}
        for rule in self.rules:
            if rule.action.startswith("jump "):
                yield rule.menu, rule.action.removeprefix(f"jump {prefixes[rule.menu]}")


def translate(rows: Iterable[FirewallRow], names: RowReferences) -> NftRuleset:
    """Translate the rows that are not disabled, in their order."""
    rules, limits = [], []
    marks: dict[str, int] = {}
    meters: dict[str, str] = {}
    for row in rows:
        if row.get("disabled") == "yes":
            continue
        try:
            rules.append(_Translation(row, names, marks, meters).rule())
        except UntranslatableRow as error:
            limits.append(f"{row.menu} {row.get('comment') or row.get('chain')}: {error}")
    sets = {_set(name): tuple(addresses) for name, addresses in sorted(names.address_lists.items())}
    used = set(re.findall(r"@(l_\w+)", " ".join(word for rule in rules for word in rule.matches)))
    every = {name: sets.get(name, ()) for name in sorted(used | set(sets))}
    return NftRuleset(tuple(rules), every, meters, tuple(limits))


@dataclass(frozen=True, slots=True)
class _Translation:
    row: FirewallRow
    names: RowReferences
    marks: dict[str, int]
    """FlowPacket and connection marks to their numbers, in the order of their first use."""
    meters: dict[str, str]
    """Sets that count packets for each address, and after how long they forget one."""

    def rule(self) -> NftRule:
        matches = [
            word for name, value in self.row.values.items() if name not in _SILENT for word in self._match(name, value)
        ]
        # A limit counts what it meets, so it stands behind every other matcher, as RouterOS evaluates it.
        matches.sort(key=lambda match: match.startswith(("limit ", "update @m_")))
        protocol = self.row.get("protocol")
        if self._needs_protocol() and protocol and not any(match.startswith(f"{protocol} ") for match in matches):
            matches.insert(0, f"meta l4proto {protocol}")
        row = self.row
        return NftRule(row.menu, row.get("chain"), tuple(matches), self._action(), row.get("comment"), row.item)

    def _needs_protocol(self) -> bool:
        return bool(self.row.get("to-ports")) or self.row.get("reject-with") == "tcp-reset"

    # --- actions ---------------------------------------------------------------------------------------------------

    def _action(self) -> str:
        get, action = self.row.get, self.row.get("action") or "accept"
        port = f":{get('to-ports')}" if get("to-ports") else ""
        simple = {
            "accept": "accept",
            "drop": "drop",
            "tarpit": "drop",
            "fasttrack-connection": "accept",
            "return": "return",
            "passthrough": "",
            "masquerade": "masquerade",
            "log": f'log prefix "{get("log-prefix")[:100]} "',
            "jump": f"jump {_chain(self.row.menu, get('jump-target'))}",
            "dst-nat": f"dnat to {get('to-addresses')}{port}",
            "src-nat": f"snat to {get('to-addresses')}{port}",
            "redirect": f"redirect to {port}" if port else "redirect",
            "change-mss": f"tcp option maxseg size set {get('new-mss').replace('clamp-to-pmtu', 'rt mtu')}",
            "change-dscp": f"ip dscp set {get('new-dscp')}",
        }
        if action in simple:
            return simple[action]
        if action == "reject":
            reason = get("reject-with") or "icmp-network-unreachable"
            how = "tcp reset" if reason == "tcp-reset" else f"icmp type {reason[5:].replace('network', 'net')}"
            return f"reject with {how}"
        if action in ("mark-packet", "mark-connection", "mark-routing"):
            end = "" if get("passthrough") != "no" else " accept"
            return f"{self._set_mark(action)}{end}"
        raise UntranslatableRow(f"unknown action {action}")

    def _set_mark(self, action: str) -> str:
        if action == "mark-routing":
            name = self.row.get("new-routing-mark")
            return f"meta mark set mark & {_PACKET_MARKS:#06x} | {self._table(name):#x}"
        if action == "mark-connection":
            return f"ct mark set {self._mark(self.row.get('new-connection-mark')):#x}"
        number = self._mark(self.row.get("new-packet-mark")) << 8
        return f"meta mark set mark & {ROUTING_MARKS:#06x} | {number:#x}"

    def _mark(self, name: str) -> int:
        return 0 if name == "no-mark" else self.marks.setdefault(name, len(self.marks) + 1)

    def _table(self, name: str) -> int:
        if name not in self.names.tables and name != "main":
            raise UntranslatableRow(f"routing table {name} does not exist")
        return self.names.tables.get(name, 0)

    # --- matchers --------------------------------------------------------------------------------------------------

    def _match(self, name: str, value: str) -> Iterator[str]:  # noqa: C901, PLR0912 - one branch a matcher
        is_not, plain_value = ("!= ", value[1:]) if value.startswith("!") else ("", value)
        side = name[0]
        if name in ("src-address", "dst-address"):
            yield f"ip {side}addr {is_not}{plain_value}"
        elif name in ("src-address-list", "dst-address-list"):
            yield f"ip {side}addr {is_not}@{_set(plain_value)}"
        elif name in ("src-address-type", "dst-address-type"):
            yield f"fib {side}addr type {is_not}{{ {plain_value.replace(',', ', ')} }}"
        elif name in ("in-interface", "out-interface"):
            yield f"{side}ifname {is_not}{self.names.device(plain_value)}"
        elif name in ("in-interface-list", "out-interface-list"):
            members = map(self.names.device, self.names.interface_lists.get(plain_value, ()) or [_NO_DEVICE])
            yield f"{side}ifname {is_not}{{ {', '.join(members)} }}"
        elif name == "protocol":
            yield f"ip protocol {is_not}{plain_value}"
        elif name == "dscp":
            yield f"ip dscp {is_not}{plain_value}"
        elif name in ("dst-port", "src-port"):
            yield f"{self.row.get('protocol')} {side}port {is_not}{{ {plain_value.replace(',', ', ')} }}"
        elif name == "connection-state":
            yield f"ct state {is_not}{{ {plain_value.replace(',', ', ')} }}"
        elif name == "connection-nat-state":
            bit = _NAT_BITS[plain_value]
            yield f"ct status & {bit} == {'0x0' if is_not else bit}"
        elif name == "connection-mark":
            yield f"ct mark {is_not}{self._mark(plain_value):#x}"
        elif name == "packet-mark":
            yield f"meta mark & {_PACKET_MARKS:#06x} {is_not or '== '}{self._mark(plain_value) << 8:#x}"
        elif name == "routing-mark":
            yield f"meta mark & {ROUTING_MARKS:#06x} {is_not or '== '}{self._table(plain_value):#x}"
        elif name == "tcp-flags":
            yield _tcp_flags(value)
        elif name == "tcp-mss":
            yield f"tcp option maxseg size {is_not}{plain_value}"
        elif name == "icmp-options":
            yield f"icmp type {is_not}{plain_value.partition(':')[0]}"
        elif name == "limit":
            yield _limit(plain_value)
        elif name == "dst-limit":
            yield self._limit_per_address(plain_value)
        else:
            raise UntranslatableRow(f"unknown matcher {name}")

    def _limit_per_address(self, value: str) -> str:
        """Translate `32,32,src-address/10s`: rate, burst, and for each address of which end."""
        rate, burst, mode = value.split(",")
        of, _, forget = mode.partition("/")
        ends = {"src-address": "ip saddr", "dst-address": "ip daddr"}
        if of not in ends:
            raise UntranslatableRow(f"unknown limit {value}")
        name = f"m_{len(self.meters)}"
        self.meters[name] = forget or "10s"
        return f"update @{name} {{ {ends[of]} {_limit(f'{rate},{burst}')} }}"


def _tcp_flags(value: str) -> str:
    """Translate `syn,!ack`: flags that are set and flags that are not."""
    flags = value.split(",")
    mask = "|".join(flag.removeprefix("!") for flag in flags)
    present = "|".join(flag for flag in flags if not flag.startswith("!")) or "0x0"
    return f"tcp flags & ({mask}) == {present}"


def _limit(value: str) -> str:
    """Translate `10/1m,5:packet` or `10,5`: so many a time (a second by default), and a burst."""
    rate, _, burst = value.removesuffix(":packet").partition(",")
    count, _, unit = rate.partition("/")
    units = {"": "second", "1s": "second", "1m": "minute", "1h": "hour", "1d": "day"}
    if unit not in units or not burst.isdecimal():
        raise UntranslatableRow(f"unknown limit {value}")
    return f"limit rate {count}/{units[unit]} burst {burst} packets"


def _chain(menu: str, name: str) -> str:
    """Return a chain's name: nft has one name space for what are four menus here, and keywords."""
    return f"{menu.rpartition('/')[2]}_{_NO_WORD.sub('_', name)}"


def _set(name: str) -> str:
    return f"l_{_NO_WORD.sub('_', name)}"
