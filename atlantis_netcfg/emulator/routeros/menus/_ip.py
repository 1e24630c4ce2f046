"""Addresses, pools, DHCP, DNS, routes.

Values and defaults: Manual, CLI reference of each menu; Manual, DHCP; Manual, DNS; Manual, IP Routing; verbose
exports of RouterOS 7.19.
"""

from __future__ import annotations

from atlantis_netcfg.emulator.routeros import values
from atlantis_netcfg.emulator.routeros.menus import _model
from atlantis_netcfg.emulator.routeros.schema import offered_values

_V4 = values.Address(v6=False)
_V4S = values.AddressesValue(_V4)
_NAME_TAKEN = _model.Unique(("name",), "failure: item with such name already exists")
_INTERFACE = _model.Arg("interface", values.Ref(("interface",)), is_required=True, always=True)

_ADDRESS = _model.of_schema(
    "/ip/address",
    noun="address",
    local=(
        _model.Arg("address", values.HostPrefix(), is_required=True, always=True),
        _model.Arg("broadcast", _V4, is_exported=False, never=True),
        _INTERFACE,
        _model.Arg("netmask", _V4, is_exported=False, never=True),
        _model.Arg("network", _V4, "", always=True),
    ),
    name_property="address",
    unique=(_model.Unique(("address", "interface"), "failure: already have such address"),),
    flags=("dynamic", "invalid"),
)

_POOL = _model.of_schema(
    "/ip/pool",
    noun="pool",
    kinds={"next-pool": values.Ref(("pool",), ("none",))},
    local=(
        _model.Arg("name", values.Text(empty=False), ""),
        _model.Arg("ranges", values.Ranges(), is_required=True, always=True),
    ),
    space="pool",
    unique=(_model.Unique(("name",), "failure: pool with such name exists"),),
)

_SERVER = _model.of_schema(
    "/ip/dhcp-server",
    noun="dhcp server",
    kinds={
        "address-pool": values.Ref(("pool",), ("static-only",)),
        "authoritative": values.Choice(("after-10sec-delay", "after-2sec-delay", "no", "yes")),
        "client-mac-limit": values.Int(words=("unlimited",)),
        "dynamic-lease-identifiers": values.Choices(("client-mac", "client-id", "opt-82")),
        "insert-queue-before": values.Choice(("bottom", "first")),
        "lease-time": values.Time(1),
        "use-radius": values.Choice(("accounting", "no", "yes")),
    },
    local=(
        _model.Arg("add-arp", values.Bool()),
        _model.Arg("always-broadcast", values.Bool()),
        _model.Arg("bootp-lease-time", values.Time(words=("forever", "lease-time"))),
        _model.Arg("bootp-support", values.Choice(("dynamic", "none", "static"))),
        _model.Arg("delay-threshold", values.Time(words=("none",))),
        _INTERFACE,
        _model.Arg("name", values.Text(empty=False), ""),
        _model.Arg("parent-queue", values.Text()),
    ),
    space="dhcp-server",
    unique=(_NAME_TAKEN, _model.Unique(("interface", "relay"), "failure: already have dhcp server on such interface")),
    flags=("dynamic", "invalid"),
)

_NETWORK = _model.of_schema(
    "/ip/dhcp-server/network",
    noun="dhcp network",
    kinds={
        "caps-manager": _V4S,
        "dns-server": _V4S,
        "gateway": _V4S,
        "netmask": values.Int(0, 32),
        "ntp-server": _V4S,
        "wins-server": _V4S,
    },
    local=(
        _model.Arg("address", values.Prefixes(v6=False), "0.0.0.0/0", always=True),
        _model.Arg("boot-file-name", values.Text()),
        _model.Arg("dns-none", values.Bool()),
        _model.Arg("domain", values.Text()),
        _model.Arg("ntp-none", values.Bool()),
    ),
    name_property="address",
    unique=(_model.Unique(("address",), "failure: already have such network"),),
    flags=("dynamic",),
)

