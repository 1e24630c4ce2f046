"""Effect of the firewall on our packets: a new session inwards, its replies outwards.

The verification after a change uses a new session, so a new session must pass; the existing one is `established` and
survives under most rules. A rule that we cannot evaluate counts against us: it may drop us, but never lets us in.

A rule matches a packet: yes, no, or unknown (Manual, Filter: matchers).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from ipaddress import IPv4Address, ip_network
from typing import TYPE_CHECKING

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.routeros._types import Row, is_bare
from atlantis_netcfg.routeros.guard._route import return_route
from atlantis_netcfg.routeros.guard._state import State, is_set
from atlantis_netcfg.routeros.menus import MENUS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping


class MatchResult(IntEnum):
    """Ordered, so that the minimum of several results is their conjunction."""

    NO = 0
    MAYBE = 1
    YES = 2


@dataclass(frozen=True, slots=True)
class Packet:
    """A TCP packet of our session, with the fields that rules can match; None is unknown."""

    source: IPv4Address
    target: IPv4Address
    source_port: int | None
    target_port: int | None
    state: str
    """State of the packet's connection: `new` or `established`."""
    in_interface: str | None = None
    out_interface: str | None = None


_NO_MATCHERS = frozenset(
    {
        *("chain", "action", "comment", "log", "log-prefix", "disabled", "jump-target", "reject-with", "hw-offload"),
        *("address-list", "address-list-timeout", "to-addresses", "to-ports", "randomise-ports", "same-not-by-dst"),
        *("passthrough", "new-connection-mark", "new-dscp", "new-mss", "new-packet-mark", "new-priority"),
        *("new-routing-mark", "new-ttl", "route-dst", "sniff-id", "sniff-target", "sniff-target-port"),
        *("socks5-port", "socks5-server", "socksify-service"),
    }
)


def matches(menu: str, rule: Row, packet: Packet, state: State) -> MatchResult:
    """Return the combined result of all matchers of a rule; an unknown matcher makes it MAYBE."""
    fields = MENUS[menu].by_name
    answers = [
        _match_condition(name, value, packet, state)
        for name, value in rule.items()
        if name in fields and name not in _NO_MATCHERS and value
    ]
    if is_set(rule, "invalid"):
        answers.append(MatchResult.MAYBE)
    return min(answers, default=MatchResult.YES)


def _match_condition(name: str, value: str, packet: Packet, state: State) -> MatchResult:
    judge = _JUDGES.get(name)
    if judge is None:
        return MatchResult.MAYBE
    answer = judge(value.removeprefix("!"), packet, state)
    return MatchResult(MatchResult.YES - answer) if value.startswith("!") else answer


def _match_result(condition: bool) -> MatchResult:  # noqa: FBT001 - the answer to a question
    return MatchResult.YES if condition else MatchResult.NO


def _match_network(text: str, address: IPv4Address) -> MatchResult:
    first, dash, last = text.partition("-")
    try:
        if dash:
            return _match_result(IPv4Address(first) <= address <= IPv4Address(last))
        return _match_result(address in ip_network(text, strict=False))
    except ValueError:
        return MatchResult.MAYBE


def in_networks(text: str, address: IPv4Address) -> MatchResult:
    """Match the address against a list of prefixes or ranges; an empty list matches all."""
    return max((_match_network(each, address) for each in text.split(",") if each), default=MatchResult.YES)


def in_list(state: State, name: str, address: IPv4Address) -> MatchResult:
    """Match the address against an address list; entries that are names count as MAYBE."""
    entries = (row for row in state.enabled_rows("/ip/firewall/address-list") if row.get("list") == name)
    return max((_match_network(row.get("address", ""), address) for row in entries), default=MatchResult.NO)


def _match_interface(text: str, name: str | None, state: State) -> MatchResult:
    if name is None:
        return MatchResult.MAYBE
    if text == "all-ethernet":
        return _match_result(state.find("/interface/ethernet", "name", name) is not None)
    return MatchResult.MAYBE if text.startswith("all-") else _match_result(text == name)


