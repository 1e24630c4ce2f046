"""`/ip firewall`: lists of addresses, and the menus in which the first rule that matches decides."""

from __future__ import annotations

from atlantis_netcfg.routeros._types import Layer
from atlantis_netcfg.routeros.menus._model import (
    COMMENT,
    DISABLED,
    Menu,
    Shape,
    boolean,
    cosmetic,
    interface,
    keep,
    mac,
    number,
    prefix,
    sequence,
    since,
    text,
    texts,
    time,
    words,
)

_ADDRESS_LIST = Menu(
    "/ip/firewall/address-list",
    Shape.LIST,
    Layer.FOUNDATION,
    keys=("list", "address"),
    subject="{address} in {list}",
    flags=("dynamic",),
    inert=True,
    named_by=("src-address-list", "dst-address-list"),
    fields=(text("list", None), prefix("address"), COMMENT, DISABLED, *keep(time("timeout"))),
)

_COSMETIC = (COMMENT, cosmetic(boolean("log")), cosmetic(text("log-prefix")))

_COMMON = (
    text("chain", None),
    text("action", "accept"),
    *_COSMETIC,
    DISABLED,
    text("address-list"),
    time("address-list-timeout", "none-dynamic"),
    text("jump-target"),
    words("dst-address-type", None),
    words("src-address-type", None),
    words("dst-port", None),
    words("src-port", None),
    words("port", None),
    prefix("dst-address"),
    prefix("src-address"),
    interface("in-interface"),
    interface("out-interface"),
    interface("in-bridge-port"),
    interface("out-bridge-port"),
    mac("src-mac-address"),
    boolean("fragment", None),
    words("ipv4-options", None),
    *texts("connection-bytes connection-limit connection-mark connection-rate connection-type content dscp"),
    *texts("dst-address-list src-address-list dst-limit hotspot icmp-options in-bridge-port-list in-interface-list"),
    *texts("ingress-priority ipsec-policy layer7-protocol limit nth out-bridge-port-list out-interface-list"),
    *texts("packet-mark packet-size per-connection-classifier priority protocol psd random realm routing-mark"),
    *texts("tcp-mss time ttl"),
    *since("7.21", *texts("tos")),
)

_STATEFUL = (
    words("connection-state", None),
    words("connection-nat-state", None),
    words("tcp-flags", None),
    *texts("p2p tls-host"),
)

_FILTER = Menu(
    "/ip/firewall/filter",
    Shape.LIST,
    Layer.POLICY,
    is_ordered=True,
    chain="chain",
    subject="{chain} {action} {comment}",
    flags=("dynamic", "invalid"),
    fields=(
        *_COMMON,
        *_STATEFUL,
        text("reject-with", "icmp-network-unreachable"),
        # At 7.21 it left the tree of the Cloud Hosted Router. Assumption: board-hw-offload
        *keep(boolean("hw-offload")),
    ),
)

_NAT = Menu(
    "/ip/firewall/nat",
    Shape.LIST,
    Layer.POLICY,
    is_ordered=True,
    chain="chain",
    subject="{chain} {action} {comment}",
    flags=("dynamic", "invalid"),
    fields=(
        *_COMMON,
        sequence("to-addresses", None),
        text("to-ports", None),
        *since("7.10", boolean("randomise-ports")),
        boolean("same-not-by-dst"),
        *since("7.20", *texts("socks5-port socks5-server socksify-service")),
    ),
)

_MANGLE = Menu(
    "/ip/firewall/mangle",
    Shape.LIST,
    Layer.POLICY,
    is_ordered=True,
    chain="chain",
    subject="{chain} {action} {comment}",
    flags=("dynamic", "invalid"),
    fields=(
        *_COMMON,
        *_STATEFUL,
        boolean("passthrough", "yes"),
        number("new-dscp"),
        *texts("new-connection-mark new-mss new-packet-mark new-priority new-routing-mark new-ttl"),
        *texts("route-dst sniff-id sniff-target sniff-target-port"),
    ),
)

MENUS = (_ADDRESS_LIST, _FILTER, _NAT, _MANGLE)
