"""Services that the router offers, and the settings that harden it.

Values and defaults: Manual, CLI reference of each menu; Manual, Services; Manual, Securing your router; verbose
exports of RouterOS 7.19.
"""

from __future__ import annotations

from atlantis_netcfg.emulator.routeros.menus._model import Arg, Select, of_schema
from atlantis_netcfg.emulator.routeros.values import (
    Address,
    AddressesValue,
    Choice,
    Choices,
    Int,
    Not,
    Pattern,
    Ports,
    Prefixes,
    Ref,
    Text,
    Time,
)

_LIST = Ref(("list",))
_VRF = Arg("vrf", Ref(("table",)), "main")
_TLS = {"certificate": "none", "tls-version": "any"}

MENUS = (
    of_schema(
        "/ip/service",
        noun="ip service",
        kinds={"address": Prefixes(many=True), "max-sessions": Int(1, 1000)},
        local=(
            Arg("name", Text(), "", is_exported=False),
            Arg("certificate", Ref(("certificate",), ("none",))),
            Arg("port", Int(1, 65535), ""),
            Arg("tls-version", Choice(("any", "only-1.2"))),
            _VRF,
        ),
        factory=(
            {"name": "telnet", "port": "23"},
            {"name": "ftp", "port": "21"},
            {"name": "www", "port": "80"},
            {"name": "ssh", "port": "22"},
            {"name": "www-ssl", "port": "443", "disabled": "yes", **_TLS},
            {"name": "api", "port": "8728"},
            {"name": "winbox", "port": "8291"},
            {"name": "api-ssl", "port": "8729", **_TLS},
        ),
        flags=("invalid",),
        select=Select.NAME,
        first_id=0,
    ),
    of_schema(
        "/ip/ssh",
        noun="ssh settings",
        kinds={
            "ciphers": Choices(("3des-cbc", "aes-cbc", "aes-ctr", "aes-gcm", "auto", "null"), is_ordered=False),
            "forwarding-enabled": Choice(("both", "local", "no", "remote")),
            "password-authentication": Choice(("no", "yes", "yes-if-no-key")),
            "publickey-authentication-options": Choice(("none", "touch-required", "verify-required")),
        },
        local=(
            Arg("host-key-size", Choice(("1024", "1536", "2048", "4096", "8192")), "2048"),
            Arg("host-key-type", Choice(("ed25519", "rsa")), "rsa"),
        ),
    ),
    of_schema(
        "/ip/neighbor/discovery-settings",
        noun="discovery settings",
        kinds={
            "discover-interface-list": Not(_LIST),
            "discover-interval": Time(5, 32768),
            "lldp-med-net-policy-vlan": Int(0, 4094, words=("disabled",)),
            "mode": Choice(("rx-only", "tx-and-rx", "tx-only")),
            "protocol": Choices(("cdp", "lldp", "mndp")),
        },
    ),
    of_schema(
        "/ip/cloud",
        noun="cloud settings",
        kinds={"ddns-enabled": Choice(("auto", "no", "yes")), "ddns-update-interval": Time(60, words=("none",))},
    ),
    of_schema(
        "/ip/proxy",
        noun="web proxy",
        kinds={
            "cache-hit-dscp": Int(0, 63),
            "max-cache-size": Int(words=("none", "unlimited")),
            "parent-proxy": Address(),
            "parent-proxy-port": Int(0, 65535),
            "port": Ports(),
            "src-address": AddressesValue(),
        },
        feature="proxy",
    ),
    of_schema(
        "/ip/socks",
        noun="socks settings",
        kinds={
            "auth-method": Choice(("none", "password")),
            "max-connections": Int(1, 500),
            "port": Int(1, 65535),
            "version": Choice(("4", "5")),
        },
        local=(_VRF,),
        feature="socks",
    ),
    of_schema(
        "/ip/settings",
        noun="ip settings",
        kinds={
            "ipv4-multipath-hash-policy": Choice(("l3", "l3-inner", "l4")),
            "rp-filter": Choice(("loose", "no", "strict")),
            "tcp-timestamps": Choice(("disabled", "enabled", "random-offset")),
        },
        local=(
            Arg("icmp-rate-mask", Pattern(r"0x[0-9A-Fa-f]{1,8}"), "0x1818"),
            Arg("max-neighbor-entries", Int(), "16384"),
        ),
    ),
    of_schema("/ip/upnp", noun="upnp settings"),
    of_schema(
        "/ipv6/settings",
        noun="ipv6 settings",
        kinds={
            "accept-redirects": Choice(("no", "yes-if-forwarding-disabled")),
            "accept-router-advertisements": Choice(("no", "yes", "yes-if-forwarding-disabled")),
            "accept-router-advertisements-on": _LIST,
            "multipath-hash-policy": Choice(("l3", "l3-inner", "l4")),
            "stale-neighbor-detect-interval": Int(),
            "stale-neighbor-timeout": Int(),
        },
        local=(
            Arg("max-neighbor-entries", Int(), "14336"),
            Arg("min-neighbor-entries", Int(), "3584"),
            Arg("soft-max-neighbor-entries", Int(), "7168"),
        ),
    ),
    of_schema(
        "/snmp",
        noun="snmp settings",
        kinds={
            "src-address": Address(),
            "trap-generators": Choices(("interfaces", "start-trap", "temp-exception")),
            "trap-version": Choice(("1", "2", "3")),
        },
        local=(_VRF,),
    ),
    of_schema(
        "/tool/romon",
        noun="romon settings",
        kinds={"id": Pattern(r"[0-9A-Fa-f]{2}(:[0-9A-Fa-f]{2}){5}")},
        local=(Arg("secrets", Text(), "", secret=True),),
        feature="romon",
    ),
    of_schema("/tool/mac-server", noun="mac-server interface", kinds={"allowed-interface-list": _LIST}),
    of_schema("/tool/mac-server/mac-winbox", noun="mac winbox setting", kinds={"allowed-interface-list": _LIST}),
    of_schema("/tool/mac-server/ping", noun="mac ping setting"),
    of_schema(
        "/tool/bandwidth-server",
        noun="bandwidth server",
        kinds={
            "allocate-udp-ports-from": Int(1000, 64000),
            "allowed-addresses4": Prefixes(many=True, v6=False),
            "max-sessions": Int(1, 1000),
        },
        feature="bandwidth-test",
    ),
)
