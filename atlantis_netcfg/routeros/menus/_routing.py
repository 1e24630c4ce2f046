"""`/ip route` and `/routing`: the route of a packet; `/tool netwatch` and `/queue tree`.

netwatch decides which link works, queues decide the priorities on a slow one.

Defaults: Manual, Netwatch; Manual, Queues (CLI reference of both menus).
"""

from __future__ import annotations

from atlantis_netcfg.core.versions import Version
from atlantis_netcfg.routeros._types import Layer
from atlantis_netcfg.routeros.menus import _model

_TABLE = _model.Menu(
    "/routing/table",
    _model.Shape.LIST,
    Layer.FOUNDATION,
    keys=("name",),
    subject="{name}",
    flags=("dynamic", "invalid"),
    stock=(("main",),),
    inert=True,
    since=Version(7, 0),
    fields=(_model.text("name", None), _model.COMMENT, _model.DISABLED, _model.flag("fib")),
)

_SETTINGS = _model.Menu(
    "/routing/settings",
    _model.Shape.SINGLETON,
    Layer.FOUNDATION,
    since=Version(7, 12),
    fields=(
        *_model.keep(_model.boolean("single-process")),
        *_model.since("7.19", *_model.keep(_model.text("connected-in-chain"), _model.text("dynamic-in-chain"))),
        *_model.since(
            "7.21",
            _model.time("check-gateway-ping-interval", "10s"),
            _model.time("check-gateway-ping-timeout", "1s"),
            _model.number("check-gateway-ping-count", "2"),
        ),
        # In which order the chains of routing rules are asked; ours are in `user`, which has to come before `main`.
        *_model.since("7.22", _model.text("policy-rules", "mangle,vrf-lookup,vrf-unreach,local,user,main")),
    ),
)

_ROUTE = _model.Menu(
    "/ip/route",
    _model.Shape.LIST,
    Layer.POLICY,
    keys=("dst-address", "gateway", "routing-table"),
    subject="{dst-address} via {gateway} {comment}",
    flags=("dynamic", "active", "connect", "immediate-gw"),
    late=(("dst-address", "0.0.0.0/0"), ("routing-table", "main")),
    fields=(
        _model.network("dst-address", "0.0.0.0/0"),
        _model.gateway("gateway"),
        *_model.since("7.0", _model.text("routing-table", "main")),
        _model.COMMENT,
        _model.DISABLED,
        _model.number("distance", "1"),
        *_model.since("7.0", _model.flag("blackhole")),
        _model.text("check-gateway", "none"),
        _model.number("scope", "30"),
        _model.number("target-scope", "10"),
        _model.prefix("pref-src", ""),
        *_model.keep(_model.interface("vrf-interface")),
        # At 7.21 it left the tree of the Cloud Hosted Router. Assumption: board-hw-offload
        *_model.since("7.0", *_model.keep(_model.boolean("suppress-hw-offload"))),
    ),
)

_RULE = _model.Menu(
    "/routing/rule",
    _model.Shape.LIST,
    Layer.POLICY,
    is_ordered=True,
    subject="{action} {table} {src-address} {dst-address} {comment}",
    flags=("dynamic",),
    since=Version(7, 0),
    fields=(
        _model.COMMENT,
        _model.DISABLED,
        _model.text("action", "lookup"),
        _model.text("table"),
        _model.prefix("src-address"),
        _model.prefix("dst-address"),
        _model.interface("interface"),
        _model.text("routing-mark"),
        _model.number("min-prefix"),
        # A rule of another chain is asked at another moment, or never. Assumption: routing-rule-chains
        *_model.since("7.22", _model.text("chain", "user"), _model.text("realm"), _model.text("vrf")),
    ),
)

_ROUTING = (_TABLE, _SETTINGS, _ROUTE, _RULE)


_PROBES = _model.Menu(
    "/tool/netwatch",
    _model.Shape.LIST,
    Layer.POLICY,
    keys=("name",),
    subject="{name}",
    # It looks, and what it does is done by its scripts when a host falls silent or answers again.
    inert=True,
    fields=(
        *_model.since("7.9", _model.text("name", None)),
        _model.COMMENT,
        _model.DISABLED,
        _model.text("host"),
        *_model.since("7.9", _model.text("type", "simple")),
        _model.time("interval", "10s"),
        _model.time("timeout", "3s"),
        _model.time("start-delay", "3s"),
        _model.time("startup-delay", "5m"),
        *_model.since("7.11", _model.text("src-address")),
        _model.text("up-script"),
        _model.text("down-script"),
        _model.text("test-script"),
        _model.number("packet-count", "10"),
        _model.time("packet-interval", "50ms"),
        _model.number("packet-size", "54"),
        # Thresholds and what else single types of probes have: nothing of ours depends on them.
        *_model.keep(
            _model.text("thr-avg"),
            _model.text("thr-max"),
            _model.text("thr-jitter"),
            _model.text("thr-stdev"),
            _model.text("thr-loss-percent"),
            _model.text("thr-loss-count"),
            _model.text("thr-http-time"),
            _model.text("thr-tcp-conn-time"),
            _model.text("certificate"),
            _model.text("check-certificate"),
            _model.text("http-codes"),
            _model.text("port"),
        ),
        *_model.since(
            "7.20", *_model.keep(_model.boolean("early-failure-detection"), _model.boolean("early-success-detection"))
        ),
        *_model.since(
            "7.16",
            *_model.keep(
                _model.text("accept-icmp-time-exceeded"),
                _model.text("dns-server"),
                _model.text("record-type"),
                _model.text("ttl"),
            ),
        ),
        *_model.since("7.17", *_model.keep(_model.boolean("ignore-initial-up"), _model.boolean("ignore-initial-down"))),
    ),
)

_TREE = _model.Menu(
    "/queue/tree",
    _model.Shape.LIST,
    Layer.POLICY,
    keys=("name",),
    subject="{name}",
    flags=("dynamic", "invalid"),
    fields=(
        _model.text("name", None),
        _model.COMMENT,
        _model.DISABLED,
        # A port or a queue.
        _model.interface("parent", ""),
        _model.words("packet-mark"),
        _model.number("priority", "8"),
        _model.text("queue", "default-small"),
        _model.rate("limit-at", "0"),
        _model.rate("max-limit", "0"),
        _model.rate("burst-limit", "0"),
        _model.rate("burst-threshold", "0"),
        _model.time("burst-time", "0s"),
        _model.text("bucket-size", "0.1"),
    ),
)

_NETWATCH = (_TREE, _PROBES)

MENUS = (*_ROUTING, *_NETWATCH)
