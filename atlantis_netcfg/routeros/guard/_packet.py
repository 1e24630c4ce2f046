"""Does a rule match a packet: yes, no, or nobody can tell from here (Manual, Filter: matchers)."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from ipaddress import IPv4Address, ip_network
from typing import TYPE_CHECKING

from atlantis_netcfg.routeros.guard._state import is_set
from atlantis_netcfg.routeros.menus import MENUS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from atlantis_netcfg.routeros._types import Row
    from atlantis_netcfg.routeros.guard._state import State


class Answer(IntEnum):
    """Ordered, so that the least of several answers is that of all together."""

    NO = 0
    MAYBE = 1
    YES = 2


@dataclass(frozen=True, slots=True)
class Packet:
    """A TCP packet of our session, as far as rules can ask about it; None is not known."""

    source: IPv4Address
    target: IPv4Address
    source_port: int | None
    target_port: int | None
    state: str
    """Of its connection: `new` or `established`."""
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


def matches(menu: str, rule: Row, packet: Packet, state: State) -> Answer:
    """Return the answer of all matchers of a rule together; one that is not understood makes the answer MAYBE."""
    fields = MENUS[menu].by_name
    answers = [
        _rule(name, value, packet, state)
        for name, value in rule.items()
        if name in fields and name not in _NO_MATCHERS and value
    ]
    if is_set(rule, "invalid"):
        answers.append(Answer.MAYBE)
    return min(answers, default=Answer.YES)


def _rule(name: str, value: str, packet: Packet, state: State) -> Answer:
    judge = _JUDGES.get(name)
    if judge is None:
        return Answer.MAYBE
    answer = judge(value.removeprefix("!"), packet, state)
    return Answer(Answer.YES - answer) if value.startswith("!") else answer


def _yes(condition: bool) -> Answer:  # noqa: FBT001 - the answer to a question
    return Answer.YES if condition else Answer.NO


def _in_network(text: str, address: IPv4Address) -> Answer:
    first, dash, last = text.partition("-")
    try:
        if dash:
            return _yes(IPv4Address(first) <= address <= IPv4Address(last))
        return _yes(address in ip_network(text, strict=False))
    except ValueError:
        return Answer.MAYBE


def in_networks(text: str, address: IPv4Address) -> Answer:
    """Tell whether one of several prefixes or ranges holds the address; none given means that all do."""
    return max((_in_network(each, address) for each in text.split(",") if each), default=Answer.YES)


def in_list(state: State, name: str, address: IPv4Address) -> Answer:
    """Tell whether an address list holds the address; entries that are names count as MAYBE."""
    entries = (row for row in state.enabled("/ip/firewall/address-list") if row.get("list") == name)
    return max((_in_network(row.get("address", ""), address) for row in entries), default=Answer.NO)


def _on_interface(text: str, name: str | None, state: State) -> Answer:
    if name is None:
        return Answer.MAYBE
    if text == "all-ethernet":
        return _yes(state.find("/interface/ethernet", "name", name) is not None)
    return Answer.MAYBE if text.startswith("all-") else _yes(text == name)


def _on_list(text: str, name: str | None, state: State, seen: frozenset[str] = frozenset()) -> Answer:
    """Manual, Interface Lists: members, plus those of `include`, less those of `exclude`."""
    if text in ("all", "none") or text in seen:
        return _yes(text == "all")
    if name is None or text in ("dynamic", "static"):
        return Answer.MAYBE
    row = state.find("/interface/list", "name", text) or {}
    if any(_on_list(each, name, state, seen | {text}) for each in row.get("exclude", "").split(",") if each):
        return Answer.NO
    members = (each for each in state.enabled("/interface/list/member") if each.get("list") == text)
    if any(each.get("interface") == name for each in members):
        return Answer.YES
    included = (_on_list(each, name, state, seen | {text}) for each in row.get("include", "").split(",") if each)
    return max(included, default=Answer.NO)


def _has_port(text: str, ports: Iterable[int | None]) -> Answer:
    known = [port for port in ports if port is not None]
    if any(_is_port_in(text, port) for port in known):
        return Answer.YES
    return Answer.NO if len(known) == len(tuple(ports)) else Answer.MAYBE


def _is_port_in(text: str, port: int) -> bool:
    for part in text.split(","):
        first, dash, last = part.partition("-")
        if first.isdecimal() and (last or first).isdecimal() and int(first) <= port <= int(last if dash else first):
            return True
    return False


def _words(text: str) -> set[str]:
    return set(text.split(","))


_JUDGES: Mapping[str, Callable[[str, Packet, State], Answer]] = {
    "src-address": lambda text, packet, _: _in_network(text, packet.source),
    "dst-address": lambda text, packet, _: _in_network(text, packet.target),
    "src-address-list": lambda text, packet, state: in_list(state, text, packet.source),
    "dst-address-list": lambda text, packet, state: in_list(state, text, packet.target),
    "in-interface": lambda text, packet, state: _on_interface(text, packet.in_interface, state),
    "out-interface": lambda text, packet, state: _on_interface(text, packet.out_interface, state),
    "in-interface-list": lambda text, packet, state: _on_list(text, packet.in_interface, state),
    "out-interface-list": lambda text, packet, state: _on_list(text, packet.out_interface, state),
    "protocol": lambda text, *_: _yes(text in ("tcp", "6")),
    "src-port": lambda text, packet, _: _has_port(text, (packet.source_port,)),
    "dst-port": lambda text, packet, _: _has_port(text, (packet.target_port,)),
    "port": lambda text, packet, _: _has_port(text, (packet.source_port, packet.target_port)),
    "connection-state": lambda text, packet, _: _yes(packet.state in _words(text)),
    "connection-nat-state": lambda *_: Answer.NO,
    "fragment": lambda text, *_: _yes(text in ("no", "false")),
    "icmp-options": lambda *_: Answer.NO,
    "ipsec-policy": lambda text, *_: _yes(text.endswith(",none")),
}