def _on_list(text: str, name: str | None, state: State, visited_lists: frozenset[str] = frozenset()) -> MatchResult:
    """Match an interface against a list: members, plus `include`, minus `exclude` (Manual, Interface Lists)."""
    if text in ("all", "none") or text in visited_lists:
        return _match_result(text == "all")
    if name is None or text in ("dynamic", "static"):
        return MatchResult.MAYBE
    row = state.find("/interface/list", "name", text) or {}
    if any(_on_list(each, name, state, visited_lists | {text}) for each in row.get("exclude", "").split(",") if each):
        return MatchResult.NO
    members = (each for each in state.enabled_rows("/interface/list/member") if each.get("list") == text)
    if any(each.get("interface") == name for each in members):
        return MatchResult.YES
    included_matches = (
        _on_list(each, name, state, visited_lists | {text}) for each in row.get("include", "").split(",") if each
    )
    return max(included_matches, default=MatchResult.NO)


def _match_port(text: str, ports: Iterable[int | None]) -> MatchResult:
    known_ports = [port for port in ports if port is not None]
    if any(_is_port_in(text, port) for port in known_ports):
        return MatchResult.YES
    return MatchResult.NO if len(known_ports) == len(tuple(ports)) else MatchResult.MAYBE


def _is_port_in(text: str, port: int) -> bool:
    for part in text.split(","):
        first, dash, last = part.partition("-")
        if first.isdecimal() and (last or first).isdecimal() and int(first) <= port <= int(last if dash else first):
            return True
    return False


def _words(text: str) -> set[str]:
    return set(text.split(","))


_JUDGES: Mapping[str, Callable[[str, Packet, State], MatchResult]] = {
    "src-address": lambda text, packet, _: _match_network(text, packet.source),
    "dst-address": lambda text, packet, _: _match_network(text, packet.target),
    "src-address-list": lambda text, packet, state: in_list(state, text, packet.source),
    "dst-address-list": lambda text, packet, state: in_list(state, text, packet.target),
    "in-interface": lambda text, packet, state: _match_interface(text, packet.in_interface, state),
    "out-interface": lambda text, packet, state: _match_interface(text, packet.out_interface, state),
    "in-interface-list": lambda text, packet, state: _on_list(text, packet.in_interface, state),
    "out-interface-list": lambda text, packet, state: _on_list(text, packet.out_interface, state),
    "protocol": lambda text, *_: _match_result(text in ("tcp", "6")),
    "src-port": lambda text, packet, _: _match_port(text, (packet.source_port,)),
    "dst-port": lambda text, packet, _: _match_port(text, (packet.target_port,)),
    "port": lambda text, packet, _: _match_port(text, (packet.source_port, packet.target_port)),
    "connection-state": lambda text, packet, _: _match_result(packet.state in _words(text)),
    "connection-nat-state": lambda *_: MatchResult.NO,
    "fragment": lambda text, *_: _match_result(text in ("no", "false")),
    "icmp-options": lambda *_: MatchResult.NO,
    "ipsec-policy": lambda text, *_: _match_result(text.endswith(",none")),
}


FILTER, NAT, MANGLE = "/ip/firewall/filter", "/ip/firewall/nat", "/ip/firewall/mangle"

_DROPS = frozenset({"drop", "reject", "tarpit"})
_TURNS = frozenset({"dst-nat", "redirect", "netmap"})


def service_port(state: State) -> int | None:
    """Return the port of the service that we talk to."""
    text = (state.find("/ip/service", "name", state.path.service) or {}).get("port", "")
    return int(text) if text.isdecimal() else None


def new_session(state: State) -> Packet:
    """Return the first packet of a new session of ours."""
    return Packet(
        source=state.technician,
        target=state.local,
        source_port=None,
        target_port=service_port(state),
        state="new",
        in_interface=return_route(state).interface,
    )


def answer_of(state: State) -> Packet:
    """Return a packet of the router's reply."""
    return Packet(
        source=state.local,
        target=state.technician,
        source_port=service_port(state),
        target_port=None,
        state="established",
        out_interface=return_route(state).interface,
    )


@dataclass(frozen=True, slots=True)
class _PacketCheck:
    """A chain, and the kind of packet for which its rules are checked."""

    menu: str
    chain: str
    packet: Callable[[State], Packet]
    harms: Callable[[Row], bool]
    words: str
    cure: str


