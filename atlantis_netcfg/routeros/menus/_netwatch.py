"""`/tool netwatch` and `/queue tree`: which link is good, and who goes first on a thin one.

Defaults: Manual, Netwatch; Manual, Queues (CLI reference of both menus).
"""

from __future__ import annotations

from atlantis_netcfg.routeros._types import Layer
from atlantis_netcfg.routeros.menus._fields import (
    COMMENT,
    DISABLED,
    boolean,
    interface,
    kept,
    number,
    rate,
    since,
    text,
    time,
    words,
)
from atlantis_netcfg.routeros.menus._model import Menu, Shape

_NETWATCH = Menu(
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
        *kept(
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
        *since("7.20", *kept(boolean("early-failure-detection"), boolean("early-success-detection"))),
        *since("7.16", *kept(text("accept-icmp-time-exceeded"), text("dns-server"), text("record-type"), text("ttl"))),
        *since("7.17", *kept(boolean("ignore-initial-up"), boolean("ignore-initial-down"))),
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

MENUS = (_TREE, _NETWATCH)
