"""What nftables does with a packet, from the text of the translated rules; knows nothing of the router's words.

Semantics after the manual page nft(8): a rule applies if all its matches do; accept and drop end the walk, return goes
back to the calling chain and ends a base chain with its policy, a jump comes back, log goes on.
"""

import re
from dataclasses import dataclass
from ipaddress import ip_address, ip_network

from atlantis_netcfg.emulator.routeros.dataplane.ruleset import FILTER, NftRule, NftRuleset

_BITS = {"srcnat": 0x10, "dstnat": 0x20}


@dataclass(frozen=True)
class Nft:
    """A packet in the words of nft(8)."""

    saddr: str
    daddr: str
    iifname: str
    oifname: str
    protocol: str
    sport: int
    dport: int
    state: str
    status: int
    dscp: int = 0

    def field(self, words: str) -> str | int | None:
        """The value of an expression; None where the packet has no such field, so that nothing can match it."""
        if words in ("tcp dport", "udp dport", "tcp sport", "udp sport"):
            protocol, which = words.split()
            return getattr(self, which) if protocol == self.protocol else None
        known: dict[str, str | int] = {
            "ip saddr": self.saddr,
            "ip daddr": self.daddr,
            "iifname": self.iifname,
            "oifname": self.oifname,
            "ip protocol": self.protocol,
            "ct state": self.state,
            "ip dscp": self.dscp,
        }
        return known[words]


def status_of(nat_state: frozenset[str]) -> int:
    return sum(_BITS[one] for one in nat_state)


def passes(ruleset: NftRuleset, chain: str, packet: Nft) -> bool:
    """Whether a base chain with policy accept lets the packet go on."""
    return _walk(ruleset, chain, packet) not in ("drop", "reject")


def _walk(ruleset: NftRuleset, chain: str, packet: Nft) -> str | None:
    for rule in ruleset.rules:
        if (rule.menu, rule.chain.replace("-", "_")) != (FILTER, chain) or not all(
            _holds(ruleset, match, packet) for match in rule.matches
        ):
            continue
        verdict = _verdict(ruleset, rule, packet)
        if verdict == "return":
            return None
        if verdict is not None:
            return verdict
    return None


def _verdict(ruleset: NftRuleset, rule: NftRule, packet: Nft) -> str | None:
    if rule.action in ("accept", "drop", "return"):
        return rule.action
    if rule.action.startswith("reject "):
        return "reject"
    if rule.action.startswith("jump filter_"):
        return _walk(ruleset, rule.action.removeprefix("jump filter_"), packet)
    assert rule.action.startswith("log "), rule.action
    return None


_MATCH = re.compile(r"(?P<field>[a-z]+(?: [a-z]+)?) (?P<negated>!= )?(?P<value>[^!].*)")


def _holds(ruleset: NftRuleset, match: str, packet: Nft) -> bool:
    if match.startswith("limit "):
        return True
    if match.startswith("ct status & "):
        bit, _, wanted = match.removeprefix("ct status & ").partition(" == ")
        return packet.status & int(bit, 16) == int(wanted, 16)
    parsed = _MATCH.fullmatch(match)
    assert parsed, match
    found = packet.field(parsed["field"])
    if found is None:
        return False
    return _is(ruleset, found, parsed["value"]) != bool(parsed["negated"])


def _is(ruleset: NftRuleset, found: str | int, value: str) -> bool:
    if value.startswith("@"):
        return any(_is(ruleset, found, one) for one in ruleset.sets[value[1:]])
    if value.startswith("{"):
        return any(_is(ruleset, found, one.strip()) for one in value.strip("{ }").split(","))
    plain = value.strip('"')
    if isinstance(found, str) and found[:1].isdigit() and plain[:1].isdigit():
        return ip_address(found) in ip_network(plain)
    return str(found) == plain