_LEASE = _model.of_schema(
    "/ip/dhcp-server/lease",
    noun="dhcp lease",
    kinds={
        "allow-dual-stack-queue": values.Bool(),
        "insert-queue-before": values.Choice(("bottom", "first")),
        "server": values.Ref(("dhcp-server",), ("all",)),
    },
    local=(
        _model.Arg("address", _V4, always=True),
        _model.Arg("agent-circuit-id", values.Text(), ""),
        _model.Arg("agent-remote-id", values.Text(), ""),
        _model.Arg("block-access", values.Bool()),
        _model.Arg("client-id", values.Text()),
        _model.Arg("rate-limit", values.Text()),
    ),
    name_property="address",
    unique=(
        _model.Unique(("address", "server"), "failure: already have static lease with this IP address"),
        # Exports have two leases of one MAC address: for other client ids, and (7.22) with one of them disabled.
        _model.Unique(
            ("mac-address", "server", "client-id"),
            "failure: already have static lease with this MAC address",
            enabled_only=True,
        ),
    ),
    flags=("blocked", "dynamic", "radius"),
)

_CLIENT = _model.of_schema(
    "/ip/dhcp-client",
    noun="dhcp client",
    kinds={
        "add-default-route": values.Choice(("no", "special-classless", "yes")),
        "check-gateway": values.Choice(("arp", "bfd", "none", "ping")),
        "default-route-distance": values.Int(1, 255),
        "default-route-tables": values.Text(empty=False),
        "dscp": values.Int(0, 63),
        "use-broadcast": values.Choice(("always", "both", "never")),
        "use-peer-dns": values.Bool(),
        "vlan-priority": values.Int(0, 7),
    },
    local=(_INTERFACE, _model.Arg("script", values.Text())),
    name_property="interface",
    unique=(_model.Unique(("interface",), "failure: dhcp-client on that interface already exists"),),
    flags=("dynamic", "invalid"),
)

_DNS = _model.of_schema(
    "/ip/dns",
    noun="dns",
    kinds={
        "max-udp-packet-size": values.Int(50, 65507),
        "mdns-repeat-ifaces": values.Refs(values.Ref(("interface",))),
        "servers": values.AddressesValue(),
        "vrf": values.Ref(("table",)),
    },
)

_STATIC = _model.of_schema(
    "/ip/dns/static",
    noun="static dns entry",
    kinds={
        "mx-preference": values.Int(0, 65535),
        "srv-port": values.Int(0, 65535),
        "srv-priority": values.Int(0, 65535),
        "srv-weight": values.Int(0, 65535),
    },
    local=(
        _model.Arg("address", values.Address()),
        _model.Arg("address-list", values.Text()),
        _model.Arg("cname", values.Text()),
        _model.Arg("forward-to", values.Text()),
        _model.Arg("match-subdomain", values.Bool()),
        _model.Arg("mx-exchange", values.Text()),
        _model.Arg("name", values.Text(empty=False)),
        _model.Arg("ns", values.Text()),
        _model.Arg("regexp", values.Text(empty=False)),
        _model.Arg("srv-target", values.Text()),
        _model.Arg("text", values.Text()),
        _model.Arg("type", values.Choice(offered_values("/ip/dns/static", "type")), "A", always=True),
    ),
    unique=(_model.Unique(("name", "type", "address", "text"), "entry already exists"),),
    flags=("dynamic",),
)

_ROUTE = _model.of_schema(
    "/ip/route",
    noun="route",
    kinds={
        "blackhole": values.FlagValue("true"),
        "distance": values.Int(1, 255),
        "dst-address": values.Prefixes(v6=False, empty="0.0.0.0/0"),
        "routing-table": values.Ref(("table",)),
        "scope": values.Int(0, 255),
        "target-scope": values.Int(0, 255),
    },
    local=(
        _model.Arg("check-gateway", values.Choice(("arp", "none", "ping"))),
        _model.Arg("gateway", values.GatewayValue()),
        _model.Arg("pref-src", values.Address(v6=False, empty=True)),
        _model.Arg("suppress-hw-offload", values.Bool(), "no"),
    ),
    name_property="dst-address",
    flags=("active", "dynamic", "inactive", "static"),
    first_id=0x80000001,
    sparse=True,
)

MENUS = (_ADDRESS, _POOL, _SERVER, _NETWORK, _LEASE, _CLIENT, _DNS, _STATIC, _ROUTE)
