"""Routing tables, rules and settings.

Values and defaults: Manual, CLI reference of `/routing/table`, `/routing/rule`, `/routing/settings`; Manual, Policy
Routing; Manual, VRF. Exports of 7.16 to 7.19 name a VRF as interface, as routing table and behind the `@` of a gateway.
"""

from __future__ import annotations

from atlantis_netcfg.emulator.routeros.menus._model import COMMENT, DISABLED, Arg, Menu, Shape, Unique, of_schema
from atlantis_netcfg.emulator.routeros.values import Bool, Choice, Int, Prefixes, Ref, Refs, Text, Time

VRF = 0x1000001
"""First id of a VRF, away from those of interfaces and routing tables: its name stands for one of each."""

MENUS = (
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
    Menu(
        "/ip/vrf",
        Shape.LIST,
        (
            Arg("name", Text(empty=False), ""),
            COMMENT,
            DISABLED,
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
