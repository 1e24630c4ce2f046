"""`/interface/wireless`: radios of the package `wireless`, their security profiles, connect and access lists.

Values and defaults: Manual, Wireless Interface. Properties without effect on emulated radios (rates, retries, WDS,
802.11u ...) are texts. A radio's factory row has the values that depend on the card: band, frequency, SSID.
"""

from __future__ import annotations

from atlantis_netcfg.emulator.routeros import values
from atlantis_netcfg.emulator.routeros.menus import _model

_SWITCH = values.Choice(("disabled", "enabled"))
_UNIQUE_NAME = _model.Unique(("name",), "failure: already have interface with such name")
_EXISTS = _model.Unique(("name",), "failure: item with such name already exists")
_CIPHERS = values.Choices(("tkip", "aes-ccm"))
_WEP = values.Choice(("104bit-wep", "40bit-wep", "aes-ccm", "none", "tkip"))
_BANDS = (
    *("2ghz-b", "2ghz-b/g", "2ghz-b/g/n", "2ghz-g/n", "2ghz-onlyg", "2ghz-onlyn"),
    *("5ghz-a", "5ghz-a/n", "5ghz-a/n/ac", "5ghz-n/ac", "5ghz-onlyac", "5ghz-onlyn"),
)
_WIDTHS = (
    *("5mhz", "10mhz", "20mhz", "20/40mhz-Ce", "20/40mhz-eC", "20/40mhz-XX", "40mhz-turbo"),
    *("20/40/80mhz-Ceee", "20/40/80mhz-XXXX", "20/40/80mhz-eCee", "20/40/80mhz-eeCe", "20/40/80mhz-eeeC"),
)
_MODES = (
    *("alignment-only", "ap-bridge", "bridge", "nstreme-dual-slave", "station", "station-bridge"),
    *("station-pseudobridge", "station-pseudobridge-clone", "station-wds", "wds-slave"),
)
_PROTOCOLS = ("802.11", "any", "nstreme", "nv2", "nv2-nstreme", "nv2-nstreme-802.11", "unspecified")
_ARP = values.Choice(("disabled", "enabled", "local-proxy-arp", "proxy-arp", "reply-only"))


def _texts(names: str, default: str | None = None) -> tuple[_model.Arg, ...]:
    return tuple(_model.Arg(name, values.Text(), default) for name in names.split())


_SECURITY = _model.of_schema(
    "/interface/wireless/security-profiles",
    noun="security profile",
    kinds={
        "authentication-types": values.Choices(("wpa-psk", "wpa2-psk", "wpa-eap", "wpa2-eap")),
        "group-ciphers": _CIPHERS,
        "group-key-update": values.Time(30, 3600),
        "management-protection": values.Choice(("allowed", "disabled", "required")),
        "mode": values.Choice(("dynamic-keys", "none", "static-keys-optional", "static-keys-required")),
        "radius-called-format": values.Choice(("mac", "mac:ssid", "ssid")),
        "radius-mac-caching": values.Time(words=("disabled",)),
        "radius-mac-mode": values.Choice(("as-username", "as-username-and-password")),
        "static-sta-private-algo": _WEP,
        "static-transmit-key": values.Choice(("key-0", "key-1", "key-2", "key-3")),
        "tls-certificate": values.Ref(("certificate",), ("none",)),
        "unicast-ciphers": _CIPHERS,
        "wpa-pre-shared-key": values.Pattern(r"|[ -~]{8,64}"),
        "wpa2-pre-shared-key": values.Pattern(r"|[ -~]{8,64}"),
    },
    local=(
        _model.Arg("name", values.Text(empty=False), ""),
        *(_model.Arg(f"static-algo-{number}", _WEP, "none") for number in range(4)),
        *(_model.Arg(f"static-key-{number}", values.Text(), "", secret=True) for number in range(4)),
        _model.Arg("supplicant-identity", values.Text(), ""),
    ),
    space="security-profile",
    unique=(_EXISTS,),
    factory=({"name": "default", "supplicant-identity": "MikroTik"},),
    builtin_flag="default",
    select=_model.Select.FIND_NAME,
    first_id=0,
)

