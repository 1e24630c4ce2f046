"""`/ip` and `/ipv6` settings and services: DNS, access to the router, and what is disabled."""

from __future__ import annotations

from atlantis_netcfg.routeros._types import Layer
from atlantis_netcfg.routeros.menus import _model

_DNS = _model.Menu(
    "/ip/dns",
    _model.Shape.SINGLETON,
    Layer.ATTACHMENT,
    fields=(
        _model.sequence("servers"),
        _model.boolean("allow-remote-requests"),
        _model.size("cache-size", "2048KiB"),
        _model.time("cache-max-ttl", "1w"),
        *_model.since("7.10", _model.time("address-list-extra-time", "0s")),
        _model.text("use-doh-server"),
        _model.boolean("verify-doh-cert"),
        _model.number("doh-max-concurrent-queries", "50"),
        _model.number("doh-max-server-connections", "5"),
        _model.time("doh-timeout", "5s"),
        _model.number("max-concurrent-queries", "100"),
        _model.number("max-concurrent-tcp-sessions", "20"),
        _model.number("max-udp-packet-size", "4096"),
        *_model.since("7.16", _model.words("mdns-repeat-ifaces")),
        _model.time("query-server-timeout", "2s"),
        _model.time("query-total-timeout", "10s"),
        *_model.since("7.15", _model.text("vrf", "main")),
    ),
)

_DNS_STATIC = _model.Menu(
    "/ip/dns/static",
    _model.Shape.LIST,
    Layer.POLICY,
    # `move` exists, because the first matching `regexp` answers; names, which are all we declare, are looked up whole.
    keys=("name", "regexp", "type", "address", "cname", "forward-to", "mx-exchange", "ns", "srv-target", "text"),
    subject="{name}{regexp} {type} {address}{cname}{forward-to}{mx-exchange}{ns}{srv-target}",
    flags=("dynamic",),
    fields=(
        _model.text("name"),
        _model.text("regexp"),
        _model.text("type", "A"),
        _model.prefix("address", ""),
        *_model.texts("cname forward-to mx-exchange ns srv-target text", ""),
        _model.COMMENT,
        _model.DISABLED,
        _model.time("ttl", "1d"),
        _model.boolean("match-subdomain"),
        _model.text("address-list"),
        *_model.keep(
            _model.number("mx-preference"),
            _model.number("srv-port"),
            _model.number("srv-priority"),
            _model.number("srv-weight"),
        ),
    ),
)

_SERVICE = _model.Menu(
    "/ip/service",
    _model.Shape.FIXED,
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
        _model.text("name", None),
        _model.DISABLED,
        _model.number("port"),
        _model.prefixes("address"),
        _model.text("certificate", "none"),
        _model.text("tls-version", "any"),
        *_model.since("7.0", _model.text("vrf", "main")),
        *_model.since("7.16", *_model.usual(_model.number("max-sessions", "20"))),
    ),
)

_SSH = _model.Menu(
    "/ip/ssh",
    _model.Shape.SINGLETON,
    Layer.CLEANUP,
    fields=(
        _model.boolean("strong-crypto"),
        _model.text("forwarding-enabled", "no"),
        *_model.keep(_model.text("host-key-size"), _model.text("host-key-type")),
        *_model.until("7.17", _model.boolean("allow-none-crypto")),
        *_model.since("7.17", _model.words("ciphers", "auto")),
        *_model.until("7.21", _model.boolean("always-allow-password-login")),
        *_model.since("7.21", *_model.usual(_model.text("password-authentication", "yes-if-no-key"))),
        *_model.since("7.21", *_model.usual(_model.words("publickey-authentication-options", "none"))),
    ),
)

_DISCOVERY = _model.Menu(
    "/ip/neighbor/discovery-settings",
    _model.Shape.SINGLETON,
    Layer.CLEANUP,
    fields=(
        *_model.usual(_model.text("discover-interface-list", "static"), _model.boolean("lldp-poe-power", "yes")),
        *_model.since("7.16", _model.time("discover-interval", "30s")),
        *_model.since("7.15", _model.boolean("lldp-mac-phy-config"), _model.boolean("lldp-max-frame-size")),
        _model.text("lldp-med-net-policy-vlan", "disabled"),
        *_model.since("7.16", _model.boolean("lldp-vlan-info")),
        _model.text("mode", "tx-and-rx"),
        _model.words("protocol", "cdp,lldp,mndp"),
    ),
)

_CLOUD = _model.Menu(
    "/ip/cloud",
    _model.Shape.SINGLETON,
    Layer.CLEANUP,
    fields=(
        *_model.usual(_model.text("ddns-enabled", "auto")),
        _model.time("ddns-update-interval", "none"),
        _model.boolean("update-time", "yes"),
    ),
)

