"""`/ip route` and `/routing`: which way a packet leaves.

`/tool netwatch` and `/queue tree`: which link is good, and who goes first on a thin one.

Defaults: Manual, Netwatch; Manual, Queues (CLI reference of both menus).
"""

from __future__ import annotations

from atlantis_netcfg.core.versions import Version
from atlantis_netcfg.routeros._types import Layer
from atlantis_netcfg.routeros.menus._model import (
    COMMENT,
    DISABLED,
    Menu,
    Shape,
    boolean,
    flag,
    gateway,
    interface,
    keep,
    network,
    number,
    prefix,
    rate,
    since,
    text,
    time,
    words,
)

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
        *keep(boolean("single-process")),
        *since("7.19", *keep(text("connected-in-chain"), text("dynamic-in-chain"))),
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
        *keep(interface("vrf-interface")),
        # At 7.21 it left the tree of the Cloud Hosted Router. Assumption: board-hw-offload
        *since("7.0", *keep(boolean("suppress-hw-offload"))),
    ),
)

_RULE = Menu(
    "/routing/rule",
    Shape.LIST,
    Layer.POLICY,
    is_ordered=True,
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

_ROUTING = (_TABLE, _SETTINGS, _ROUTE, _RULE)


_PROBES = Menu(
    "/tool/netwatch",
    Shape.LIST,
    Layer.POLICY,
    keys=("name",),
    subject="{name}",
    # It looks, and what it does is done by its scripts when a host falls silent or answers again.
    inert=True,
    fields=(
        *since("7.9", text("name", None)),
        COMMENT,
        DISABLED,
        text("host"),
        *since("7.9", text("type", "simple")),
        time("interval", "10s"),
        time("timeout", "3s"),
        time("start-delay", "3s"),
        time("startup-delay", "5m"),
        *since("7.11", text("src-address")),
        text("up-script"),
        text("down-script"),
        text("test-script"),
        number("packet-count", "10"),
        time("packet-interval", "50ms"),
        number("packet-size", "54"),
        # Thresholds and what else single types of probes have: nothing of ours depends on them.
        *keep(
            text("thr-avg"),
            text("thr-max"),
            text("thr-jitter"),
            text("thr-stdev"),
            text("thr-loss-percent"),
            text("thr-loss-count"),
            text("thr-http-time"),
            text("thr-tcp-conn-time"),
            text("certificate"),
            text("check-certificate"),
            text("http-codes"),
            text("port"),
        ),
        *since("7.20", *keep(boolean("early-failure-detection"), boolean("early-success-detection"))),
        *since("7.16", *keep(text("accept-icmp-time-exceeded"), text("dns-server"), text("record-type"), text("ttl"))),
        *since("7.17", *keep(boolean("ignore-initial-up"), boolean("ignore-initial-down"))),
    ),
)

_TREE = Menu(
    "/queue/tree",
    Shape.LIST,
    Layer.POLICY,
    keys=("name",),
    subject="{name}",
    flags=("dynamic", "invalid"),
    fields=(
        text("name", None),
        COMMENT,
        DISABLED,
        # A port or a queue.
        interface("parent", ""),
        words("packet-mark"),
        number("priority", "8"),
        text("queue", "default-small"),
        rate("limit-at", "0"),
        rate("max-limit", "0"),
        rate("burst-limit", "0"),
        rate("burst-threshold", "0"),
        time("burst-time", "0s"),
        text("bucket-size", "0.1"),
    ),
)

_NETWATCH = (_TREE, _PROBES)

MENUS = (*_ROUTING, *_NETWATCH)
