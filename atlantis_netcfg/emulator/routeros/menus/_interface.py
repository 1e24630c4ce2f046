"""Interfaces: Ethernet ports, bridges and their ports, interface lists, the OpenVPN client.

Values and defaults: Manual, CLI reference of each menu; Manual, Bridging and Switching; Manual, Ethernet; Manual,
PoE-Out; Manual, OpenVPN; verbose exports of RouterOS 7.19.
"""

from __future__ import annotations

from dataclasses import dataclass

from atlantis_netcfg.emulator.routeros.menus._model import (
    Arg,
    Select,
    Unique,
    of_schema,
)
from atlantis_netcfg.emulator.routeros.schema import offered_values
from atlantis_netcfg.emulator.routeros.values import Address, Bool, Choice, Choices, Int, Mac, Ref, Refs, Text, Time

_UNIQUE_NAME = Unique(("name",), "failure: already have interface with such name")
_ARP = Choice(("disabled", "enabled", "local-proxy-arp", "proxy-arp", "reply-only"))
_FRAMES = Choice(("admit-all", "admit-only-untagged-and-priority-tagged", "admit-only-vlan-tagged"))
_ROUTER = Choice(("disabled", "permanent", "temporary-query"))
_VLAN = ("vlan-filtering", "yes")
_IGMP = ("igmp-snooping", "yes")
_FLOW = Choice(("auto", "off", "on"))
_RATES = "10M-baseT-half,10M-baseT-full,100M-baseT-half,100M-baseT-full,1G-baseT-half,1G-baseT-full"

_ADVERTISED_RATES = (
    *("10M-half", "10M-full", "100M-half", "100M-full", "1000M-half", "1000M-full"),
    *("2500M-full", "5000M-full", "10000M-full"),
)
_SPEEDS = ("10Mbps", "100Mbps", "1Gbps", "2.5Gbps", "5Gbps", "10Gbps")


@dataclass(frozen=True, slots=True)
class OldWords:
    """Words of an argument that got other names in version `until`; `is_complete`: before that there were no others."""

    until: str
    old: tuple[str, ...]
    is_complete: bool = True


OLD_WORDS = {
    "/interface/ethernet": {"advertise": OldWords("7.12", _ADVERTISED_RATES), "speed": OldWords("7.12", _SPEEDS)},
    "/interface/ovpn-client": {"cipher": OldWords("7.7", ("aes128", "aes192", "aes256"), is_complete=False)},
}
"""Ethernet: changelog of 7.12, "changed advertise and speed arguments"; exports of 6.43 to 7.8. OpenVPN: exports of 7.5
and 7.6 have `aes256`, of 7.11.2 `aes256-cbc`; when it changed between them is not known."""

_BRIDGE = of_schema(
    "/interface/bridge",
    noun="device",
    kinds={
        "ageing-time": Time(10, 1005400),
        "arp": _ARP,
        "arp-timeout": Time(words=("auto",)),
        "forward-delay": Time(4, 30),
        "max-learned-entries": Int(words=("auto", "unlimited")),
        "max-message-age": Time(6, 40),
        "mtu": Int(68, 65535, words=("auto",)),
        "port-cost-mode": Choice(("long", "short")),
        "priority": Int(0, 65535, hexadecimal=True),
        "protocol-mode": Choice(("mstp", "none", "rstp", "stp")),
        "transmit-hold-count": Int(1, 10),
    },
    local=(
        Arg("name", Text(empty=False), ""),
        Arg("add-dhcp-option82", Bool(), "no", shown_if=("dhcp-snooping", "yes")),
        Arg("ether-type", Choice(("0x8100", "0x88a8", "0x9100")), "0x8100", shown_if=_VLAN),
        Arg("forward-reserved-addresses", Bool(), "no", shown_if=("protocol-mode", "none")),
        Arg("frame-types", _FRAMES, "admit-all", shown_if=_VLAN),
        Arg("igmp-version", Choice(("2", "3")), "2", shown_if=_IGMP),
        Arg("ingress-filtering", Bool(), "yes", shown_if=_VLAN),
        Arg("last-member-interval", Time(), "1s", shown_if=_IGMP),
        Arg("last-member-query-count", Int(), "2", shown_if=_IGMP),
        Arg("max-hops", Int(6, 40), "20", shown_if=("protocol-mode", "mstp")),
        Arg("membership-interval", Time(), "4m20s", shown_if=_IGMP),
        Arg("mld-version", Choice(("1", "2")), "1", shown_if=_IGMP),
        Arg("multicast-querier", Bool(), "no", shown_if=_IGMP),
        Arg("multicast-router", _ROUTER, "temporary-query", shown_if=_IGMP),
        Arg("pvid", Int(1, 4094), "1", shown_if=_VLAN),
        Arg("querier-interval", Time(), "4m15s", shown_if=_IGMP),
        Arg("query-interval", Time(), "2m5s", shown_if=_IGMP),
        Arg("query-response-interval", Time(), "10s", shown_if=_IGMP),
        Arg("region-name", Text(), "", shown_if=("protocol-mode", "mstp")),
        Arg("region-revision", Int(0, 65535), "0", shown_if=("protocol-mode", "mstp")),
        Arg("startup-query-count", Int(), "2", shown_if=_IGMP),
        Arg("startup-query-interval", Time(), "31s250ms", shown_if=_IGMP),
    ),
    space="interface",
    unique=(_UNIQUE_NAME,),
    flags=("dynamic", "running"),
)

