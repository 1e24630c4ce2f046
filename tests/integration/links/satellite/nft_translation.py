"""The router's filter and source NAT as nftables, rule by rule; an unknown matcher or action is an error.

Both sit on the same hooks of Linux' netfilter with the same connection tracking, so a chain, a jump, a return and a
state mean the same. One rule of the router becomes one rule here (its comment and a counter with it), but for these:
`connection-nat-state` is two bits of `ct status`; an address list is a set; an interface list is an anonymous set.
Not translated: disabled rows, which the desired text has none of, and mangle, which only changes the MSS.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from atlantis_netcfg.routeros.rsc import Export, Statement

FILTER, NAT = "/ip/firewall/filter", "/ip/firewall/nat"
_HOOKS = {
    "input": "type filter hook input priority filter",
    "forward": "type filter hook forward priority filter",
    "output": "type filter hook output priority filter",
    "srcnat": "type nat hook postrouting priority srcnat",
    "dstnat": "type nat hook prerouting priority dstnat",
}
"""RouterOS' chains and the hooks that they are (Manual, Packet Flow)."""
_NAT_BITS = {"srcnat": "0x10", "dstnat": "0x20"}
"""IPS_SRC_NAT and IPS_DST_NAT of linux/netfilter/nf_conntrack_common.h."""
_SILENT = frozenset({"action", "chain", "comment", "jump-target", "log-prefix", "reject-with", "to-addresses"})


@dataclass(frozen=True)
class Rule:
    """One rule of nftables: what it matches, word for word, and what it does."""

    chain: str
    matches: tuple[str, ...]
    action: str
    comment: str

    def text(self) -> str:
        remark = self.comment.replace('"', "'")
        return " ".join([*self.matches, "counter", self.action, f'comment "{remark}"'])


@dataclass(frozen=True)
class Ruleset:
    rules: tuple[Rule, ...]
    sets: dict[str, tuple[str, ...]]

    def text(self, extra: Sequence[str] = ()) -> str:
        """A whole table for `nft -f`; `extra` are lines of the caller's own."""
        chains = dict.fromkeys([*_HOOKS, *(rule.chain for rule in self.rules), *self._targets()])
        lines = ["table ip atlantis {"]
        for name, addresses in self.sets.items():
            held = f"elements = {{ {', '.join(addresses)} }};" if addresses else ""
            lines.append(f"set {name} {{ type ipv4_addr; flags interval; auto-merge; {held} }}")
        for chain in chains:
            hook = f"{_HOOKS[chain]}; policy accept;" if chain in _HOOKS else ""
            rules = [rule.text() for rule in self.rules if rule.chain == chain]
            lines += [f"chain {_name(chain)} {{", hook, *rules, "}"]
        return "\n".join([*lines, *extra, "}"])

    def _targets(self) -> Iterator[str]:
        for rule in self.rules:
            if rule.action.startswith("jump "):
                yield rule.action.removeprefix("jump c_")


def translate(export: Export) -> Ruleset:
    """Translate the whole firewall of a rendered text."""
    lists = _grouped(export, "/ip/firewall/address-list", "address")
    members = _grouped(export, "/interface/list/member", "interface")
    rows = [row for row in export.statements if row.menu in (FILTER, NAT)]
    named = {value.removeprefix("!") for row in rows for name, value in row.values if name in _LISTS and value}
    sets = {_set(name): lists.get(name, ()) for name in sorted(named | set(lists))}
    return Ruleset(tuple(_rule(row, members) for row in rows), sets)


_LISTS = ("src-address-list", "dst-address-list")


def _rule(row: Statement, members: dict[str, tuple[str, ...]]) -> Rule:
    matches = [
        word
        for name, value in row.values
        if name not in _SILENT
        for word in _match(name, str(value), str(row.get("protocol")), members)
    ]
    return Rule(str(row.get("chain")), tuple(sorted(matches, key=_last)), _action(row), str(row.get("comment")))


def _last(match: str) -> bool:
    """A limit counts what it meets, so it has to stand behind every other matcher, as RouterOS evaluates it."""
    return match.startswith("limit ")


def _action(row: Statement) -> str:
    action = str(row.get("action"))
    if action in ("accept", "drop", "return", "masquerade"):
        return action
    if action == "jump":
        return f"jump {_name(str(row.get('jump-target')))}"
    if action == "log":
        return f'log prefix "{row.get("log-prefix")} "'
    if action == "reject":
        return f"reject with icmp type {str(row.get('reject-with')).removeprefix('icmp-')}"
    if action == "dst-nat":
        return f"dnat to {row.get('to-addresses')}"
    raise ValueError(f"unknown action {action}")


def _match(name: str, value: str, protocol: str, members: dict[str, tuple[str, ...]]) -> Iterator[str]:
    negated, wanted = value.startswith("!"), value.removeprefix("!")
    is_not = "!= " if negated else ""
    side, _, rest = name.partition("-")
    if name in ("src-address", "dst-address"):
        yield f"ip {side[0]}addr {is_not}{wanted}"
    elif name in _LISTS:
        yield f"ip {side[0]}addr {is_not}@{_set(wanted)}"
    elif name in ("in-interface", "out-interface"):
        yield f'{side[0]}ifname {is_not}"{wanted}"'
    elif name in ("in-interface-list", "out-interface-list"):
        quoted = ", ".join(f'"{member}"' for member in members.get(wanted, ())) or '"nothing"'
        yield f"{side[0]}ifname {is_not}{{ {quoted} }}"
    elif name in ("dscp", "protocol"):
        yield f"ip {name} {is_not}{wanted}"
    elif name in ("dst-port", "src-port"):
        yield f"{protocol} {side[0]}port {is_not}{{ {wanted.replace(',', ', ')} }}"
    elif name == "connection-state":
        yield f"ct state {is_not}{{ {wanted.replace(',', ', ')} }}"
    elif name == "connection-nat-state":
        bit = _NAT_BITS[wanted]
        yield f"ct status & {bit} == {'0x0' if negated else bit}"
    elif name == "limit":
        yield _limit(wanted)
    else:
        raise ValueError(f"unknown matcher {name} ({rest})")


def _limit(value: str) -> str:
    """Translate `10/1m,5:packet`: so many a time, and a burst."""
    rate, _, burst = value.removesuffix(":packet").partition(",")
    count, _, unit = rate.partition("/")
    return f"limit rate {count}/{ {'1s': 'second', '1m': 'minute', '1h': 'hour'}[unit] } burst {burst} packets"


def _name(chain: str) -> str:
    """A chain's name; ours begin with a letter and have no digit first, `c_` keeps them apart from keywords of nft."""
    return f"c_{chain}"


def _set(name: str) -> str:
    return f"l_{name}"


def _grouped(export: Export, menu: str, column: str) -> dict[str, tuple[str, ...]]:
    found: dict[str, list[str]] = {}
    for row in export.statements:
        if row.menu == menu:
            found.setdefault(str(row.get("list")), []).append(str(row.get(column)))
    return {name: tuple(values) for name, values in found.items()}
