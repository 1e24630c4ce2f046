"""Interfaces: Ethernet ports, bridges and their ports, interface lists, the OpenVPN client.

Values and defaults: Manual, CLI reference of each menu; Manual, Bridging and Switching; Manual, Ethernet; Manual,
PoE-Out; Manual, OpenVPN; verbose exports of RouterOS 7.19.
"""

from __future__ import annotations

from dataclasses import dataclass

from atlantis_netcfg.emulator.routeros import values
from atlantis_netcfg.emulator.routeros.menus import _model
from atlantis_netcfg.emulator.routeros.schema import offered_values

_UNIQUE_NAME = _model.Unique(("name",), "failure: already have interface with such name")
_ARP = values.Choice(("disabled", "enabled", "local-proxy-arp", "proxy-arp", "reply-only"))
_FRAMES = values.Choice(("admit-all", "admit-only-untagged-and-priority-tagged", "admit-only-vlan-tagged"))
_ROUTER = values.Choice(("disabled", "permanent", "temporary-query"))
_VLAN = ("vlan-filtering", "yes")
_IGMP = ("igmp-snooping", "yes")
_FLOW = values.Choice(("auto", "off", "on"))
_RATES = "10M-baseT-half,10M-baseT-full,100M-baseT-half,100M-baseT-full,1G-baseT-half,1G-baseT-full"

_ADVERTISED_RATES = (
    *("10M-half", "10M-full", "100M-half", "100M-full", "1000M-half", "1000M-full"),
    *("2500M-full", "5000M-full", "10000M-full"),
)
_SPEEDS = ("10Mbps", "100Mbps", "1Gbps", "2.5Gbps", "5Gbps", "10Gbps")


@dataclass(frozen=True, slots=True)
class OldWords:
    """Keywords renamed in version `until`; `is_complete`: there were no others before."""

    until: str
    old: tuple[str, ...]
    is_complete: bool = True


OLD_WORDS = {
    "/interface/ethernet": {"advertise": OldWords("7.12", _ADVERTISED_RATES), "speed": OldWords("7.12", _SPEEDS)},
    "/interface/ovpn-client": {"cipher": OldWords("7.7", ("aes128", "aes192", "aes256"), is_complete=False)},
}
"""Ethernet: changelog of 7.12, "changed advertise and speed arguments"; exports of 6.43 to 7.8. OpenVPN: exports of 7.5
and 7.6 have `aes256`, of 7.11.2 `aes256-cbc`; when it changed between them is not known."""

_BRIDGE = _model.of_schema(
    "/interface/bridge",
    noun="device",
    kinds={
        "ageing-time": values.Time(10, 1005400),
        "arp": _ARP,
        "arp-timeout": values.Time(words=("auto",)),
        "forward-delay": values.Time(4, 30),
        "max-learned-entries": values.Int(words=("auto", "unlimited")),
        "max-message-age": values.Time(6, 40),
        "mtu": values.Int(68, 65535, words=("auto",)),
        "port-cost-mode": values.Choice(("long", "short")),
        "priority": values.Int(0, 65535, hexadecimal=True),
        "protocol-mode": values.Choice(("mstp", "none", "rstp", "stp")),
        "transmit-hold-count": values.Int(1, 10),
    },
    local=(
        _model.Arg("name", values.Text(empty=False), ""),
        _model.Arg("add-dhcp-option82", values.Bool(), "no", shown_if=("dhcp-snooping", "yes")),
        _model.Arg("ether-type", values.Choice(("0x8100", "0x88a8", "0x9100")), "0x8100", shown_if=_VLAN),
        _model.Arg("forward-reserved-addresses", values.Bool(), "no", shown_if=("protocol-mode", "none")),
        _model.Arg("frame-types", _FRAMES, "admit-all", shown_if=_VLAN),
        _model.Arg("igmp-version", values.Choice(("2", "3")), "2", shown_if=_IGMP),
        _model.Arg("ingress-filtering", values.Bool(), "yes", shown_if=_VLAN),
        _model.Arg("last-member-interval", values.Time(), "1s", shown_if=_IGMP),
        _model.Arg("last-member-query-count", values.Int(), "2", shown_if=_IGMP),
        _model.Arg("max-hops", values.Int(6, 40), "20", shown_if=("protocol-mode", "mstp")),
        _model.Arg("membership-interval", values.Time(), "4m20s", shown_if=_IGMP),
        _model.Arg("mld-version", values.Choice(("1", "2")), "1", shown_if=_IGMP),
        _model.Arg("multicast-querier", values.Bool(), "no", shown_if=_IGMP),
        _model.Arg("multicast-router", _ROUTER, "temporary-query", shown_if=_IGMP),
        _model.Arg("pvid", values.Int(1, 4094), "1", shown_if=_VLAN),
        _model.Arg("querier-interval", values.Time(), "4m15s", shown_if=_IGMP),
        _model.Arg("query-interval", values.Time(), "2m5s", shown_if=_IGMP),
        _model.Arg("query-response-interval", values.Time(), "10s", shown_if=_IGMP),
        _model.Arg("region-name", values.Text(), "", shown_if=("protocol-mode", "mstp")),
        _model.Arg("region-revision", values.Int(0, 65535), "0", shown_if=("protocol-mode", "mstp")),
        _model.Arg("startup-query-count", values.Int(), "2", shown_if=_IGMP),
        _model.Arg("startup-query-interval", values.Time(), "31s250ms", shown_if=_IGMP),
    ),
    space="interface",
    unique=(_UNIQUE_NAME,),
    flags=("dynamic", "running"),
)

