"""`/ip` and `/ipv6` settings and services: DNS, doors into the router, and what is switched off."""

from __future__ import annotations

from atlantis_netcfg.routeros._types import Layer
from atlantis_netcfg.routeros.menus._model import (
    COMMENT,
    DISABLED,
    Menu,
    Shape,
    boolean,
    keep,
    number,
    prefix,
    prefixes,
    secret,
    sequence,
    since,
    size,
    text,
    texts,
    time,
    until,
    usual,
    words,
)

_DNS = Menu(
    "/ip/dns",
    Shape.SINGLETON,
    Layer.ATTACHMENT,
    fields=(
        sequence("servers"),
        boolean("allow-remote-requests"),
        size("cache-size", "2048KiB"),
        time("cache-max-ttl", "1w"),
        *since("7.10", time("address-list-extra-time", "0s")),
        text("use-doh-server"),
        boolean("verify-doh-cert"),
        number("doh-max-concurrent-queries", "50"),
        number("doh-max-server-connections", "5"),
        time("doh-timeout", "5s"),
        number("max-concurrent-queries", "100"),
        number("max-concurrent-tcp-sessions", "20"),
        number("max-udp-packet-size", "4096"),
        *since("7.16", words("mdns-repeat-ifaces")),
        time("query-server-timeout", "2s"),
        time("query-total-timeout", "10s"),
        *since("7.15", text("vrf", "main")),
    ),
)

_DNS_STATIC = Menu(
    "/ip/dns/static",
    Shape.LIST,
    Layer.POLICY,
    # `move` exists, because the first matching `regexp` answers; names, which are all we declare, are looked up whole.
    keys=("name", "regexp", "type", "address", "cname", "forward-to", "mx-exchange", "ns", "srv-target", "text"),
    subject="{name}{regexp} {type} {address}{cname}{forward-to}{mx-exchange}{ns}{srv-target}",
    flags=("dynamic",),
    fields=(
        text("name"),
        text("regexp"),
        text("type", "A"),
        prefix("address", ""),
        *texts("cname forward-to mx-exchange ns srv-target text", ""),
        COMMENT,
        DISABLED,
        time("ttl", "1d"),
        boolean("match-subdomain"),
        text("address-list"),
        *keep(number("mx-preference"), number("srv-port"), number("srv-priority"), number("srv-weight")),
    ),
)

_SERVICE = Menu(
    "/ip/service",
    Shape.FIXED,
    Layer.CLEANUP,
    keys=("name",),
    subject="{name}",
    flags=("dynamic", "invalid"),
    row_defaults={
        "telnet": {"port": "23"},
        "ftp": {"port": "21"},
        "www": {"port": "80"},
        "ssh": {"port": "22"},
        "www-ssl": {"port": "443", "disabled": "yes"},
        "api": {"port": "8728"},
        "winbox": {"port": "8291"},
        "api-ssl": {"port": "8729"},
    },
    fields=(
        text("name", None),
        DISABLED,
        number("port"),
        prefixes("address"),
        text("certificate", "none"),
        text("tls-version", "any"),
        *since("7.0", text("vrf", "main")),
        *since("7.16", *usual(number("max-sessions", "20"))),
    ),
)

_SSH = Menu(
    "/ip/ssh",
    Shape.SINGLETON,
    Layer.CLEANUP,
    fields=(
        boolean("strong-crypto"),
        text("forwarding-enabled", "no"),
        *keep(text("host-key-size"), text("host-key-type")),
        *until("7.17", boolean("allow-none-crypto")),
        *since("7.17", words("ciphers", "auto")),
        *until("7.21", boolean("always-allow-password-login")),
        *since("7.21", *usual(text("password-authentication", "yes-if-no-key"))),
        *since("7.21", *usual(words("publickey-authentication-options", "none"))),
    ),
)

_DISCOVERY = Menu(
    "/ip/neighbor/discovery-settings",
    Shape.SINGLETON,
    Layer.CLEANUP,
    fields=(
        *usual(text("discover-interface-list", "static"), boolean("lldp-poe-power", "yes")),
        *since("7.16", time("discover-interval", "30s")),
        *since("7.15", boolean("lldp-mac-phy-config"), boolean("lldp-max-frame-size")),
        text("lldp-med-net-policy-vlan", "disabled"),
        *since("7.16", boolean("lldp-vlan-info")),
        text("mode", "tx-and-rx"),
        words("protocol", "cdp,lldp,mndp"),
    ),
)

