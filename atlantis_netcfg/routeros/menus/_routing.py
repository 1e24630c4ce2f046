"""`/ip route` and `/routing`: which way a packet leaves."""

from __future__ import annotations

from atlantis_netcfg.core.versions import Version
from atlantis_netcfg.routeros._types import Layer
from atlantis_netcfg.routeros.menus._fields import (
    COMMENT,
    DISABLED,
    boolean,
    flag,
    gateway,
    interface,
    kept,
    network,
    number,
    prefix,
    since,
    text,
    time,
)
from atlantis_netcfg.routeros.menus._model import Menu, Shape

_TABLE = Menu(
    "/routing/table",
    Shape.LIST,
    Layer.FOUNDATION,
    keys=("name",),
    subject="{name}",
    flags=("dynamic", "invalid"),
    stock=(("main",),),
    inert=True,
    since=Version(7, 0),
    fields=(text("name", None), COMMENT, DISABLED, flag("fib")),
)

_SETTINGS = Menu(
    "/routing/settings",
    Shape.SINGLETON,
    Layer.FOUNDATION,
    since=Version(7, 12),
    fields=(
        *kept(boolean("single-process")),
        *since("7.19", *kept(text("connected-in-chain"), text("dynamic-in-chain"))),
        *since(
            "7.21",
            time("check-gateway-ping-interval", "10s"),
            time("check-gateway-ping-timeout", "1s"),
            number("check-gateway-ping-count", "2"),
        ),
        # In which order the chains of routing rules are asked; ours are in `user`, which has to come before `main`.
        *since("7.22", text("policy-rules", "mangle,vrf-lookup,vrf-unreach,local,user,main")),
    ),
)

_ROUTE = Menu(
    "/ip/route",
    Shape.LIST,
    Layer.POLICY,
    keys=("dst-address", "gateway", "routing-table"),
    subject="{dst-address} via {gateway} {comment}",
    flags=("dynamic", "active", "connect", "immediate-gw"),
    late=(("dst-address", "0.0.0.0/0"), ("routing-table", "main")),
    fields=(
        network("dst-address", "0.0.0.0/0"),
        gateway("gateway"),
        *since("7.0", text("routing-table", "main")),
        COMMENT,
        DISABLED,
        number("distance", "1"),
        *since("7.0", flag("blackhole")),
        text("check-gateway", "none"),
        number("scope", "30"),
        number("target-scope", "10"),
        prefix("pref-src", ""),
        *kept(interface("vrf-interface")),
        # At 7.21 it left the tree of the Cloud Hosted Router. Assumption: board-hw-offload
        *since("7.0", *kept(boolean("suppress-hw-offload"))),
    ),
)

_RULE = Menu(
    "/routing/rule",
    Shape.LIST,
    Layer.POLICY,
    ordered=True,
    subject="{action} {table} {src-address} {dst-address} {comment}",
    flags=("dynamic",),
    since=Version(7, 0),
    fields=(
        COMMENT,
        DISABLED,
        text("action", "lookup"),
        text("table"),
        prefix("src-address"),
        prefix("dst-address"),
        interface("interface"),
        text("routing-mark"),
        number("min-prefix"),
        # A rule of another chain is asked at another moment, or never. Assumption: routing-rule-chains
        *since("7.22", text("chain", "user"), text("realm"), text("vrf")),
    ),
)

MENUS = (_TABLE, _SETTINGS, _ROUTE, _RULE)
