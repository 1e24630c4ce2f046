"""Services that the router offers, and the settings that harden it.

Values and defaults: Manual, CLI reference of each menu; Manual, Services; Manual, Securing your router; verbose
exports of RouterOS 7.19.
"""

from __future__ import annotations

from atlantis_netcfg.twin.menus._model import DISABLED, Arg, Menu, Select, Shape
from atlantis_netcfg.twin.values import (
    Address,
    Addresses,
    Bool,
    Choice,
    Choices,
    Int,
    Not,
    Pattern,
    Prefixes,
    Ref,
    Size,
    Text,
    Time,
)

__all__ = ["MENUS"]

_LIST = Ref(("list",))
_VRF = Arg("vrf", Ref(("table",)), "main")
_TLS = {"certificate": "none", "tls-version": "any"}

MENUS = (
    Menu(
        "/ip/service",
        Shape.FIXED,
        (
            Arg("name", Text(), "", exported=False),
            Arg("address", Prefixes(many=True), ""),
            Arg("certificate", Ref(("certificate",), ("none",))),
            DISABLED,
            Arg("max-sessions", Int(1, 1000), "20"),
            Arg("port", Int(1, 65535), ""),
            Arg("tls-version", Choice(("any", "only-1.2"))),
            _VRF,
        ),
        noun="ip service",
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
    Menu(
        "/ip/ssh",
        Shape.SETTINGS,
        (
            Arg("allow-none-crypto", Bool(), "no"),
            Arg("always-allow-password-login", Bool(), "no"),
            Arg(
                "ciphers", Choices(("3des-cbc", "aes-cbc", "aes-ctr", "aes-gcm", "auto", "null"), ordered=False), "auto"
            ),
            Arg("forwarding-enabled", Choice(("both", "local", "no", "remote")), "no"),
            Arg("host-key-size", Choice(("1024", "1536", "2048", "4096", "8192")), "2048"),
            Arg("host-key-type", Choice(("ed25519", "rsa")), "rsa"),
            Arg("password-authentication", Choice(("no", "yes", "yes-if-no-key")), "yes-if-no-key"),
            Arg("publickey-authentication-options", Choice(("none", "touch-required", "verify-required")), "none"),
            Arg("strong-crypto", Bool(), "no"),
        ),
        noun="ssh settings",
    ),
    Menu(
        "/ip/neighbor/discovery-settings",
        Shape.SETTINGS,
        (
            Arg("discover-interface-list", Not(_LIST), "static"),
            Arg("discover-interval", Time(5, 32768), "30s"),
            Arg("lldp-mac-phy-config", Bool(), "no"),
            Arg("lldp-max-frame-size", Bool(), "no"),
            Arg("lldp-med-net-policy-vlan", Int(0, 4094, words=("disabled",)), "disabled"),
            Arg("lldp-poe-power", Bool(), "yes"),
            Arg("lldp-vlan-info", Bool(), "no"),
            Arg("mode", Choice(("rx-only", "tx-and-rx", "tx-only")), "tx-and-rx"),
            Arg("protocol", Choices(("cdp", "lldp", "mndp")), "cdp,lldp,mndp"),
        ),
        noun="discovery settings",
    ),
    Menu(
        "/ip/cloud",
        Shape.SETTINGS,
        (
            Arg("ddns-enabled", Choice(("auto", "no", "yes")), "auto"),
            Arg("ddns-update-interval", Time(60, words=("none",)), "none"),
            Arg("update-time", Bool(), "yes"),
        ),
        noun="cloud settings",
    ),
    Menu(
        "/ip/proxy",
        Shape.SETTINGS,
        (
            Arg("always-from-cache", Bool(), "no"),
            Arg("anonymous", Bool(), "no"),
            Arg("cache-administrator", Text(), "webmaster"),
            Arg("cache-hit-dscp", Int(0, 63), "4"),
            Arg("cache-on-disk", Bool(), "no"),
            Arg("cache-path", Text(), "web-proxy"),
            Arg("enabled", Bool(), "no"),
            Arg("max-cache-object-size", Size(), "2048KiB"),
            Arg("max-cache-size", Int(words=("none", "unlimited")), "unlimited"),
            Arg("max-client-connections", Int(), "600"),
            Arg("max-fresh-time", Time(), "3d"),
            Arg("max-server-connections", Int(), "600"),
            Arg("parent-proxy", Address(), "::"),
            Arg("parent-proxy-port", Int(0, 65535), "0"),
            Arg("port", Pattern(r"\d{1,5}(,\d{1,5})*"), "8080"),
            Arg("serialize-connections", Bool(), "no"),
            Arg("src-address", Addresses(), "::"),
        ),
        noun="web proxy",
        feature="proxy",
    ),
    Menu(
        "/ip/socks",
        Shape.SETTINGS,
        (
            Arg("auth-method", Choice(("none", "password")), "none"),
            Arg("connection-idle-timeout", Time(), "2m"),
            Arg("enabled", Bool(), "no"),
            Arg("max-connections", Int(1, 500), "200"),
            Arg("port", Int(1, 65535), "1080"),
            Arg("version", Choice(("4", "5")), "4"),
            _VRF,
        ),
        noun="socks settings",
        feature="socks",
    ),
    Menu(
        "/ip/upnp",
        Shape.SETTINGS,
        (
            Arg("allow-disable-external-interface", Bool(), "no"),
            Arg("enabled", Bool(), "no"),
            Arg("show-dummy-rule", Bool(), "yes"),
        ),
        noun="upnp settings",
    ),
    Menu(
        "/ipv6/settings",
        Shape.SETTINGS,
        (
            Arg("accept-redirects", Choice(("no", "yes-if-forwarding-disabled")), "yes-if-forwarding-disabled"),
            Arg(
                "accept-router-advertisements",
                Choice(("no", "yes", "yes-if-forwarding-disabled")),
                "yes-if-forwarding-disabled",
            ),
            Arg("accept-router-advertisements-on", _LIST, "all"),
            Arg("allow-fast-path", Bool(), "yes"),
            Arg("disable-ipv6", Bool(), "no"),
            Arg("disable-link-local-address", Bool(), "no"),
            Arg("forward", Bool(), "yes"),
            Arg("max-neighbor-entries", Int(), "14336"),
            Arg("min-neighbor-entries", Int(), "3584"),
            Arg("multipath-hash-policy", Choice(("l3", "l3-inner", "l4")), "l3"),
            Arg("soft-max-neighbor-entries", Int(), "7168"),
            Arg("stale-neighbor-detect-interval", Int(), "30"),
            Arg("stale-neighbor-timeout", Int(), "60"),
        ),
        noun="ipv6 settings",
    ),
    Menu(
        "/tool/mac-server",
        Shape.SETTINGS,
        (Arg("allowed-interface-list", _LIST, "all"),),
        noun="mac-server interface",
    ),
    Menu(
        "/tool/mac-server/mac-winbox",
        Shape.SETTINGS,
        (Arg("allowed-interface-list", _LIST, "all"),),
        noun="mac winbox setting",
    ),
    Menu("/tool/mac-server/ping", Shape.SETTINGS, (Arg("enabled", Bool(), "yes"),), noun="mac ping setting"),
    Menu(
        "/tool/bandwidth-server",
        Shape.SETTINGS,
        (
            Arg("allocate-udp-ports-from", Int(1000, 64000), "2000"),
            Arg("allowed-addresses4", Prefixes(many=True, v6=False), ""),
            Arg("allowed-addresses6", Text(), ""),
            Arg("authenticate", Bool(), "yes"),
            Arg("enabled", Bool(), "yes"),
            Arg("max-sessions", Int(1, 1000), "100"),
        ),
        noun="bandwidth server",
        feature="bandwidth-test",
    ),
)
