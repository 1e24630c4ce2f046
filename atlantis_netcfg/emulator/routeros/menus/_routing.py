"""Routing tables, rules and settings, netwatch and the queue tree.

Values and defaults: Manual, CLI reference of these menus; Manual, Policy Routing; Manual, VRF; Manual, Netwatch;
Manual, Queues. Exports of 7.16 to 7.19 name a VRF as interface, as routing table and behind the `@` of a gateway.
Intervals, rates and percentages are printed as in other menus.

Assumption: netwatch-values
"""

from __future__ import annotations

from atlantis_netcfg.emulator.routeros import values
from atlantis_netcfg.emulator.routeros.menus import _model
from atlantis_netcfg.emulator.routeros.schema import offered_values

VRF = 0x1000001
"""First id of a VRF, distinct from ids of interfaces and routing tables: a VRF name stands for one of each."""

_ROUTING = (
    _model.of_schema(
        "/routing/table",
        noun="routing table",
        local=(_model.Arg("name", values.Text(empty=False), ""),),
        space="table",
        unique=(_model.Unique(("name",), "failure: item with such name already exists"),),
        factory=({"name": "main", "fib": ""},),
        factory_dynamic=True,
        flags=("dynamic", "invalid", "used"),
        sparse=True,
        first_id=0,
    ),
    _model.EmulatedMenu(
        "/ip/vrf",
        _model.Shape.LIST,
        (
            _model.Arg("name", values.Text(empty=False), ""),
            _model.COMMENT,
            _model.DISABLED_ARG,
            _model.Arg("interfaces", values.Refs(values.Ref(("interface", "list"), ("none",))), ""),
        ),
        noun="vrf",
        unique=(_model.Unique(("name",), "failure: item with such name already exists"),),
        first_id=VRF,
    ),
    _model.of_schema(
        "/routing/rule",
        noun="routing rule",
        kinds={
            "action": values.Choice(("drop", "lookup", "lookup-only-in-table", "unreachable")),
            "chain": values.Text(empty=False),
            "dst-address": values.Prefixes(v6=False),
            "min-prefix": values.Int(0, 32),
            "src-address": values.Prefixes(v6=False),
        },
        local=(_model.Arg("routing-mark", values.Ref(("table",))), _model.Arg("table", values.Ref(("table",)))),
        without=("realm", "vrf"),
        flags=("inactive",),
        sparse=True,
    ),
    _model.of_schema(
        "/routing/settings",
        noun="routing settings",
        kinds={
            "check-gateway-ping-count": values.Int(1),
            "check-gateway-ping-interval": values.Time(0.1, 600),
            "check-gateway-ping-timeout": values.Time(0.001, 1),
            "connected-in-chain": values.Text(empty=False),
            "dynamic-in-chain": values.Text(empty=False),
            "policy-rules": values.Text(empty=False),
        },
        local=(_model.Arg("single-process", values.Bool(), "no"),),
    ),
)


_ICMP = ("type", "icmp")
_TCP = ("type", "tcp-conn")
_PORT = ("type", "tcp-conn|http-get|https-get")

_NETWATCH = (
    _model.of_schema(
        "/queue/tree",
        noun="queue tree",
        kinds={"bucket-size": values.Pattern(r"\d+(\.\d+)?"), "priority": values.Int(1, 8)},
        local=(
            _model.Arg("name", values.Text(empty=False), is_required=True),
            _model.Arg("parent", values.Ref(("interface", "queue"), ("global",)), is_required=True),
        ),
        space="queue",
        unique=(_model.Unique(("name",), "failure: already have such name"),),
        flags=("invalid", "dynamic"),
    ),
    _model.of_schema(
        "/tool/netwatch",
        noun="netwatch entry",
        kinds={"interval": values.Time(0.001), "timeout": values.Time(0.001)},
        local=(
            _model.Arg("accept-icmp-time-exceeded", values.Bool(), shown_if=_ICMP),
            _model.Arg("early-failure-detection", values.Bool(), shown_if=_ICMP),
            _model.Arg("early-success-detection", values.Bool(), shown_if=_ICMP),
            _model.Arg("host", values.Address(dns=True), "", always=True),
            _model.Arg("packet-count", values.Int(1), "10", shown_if=_ICMP),
            _model.Arg("packet-interval", values.Time(0.001), "50ms", shown_if=_ICMP),
            _model.Arg("packet-size", values.Int(28, 65535), "54", shown_if=_ICMP),
            _model.Arg("port", values.Int(1, 65535), shown_if=_PORT),
            _model.Arg("src-address", values.Address(empty=True)),
            _model.Arg("thr-avg", values.Time(), shown_if=_ICMP),
            _model.Arg("thr-jitter", values.Time(), shown_if=_ICMP),
            _model.Arg("thr-loss-count", values.Int(), shown_if=_ICMP),
            _model.Arg("thr-loss-percent", values.Pattern(r"\d+(\.\d+)?%?"), shown_if=_ICMP),
            _model.Arg("thr-max", values.Time(), shown_if=_ICMP),
            _model.Arg("thr-stdev", values.Time(), shown_if=_ICMP),
            _model.Arg("thr-tcp-conn-time", values.Time(), shown_if=_TCP),
            _model.Arg("ttl", values.Int(1, 255), shown_if=_ICMP),
            _model.Arg("type", values.Choice(offered_values("/tool/netwatch", "type")), "simple", always=True),
        ),
        without=("certificate", "check-certificate", "dns-server", "http-codes", "record-type", "thr-http-time"),
    ),
)

MENUS = (*_ROUTING, *_NETWATCH)