_CHECKS = (
    _PacketCheck(
        FILTER,
        "input",
        new_session,
        lambda rule: rule.get("action") in _DROPS,
        "drop your new sessions",
        "add a rule above it that accepts your address and port",
    ),
    _PacketCheck(
        FILTER,
        "output",
        answer_of,
        lambda rule: rule.get("action") in _DROPS,
        "drop the router's responses to you",
        "add a rule above it that accepts them",
    ),
    _PacketCheck(
        NAT,
        "dstnat",
        new_session,
        lambda rule: rule.get("action") in _TURNS,
        "send your new sessions elsewhere",
        "restrict it to other addresses or ports",
    ),
    _PacketCheck(
        MANGLE,
        "output",
        answer_of,
        lambda rule: rule.get("action") == "mark-routing",
        "route the router's responses to you by another table",
        "exclude your address from it",
    ),
)


def firewall_objections(before: State, after: State) -> Iterator[str]:
    """Yield rules that block us after the change and did not before.

    If not all entries of the address lists were read, the state before is unknown.
    """
    unread = any(map(is_bare, before.all("/ip/firewall/address-list")))
    for check in _CHECKS:
        earlier_keys = frozenset() if unread else {_key(check, each) for each in _find_harms(check, before)}
        yield from (
            _harm_text(check, each) for each in _find_harms(check, after) if _key(check, each) not in earlier_keys
        )


@dataclass(frozen=True, slots=True)
class _Harm:
    rule: Row
    certain: bool


def _key(check: _PacketCheck, harm: _Harm) -> tuple[object, ...]:
    """Return a key that identifies a rule before and after the change, whatever its position."""
    menu = MENUS[check.menu]
    content = {name: menu.form(name, harm.rule) for name in harm.rule if name in menu.by_name}
    return harm.certain, *sorted((name, form) for name, form in content.items() if not menu.by_name[name].cosmetic)


def _harm_text(check: _PacketCheck, harm: _Harm) -> str:
    menu = MENUS[check.menu]
    may = "would" if harm.certain else "may"
    doubt = "" if harm.certain else " (it has conditions that cannot be evaluated here)"
    return msg(
        f"{arg(menu.title)}: the rule `{arg(menu.name_of(harm.rule))}` {arg(may)} {arg(check.words)}{arg(doubt)}: "
        f"{arg(check.cure)}"
    )


def _find_harms(check: _PacketCheck, state: State) -> list[_Harm]:
    walk = _Walk(check, state, check.packet(state))
    walk.through(check.chain, MatchResult.YES, frozenset())
    return walk.harms


@dataclass(slots=True)
class _Walk:
    """Simulates one packet passing through chains; YES, MAYBE and NO tell how surely it gets to a rule."""

    check: _PacketCheck
    state: State
    packet: Packet
    harms: list[_Harm] = field(default_factory=list)

    def through(self, chain: str, reach: MatchResult, callers: frozenset[str]) -> MatchResult:
        """Follow the packet through a chain and return how surely it comes out at its end."""
        return_reach = MatchResult.NO
        for rule in self.state.enabled_rows(self.check.menu):
            match = (
                matches(self.check.menu, rule, self.packet, self.state)
                if rule.get("chain") == chain
                else MatchResult.NO
            )
            if match is MatchResult.NO:
                continue
            goes_on = self._meet(rule, min(reach, match), callers | {chain})
            if goes_on is None:
                continue
            if rule.get("action") == "return":
                return_reach = max(return_reach, min(reach, match))
            reach = min(reach, goes_on) if match is MatchResult.YES else MatchResult.MAYBE
            if reach is MatchResult.NO:
                return return_reach
        return max(return_reach, reach)

    def _meet(self, rule: Row, surely: MatchResult, callers: frozenset[str]) -> MatchResult | None:
        """Return how surely the packet continues to the next rule; None if the rule does not affect it."""
        action, target = rule.get("action", "accept"), rule.get("jump-target", "")
        if self.check.harms(rule):
            self.harms.append(_Harm(rule, surely is MatchResult.YES))
            return MatchResult.NO
        if action in ("accept", "return"):
            return MatchResult.NO
        if action == "jump" and target not in callers:
            return self.through(target, surely, callers)
        return None
