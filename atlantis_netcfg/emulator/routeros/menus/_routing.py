"""Routing tables, rules and settings.

Values and defaults: Manual, CLI reference of `/routing/table`, `/routing/rule`, `/routing/settings`; Manual, Policy
Routing; Manual, VRF. Exports of 7.16 to 7.19 name a VRF as interface, as routing table and behind the `@` of a gateway.
"""

from __future__ import annotations

from atlantis_netcfg.emulator.routeros.menus._model import COMMENT, DISABLED, Arg, Menu, Shape, Unique
from atlantis_netcfg.emulator.routeros.values import Bool, Choice, Flag, Int, Prefixes, Ref, Refs, Text, Time

VRF = 0x1000001
"""First id of a VRF, away from those of interfaces and routing tables: its name stands for one of each."""

MENUS = (
    Menu(
        "/routing/table",
        Shape.LIST,
        (COMMENT, Arg("disabled", Bool(), "no"), Arg("fib", Flag()), Arg("name", Text(empty=False), "")),
        noun="routing table",
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
    Menu(
        "/routing/rule",
        Shape.LIST,
        (
            Arg("action", Choice(("drop", "lookup", "lookup-only-in-table", "unreachable")), "lookup"),
            Arg("chain", Text(empty=False), "user"),
            COMMENT,
            Arg("disabled", Bool(), "no"),
            Arg("dst-address", Prefixes(v6=False)),
            Arg("interface", Ref(("interface",))),
            Arg("min-prefix", Int(0, 32)),
            Arg("routing-mark", Ref(("table",))),
            Arg("src-address", Prefixes(v6=False)),
            Arg("table", Ref(("table",))),
        ),
        noun="routing rule",
        flags=("inactive",),
        sparse=True,
    ),
    Menu(
        "/routing/settings",
        Shape.SETTINGS,
        (
            Arg("check-gateway-ping-count", Int(1), "2"),
            Arg("check-gateway-ping-interval", Time(0.1, 600), "10s"),
            Arg("check-gateway-ping-timeout", Time(0.001, 1), "1s"),
            Arg("connected-in-chain", Text(empty=False)),
            Arg("dynamic-in-chain", Text(empty=False)),
            Arg("policy-rules", Text(empty=False), "mangle,vrf-lookup,vrf-unreach,local,user,main"),
            Arg("single-process", Bool(), "no"),
        ),
        noun="routing settings",
    ),
)
