"""The IPv4 firewall.

Values and defaults: Manual, CLI reference of `/ip/firewall/filter`, `nat`, `mangle`, `raw` and `address-list`;
verbose exports of RouterOS 7.19.
"""

from __future__ import annotations

from atlantis_netcfg.emulator.routeros import values
from atlantis_netcfg.emulator.routeros.menus import _model
from atlantis_netcfg.emulator.routeros.schema import offered_values
from atlantis_netcfg.routeros import menus as schema

_FILTER = "/ip/firewall/filter"
_PROTOCOLS = (*offered_values(_FILTER, "protocol"), *map(str, range(256)))
_ANY_INTERFACE = values.Ref(("interface",), ("all-ethernet", "all-ppp", "all-vlan", "all-wireless"))
_ANY_LIST = values.Ref(("list",))
_ADDRESS_TYPES = values.Choices(("unicast", "local", "broadcast", "multicast", "blackhole"))
_STATES = values.Choices(("invalid", "established", "related", "new", "untracked"))
_NUMBER = r"\d+"
_RANGE = r"\d+(-\d+)?"

_MATCHERS: dict[str, values.ValueType] = {
    "connection-bytes": values.Pattern(r"\d+-\d+"),
    "connection-limit": values.Not(values.Pattern(r"\d+,\d+")),
    "connection-mark": values.Not(values.Text(empty=False)),
    "connection-nat-state": values.Not(values.Choices(("srcnat", "dstnat", "ein-snat", "ein-dnat"))),
    "connection-rate": values.Not(values.Pattern(r"\d+[kMG]?-\d+[kMG]?")),
    "connection-state": values.Not(_STATES),
    "connection-type": values.Not(values.Choice(("ftp", "h323", "irc", "pptp", "quake3", "sip", "tftp"))),
    "content": values.Not(values.Text(empty=False)),
    "dscp": values.Not(values.Int(0, 63)),
    "dst-address": values.Not(values.Matcher()),
    "dst-address-list": values.Not(values.Text(empty=False)),
    "dst-address-type": values.Not(_ADDRESS_TYPES),
    "dst-limit": values.Pattern(r"\d+(/\w+)?,\d+,[a-z-]+(/\w+)?"),
    "dst-port": values.Not(values.Ports()),
    "fragment": values.Bool(),
    "hotspot": values.Not(values.Choices(offered_values(_FILTER, "hotspot"), is_ordered=False)),
    "icmp-options": values.Not(values.Pattern(r"\d{1,3}(:\d{1,3}(-\d{1,3})?)?")),
    "in-bridge-port": values.Not(_ANY_INTERFACE),
    "in-bridge-port-list": values.Not(_ANY_LIST),
    "in-interface": values.Not(_ANY_INTERFACE),
    "in-interface-list": values.Not(_ANY_LIST),
    "ingress-priority": values.Not(values.Int(0, 63)),
    "ipsec-policy": values.Pattern(r"(in|out),(ipsec|none)"),
    "ipv4-options": values.Choice(offered_values(_FILTER, "ipv4-options")),
    "layer7-protocol": values.Not(values.Text(empty=False)),
    "limit": values.Not(values.Pattern(r"\d+[kMG]?(/\w+)?,\d+[kMG]?(:(packet|bit))?")),
    "nth": values.Not(values.Pattern(r"\d+(,\d+)?")),
    "out-bridge-port": values.Not(_ANY_INTERFACE),
    "out-bridge-port-list": values.Not(_ANY_LIST),
    "out-interface": values.Not(_ANY_INTERFACE),
    "out-interface-list": values.Not(_ANY_LIST),
    "p2p": values.Not(values.Choice(offered_values(_FILTER, "p2p"))),
    "packet-mark": values.Not(values.Text(empty=False)),
    "packet-size": values.Not(values.Pattern(_RANGE)),
    "per-connection-classifier": values.Not(values.Pattern(r"[a-z-]+:\d+/\d+")),
    "port": values.Not(values.Ports()),
    "priority": values.Not(values.Int(0, 255)),  # the Manual says 63, an export of 7.16 has 100 and 110
    "protocol": values.Not(values.Choice(_PROTOCOLS)),
    "psd": values.Pattern(r"\d+,\w+,\d+,\d+"),
    "random": values.Int(1, 99),
    "realm": values.Not(values.Int()),
    "routing-mark": values.Not(values.Text(empty=False)),
    "src-address": values.Not(values.Matcher()),
    "src-address-list": values.Not(values.Text(empty=False)),
    "src-address-type": values.Not(_ADDRESS_TYPES),
    "src-mac-address": values.Not(values.Mac()),
    "src-port": values.Not(values.Ports()),
    "tcp-flags": values.Choices(("fin", "syn", "rst", "psh", "ack", "urg", "ece", "cwr"), has_signs=True),
    "tcp-mss": values.Not(values.Pattern(_RANGE)),
    "time": values.Not(values.Pattern(r"[\dhms:]+-[\dhms:d]+,[a-z,]+")),
    "tls-host": values.Not(values.Text(empty=False)),
    "tos": values.Not(values.Pattern(r"\d+(/\d+)?")),
    "ttl": values.Pattern(r"(equal|greater-than|less-than|not-equal):\d{1,3}"),
}

