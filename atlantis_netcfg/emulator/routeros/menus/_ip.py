"""Addresses, pools, DHCP, DNS, routes.

Values and defaults: Manual, CLI reference of each menu; Manual, DHCP; Manual, DNS; Manual, IP Routing; verbose
exports of RouterOS 7.19.
"""

from __future__ import annotations

from atlantis_netcfg.emulator.routeros.menus._model import Arg, Unique, of_schema
from atlantis_netcfg.emulator.routeros.schema import offered_values
from atlantis_netcfg.emulator.routeros.values import (
    Address,
    AddressesValue,
    Bool,
    Choice,
    Choices,
    FlagValue,
    GatewayValue,
    HostPrefix,
    Int,
    Prefixes,
    Ranges,
    Ref,
    Refs,
    Text,
    Time,
)

_V4 = Address(v6=False)
_V4S = AddressesValue(_V4)
_NAME_TAKEN = Unique(("name",), "failure: item with such name already exists")
_INTERFACE = Arg("interface", Ref(("interface",)), is_required=True, always=True)

_ADDRESS = of_schema(
    "/ip/address",
    noun="address",
    local=(
        Arg("address", HostPrefix(), is_required=True, always=True),
        Arg("broadcast", _V4, is_exported=False, never=True),
        _INTERFACE,
        Arg("netmask", _V4, is_exported=False, never=True),
        Arg("network", _V4, "", always=True),
    ),
    name_property="address",
    unique=(Unique(("address", "interface"), "failure: already have such address"),),
    flags=("dynamic", "invalid"),
)

_POOL = of_schema(
    "/ip/pool",
    noun="pool",
    kinds={"next-pool": Ref(("pool",), ("none",))},
    local=(Arg("name", Text(empty=False), ""), Arg("ranges", Ranges(), is_required=True, always=True)),
    space="pool",
    unique=(Unique(("name",), "failure: pool with such name exists"),),
)

_SERVER = of_schema(
    "/ip/dhcp-server",
    noun="dhcp server",
    kinds={
        "address-pool": Ref(("pool",), ("static-only",)),
        "authoritative": Choice(("after-10sec-delay", "after-2sec-delay", "no", "yes")),
        "client-mac-limit": Int(words=("unlimited",)),
        "dynamic-lease-identifiers": Choices(("client-mac", "client-id", "opt-82")),
        "insert-queue-before": Choice(("bottom", "first")),
        "lease-time": Time(1),
        "use-radius": Choice(("accounting", "no", "yes")),
    },
    local=(
        Arg("add-arp", Bool()),
        Arg("always-broadcast", Bool()),
        Arg("bootp-lease-time", Time(words=("forever", "lease-time"))),
        Arg("bootp-support", Choice(("dynamic", "none", "static"))),
        Arg("delay-threshold", Time(words=("none",))),
        _INTERFACE,
        Arg("name", Text(empty=False), ""),
        Arg("parent-queue", Text()),
    ),
    space="dhcp-server",
    unique=(_NAME_TAKEN, Unique(("interface", "relay"), "failure: already have dhcp server on such interface")),
    flags=("dynamic", "invalid"),
)

_NETWORK = of_schema(
    "/ip/dhcp-server/network",
    noun="dhcp network",
    kinds={
        "caps-manager": _V4S,
        "dns-server": _V4S,
        "gateway": _V4S,
        "netmask": Int(0, 32),
        "ntp-server": _V4S,
        "wins-server": _V4S,
    },
    local=(
        Arg("address", Prefixes(v6=False), "0.0.0.0/0", always=True),
        Arg("boot-file-name", Text()),
        Arg("dns-none", Bool()),
        Arg("domain", Text()),
        Arg("ntp-none", Bool()),
    ),
    name_property="address",
    unique=(Unique(("address",), "failure: already have such network"),),
    flags=("dynamic",),
)

