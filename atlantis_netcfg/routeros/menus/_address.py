"""`/ip address`, `/ip pool` and DHCP: address assignment."""

from __future__ import annotations

from atlantis_netcfg.routeros._types import Layer
from atlantis_netcfg.routeros.menus import _model

_POOL = _model.Menu(
    "/ip/pool",
    _model.Shape.LIST,
    Layer.FOUNDATION,
    keys=("name",),
    subject="{name}",
    flags=("dynamic",),
    inert=True,
    fields=(_model.text("name", None), _model.COMMENT, _model.sequence("ranges"), _model.text("next-pool", "none")),
)

_ADDRESS = _model.Menu(
    "/ip/address",
    _model.Shape.LIST,
    Layer.ATTACHMENT,
    keys=("address",),
    subject="{address} on {interface}",
    flags=("dynamic", "invalid", "actual-interface"),
    fields=(
        _model.prefix("address"),
        _model.interface("interface"),
        _model.COMMENT,
        _model.DISABLED,
        *_model.keep(_model.prefix("network"), _model.prefix("broadcast")),
    ),
)

_DHCP_CLIENT = _model.Menu(
    "/ip/dhcp-client",
    _model.Shape.LIST,
    Layer.ATTACHMENT,
    keys=("interface",),
    subject="{interface}",
    flags=("dynamic", "invalid", "status"),
    fields=(
        _model.interface("interface"),
        _model.COMMENT,
        _model.DISABLED,
        _model.text("add-default-route", "yes"),
        _model.number("default-route-distance", "1"),
        *_model.since("7.18", _model.words("default-route-tables", "default")),
        _model.words("dhcp-options", "hostname,clientid"),
        _model.text("use-peer-dns", "yes"),
        _model.boolean("use-peer-ntp", "yes"),
        _model.text("script"),
        *_model.since("7.19", _model.boolean("allow-reconfigure"), _model.text("check-gateway", "none")),
        *_model.since(
            "7.20", *_model.keep(_model.number("dscp"), _model.text("use-broadcast"), _model.number("vlan-priority"))
        ),
    ),
)

_DHCP_SERVER = _model.Menu(
    "/ip/dhcp-server",
    _model.Shape.LIST,
    Layer.ATTACHMENT,
    keys=("name",),
    unique=("interface",),
    subject="{name}",
    flags=("dynamic", "invalid"),
    fields=(
        _model.text("name", None),
        _model.COMMENT,
        _model.DISABLED,
        _model.interface("interface"),
        _model.text("address-pool", "static-only"),
        _model.time("lease-time", "30m"),
        _model.text("lease-script"),
        _model.boolean("add-arp"),
        *_model.since("7.17", _model.words("address-lists")),
        _model.text("use-radius", "no"),
        _model.boolean("always-broadcast"),
        _model.text("bootp-support", "static"),
        _model.time("bootp-lease-time", "forever"),
        _model.time("delay-threshold", "none"),
        _model.text("parent-queue", "none"),
        *_model.keep(
            _model.boolean("allow-dual-stack-queue"),
            _model.text("authoritative"),
            _model.text("client-mac-limit"),
            _model.boolean("conflict-detection"),
            _model.text("dhcp-option-set"),
            _model.text("insert-queue-before"),
            _model.prefix("relay"),
            _model.prefix("server-address"),
            _model.boolean("use-framed-as-classless"),
        ),
        *_model.since("7.19", _model.boolean("use-reconfigure")),
        *_model.since(
            "7.21", *_model.keep(_model.text("dynamic-lease-identifiers"), _model.boolean("support-broadband-tr101"))
        ),
    ),
)

_DHCP_NETWORK = _model.Menu(
    "/ip/dhcp-server/network",
    _model.Shape.LIST,
    Layer.ATTACHMENT,
    keys=("address",),
    subject="{address}",
    flags=("dynamic",),
    fields=(
        _model.network("address"),
        _model.COMMENT,
        _model.prefix("gateway", ""),
        _model.sequence("dns-server"),
        _model.boolean("dns-none"),
        _model.sequence("ntp-server"),
        *_model.since("7.20", _model.boolean("ntp-none")),
        _model.text("domain"),
        _model.sequence("wins-server"),
        _model.sequence("caps-manager"),
        _model.text("boot-file-name"),
        _model.prefix("next-server"),
        _model.words("dhcp-option"),
        *_model.keep(_model.text("dhcp-option-set"), _model.number("netmask")),
    ),
)

_LEASE = _model.Menu(
    "/ip/dhcp-server/lease",
    _model.Shape.LIST,
    Layer.POLICY,
    keys=("mac-address",),
    unique=("address",),
    subject="{address} for {mac-address} {comment}",
    flags=("dynamic",),
    # A host keeps the address that it has until it asks again.
    inert=True,
    fields=(
        _model.mac("mac-address"),
        _model.prefix("address"),
        _model.text("server", "all"),
        _model.COMMENT,
        _model.DISABLED,
        _model.text("client-id"),
        _model.words("address-lists"),
        _model.boolean("block-access"),
        _model.words("dhcp-option"),
        _model.text("rate-limit"),
        *_model.keep(
            _model.text("allow-dual-stack-queue"),
            _model.boolean("always-broadcast"),
            _model.text("dhcp-option-set"),
            _model.text("insert-queue-before"),
            _model.time("lease-time"),
            _model.text("parent-queue"),
            _model.text("queue-type"),
            _model.text("routes"),
            _model.boolean("use-src-mac"),
        ),
        *_model.since("7.21", *_model.keep(_model.text("agent-circuit-id"), _model.text("agent-remote-id"))),
    ),
)

MENUS = (_POOL, _ADDRESS, _DHCP_CLIENT, _DHCP_SERVER, _DHCP_NETWORK, _LEASE)