_PORT = _model.of_schema(
    "/interface/bridge/port",
    noun="bridge port",
    kinds={
        "edge": values.Choice(("auto", "no", "no-discover", "yes", "yes-discover")),
        "frame-types": _FRAMES,
        "horizon": values.Int(0, 429496729, words=("none",)),
        "internal-path-cost": values.Int(0, 200000000),
        "learn": values.Choice(("auto", "no", "yes")),
        "multicast-router": _ROUTER,
        "mvrp-applicant-state": values.Choice(("non-participant", "normal-participant")),
        "mvrp-registrar-state": values.Choice(("fixed", "normal")),
        "path-cost": values.Int(0, 200000000),
        "point-to-point": values.Choice(("auto", "no", "yes")),
        "priority": values.Int(0, 240, hexadecimal=True),
        "pvid": values.Int(1, 4094),
    },
    local=(
        _model.Arg("bridge", values.Ref(("bridge",)), is_required=True, always=True),
        _model.Arg("interface", values.Ref(("interface", "list")), is_required=True, always=True),
    ),
    name_property="interface",
    unique=(_model.Unique(("interface",), "failure: device already added as bridge port"),),
    flags=("dynamic", "inactive"),
    first_id=0,
)

# Rows refer to a port by its id. Assumption: name-in-routes. Assumption: port-new-name
_ETHERNET = _model.of_schema(
    "/interface/ethernet",
    noun="device",
    kinds={
        "arp": _ARP,
        "arp-timeout": values.Time(words=("auto",)),
        "loop-protect": values.Choice(("default", "off", "on")),
        "loop-protect-send-interval": values.Time(1),
        "mtu": values.Int(68, 65535),
        "speed": values.Choice((*offered_values("/interface/ethernet", "speed"), *_SPEEDS)),
        "poe-out": values.Choice(("auto-on", "forced-on", "off")),
        "poe-priority": values.Int(0, 99),
        "poe-voltage": values.Choice(("auto", "high", "low")),
        "power-cycle-interval": values.Time(words=("none",)),
        "power-cycle-ping-address": values.Address(),
    },
    local=(
        _model.Arg("name", values.Text(empty=False), ""),
        _model.Arg(
            "advertise",
            values.Choices((*offered_values("/interface/ethernet", "advertise"), *_ADVERTISED_RATES), is_ordered=False),
            _RATES,
        ),
        _model.Arg("l2mtu", values.Int(0, 65535), "1598"),
        _model.Arg("mac-address", values.Mac(), ""),
        _model.Arg("orig-mac-address", values.Mac(), ""),
        _model.Arg("rx-flow-control", _FLOW, "off"),
        _model.Arg("tx-flow-control", _FLOW, "off"),
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
    select=_model.Select.DEFAULT_NAME,
)

_LIST = _model.of_schema(
    "/interface/list",
    noun="interface list",
    kinds={"exclude": values.Refs(values.Ref(("list",))), "include": values.Refs(values.Ref(("list",)))},
    local=(_model.Arg("name", values.Text(empty=False), is_required=True),),
    space="list",
    unique=(_model.Unique(("name",), "failure: already have such name"),),
    factory=(
        {"name": "all", "comment": "contains all interfaces"},
        {"name": "none", "comment": "contains no interfaces"},
        {"name": "dynamic", "comment": "contains dynamic interfaces"},
        {"name": "static", "comment": "contains static interfaces"},
    ),
    flags=("dynamic",),
    builtin_flag="builtin",
    select=_model.Select.FIND_NAME,
    first_id=0x2000000,
)

_MEMBER = _model.of_schema(
    "/interface/list/member",
    noun="interface list member",
    local=(
        _model.Arg("interface", values.Ref(("interface",)), is_required=True, always=True),
        _model.Arg("list", values.Ref(("list",)), is_required=True, always=True),
    ),
    unique=(_model.Unique(("interface", "list"), "failure: already have such entry"),),
    flags=("dynamic",),
)

_CIPHERS = values.Choice(
    (*offered_values("/interface/ovpn-client", "cipher"), *OLD_WORDS["/interface/ovpn-client"]["cipher"].old)
)
_OVPN = _model.of_schema(
    "/interface/ovpn-client",
    noun="device",
    kinds={
        "auth": values.Choice(("md5", "null", "sha1", "sha256", "sha384", "sha512")),
        "certificate": values.Ref(("certificate",), ("none",)),
        "cipher": _CIPHERS,
        "max-mtu": values.Int(64, 65535),
        "mode": values.Choice(("ethernet", "ip")),
        "password": values.Text(longest=1000),
        "port": values.Int(1, 65535),
        "protocol": values.Choice(("tcp", "udp")),
        "tls-version": values.Choice(("any", "only-1.2")),
    },
    local=(
        _model.Arg("name", values.Text(empty=False), ""),
        _model.Arg("connect-to", values.Address(dns=True), is_required=True),
        _model.Arg("disabled", values.Bool(), "yes"),
        _model.Arg("disconnect-notify", values.Bool(), "yes", shown_if=("protocol", "udp")),
        _model.Arg("mac-address", values.Mac(), ""),
        _model.Arg("use-peer-dns", values.Choice(("exclusively", "no", "yes")), "yes"),
        _model.Arg("user", values.Text(longest=27, empty=False), is_required=True),
    ),
    space="interface",
    unique=(_UNIQUE_NAME,),
    flags=("running", "hw-crypto"),
)

MENUS = (_BRIDGE, _PORT, _ETHERNET, _LIST, _MEMBER, _OVPN)