_PROXY = _model.Menu(
    "/ip/proxy",
    _model.Shape.SINGLETON,
    Layer.CLEANUP,
    fields=(
        _model.boolean("enabled"),
        _model.sequence("port", "8080"),
        _model.boolean("anonymous"),
        _model.boolean("always-from-cache"),
        _model.text("cache-administrator", "webmaster"),
        _model.number("cache-hit-dscp", "4"),
        _model.boolean("cache-on-disk"),
        _model.text("cache-path", "web-proxy"),
        _model.size("max-cache-object-size", "2048KiB"),
        _model.size("max-cache-size", "unlimited"),
        _model.number("max-client-connections", "600"),
        _model.time("max-fresh-time", "3d"),
        _model.number("max-server-connections", "600"),
        _model.number("parent-proxy-port", "0"),
        _model.boolean("serialize-connections"),
        *_model.usual(_model.text("parent-proxy", "::"), _model.text("src-address", "::")),
    ),
)

_SOCKS = _model.Menu(
    "/ip/socks",
    _model.Shape.SINGLETON,
    Layer.CLEANUP,
    fields=(
        _model.boolean("enabled"),
        _model.number("port", "1080"),
        _model.text("auth-method", "none"),
        _model.time("connection-idle-timeout", "2m"),
        _model.number("max-connections", "200"),
        _model.number("version", "4"),
        *_model.since("7.0", _model.text("vrf", "main")),
    ),
)

_UPNP = _model.Menu(
    "/ip/upnp",
    _model.Shape.SINGLETON,
    Layer.CLEANUP,
    fields=(
        _model.boolean("enabled"),
        _model.boolean("allow-disable-external-interface"),
        _model.boolean("show-dummy-rule", "yes"),
    ),
)

_IP = _model.Menu(
    "/ip/settings",
    _model.Shape.SINGLETON,
    Layer.CLEANUP,
    fields=(
        _model.boolean("accept-redirects"),
        _model.boolean("accept-source-route"),
        _model.boolean("allow-fast-path", "yes"),
        _model.time("arp-timeout", "30s"),
        *_model.since("7.17", _model.boolean("icmp-errors-use-inbound-interface-address")),
        _model.number("icmp-rate-limit", "10"),
        *_model.keep(_model.text("icmp-rate-mask")),
        _model.boolean("ip-forward", "yes"),
        *_model.since("7.16", _model.text("ipv4-multipath-hash-policy", "l3")),
        *_model.keep(_model.number("max-neighbor-entries")),
        _model.text("rp-filter", "no"),
        _model.boolean("secure-redirects", "yes"),
        _model.boolean("send-redirects", "yes"),
        _model.boolean("tcp-syncookies"),
        *_model.since("7.17", *_model.usual(_model.text("tcp-timestamps", "random-offset"))),
    ),
)

_SNMP = _model.Menu(
    "/snmp",
    _model.Shape.SINGLETON,
    Layer.CLEANUP,
    fields=(
        _model.boolean("enabled"),
        _model.text("contact"),
        _model.text("location"),
        *_model.since("7.10", _model.text("engine-id-suffix")),
        _model.text("trap-community", "public"),
        *_model.usual(
            _model.words("trap-generators", "temp-exception"),
            _model.text("trap-version", "1"),
            _model.text("src-address", "::"),
        ),
        _model.words("trap-interfaces"),
        _model.text("trap-target"),
        *_model.since("7.0", _model.text("vrf", "main")),
    ),
)

_ROMON = _model.Menu(
    "/tool/romon",
    _model.Shape.SINGLETON,
    Layer.CLEANUP,
    fields=(
        _model.boolean("enabled"),
        *_model.usual(_model.text("id", "00:00:00:00:00:00")),
        *_model.keep(_model.secret(_model.text("secrets"))),
    ),
)

_IPV6 = _model.Menu(
    "/ipv6/settings",
    _model.Shape.SINGLETON,
    Layer.FOUNDATION,
    fields=(
        _model.boolean("disable-ipv6"),
        _model.boolean("forward", "yes"),
        _model.text("accept-redirects", "yes-if-forwarding-disabled"),
        _model.text("accept-router-advertisements", "yes-if-forwarding-disabled"),
        *_model.since("7.16", _model.text("multipath-hash-policy", "l3")),
        *_model.keep(_model.number("max-neighbor-entries")),
        *_model.since(
            "7.17", *_model.keep(_model.number("min-neighbor-entries"), _model.number("soft-max-neighbor-entries"))
        ),
        *_model.since(
            "7.17",
            *_model.usual(
                _model.text("stale-neighbor-detect-interval", "30"), _model.text("stale-neighbor-timeout", "60")
            ),
        ),
        *_model.since("7.18", _model.boolean("allow-fast-path", "yes"), _model.boolean("disable-link-local-address")),
        *_model.since("7.21", *_model.usual(_model.text("accept-router-advertisements-on", "all"))),
    ),
)

MENUS = (_IPV6, _IP, _DNS, _DNS_STATIC, _DISCOVERY, _CLOUD, _PROXY, _SOCKS, _UPNP, _SNMP, _ROMON, _SSH, _SERVICE)