_CLOUD = Menu(
    "/ip/cloud",
    Shape.SINGLETON,
    Layer.CLEANUP,
    fields=(*usual(text("ddns-enabled", "auto")), time("ddns-update-interval", "none"), boolean("update-time", "yes")),
)

_PROXY = Menu(
    "/ip/proxy",
    Shape.SINGLETON,
    Layer.CLEANUP,
    fields=(
        boolean("enabled"),
        sequence("port", "8080"),
        boolean("anonymous"),
        boolean("always-from-cache"),
        text("cache-administrator", "webmaster"),
        number("cache-hit-dscp", "4"),
        boolean("cache-on-disk"),
        text("cache-path", "web-proxy"),
        size("max-cache-object-size", "2048KiB"),
        size("max-cache-size", "unlimited"),
        number("max-client-connections", "600"),
        time("max-fresh-time", "3d"),
        number("max-server-connections", "600"),
        number("parent-proxy-port", "0"),
        boolean("serialize-connections"),
        *usual(text("parent-proxy", "::"), text("src-address", "::")),
    ),
)

_SOCKS = Menu(
    "/ip/socks",
    Shape.SINGLETON,
    Layer.CLEANUP,
    fields=(
        boolean("enabled"),
        number("port", "1080"),
        text("auth-method", "none"),
        time("connection-idle-timeout", "2m"),
        number("max-connections", "200"),
        number("version", "4"),
        *since("7.0", text("vrf", "main")),
    ),
)

_UPNP = Menu(
    "/ip/upnp",
    Shape.SINGLETON,
    Layer.CLEANUP,
    fields=(boolean("enabled"), boolean("allow-disable-external-interface"), boolean("show-dummy-rule", "yes")),
)

_IP = Menu(
    "/ip/settings",
    Shape.SINGLETON,
    Layer.CLEANUP,
    fields=(
        boolean("accept-redirects"),
        boolean("accept-source-route"),
        boolean("allow-fast-path", "yes"),
        time("arp-timeout", "30s"),
        *since("7.17", boolean("icmp-errors-use-inbound-interface-address")),
        number("icmp-rate-limit", "10"),
        *keep(text("icmp-rate-mask")),
        boolean("ip-forward", "yes"),
        *since("7.16", text("ipv4-multipath-hash-policy", "l3")),
        *keep(number("max-neighbor-entries")),
        text("rp-filter", "no"),
        boolean("secure-redirects", "yes"),
        boolean("send-redirects", "yes"),
        boolean("tcp-syncookies"),
        *since("7.17", *usual(text("tcp-timestamps", "random-offset"))),
    ),
)

_SNMP = Menu(
    "/snmp",
    Shape.SINGLETON,
    Layer.CLEANUP,
    fields=(
        boolean("enabled"),
        text("contact"),
        text("location"),
        *since("7.10", text("engine-id-suffix")),
        text("trap-community", "public"),
        *usual(words("trap-generators", "temp-exception"), text("trap-version", "1"), text("src-address", "::")),
        words("trap-interfaces"),
        text("trap-target"),
        *since("7.0", text("vrf", "main")),
    ),
)

_ROMON = Menu(
    "/tool/romon",
    Shape.SINGLETON,
    Layer.CLEANUP,
    fields=(boolean("enabled"), *usual(text("id", "00:00:00:00:00:00")), *keep(secret(text("secrets")))),
)

_IPV6 = Menu(
    "/ipv6/settings",
    Shape.SINGLETON,
    Layer.FOUNDATION,
    fields=(
        boolean("disable-ipv6"),
        boolean("forward", "yes"),
        text("accept-redirects", "yes-if-forwarding-disabled"),
        text("accept-router-advertisements", "yes-if-forwarding-disabled"),
        *since("7.16", text("multipath-hash-policy", "l3")),
        *keep(number("max-neighbor-entries")),
        *since("7.17", *keep(number("min-neighbor-entries"), number("soft-max-neighbor-entries"))),
        *since("7.17", *usual(text("stale-neighbor-detect-interval", "30"), text("stale-neighbor-timeout", "60"))),
        *since("7.18", boolean("allow-fast-path", "yes"), boolean("disable-link-local-address")),
        *since("7.21", *usual(text("accept-router-advertisements-on", "all"))),
    ),
)

MENUS = (_IPV6, _IP, _DNS, _DNS_STATIC, _DISCOVERY, _CLOUD, _PROXY, _SOCKS, _UPNP, _SNMP, _ROMON, _SSH, _SERVICE)
