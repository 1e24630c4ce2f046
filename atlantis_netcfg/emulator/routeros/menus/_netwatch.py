"""Netwatch and the queue tree.

Values and defaults: Manual, Netwatch; Manual, Queues; Manual, CLI reference of both menus. Intervals, rates and
percentages are printed as in other menus.

Assumption: netwatch-values
"""

from __future__ import annotations

from atlantis_netcfg.emulator.routeros.menus._model import COMMENT, DISABLED, Arg, Menu, Shape, Unique
from atlantis_netcfg.emulator.routeros.schema import offered
from atlantis_netcfg.emulator.routeros.values import Bool, Choice, Int, Pattern, Rate, Ref, Text, Time

_ICMP = ("type", "icmp")
_TCP = ("type", "tcp-conn")
_PORT = ("type", "tcp-conn|http-get|https-get")
_QUEUES = offered("/queue/tree", "queue")

MENUS = (
    Menu(
        "/queue/tree",
        Shape.LIST,
        (
            Arg("bucket-size", Pattern(r"\d+(\.\d+)?"), "0.1"),
            Arg("burst-limit", Rate(), "0"),
            Arg("burst-threshold", Rate(), "0"),
            Arg("burst-time", Time(), "0s"),
            COMMENT,
            DISABLED,
            Arg("limit-at", Rate(), "0"),
            Arg("max-limit", Rate(), "0"),
            Arg("name", Text(empty=False), required=True),
            Arg("packet-mark", Text(), ""),
            Arg("parent", Ref(("interface", "queue"), ("global",)), required=True),
            Arg("priority", Int(1, 8), "8"),
            Arg("queue", Choice(_QUEUES), "default-small"),
        ),
        noun="queue tree",
        space="queue",
        unique=(Unique(("name",), "failure: already have such name"),),
        flags=("invalid", "dynamic"),
    ),
    Menu(
        "/tool/netwatch",
        Shape.LIST,
        (
            Arg("accept-icmp-time-exceeded", Bool(), shown_if=_ICMP),
            COMMENT,
            DISABLED,
            Arg("down-script", Text(), ""),
            Arg("early-failure-detection", Bool(), shown_if=_ICMP),
            Arg("early-success-detection", Bool(), shown_if=_ICMP),
            Arg("host", Text(empty=False), "", always=True),
            Arg("ignore-initial-down", Bool()),
            Arg("ignore-initial-up", Bool()),
            Arg("interval", Time(0.001), "10s"),
            Arg("name", Text()),
            Arg("packet-count", Int(1), "10", shown_if=_ICMP),
            Arg("packet-interval", Time(0.001), "50ms", shown_if=_ICMP),
            Arg("packet-size", Int(28, 65535), "54", shown_if=_ICMP),
            Arg("port", Int(1, 65535), shown_if=_PORT),
            Arg("src-address", Text()),
            Arg("start-delay", Time(), "3s"),
            Arg("startup-delay", Time(), "5m"),
            Arg("test-script", Text(), ""),
            Arg("thr-avg", Time(), shown_if=_ICMP),
            Arg("thr-jitter", Time(), shown_if=_ICMP),
            Arg("thr-loss-count", Int(), shown_if=_ICMP),
            Arg("thr-loss-percent", Pattern(r"\d+(\.\d+)?%?"), shown_if=_ICMP),
            Arg("thr-max", Time(), shown_if=_ICMP),
            Arg("thr-stdev", Time(), shown_if=_ICMP),
            Arg("thr-tcp-conn-time", Time(), shown_if=_TCP),
            Arg("timeout", Time(0.001), "3s"),
            Arg("ttl", Int(1, 255), shown_if=_ICMP),
            Arg("type", Choice(offered("/tool/netwatch", "type")), "simple", always=True),
            Arg("up-script", Text(), ""),
        ),
        noun="netwatch entry",
    ),
)