_RADIO = _model.of_schema(
    "/interface/wireless",
    noun="device",
    shape=_model.Shape.LIST,
    kinds={
        "adaptive-noise-immunity": values.Choice(("ap-and-client-mode", "client-mode", "none")),
        "amsdu-limit": values.Int(0, 8192),
        "amsdu-threshold": values.Int(0, 8192),
        "arp": _ARP,
        "arp-timeout": values.Time(words=("auto",)),
        "band": values.Choice(_BANDS),
        "bridge-mode": _SWITCH,
        "channel-width": values.Choice(_WIDTHS),
        "country": values.Text(empty=False),
        "disconnect-timeout": values.Time(0, 15),
        "distance": values.Int(words=("dynamic", "indoors")),
        "frequency": values.Int(words=("auto",)),
        "frequency-mode": values.Choice(("manual-txpower", "regulatory-domain", "superchannel")),
        "frequency-offset": values.Int(-2147483648, 2147483647),
        "guard-interval": values.Choice(("any", "long")),
        "hw-fragmentation-threshold": values.Int(256, 3000, words=("disabled",)),
        "hw-protection-mode": values.Choice(("cts-to-self", "none", "rts-cts")),
        "hw-protection-threshold": values.Int(0, 65535),
        "hw-retries": values.Int(0, 15),
        "installation": values.Choice(("any", "indoor", "outdoor")),
        "keepalive-frames": _SWITCH,
        "max-station-count": values.Int(1, 2007),
        "mode": values.Choice(_MODES),
        "mtu": values.Int(32, 2290),
        "multicast-buffering": _SWITCH,
        "multicast-helper": values.Choice(("default", "disabled", "dhcp", "full")),
        "nv2-cell-radius": values.Int(10, 200),
        "nv2-downlink-ratio": values.Int(20, 80),
        "nv2-mode": values.Choice(("dynamic-downlink", "fixed-downlink", "sync-master", "sync-slave")),
        "nv2-noise-floor-offset": values.Int(0, 20, words=("default",)),
        "nv2-preshared-key": values.Text(longest=64),
        "nv2-qos": values.Choice(("default", "frame-priority")),
        "nv2-queue-count": values.Int(2, 8),
        "nv2-security": _SWITCH,
        "on-fail-retry-time": values.Time(0.1, 1),
        "preamble-mode": values.Choice(("both", "long", "short")),
        "rate-selection": values.Choice(("advanced", "legacy")),
        "rate-set": values.Choice(("configured", "default")),
        "security-profile": values.Ref(("security-profile",)),
        "skip-dfs-channels": values.Choice(("10min-cac", "all", "disabled")),
        "station-roaming": _SWITCH,
        "tdma-period-size": values.Int(1, 10),
        "tx-power": values.Int(-30, 40),
        "tx-power-mode": values.Choice(("all-rates-fixed", "card-rates", "default", "manual-table")),
        "update-stats-interval": values.Time(words=("disabled",)),
        "vlan-id": values.Int(1, 4095),
        "vlan-mode": values.Choice(("no-tag", "use-service-tag", "use-tag")),
        "wds-default-bridge": values.Ref(("bridge",), ("none",)),
        "wds-default-cost": values.Int(0, 200000000),
        "wds-mode": values.Choice(("disabled", "dynamic", "dynamic-mesh", "static", "static-mesh")),
        "wireless-protocol": values.Choice(_PROTOCOLS),
        "wmm-support": values.Choice(("disabled", "enabled", "required")),
    },
    local=(
        _model.Arg("name", values.Text(empty=False), ""),
        _model.Arg("l2mtu", values.Int(0, 65536), "1600"),
        _model.Arg("mac-address", values.Mac(), ""),
        _model.Arg("radio-name", values.Text(), ""),
        _model.Arg("ssid", values.Text(longest=32), ""),
        *_texts(
            "antenna-mode burst-time ht-basic-mcs ht-supported-mcs prism-cardtype rx-chains supported-rates-a/g"
            " supported-rates-b tx-chains vht-basic-mcs vht-supported-mcs wps-mode"
        ),
    ),
    without=("default-name",),
    space="interface",
    unique=(_UNIQUE_NAME,),
    flags=("running",),
    select=_model.Select.DEFAULT_NAME,
)

_CONNECT = _model.of_schema(
    "/interface/wireless/connect-list",
    noun="connect list entry",
    kinds={
        "allow-signal-out-of-range": values.Time(words=("always",)),
        "security-profile": values.Ref(("security-profile",), ("none",)),
        "ssid": values.Text(longest=32),
        "wireless-protocol": values.Choice(("802.11", "any", "nstreme", "tdma")),
    },
    local=(
        _model.Arg("interface", values.Ref(("interface",)), is_required=True, always=True),
        *_texts(
            "3gpp iw-asra iw-authentication-types iw-connection-capabilities iw-esr iw-hessid iw-hotspot20"
            " iw-hotspot20-dgaf iw-internet iw-ipv4-availability iw-ipv6-availability iw-network-type iw-realms"
            " iw-roaming-ois iw-uesa iw-venue"
        ),
    ),
    first_id=0,
)

_ACCESS = _model.of_schema(
    "/interface/wireless/access-list",
    noun="access list entry",
    kinds={
        "allow-signal-out-of-range": values.Time(words=("always",)),
        "interface": values.Ref(("interface", "list"), ("any",)),
        "private-algo": _WEP,
        "vlan-id": values.Int(1, 4095),
        "vlan-mode": values.Choice(("default", "no-tag", "use-service-tag", "use-tag")),
    },
    local=(_model.Arg("time", values.Text()),),
    first_id=0,
)

MENUS = (_SECURITY, _RADIO, _CONNECT, _ACCESS)
