"""Routing tables, rules and settings, netwatch and the queue tree.

Values and defaults: Manual, CLI reference of these menus; Manual, Policy Routing; Manual, VRF; Manual, Netwatch;
Manual, Queues. Exports of 7.16 to 7.19 name a VRF as interface, as routing table and behind the `@` of a gateway.
Intervals, rates and percentages are printed as in other menus.

Assumption: netwatch-values
"""

from __future__ import annotations

from atlantis_netcfg.emulator.routeros import values
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
from atlantis_netcfg.emulator.routeros.values import Bool, Choice, Int, Pattern, Prefixes, Ref, Refs, Text, Time

VRF = 0x1000001
"""First id of a VRF, away from those of interfaces and routing tables: its name stands for one of each."""

_ROUTING = (
    of_schema(
        "/routing/table",
        noun="routing table",
        local=(Arg("name", Text(empty=False), ""),),
        space="table",
        unique=(Unique(("name",), "failure: item with such name already exists"),),
        factory=({"name": "main", "fib": ""},),
        factory_dynamic=True,
        flags=("dynamic", "invalid", "used"),
        sparse=True,
        first_id=0,
    ),
    EmulatedMenu(
        "/ip/vrf",
        Shape.LIST,
        (
            Arg("name", Text(empty=False), ""),
            COMMENT,
            DISABLED_ARG,
            Arg("interfaces", Refs(Ref(("interface", "list"), ("none",))), ""),
        ),
        noun="vrf",
        unique=(Unique(("name",), "failure: item with such name already exists"),),
        first_id=VRF,
    ),
    of_schema(
        "/routing/rule",
        noun="routing rule",
        kinds={
            "action": Choice(("drop", "lookup", "lookup-only-in-table", "unreachable")),
            "chain": Text(empty=False),
            "dst-address": Prefixes(v6=False),
            "min-prefix": Int(0, 32),
            "src-address": Prefixes(v6=False),
        },
        local=(Arg("routing-mark", Ref(("table",))), Arg("table", Ref(("table",)))),
        without=("realm", "vrf"),
        flags=("inactive",),
        sparse=True,
    ),
    of_schema(
        "/routing/settings",
        noun="routing settings",
        kinds={
            "check-gateway-ping-count": Int(1),
            "check-gateway-ping-interval": Time(0.1, 600),
            "check-gateway-ping-timeout": Time(0.001, 1),
            "connected-in-chain": Text(empty=False),
            "dynamic-in-chain": Text(empty=False),
            "policy-rules": Text(empty=False),
        },
        local=(Arg("single-process", Bool(), "no"),),
    ),
)


_ICMP = ("type", "icmp")
_TCP = ("type", "tcp-conn")
_PORT = ("type", "tcp-conn|http-get|https-get")

_NETWATCH = (
    of_schema(
        "/queue/tree",
        noun="queue tree",
        kinds={"bucket-size": Pattern(r"\d+(\.\d+)?"), "priority": Int(1, 8)},
        local=(
            Arg("name", Text(empty=False), is_required=True),
            Arg("parent", Ref(("interface", "queue"), ("global",)), is_required=True),
        ),
        space="queue",
        unique=(Unique(("name",), "failure: already have such name"),),
        flags=("invalid", "dynamic"),
    ),
    of_schema(
        "/tool/netwatch",
        noun="netwatch entry",
        kinds={"interval": Time(0.001), "timeout": Time(0.001)},
        local=(
            Arg("accept-icmp-time-exceeded", Bool(), shown_if=_ICMP),
            Arg("early-failure-detection", Bool(), shown_if=_ICMP),
            Arg("early-success-detection", Bool(), shown_if=_ICMP),
            Arg("host", values.Address(dns=True), "", always=True),
            Arg("packet-count", Int(1), "10", shown_if=_ICMP),
            Arg("packet-interval", Time(0.001), "50ms", shown_if=_ICMP),
            Arg("packet-size", Int(28, 65535), "54", shown_if=_ICMP),
            Arg("port", Int(1, 65535), shown_if=_PORT),
            Arg("src-address", values.Address(empty=True)),
            Arg("thr-avg", Time(), shown_if=_ICMP),
            Arg("thr-jitter", Time(), shown_if=_ICMP),
            Arg("thr-loss-count", Int(), shown_if=_ICMP),
            Arg("thr-loss-percent", Pattern(r"\d+(\.\d+)?%?"), shown_if=_ICMP),
            Arg("thr-max", Time(), shown_if=_ICMP),
            Arg("thr-stdev", Time(), shown_if=_ICMP),
            Arg("thr-tcp-conn-time", Time(), shown_if=_TCP),
            Arg("ttl", Int(1, 255), shown_if=_ICMP),
            Arg("type", Choice(offered_values("/tool/netwatch", "type")), "simple", always=True),
        ),
        without=("certificate", "check-certificate", "dns-server", "http-codes", "record-type", "thr-http-time"),
    ),
)

MENUS = (*_ROUTING, *_NETWATCH)
