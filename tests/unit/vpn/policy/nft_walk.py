"""What the kernel does with a packet, from the text of the ruleset alone: knows nothing of zones and permissions.

Semantics after nft(8): a rule applies if all its matches do; accept ends this table's say, drop ends the packet, goto
does not come back, and the end of a base chain is its policy. Words that are not known are an error.
"""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cache
from ipaddress import IPv4Address, IPv4Network


@dataclass(frozen=True)
class Packet:
    """In the words of nft(8); `saddr` of IPv6 is not looked at."""

    hook: str
    iifname: str
    oifname: str
    saddr: str
    daddr: str
    protocol: str
    sport: int = 0
    dport: int = 0
    icmp: str = ""
    state: str = "new"
    reply: bool = False
    spoofed: bool = False
    ipv6: bool = False


Test = Callable[[Packet], bool]


@dataclass(frozen=True)
class Rule:
    """What it asks, whether it counts or logs, and where the packet goes then."""

    asks: tuple[Test, ...]
    leaves: str
    verdict: str
    chain: str


@dataclass
class Table:
    """A ruleset."""

    sets: dict[str, frozenset[IPv4Network]] = field(default_factory=dict)
    chains: dict[str, list[Rule]] = field(default_factory=dict)
    hooks: dict[str, tuple[str, str]] = field(default_factory=dict)
    """Hook: chain and policy."""
    counters: set[str] = field(default_factory=set)

    def walk(self, packet: Packet) -> tuple[bool, tuple[str, ...]]:
        """Whether it passes, and what counts and logs it."""
        if packet.hook not in self.hooks:
            return True, ()
        chain, policy = self.hooks[packet.hook]
        seen: list[str] = []
        return (self._chain(chain, packet, seen) or policy) == "accept", tuple(seen)

    def _chain(self, name: str, packet: Packet, seen: list[str]) -> str | None:
        for rule in self.chains[name]:
            if not all(asks(packet) for asks in rule.asks):
                continue
            if rule.leaves:
                seen.append(rule.leaves)
            if rule.verdict in {"accept", "drop"}:
                return rule.verdict
            if rule.chain:
                told = self._chain(rule.chain, packet, seen)
                if told is not None or rule.verdict == "goto":
                    return told
        return None

    def rule(self, line: str) -> Rule:
        """Read a rule; sets and counters stand before it."""
        rest, asks = re.sub(r' comment "[^"]*"$', "", line), list[Test]()
        while (made := next(self._match(rest), None)) is not None:
            asks.append(made[0])
            rest = rest[made[1] :]
        leaves = ""
        if (found := re.match(r"counter name (p_\w+) ?", rest)) is not None:
            leaves, rest = found[1], rest[found.end() :]
            if leaves not in self.counters:
                raise ValueError(line)
        elif rest == 'limit rate 10/minute burst 20 packets log prefix "atlantis-vpn denied: " level notice':
            leaves, rest = "log", ""
        if (found := re.fullmatch(r"(accept|drop|goto|jump|)(?: (p_\w+))?", rest)) is None:
            raise ValueError(line)
        return Rule(tuple(asks), leaves, found[1], found[2] or "")

    def _match(self, rest: str) -> Iterator[tuple[Test, int]]:
        for pattern, make in _MATCHES:
            if (found := re.match(pattern + r"(?: |$)", rest)) is not None:
                yield make(self, *found.groups()), found.end()


def _name(_: Table, side: str, unlike: str) -> Test:
    wanted = not unlike
    return lambda packet: ((packet.iifname if side == "i" else packet.oifname) == "tun0") is wanted


def _address(table: Table, side: str, unlike: str, value: str) -> Test:
    networks = table.sets[value[1:]] if value.startswith("@") else {IPv4Network(value)}
    wanted = not unlike

    @cache
    def inside(text: str) -> bool:
        address = IPv4Address(text)
        return any(address in network for network in networks)

    return lambda packet: not packet.ipv6 and inside(packet.saddr if side == "s" else packet.daddr) is wanted


def _ports(_: Table, protocol: str, side: str, first: str, last: str | None) -> Test:
    ports = range(int(first), int(last or first) + 1)
    return lambda packet: packet.protocol == protocol and (packet.sport if side == "s" else packet.dport) in ports


def _icmp(_: Table, several: str | None, one: str | None) -> Test:
    types = (several or one or "").replace(" ", "").split(",")
    return lambda packet: packet.protocol == "icmp" and packet.icmp in types


def _state(_: Table, states: str) -> Test:
    return lambda packet: packet.state in states.split(",")


def _protocol(_: Table, protocol: str) -> Test:
    return lambda packet: packet.protocol == protocol


_MATCHES: tuple[tuple[str, Callable[..., Test]], ...] = (
    (r'([io])ifname (!= )?"tun0"', _name),
    (r"meta nfproto ipv6", lambda _: lambda packet: packet.ipv6),
    (r"fib saddr \. iif oif missing", lambda _: lambda packet: packet.spoofed),
    (r"ip ([sd])addr (!= )?(@[\w-]+|[\d./]+)", _address),
    (r"(udp|tcp) ([sd])port (\d+)(?:-(\d+))?", _ports),
    (r"icmp type (?:\{ ([a-z, -]+) \}|([a-z-]+))", _icmp),
    (r"meta l4proto (icmp|tcp|udp)", _protocol),
    (r"ct state ([a-z,]+)", _state),
    (r"ct direction reply", lambda _: lambda packet: packet.reply),
)


def parse(text: str) -> Table:
    """Read a file of ours. ValueError where nft would refuse it as well, as far as a line that is missing does that."""
    table, block = Table(), ""
    lines = [line.strip() for line in text.splitlines() if line.strip() and not line.strip().startswith("#")]
    if lines[:3] != [f"{words} inet p_atlantis_vpn{end}" for words, end in _HEAD] or lines.count("}") != _closing(
        lines
    ):
        raise ValueError("not a file of ours")
    for line in lines[3:]:
        if (found := re.fullmatch(r"(set|chain) (p_[\w-]+) \{", line)) is not None:
            block = found[2]
            if found[1] == "set":
                table.sets[block] = frozenset()
            else:
                table.chains[block] = []
        elif (found := re.fullmatch(r"counter (p_\w+) \{ \}", line)) is not None:
            table.counters.add(found[1])
        elif (found := re.fullmatch(r"elements = \{ (.*) \}", line)) is not None:
            table.sets[block] = frozenset(IPv4Network(one) for one in found[1].split(", "))
        elif (found := re.fullmatch(r"type filter hook (\w+) priority filter; policy (\w+);", line)) is not None:
            table.hooks[found[1]] = (block, found[2])
        elif line not in {"}", "type ipv4_addr", "flags interval"}:
            table.chains[block].append(table.rule(line))
    return table


_HEAD = (("add table", ""), ("delete table", ""), ("table", " {"))


def _closing(lines: list[str]) -> int:
    return sum(line.endswith("{") for line in lines)
