"""The IPv4 firewall.

Values and defaults: Manual, CLI reference of `/ip/firewall/filter`, `nat`, `mangle`, `raw` and `address-list`;
verbose exports of RouterOS 7.19.
"""

from __future__ import annotations

from atlantis_netcfg.emulator.routeros.menus._model import (
    COMMENT,
    DISABLED_ARG,
    Arg,
    EmulatedMenu,
    Shape,
    Unique,
    of_schema,
)
from atlantis_netcfg.emulator.routeros.schema import offered_values
from atlantis_netcfg.emulator.routeros.values import (
    Address,
    Bool,
    Choice,
    Choices,
    Int,
    Mac,
    Matcher,
    Not,
    Pattern,
    Ports,
    Ref,
    Text,
    Time,
    ValueType,
)
from atlantis_netcfg.routeros import menus as schema

_FILTER = "/ip/firewall/filter"
_PROTOCOLS = (*offered_values(_FILTER, "protocol"), *map(str, range(256)))
_ANY_INTERFACE = Ref(("interface",), ("all-ethernet", "all-ppp", "all-vlan", "all-wireless"))
_ANY_LIST = Ref(("list",))
_ADDRESS_TYPES = Choices(("unicast", "local", "broadcast", "multicast", "blackhole"))
_STATES = Choices(("invalid", "established", "related", "new", "untracked"))
_NUMBER = r"\d+"
_RANGE = r"\d+(-\d+)?"

_MATCHERS: dict[str, ValueType] = {
    "connection-bytes": Pattern(r"\d+-\d+"),
    "connection-limit": Not(Pattern(r"\d+,\d+")),
    "connection-mark": Not(Text(empty=False)),
    "connection-nat-state": Not(Choices(("srcnat", "dstnat", "ein-snat", "ein-dnat"))),
    "connection-rate": Not(Pattern(r"\d+[kMG]?-\d+[kMG]?")),
    "connection-state": Not(_STATES),
    "connection-type": Not(Choice(("ftp", "h323", "irc", "pptp", "quake3", "sip", "tftp"))),
    "content": Not(Text(empty=False)),
    "dscp": Not(Int(0, 63)),
    "dst-address": Not(Matcher()),
    "dst-address-list": Not(Text(empty=False)),
    "dst-address-type": Not(_ADDRESS_TYPES),
    "dst-limit": Pattern(r"\d+(/\w+)?,\d+,[a-z-]+(/\w+)?"),
    "dst-port": Not(Ports()),
    "fragment": Bool(),
    "hotspot": Not(Choices(offered_values(_FILTER, "hotspot"), is_ordered=False)),
    "icmp-options": Not(Pattern(r"\d{1,3}(:\d{1,3}(-\d{1,3})?)?")),
    "in-bridge-port": Not(_ANY_INTERFACE),
    "in-bridge-port-list": Not(_ANY_LIST),
    "in-interface": Not(_ANY_INTERFACE),
    "in-interface-list": Not(_ANY_LIST),
    "ingress-priority": Not(Int(0, 63)),
    "ipsec-policy": Pattern(r"(in|out),(ipsec|none)"),
    "ipv4-options": Choice(offered_values(_FILTER, "ipv4-options")),
    "layer7-protocol": Not(Text(empty=False)),
    "limit": Not(Pattern(r"\d+[kMG]?(/\w+)?,\d+[kMG]?(:(packet|bit))?")),
    "nth": Not(Pattern(r"\d+(,\d+)?")),
    "out-bridge-port": Not(_ANY_INTERFACE),
    "out-bridge-port-list": Not(_ANY_LIST),
    "out-interface": Not(_ANY_INTERFACE),
    "out-interface-list": Not(_ANY_LIST),
    "p2p": Not(Choice(offered_values(_FILTER, "p2p"))),
    "packet-mark": Not(Text(empty=False)),
    "packet-size": Not(Pattern(_RANGE)),
    "per-connection-classifier": Not(Pattern(r"[a-z-]+:\d+/\d+")),
    "port": Not(Ports()),
    "priority": Not(Int(0, 255)),  # the Manual says 63, an export of 7.16 has 100 and 110
    "protocol": Not(Choice(_PROTOCOLS)),
    "psd": Pattern(r"\d+,\w+,\d+,\d+"),
    "random": Int(1, 99),
    "realm": Not(Int()),
    "routing-mark": Not(Text(empty=False)),
    "src-address": Not(Matcher()),
    "src-address-list": Not(Text(empty=False)),
    "src-address-type": Not(_ADDRESS_TYPES),
    "src-mac-address": Not(Mac()),
    "src-port": Not(Ports()),
    "tcp-flags": Choices(("fin", "syn", "rst", "psh", "ack", "urg", "ece", "cwr"), has_signs=True),
    "tcp-mss": Not(Pattern(_RANGE)),
    "time": Not(Pattern(r"[\dhms:]+-[\dhms:d]+,[a-z,]+")),
    "tls-host": Not(Text(empty=False)),
    "tos": Not(Pattern(r"\d+(/\d+)?")),
    "ttl": Pattern(r"(equal|greater-than|less-than|not-equal):\d{1,3}"),
}

