"""Addresses, pools, DHCP, DNS, routes.

Values and defaults: Manual, CLI reference of each menu; Manual, DHCP; Manual, DNS; Manual, IP Routing; verbose
exports of RouterOS 7.19.
"""

from __future__ import annotations

from atlantis_netcfg.emulator.routeros.menus._model import COMMENT, DISABLED, Arg, Menu, Shape, Unique
from atlantis_netcfg.emulator.routeros.schema import offered
from atlantis_netcfg.emulator.routeros.values import (
    Address,
    Addresses,
    Bool,
    Choice,
    Choices,
    Flag,
    Gateway,
    HostPrefix,
    Int,
    Mac,
    Prefixes,
    Ranges,
    Ref,
    Refs,
    Size,
    Text,
    Time,
)

_V4 = Address(v6=False)
_V4S = Addresses(_V4)
_NAME_TAKEN = Unique(("name",), "failure: item with such name already exists")
_INTERFACE = Arg("interface", Ref(("interface",)), required=True, always=True)

_ADDRESS = Menu(
    "/ip/address",
    Shape.LIST,
    (
        Arg("address", HostPrefix(), required=True, always=True),
        Arg("broadcast", _V4, exported=False, never=True),
        COMMENT,
        DISABLED,
        _INTERFACE,
        Arg("netmask", _V4, exported=False, never=True),
        Arg("network", _V4, "", always=True),
    ),
    noun="address",
    called="address",
    unique=(Unique(("address", "interface"), "failure: already have such address"),),
    flags=("dynamic", "invalid"),
)

_POOL = Menu(
    "/ip/pool",
    Shape.LIST,
    (
        COMMENT,
        Arg("name", Text(empty=False), ""),
        Arg("next-pool", Ref(("pool",), ("none",)), "none"),
        Arg("ranges", Ranges(), required=True, always=True),
    ),
    noun="pool",
    space="pool",
    unique=(Unique(("name",), "failure: pool with such name exists"),),
)

_SERVER = Menu(
    "/ip/dhcp-server",
    Shape.LIST,
    (
        Arg("add-arp", Bool()),
        Arg("address-lists", Text(), ""),
        Arg("address-pool", Ref(("pool",), ("static-only",)), "static-only"),
        Arg("allow-dual-stack-queue", Bool()),
        Arg("always-broadcast", Bool()),
        Arg("authoritative", Choice(("after-10sec-delay", "after-2sec-delay", "no", "yes"))),
        Arg("bootp-lease-time", Time(words=("forever", "lease-time"))),
        Arg("bootp-support", Choice(("dynamic", "none", "static"))),
        Arg("client-mac-limit", Int(words=("unlimited",))),
        COMMENT,
        Arg("conflict-detection", Bool()),
        Arg("delay-threshold", Time(words=("none",))),
        Arg("dhcp-option-set", Text()),
        DISABLED,
        Arg("dynamic-lease-identifiers", Choices(("client-mac", "client-id", "opt-82"))),
        Arg("insert-queue-before", Choice(("bottom", "first"))),
        _INTERFACE,
        Arg("lease-script", Text(), ""),
        Arg("lease-time", Time(1), "30m"),
        Arg("name", Text(empty=False), ""),
        Arg("parent-queue", Text()),
        Arg("relay", _V4),
        Arg("server-address", _V4),
        Arg("support-broadband-tr101", Bool()),
        Arg("use-framed-as-classless", Bool()),
        Arg("use-radius", Choice(("accounting", "no", "yes")), "no"),
        Arg("use-reconfigure", Bool(), "no"),
    ),
    noun="dhcp server",
    space="dhcp-server",
    unique=(_NAME_TAKEN, Unique(("interface", "relay"), "failure: already have dhcp server on such interface")),
    flags=("dynamic", "invalid"),
)

_NETWORK = Menu(
    "/ip/dhcp-server/network",
    Shape.LIST,
    (
        Arg("address", Prefixes(v6=False), "0.0.0.0/0", always=True),
        Arg("boot-file-name", Text()),
        Arg("caps-manager", _V4S, ""),
        COMMENT,
        Arg("dhcp-option", Text(), ""),
        Arg("dhcp-option-set", Text()),
        Arg("dns-none", Bool()),
        Arg("dns-server", _V4S, ""),
        Arg("domain", Text()),
        Arg("gateway", _V4S, ""),
        Arg("netmask", Int(0, 32)),
        Arg("next-server", _V4),
        Arg("ntp-none", Bool()),
        Arg("ntp-server", _V4S, ""),
        Arg("wins-server", _V4S, ""),
    ),
    noun="dhcp network",
    called="address",
    unique=(Unique(("address",), "failure: already have such network"),),
    flags=("dynamic",),
)