_LEASE = of_schema(
    "/ip/dhcp-server/lease",
    noun="dhcp lease",
    kinds={
        "allow-dual-stack-queue": Bool(),
        "insert-queue-before": Choice(("bottom", "first")),
        "server": Ref(("dhcp-server",), ("all",)),
    },
    local=(
        Arg("address", _V4, always=True),
        Arg("agent-circuit-id", Text(), ""),
        Arg("agent-remote-id", Text(), ""),
        Arg("block-access", Bool()),
        Arg("client-id", Text()),
        Arg("rate-limit", Text()),
    ),
    name_property="address",
    unique=(
        Unique(("address", "server"), "failure: already have static lease with this IP address"),
        # Exports have two leases of one MAC address: for other client ids, and (7.22) with one of them disabled.
        Unique(
            ("mac-address", "server", "client-id"),
            "failure: already have static lease with this MAC address",
            enabled_only=True,
        ),
    ),
    flags=("blocked", "dynamic", "radius"),
)

_CLIENT = of_schema(
    "/ip/dhcp-client",
    noun="dhcp client",
    kinds={
        "add-default-route": Choice(("no", "special-classless", "yes")),
        "check-gateway": Choice(("arp", "bfd", "none", "ping")),
        "default-route-distance": Int(1, 255),
        "default-route-tables": Text(empty=False),
        "dscp": Int(0, 63),
        "use-broadcast": Choice(("always", "both", "never")),
        "use-peer-dns": Bool(),
        "vlan-priority": Int(0, 7),
    },
    local=(_INTERFACE, Arg("script", Text())),
    name_property="interface",
    unique=(Unique(("interface",), "failure: dhcp-client on that interface already exists"),),
    flags=("dynamic", "invalid"),
)

_DNS = of_schema(
    "/ip/dns",
    noun="dns",
    kinds={
        "max-udp-packet-size": Int(50, 65507),
        "mdns-repeat-ifaces": Refs(Ref(("interface",))),
        "servers": AddressesValue(),
        "vrf": Ref(("table",)),
    },
)

_STATIC = of_schema(
    "/ip/dns/static",
    noun="static dns entry",
    kinds={
        "mx-preference": Int(0, 65535),
        "srv-port": Int(0, 65535),
        "srv-priority": Int(0, 65535),
        "srv-weight": Int(0, 65535),
    },
    local=(
        Arg("address", Address()),
        Arg("address-list", Text()),
        Arg("cname", Text()),
        Arg("forward-to", Text()),
        Arg("match-subdomain", Bool()),
        Arg("mx-exchange", Text()),
        Arg("name", Text(empty=False)),
        Arg("ns", Text()),
        Arg("regexp", Text(empty=False)),
        Arg("srv-target", Text()),
        Arg("text", Text()),
        Arg("type", Choice(offered_values("/ip/dns/static", "type")), "A", always=True),
    ),
    unique=(Unique(("name", "type", "address", "text"), "entry already exists"),),
    flags=("dynamic",),
)

_ROUTE = of_schema(
    "/ip/route",
    noun="route",
    kinds={
        "blackhole": FlagValue("true"),
        "distance": Int(1, 255),
        "dst-address": Prefixes(v6=False, empty="0.0.0.0/0"),
        "routing-table": Ref(("table",)),
        "scope": Int(0, 255),
        "target-scope": Int(0, 255),
    },
    local=(
        Arg("check-gateway", Choice(("arp", "none", "ping"))),
        Arg("gateway", GatewayValue()),
        Arg("pref-src", Address(v6=False, empty=True)),
        Arg("suppress-hw-offload", Bool(), "no"),
    ),
    name_property="dst-address",
    flags=("active", "dynamic", "inactive", "static"),
    first_id=0x80000001,
    sparse=True,
)

MENUS = (_ADDRESS, _POOL, _SERVER, _NETWORK, _LEASE, _CLIENT, _DNS, _STATIC, _ROUTE)