_COMMON = (
    Arg("address-list", Text(empty=False)),
    Arg("address-list-timeout", Time(0, 21474836, words=("none-dynamic", "none-static"))),
    Arg("chain", Text(empty=False), is_required=True, always=True),
    COMMENT,
    DISABLED_ARG,
    Arg("jump-target", Text(empty=False)),
    Arg("log", Bool(), "no"),
    Arg("log-prefix", Text(longest=31), ""),
)


def _rules(path: str, noun: str, *further: Arg) -> EmulatedMenu:
    """Make a table of rules: arguments of its own, those of every rule, and the matchers."""
    schema_arguments = schema.MENUS[path].by_name if path in schema.MENUS else {}
    action = Arg("action", Choice(offered_values(path, "action")), "accept", always=True)
    local = (
        action,
        *further,
        *_COMMON,
        *(Arg(name, kind) for name, kind in _MATCHERS.items() if name not in schema_arguments),
    )
    if schema_arguments:
        return of_schema(path, noun=noun, kinds=_MATCHERS, local=local, flags=("dynamic", "invalid"))
    return EmulatedMenu(
        path, Shape.LIST, tuple(sorted(local, key=lambda arg: arg.name)), noun, flags=("dynamic", "invalid")
    )


_MARK = Text(empty=False)
_MARKING = (
    "change-dscp|change-mss|change-ttl|clear-df|mark-connection|mark-packet|mark-routing|route|set-priority|"
    "strip-ipv4-options"
)
_REJECT = Choice(offered_values(_FILTER, "reject-with"))

MENUS = (
    of_schema(
        "/ip/firewall/address-list",
        noun="address list entry",
        local=(
            Arg("address", Matcher(dns=True), "0.0.0.0/0", always=True),
            Arg("dynamic", Bool(), "no", never=True, is_exported=False),
            Arg("list", Text(empty=False), is_required=True, always=True),
            Arg("timeout", Time(0, 21474836), is_exported=False),
        ),
        name_property="address",
        unique=(Unique(("address", "list"), "failure: already have such entry"),),
        flags=("dynamic",),
    ),
    _rules(
        _FILTER,
        "filter rule",
        Arg("hw-offload", Bool(), "yes", shown_if=("action", "fasttrack-connection"), always=True),
        Arg("reject-with", _REJECT, "icmp-network-unreachable", shown_if=("action", "reject"), always=True),
    ),
    _rules(
        "/ip/firewall/nat",
        "nat rule",
        Arg("randomise-ports", Bool()),
        Arg("same-not-by-dst", Bool()),
        Arg("socks5-port", Int(1, 65535)),
        Arg("socks5-server", Address(v6=False)),
        Arg("socksify-service", Text()),
        Arg("to-addresses", Matcher()),
        Arg("to-ports", Ports(single=True)),
    ),
    _rules(
        "/ip/firewall/mangle",
        "mangle rule",
        Arg("new-connection-mark", _MARK),
        Arg("new-dscp", Int(0, 63, words=("from-priority", "from-priority-to-high-3-bits"))),
        Arg("new-mss", Int(40, 65534, words=("clamp-to-pmtu",))),
        Arg("new-packet-mark", _MARK),
        Arg("new-priority", Int(0, 63, words=("from-dscp", "from-dscp-high-3-bits", "from-ingress"))),
        Arg("new-routing-mark", Ref(("table",))),
        Arg("new-ttl", Pattern(r"(decrement|increment|set):\d{1,3}")),
        Arg("passthrough", Bool(), "yes", shown_if=("action", _MARKING), always=True),
        Arg("route-dst", Address(v6=False)),
        Arg("sniff-id", Int()),
        Arg("sniff-target", Address(v6=False)),
        Arg("sniff-target-port", Int(0, 65535)),
    ),
    _rules("/ip/firewall/raw", "raw rule", Arg("reject-with", _REJECT)),
)