_LEASE = Menu(
    "/ip/dhcp-server/lease",
    Shape.LIST,
    (
        Arg("address", _V4, always=True),
        Arg("address-lists", Text(), ""),
        Arg("agent-circuit-id", Text(), ""),
        Arg("agent-remote-id", Text(), ""),
        Arg("allow-dual-stack-queue", Bool()),
        Arg("always-broadcast", Bool()),
        Arg("block-access", Bool()),
        Arg("client-id", Text()),
        COMMENT,
        Arg("dhcp-option", Text(), ""),
        Arg("dhcp-option-set", Text()),
        DISABLED,
        Arg("insert-queue-before", Choice(("bottom", "first"))),
        Arg("lease-time", Time()),
        Arg("mac-address", Mac()),
        Arg("parent-queue", Text()),
        Arg("queue-type", Choice(offered("/ip/dhcp-server/lease", "queue-type"))),
        Arg("rate-limit", Text()),
        Arg("routes", Text()),
        Arg("server", Ref(("dhcp-server",), ("all",)), "all"),
        Arg("use-src-mac", Bool()),
    ),
    noun="dhcp lease",
    called="address",
    unique=(
        Unique(("address", "server"), "failure: already have static lease with this IP address"),
        # An export of 7.22 has two leases for one address, of which one is disabled.
        Unique(("mac-address", "server"), "failure: already have static lease with this MAC address", enabled=True),
    ),
    flags=("blocked", "dynamic", "radius"),
)

_CLIENT = Menu(
    "/ip/dhcp-client",
    Shape.LIST,
    (
        Arg("add-default-route", Choice(("no", "special-classless", "yes")), "yes"),
        Arg("allow-reconfigure", Bool(), "no"),
        Arg("check-gateway", Choice(("arp", "bfd", "none", "ping")), "none"),
        COMMENT,
        Arg("default-route-distance", Int(1, 255), "1"),
        Arg("default-route-tables", Text(empty=False), "default"),
        Arg("dhcp-options", Text(), "hostname,clientid"),
        DISABLED,
        Arg("dscp", Int(0, 63)),
        _INTERFACE,
        Arg("script", Text()),
        Arg("use-broadcast", Choice(("always", "both", "never"))),
        Arg("use-peer-dns", Bool(), "yes"),
        Arg("use-peer-ntp", Bool(), "yes"),
        Arg("vlan-priority", Int(0, 7)),
    ),
    noun="dhcp client",
    called="interface",
    unique=(Unique(("interface",), "failure: dhcp-client on that interface already exists"),),
    flags=("dynamic", "invalid"),
)

_DNS = Menu(
    "/ip/dns",
    Shape.SETTINGS,
    (
        Arg("address-list-extra-time", Time(), "0s"),
        Arg("allow-remote-requests", Bool(), "no"),
        Arg("cache-max-ttl", Time(), "1w"),
        Arg("cache-size", Size(), "2048KiB"),
        Arg("doh-max-concurrent-queries", Int(), "50"),
        Arg("doh-max-server-connections", Int(), "5"),
        Arg("doh-timeout", Time(), "5s"),
        Arg("max-concurrent-queries", Int(), "100"),
        Arg("max-concurrent-tcp-sessions", Int(), "20"),
        Arg("max-udp-packet-size", Int(50, 65507), "4096"),
        Arg("mdns-repeat-ifaces", Refs(Ref(("interface",))), ""),
        Arg("query-server-timeout", Time(), "2s"),
        Arg("query-total-timeout", Time(), "10s"),
        Arg("servers", Addresses(), ""),
        Arg("use-doh-server", Text(), ""),
        Arg("verify-doh-cert", Bool(), "no"),
        Arg("vrf", Ref(("table",)), "main"),
    ),
    noun="dns",
)

_STATIC = Menu(
    "/ip/dns/static",
    Shape.LIST,
    (
        Arg("address", Address()),
        Arg("address-list", Text()),
        Arg("cname", Text()),
        COMMENT,
        DISABLED,
        Arg("forward-to", Text()),
        Arg("match-subdomain", Bool()),
        Arg("mx-exchange", Text()),
        Arg("mx-preference", Int(0, 65535)),
        Arg("name", Text(empty=False)),
        Arg("ns", Text()),
        Arg("regexp", Text(empty=False)),
        Arg("srv-port", Int(0, 65535)),
        Arg("srv-priority", Int(0, 65535)),
        Arg("srv-target", Text()),
        Arg("srv-weight", Int(0, 65535)),
        Arg("text", Text()),
        Arg("ttl", Time(), "1d"),
        Arg("type", Choice(offered("/ip/dns/static", "type")), "A", always=True),
    ),
    noun="static dns entry",
    unique=(Unique(("name", "type", "address", "text"), "entry already exists"),),
    flags=("dynamic",),
)

_ROUTE = Menu(
    "/ip/route",
    Shape.LIST,
    (
        Arg("blackhole", Flag("true")),
        Arg("check-gateway", Choice(("arp", "none", "ping"))),
        COMMENT,
        Arg("disabled", Bool(), "no"),
        Arg("distance", Int(1, 255), "1"),
        Arg("dst-address", Prefixes(v6=False, empty="0.0.0.0/0"), "0.0.0.0/0"),
        Arg("gateway", Gateway()),
        Arg("pref-src", Address(v6=False, empty=True)),
        Arg("routing-table", Ref(("table",)), "main"),
        Arg("scope", Int(0, 255), "30"),
        Arg("suppress-hw-offload", Bool(), "no"),
        Arg("target-scope", Int(0, 255), "10"),
        Arg("vrf-interface", Ref(("interface",))),
    ),
    noun="route",
    called="dst-address",
    flags=("active", "dynamic", "inactive", "static"),
    first_id=0x80000001,
    sparse=True,
)

MENUS = (_ADDRESS, _POOL, _SERVER, _NETWORK, _LEASE, _CLIENT, _DNS, _STATIC, _ROUTE)
