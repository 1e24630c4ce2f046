"""`/ip firewall`: address lists, and the menus in which the first matching rule decides."""

from __future__ import annotations

from atlantis_netcfg.routeros._types import Layer
from atlantis_netcfg.routeros.menus import _model

_ADDRESS_LIST = _model.Menu(
    "/ip/firewall/address-list",
    _model.Shape.LIST,
    Layer.FOUNDATION,
    keys=("list", "address"),
    subject="{address} in {list}",
    flags=("dynamic",),
    inert=True,
    named_by=("src-address-list", "dst-address-list"),
    fields=(
        _model.text("list", None),
        _model.prefix("address"),
        _model.COMMENT,
        _model.DISABLED,
        *_model.keep(_model.time("timeout")),
    ),
)

_COSMETIC = (_model.COMMENT, _model.cosmetic(_model.boolean("log")), _model.cosmetic(_model.text("log-prefix")))

_COMMON = (
    _model.text("chain", None),
    _model.text("action", "accept"),
    *_COSMETIC,
    _model.DISABLED,
    _model.text("address-list"),
    _model.time("address-list-timeout", "none-dynamic"),
    _model.text("jump-target"),
    _model.words("dst-address-type", None),
    _model.words("src-address-type", None),
    _model.words("dst-port", None),
    _model.words("src-port", None),
    _model.words("port", None),
    _model.prefix("dst-address"),
    _model.prefix("src-address"),
    _model.interface("in-interface"),
    _model.interface("out-interface"),
    _model.interface("in-bridge-port"),
    _model.interface("out-bridge-port"),
    _model.mac("src-mac-address"),
    _model.boolean("fragment", None),
    _model.words("ipv4-options", None),
    *_model.texts("connection-bytes connection-limit connection-mark connection-rate connection-type content dscp"),
    *_model.texts(
        "dst-address-list src-address-list dst-limit hotspot icmp-options in-bridge-port-list in-interface-list"
    ),
    *_model.texts("ingress-priority ipsec-policy layer7-protocol limit nth out-bridge-port-list out-interface-list"),
    *_model.texts("packet-mark packet-size per-connection-classifier priority protocol psd random realm routing-mark"),
    *_model.texts("tcp-mss time ttl"),
    *_model.since("7.21", *_model.texts("tos")),
)

_STATEFUL = (
    _model.words("connection-state", None),
    _model.words("connection-nat-state", None),
    _model.words("tcp-flags", None),
    *_model.texts("p2p tls-host"),
)

_FILTER = _model.Menu(
    "/ip/firewall/filter",
    _model.Shape.LIST,
    Layer.POLICY,
    is_ordered=True,
    chain="chain",
    subject="{chain} {action} {comment}",
    flags=("dynamic", "invalid"),
    fields=(
        *_COMMON,
        *_STATEFUL,
        _model.text("reject-with", "icmp-network-unreachable"),
        # At 7.21 it left the tree of the Cloud Hosted Router. Assumption: board-hw-offload
        *_model.keep(_model.boolean("hw-offload")),
    ),
)

_NAT = _model.Menu(
    "/ip/firewall/nat",
    _model.Shape.LIST,
    Layer.POLICY,
    is_ordered=True,
    chain="chain",
    subject="{chain} {action} {comment}",
    flags=("dynamic", "invalid"),
    fields=(
        *_COMMON,
        _model.sequence("to-addresses", None),
        _model.text("to-ports", None),
        *_model.since("7.10", _model.boolean("randomise-ports")),
        _model.boolean("same-not-by-dst"),
        *_model.since("7.20", *_model.texts("socks5-port socks5-server socksify-service")),
    ),
)

_MANGLE = _model.Menu(
    "/ip/firewall/mangle",
    _model.Shape.LIST,
    Layer.POLICY,
    is_ordered=True,
    chain="chain",
    subject="{chain} {action} {comment}",
    flags=("dynamic", "invalid"),
    fields=(
        *_COMMON,
        *_STATEFUL,
        _model.boolean("passthrough", "yes"),
        _model.number("new-dscp"),
        *_model.texts("new-connection-mark new-mss new-packet-mark new-priority new-routing-mark new-ttl"),
        *_model.texts("route-dst sniff-id sniff-target sniff-target-port"),
    ),
)

MENUS = (_ADDRESS_LIST, _FILTER, _NAT, _MANGLE)
