"""`/ip address`, `/ip pool` and DHCP: who has which address."""

from __future__ import annotations

from atlantis_netcfg.routeros._types import Layer
from atlantis_netcfg.routeros.menus._model import (
    COMMENT,
    DISABLED,
    Menu,
    Shape,
    boolean,
    interface,
    keep,
    mac,
    network,
    number,
    prefix,
    sequence,
    since,
    text,
    time,
    words,
)

_POOL = Menu(
    "/ip/pool",
    Shape.LIST,
    Layer.FOUNDATION,
    keys=("name",),
    subject="{name}",
    flags=("dynamic",),
    inert=True,
    fields=(text("name", None), COMMENT, sequence("ranges"), text("next-pool", "none")),
)

_ADDRESS = Menu(
    "/ip/address",
    Shape.LIST,
    Layer.ATTACHMENT,
    keys=("address",),
    subject="{address} on {interface}",
    flags=("dynamic", "invalid", "actual-interface"),
    fields=(
        prefix("address"),
        interface("interface"),
        COMMENT,
        DISABLED,
        *keep(prefix("network"), prefix("broadcast")),
    ),
)

_DHCP_CLIENT = Menu(
    "/ip/dhcp-client",
    Shape.LIST,
    Layer.ATTACHMENT,
    keys=("interface",),
    subject="{interface}",
    flags=("dynamic", "invalid", "status"),
    fields=(
        interface("interface"),
        COMMENT,
        DISABLED,
        text("add-default-route", "yes"),
        number("default-route-distance", "1"),
        *since("7.18", words("default-route-tables", "default")),
        words("dhcp-options", "hostname,clientid"),
        text("use-peer-dns", "yes"),
        boolean("use-peer-ntp", "yes"),
        text("script"),
        *since("7.19", boolean("allow-reconfigure"), text("check-gateway", "none")),
        *since("7.20", *keep(number("dscp"), text("use-broadcast"), number("vlan-priority"))),
    ),
)

_DHCP_SERVER = Menu(
    "/ip/dhcp-server",
    Shape.LIST,
    Layer.ATTACHMENT,
    keys=("name",),
    unique=("interface",),
    subject="{name}",
    flags=("dynamic", "invalid"),
    fields=(
        text("name", None),
        COMMENT,
        DISABLED,
        interface("interface"),
        text("address-pool", "static-only"),
        time("lease-time", "30m"),
        text("lease-script"),
        boolean("add-arp"),
        *since("7.17", words("address-lists")),
        text("use-radius", "no"),
        boolean("always-broadcast"),
        text("bootp-support", "static"),
        time("bootp-lease-time", "forever"),
        time("delay-threshold", "none"),
        text("parent-queue", "none"),
        *keep(
            boolean("allow-dual-stack-queue"),
            text("authoritative"),
            text("client-mac-limit"),
            boolean("conflict-detection"),
            text("dhcp-option-set"),
            text("insert-queue-before"),
            prefix("relay"),
            prefix("server-address"),
            boolean("use-framed-as-classless"),
        ),
        *since("7.19", boolean("use-reconfigure")),
        *since("7.21", *keep(text("dynamic-lease-identifiers"), boolean("support-broadband-tr101"))),
    ),
)

_DHCP_NETWORK = Menu(
    "/ip/dhcp-server/network",
    Shape.LIST,
    Layer.ATTACHMENT,
    keys=("address",),
    subject="{address}",
    flags=("dynamic",),
    fields=(
        network("address"),
        COMMENT,
        prefix("gateway", ""),
        sequence("dns-server"),
        boolean("dns-none"),
        sequence("ntp-server"),
        *since("7.20", boolean("ntp-none")),
        text("domain"),
        sequence("wins-server"),
        sequence("caps-manager"),
        text("boot-file-name"),
        prefix("next-server"),
        words("dhcp-option"),
        *keep(text("dhcp-option-set"), number("netmask")),
    ),
)

_LEASE = Menu(
    "/ip/dhcp-server/lease",
    Shape.LIST,
    Layer.POLICY,
    keys=("mac-address",),
    unique=("address",),
    subject="{address} for {mac-address} {comment}",
    flags=("dynamic",),
    # A host keeps the address that it has until it asks again.
    inert=True,
    fields=(
        mac("mac-address"),
        prefix("address"),
        text("server", "all"),
        COMMENT,
        DISABLED,
        text("client-id"),
        words("address-lists"),
        boolean("block-access"),
        words("dhcp-option"),
        text("rate-limit"),
        *keep(
            text("allow-dual-stack-queue"),
            boolean("always-broadcast"),
            text("dhcp-option-set"),
            text("insert-queue-before"),
            time("lease-time"),
            text("parent-queue"),
            text("queue-type"),
            text("routes"),
            boolean("use-src-mac"),
        ),
        *since("7.21", *keep(text("agent-circuit-id"), text("agent-remote-id"))),
    ),
)

MENUS = (_POOL, _ADDRESS, _DHCP_CLIENT, _DHCP_SERVER, _DHCP_NETWORK, _LEASE)