_PORT = of_schema(
    "/interface/bridge/port",
    noun="bridge port",
    kinds={
        "edge": Choice(("auto", "no", "no-discover", "yes", "yes-discover")),
        "frame-types": _FRAMES,
        "horizon": Int(0, 429496729, words=("none",)),
        "internal-path-cost": Int(0, 200000000),
        "learn": Choice(("auto", "no", "yes")),
        "multicast-router": _ROUTER,
        "mvrp-applicant-state": Choice(("non-participant", "normal-participant")),
        "mvrp-registrar-state": Choice(("fixed", "normal")),
        "path-cost": Int(0, 200000000),
        "point-to-point": Choice(("auto", "no", "yes")),
        "priority": Int(0, 240, hexadecimal=True),
        "pvid": Int(1, 4094),
    },
    local=(
        Arg("bridge", Ref(("bridge",)), is_required=True, always=True),
        Arg("interface", Ref(("interface", "list")), is_required=True, always=True),
    ),
    name_property="interface",
    unique=(Unique(("interface",), "failure: device already added as bridge port"),),
    flags=("dynamic", "inactive"),
    first_id=0,
)

# Rows refer to a port by its id. Assumption: name-in-routes. Assumption: port-new-name
_ETHERNET = of_schema(
    "/interface/ethernet",
    noun="device",
    kinds={
        "arp": _ARP,
        "arp-timeout": Time(words=("auto",)),
        "loop-protect": Choice(("default", "off", "on")),
        "loop-protect-send-interval": Time(1),
        "mtu": Int(68, 65535),
        "speed": Choice((*offered_values("/interface/ethernet", "speed"), *_SPEEDS)),
        "poe-out": Choice(("auto-on", "forced-on", "off")),
        "poe-priority": Int(0, 99),
        "poe-voltage": Choice(("auto", "high", "low")),
        "power-cycle-interval": Time(words=("none",)),
        "power-cycle-ping-address": Address(),
    },
    local=(
        Arg("name", Text(empty=False), ""),
        Arg(
            "advertise",
            Choices((*offered_values("/interface/ethernet", "advertise"), *_ADVERTISED_RATES), is_ordered=False),
            _RATES,
        ),
        Arg("l2mtu", Int(0, 65535), "1598"),
        Arg("mac-address", Mac(), ""),
        Arg("orig-mac-address", Mac(), ""),
        Arg("rx-flow-control", _FLOW, "off"),
        Arg("tx-flow-control", _FLOW, "off"),
    ),
    without=(
        "cable-settings",
        "combo-mode",
        "default-name",
        "disable-running-check",
        "fec-mode",
        "mdix-enable",
        "sfp-ignore-rx-los",
        "sfp-rate-select",
        "sfp-shutdown-temperature",
    ),
    space="interface",
    unique=(_UNIQUE_NAME,),
    flags=("running", "slave"),
    select=Select.DEFAULT_NAME,
)

_LIST = of_schema(
    "/interface/list",
    noun="interface list",
    kinds={"exclude": Refs(Ref(("list",))), "include": Refs(Ref(("list",)))},
    local=(Arg("name", Text(empty=False), is_required=True),),
    space="list",
    unique=(Unique(("name",), "failure: already have such name"),),
    factory=(
        {"name": "all", "comment": "contains all interfaces"},
        {"name": "none", "comment": "contains no interfaces"},
        {"name": "dynamic", "comment": "contains dynamic interfaces"},
        {"name": "static", "comment": "contains static interfaces"},
    ),
    flags=("dynamic",),
    builtin_flag="builtin",
    select=Select.FIND_NAME,
    first_id=0x2000000,
)

_MEMBER = of_schema(
    "/interface/list/member",
    noun="interface list member",
    local=(
        Arg("interface", Ref(("interface",)), is_required=True, always=True),
        Arg("list", Ref(("list",)), is_required=True, always=True),
    ),
    unique=(Unique(("interface", "list"), "failure: already have such entry"),),
    flags=("dynamic",),
)

_CIPHERS = Choice(
    (*offered_values("/interface/ovpn-client", "cipher"), *OLD_WORDS["/interface/ovpn-client"]["cipher"].old)
)
_OVPN = of_schema(
    "/interface/ovpn-client",
    noun="device",
    kinds={
        "auth": Choice(("md5", "null", "sha1", "sha256", "sha384", "sha512")),
        "certificate": Ref(("certificate",), ("none",)),
        "cipher": _CIPHERS,
        "max-mtu": Int(64, 65535),
        "mode": Choice(("ethernet", "ip")),
        "password": Text(longest=1000),
        "port": Int(1, 65535),
        "protocol": Choice(("tcp", "udp")),
        "tls-version": Choice(("any", "only-1.2")),
    },
    local=(
        Arg("name", Text(empty=False), ""),
        Arg("connect-to", Address(dns=True), is_required=True),
        Arg("disabled", Bool(), "yes"),
        Arg("disconnect-notify", Bool(), "yes", shown_if=("protocol", "udp")),
        Arg("mac-address", Mac(), ""),
        Arg("use-peer-dns", Choice(("exclusively", "no", "yes")), "yes"),
        Arg("user", Text(longest=27, empty=False), is_required=True),
    ),
    space="interface",
    unique=(_UNIQUE_NAME,),
    flags=("running", "hw-crypto"),
)

MENUS = (_BRIDGE, _PORT, _ETHERNET, _LIST, _MEMBER, _OVPN)