_COMMON = (
    _model.Arg("address-list", values.Text(empty=False)),
    _model.Arg("address-list-timeout", values.Time(0, 21474836, words=("none-dynamic", "none-static"))),
    _model.Arg("chain", values.Text(empty=False), is_required=True, always=True),
    _model.COMMENT,
    _model.DISABLED_ARG,
    _model.Arg("jump-target", values.Text(empty=False)),
    _model.Arg("log", values.Bool(), "no"),
    _model.Arg("log-prefix", values.Text(longest=31), ""),
)


def _rules(path: str, noun: str, *further: _model.Arg) -> _model.EmulatedMenu:
    """Build a menu of firewall rules: its own arguments, common ones, and matchers."""
    schema_arguments = schema.MENUS[path].by_name if path in schema.MENUS else {}
    action = _model.Arg("action", values.Choice(offered_values(path, "action")), "accept", always=True)
    local = (
        action,
        *further,
        *_COMMON,
        *(_model.Arg(name, kind) for name, kind in _MATCHERS.items() if name not in schema_arguments),
    )
    if schema_arguments:
        return _model.of_schema(path, noun=noun, kinds=_MATCHERS, local=local, flags=("dynamic", "invalid"))
    return _model.EmulatedMenu(
        path, _model.Shape.LIST, tuple(sorted(local, key=lambda arg: arg.name)), noun, flags=("dynamic", "invalid")
    )


_MARK = values.Text(empty=False)
_MARKING = (
    "change-dscp|change-mss|change-ttl|clear-df|mark-connection|mark-packet|mark-routing|route|set-priority|"
    "strip-ipv4-options"
)
_REJECT = values.Choice(offered_values(_FILTER, "reject-with"))

MENUS = (
    _model.of_schema(
        "/ip/firewall/address-list",
        noun="address list entry",
        local=(
            _model.Arg("address", values.Matcher(dns=True), "0.0.0.0/0", always=True),
            _model.Arg("dynamic", values.Bool(), "no", never=True, is_exported=False),
            _model.Arg("list", values.Text(empty=False), is_required=True, always=True),
            _model.Arg("timeout", values.Time(0, 21474836), is_exported=False),
        ),
        name_property="address",
        unique=(_model.Unique(("address", "list"), "failure: already have such entry"),),
        flags=("dynamic",),
    ),
    _rules(
        _FILTER,
        "filter rule",
        _model.Arg("hw-offload", values.Bool(), "yes", shown_if=("action", "fasttrack-connection"), always=True),
        _model.Arg("reject-with", _REJECT, "icmp-network-unreachable", shown_if=("action", "reject"), always=True),
    ),
    _rules(
        "/ip/firewall/nat",
        "nat rule",
        _model.Arg("randomise-ports", values.Bool()),
        _model.Arg("same-not-by-dst", values.Bool()),
        _model.Arg("socks5-port", values.Int(1, 65535)),
        _model.Arg("socks5-server", values.Address(v6=False)),
        _model.Arg("socksify-service", values.Text()),
        _model.Arg("to-addresses", values.Matcher()),
        _model.Arg("to-ports", values.Ports(single=True)),
    ),
    _rules(
        "/ip/firewall/mangle",
        "mangle rule",
        _model.Arg("new-connection-mark", _MARK),
        _model.Arg("new-dscp", values.Int(0, 63, words=("from-priority", "from-priority-to-high-3-bits"))),
        _model.Arg("new-mss", values.Int(40, 65534, words=("clamp-to-pmtu",))),
        _model.Arg("new-packet-mark", _MARK),
        _model.Arg("new-priority", values.Int(0, 63, words=("from-dscp", "from-dscp-high-3-bits", "from-ingress"))),
        _model.Arg("new-routing-mark", values.Ref(("table",))),
        _model.Arg("new-ttl", values.Pattern(r"(decrement|increment|set):\d{1,3}")),
        _model.Arg("passthrough", values.Bool(), "yes", shown_if=("action", _MARKING), always=True),
        _model.Arg("route-dst", values.Address(v6=False)),
        _model.Arg("sniff-id", values.Int()),
        _model.Arg("sniff-target", values.Address(v6=False)),
        _model.Arg("sniff-target-port", values.Int(0, 65535)),
    ),
    _rules("/ip/firewall/raw", "raw rule", _model.Arg("reject-with", _REJECT)),
)
