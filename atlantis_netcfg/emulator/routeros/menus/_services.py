"""Services that the router offers, and the settings that harden it.

Values and defaults: Manual, CLI reference of each menu; Manual, Services; Manual, Securing your router; verbose
exports of RouterOS 7.19.
"""

from __future__ import annotations

from atlantis_netcfg.emulator.routeros import values
from atlantis_netcfg.emulator.routeros.menus import _model

_LIST = values.Ref(("list",))
_VRF = _model.Arg("vrf", values.Ref(("table",)), "main")
_TLS = {"certificate": "none", "tls-version": "any"}

MENUS = (
    _model.of_schema(
        "/ip/service",
        noun="ip service",
        kinds={"address": values.Prefixes(many=True), "max-sessions": values.Int(1, 1000)},
        local=(
            _model.Arg("name", values.Text(), "", is_exported=False),
            _model.Arg("certificate", values.Ref(("certificate",), ("none",))),
            _model.Arg("port", values.Int(1, 65535), ""),
            _model.Arg("tls-version", values.Choice(("any", "only-1.2"))),
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
        select=_model.Select.NAME,
        first_id=0,
    ),
    _model.of_schema(
        "/ip/ssh",
        noun="ssh settings",
        kinds={
            "ciphers": values.Choices(("3des-cbc", "aes-cbc", "aes-ctr", "aes-gcm", "auto", "null"), is_ordered=False),
            "forwarding-enabled": values.Choice(("both", "local", "no", "remote")),
            "password-authentication": values.Choice(("no", "yes", "yes-if-no-key")),
            "publickey-authentication-options": values.Choice(("none", "touch-required", "verify-required")),
        },
        local=(
            _model.Arg("host-key-size", values.Choice(("1024", "1536", "2048", "4096", "8192")), "2048"),
            _model.Arg("host-key-type", values.Choice(("ed25519", "rsa")), "rsa"),
        ),
    ),
    _model.of_schema(
        "/ip/neighbor/discovery-settings",
        noun="discovery settings",
        kinds={
            "discover-interface-list": values.Not(_LIST),
            "discover-interval": values.Time(5, 32768),
            "lldp-med-net-policy-vlan": values.Int(0, 4094, words=("disabled",)),
            "mode": values.Choice(("rx-only", "tx-and-rx", "tx-only")),
            "protocol": values.Choices(("cdp", "lldp", "mndp")),
        },
    ),
    _model.of_schema(
        "/ip/cloud",
        noun="cloud settings",
        kinds={
            "ddns-enabled": values.Choice(("auto", "no", "yes")),
            "ddns-update-interval": values.Time(60, words=("none",)),
        },
    ),
    _model.of_schema(
        "/ip/proxy",
        noun="web proxy",
        kinds={
            "cache-hit-dscp": values.Int(0, 63),
            "max-cache-size": values.Int(words=("none", "unlimited")),
            "parent-proxy": values.Address(),
            "parent-proxy-port": values.Int(0, 65535),
            "port": values.Ports(),
            "src-address": values.AddressesValue(),
        },
        feature="proxy",
    ),
    _model.of_schema(
        "/ip/socks",
        noun="socks settings",
        kinds={
            "auth-method": values.Choice(("none", "password")),
            "max-connections": values.Int(1, 500),
            "port": values.Int(1, 65535),
            "version": values.Choice(("4", "5")),
        },
        local=(_VRF,),
        feature="socks",
    ),
    _model.of_schema(
        "/ip/settings",
        noun="ip settings",
        kinds={
            "ipv4-multipath-hash-policy": values.Choice(("l3", "l3-inner", "l4")),
            "rp-filter": values.Choice(("loose", "no", "strict")),
            "tcp-timestamps": values.Choice(("disabled", "enabled", "random-offset")),
        },
        local=(
            _model.Arg("icmp-rate-mask", values.Pattern(r"0x[0-9A-Fa-f]{1,8}"), "0x1818"),
            _model.Arg("max-neighbor-entries", values.Int(), "16384"),
        ),
    ),
    _model.of_schema("/ip/upnp", noun="upnp settings"),
    _model.of_schema(
        "/ipv6/settings",
        noun="ipv6 settings",
        kinds={
            "accept-redirects": values.Choice(("no", "yes-if-forwarding-disabled")),
            "accept-router-advertisements": values.Choice(("no", "yes", "yes-if-forwarding-disabled")),
            "accept-router-advertisements-on": _LIST,
            "multipath-hash-policy": values.Choice(("l3", "l3-inner", "l4")),
            "stale-neighbor-detect-interval": values.Int(),
            "stale-neighbor-timeout": values.Int(),
        },
        local=(
            _model.Arg("max-neighbor-entries", values.Int(), "14336"),
            _model.Arg("min-neighbor-entries", values.Int(), "3584"),
            _model.Arg("soft-max-neighbor-entries", values.Int(), "7168"),
        ),
    ),
    _model.of_schema(
        "/snmp",
        noun="snmp settings",
        kinds={
            "src-address": values.Address(),
            "trap-generators": values.Choices(("interfaces", "start-trap", "temp-exception")),
            "trap-version": values.Choice(("1", "2", "3")),
        },
        local=(_VRF,),
    ),
    _model.of_schema(
        "/tool/romon",
        noun="romon settings",
        kinds={"id": values.Pattern(r"[0-9A-Fa-f]{2}(:[0-9A-Fa-f]{2}){5}")},
        local=(_model.Arg("secrets", values.Text(), "", secret=True),),
        feature="romon",
    ),
    _model.of_schema("/tool/mac-server", noun="mac-server interface", kinds={"allowed-interface-list": _LIST}),
    _model.of_schema("/tool/mac-server/mac-winbox", noun="mac winbox setting", kinds={"allowed-interface-list": _LIST}),
    _model.of_schema("/tool/mac-server/ping", noun="mac ping setting"),
    _model.of_schema(
        "/tool/bandwidth-server",
        noun="bandwidth server",
        kinds={
            "allocate-udp-ports-from": values.Int(1000, 64000),
            "allowed-addresses4": values.Prefixes(many=True, v6=False),
            "max-sessions": values.Int(1, 1000),
        },
        feature="bandwidth-test",
    ),
)
