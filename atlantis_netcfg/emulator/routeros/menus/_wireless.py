"""`/interface/wireless`: radios of the package `wireless`, their security profiles, connect and access lists.

Values and defaults: Manual, Wireless Interface. Properties that the twin's radios do not obey (rates, retries, WDS,
802.11u ...) are texts. The factory's row of a radio holds what the manual leaves to the card: band, frequency, SSID.
"""

from __future__ import annotations

from atlantis_netcfg.emulator.routeros.menus._model import (
    Arg,
    Select,
    Shape,
    Unique,
    of_schema,
)
from atlantis_netcfg.emulator.routeros.values import Choice, Choices, Int, Mac, Pattern, Ref, Text, Time

_SWITCH = Choice(("disabled", "enabled"))
_UNIQUE_NAME = Unique(("name",), "failure: already have interface with such name")
_EXISTS = Unique(("name",), "failure: item with such name already exists")
_NO_MAC = "00:00:00:00:00:00"
_CIPHERS = Choices(("tkip", "aes-ccm"))
_WEP = Choice(("104bit-wep", "40bit-wep", "aes-ccm", "none", "tkip"))
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
_ARP = Choice(("disabled", "enabled", "local-proxy-arp", "proxy-arp", "reply-only"))


def _texts(names: str, default: str | None = None) -> tuple[Arg, ...]:
    return tuple(Arg(name, Text(), default) for name in names.split())


_SECURITY = of_schema(
    "/interface/wireless/security-profiles",
    noun="security profile",
    kinds={
        "authentication-types": Choices(("wpa-psk", "wpa2-psk", "wpa-eap", "wpa2-eap")),
        "group-ciphers": _CIPHERS,
        "group-key-update": Time(30, 3600),
        "management-protection": Choice(("allowed", "disabled", "required")),
        "mode": Choice(("dynamic-keys", "none", "static-keys-optional", "static-keys-required")),
        "radius-called-format": Choice(("mac", "mac:ssid", "ssid")),
        "radius-mac-caching": Time(words=("disabled",)),
        "radius-mac-mode": Choice(("as-username", "as-username-and-password")),
        "static-sta-private-algo": _WEP,
        "static-transmit-key": Choice(("key-0", "key-1", "key-2", "key-3")),
        "tls-certificate": Ref(("certificate",), ("none",)),
        "unicast-ciphers": _CIPHERS,
        "wpa-pre-shared-key": Pattern(r"|[ -~]{8,64}"),
        "wpa2-pre-shared-key": Pattern(r"|[ -~]{8,64}"),
    },
    local=(
        Arg("name", Text(empty=False), ""),
        *(Arg(f"static-algo-{number}", _WEP, "none") for number in range(4)),
        *(Arg(f"static-key-{number}", Text(), "", secret=True) for number in range(4)),
        Arg("supplicant-identity", Text(), ""),
    ),
    space="security-profile",
    unique=(_EXISTS,),
    factory=({"name": "default", "supplicant-identity": "MikroTik"},),
    builtin_flag="default",
    select=Select.FIND_NAME,
    first_id=0,
)

_RADIO = of_schema(
    "/interface/wireless",
    noun="device",
    shape=Shape.LIST,
    kinds={
        "adaptive-noise-immunity": Choice(("ap-and-client-mode", "client-mode", "none")),
        "amsdu-limit": Int(0, 8192),
        "amsdu-threshold": Int(0, 8192),
        "arp": _ARP,
        "arp-timeout": Time(words=("auto",)),
        "band": Choice(_BANDS),
        "bridge-mode": _SWITCH,
        "channel-width": Choice(_WIDTHS),
        "country": Text(empty=False),
        "disconnect-timeout": Time(0, 15),
        "distance": Int(words=("dynamic", "indoors")),
        "frequency": Int(words=("auto",)),
        "frequency-mode": Choice(("manual-txpower", "regulatory-domain", "superchannel")),
        "frequency-offset": Int(-2147483648, 2147483647),
        "guard-interval": Choice(("any", "long")),
        "hw-fragmentation-threshold": Int(256, 3000, words=("disabled",)),
        "hw-protection-mode": Choice(("cts-to-self", "none", "rts-cts")),
        "hw-protection-threshold": Int(0, 65535),
        "hw-retries": Int(0, 15),
        "installation": Choice(("any", "indoor", "outdoor")),
        "keepalive-frames": _SWITCH,
        "max-station-count": Int(1, 2007),
        "mode": Choice(_MODES),
        "mtu": Int(32, 2290),
        "multicast-buffering": _SWITCH,
        "multicast-helper": Choice(("default", "disabled", "dhcp", "full")),
        "nv2-cell-radius": Int(10, 200),
        "nv2-downlink-ratio": Int(20, 80),
        "nv2-mode": Choice(("dynamic-downlink", "fixed-downlink", "sync-master", "sync-slave")),
        "nv2-noise-floor-offset": Int(0, 20, words=("default",)),
        "nv2-preshared-key": Text(longest=64),
        "nv2-qos": Choice(("default", "frame-priority")),
        "nv2-queue-count": Int(2, 8),
        "nv2-security": _SWITCH,
        "on-fail-retry-time": Time(0.1, 1),
        "preamble-mode": Choice(("both", "long", "short")),
        "rate-selection": Choice(("advanced", "legacy")),
        "rate-set": Choice(("configured", "default")),
        "security-profile": Ref(("security-profile",)),
        "skip-dfs-channels": Choice(("10min-cac", "all", "disabled")),
        "station-roaming": _SWITCH,
        "tdma-period-size": Int(1, 10),
        "tx-power": Int(-30, 40),
        "tx-power-mode": Choice(("all-rates-fixed", "card-rates", "default", "manual-table")),
        "update-stats-interval": Time(words=("disabled",)),
        "vlan-id": Int(1, 4095),
        "vlan-mode": Choice(("no-tag", "use-service-tag", "use-tag")),
        "wds-default-bridge": Ref(("bridge",), ("none",)),
        "wds-default-cost": Int(0, 200000000),
        "wds-mode": Choice(("disabled", "dynamic", "dynamic-mesh", "static", "static-mesh")),
        "wireless-protocol": Choice(_PROTOCOLS),
        "wmm-support": Choice(("disabled", "enabled", "required")),
    },
    local=(
        Arg("name", Text(empty=False), ""),
        Arg("l2mtu", Int(0, 65536), "1600"),
        Arg("mac-address", Mac(), ""),
        Arg("radio-name", Text(), ""),
        Arg("ssid", Text(longest=32), ""),
        *_texts(
            "antenna-mode burst-time ht-basic-mcs ht-supported-mcs prism-cardtype rx-chains supported-rates-a/g"
            " supported-rates-b tx-chains vht-basic-mcs vht-supported-mcs wps-mode"
        ),
    ),
    without=("default-name",),
    space="interface",
    unique=(_UNIQUE_NAME,),
    flags=("running",),
    select=Select.DEFAULT_NAME,
)

_CONNECT = of_schema(
    "/interface/wireless/connect-list",
    noun="connect list entry",
    kinds={
        "allow-signal-out-of-range": Time(words=("always",)),
        "security-profile": Ref(("security-profile",), ("none",)),
        "ssid": Text(longest=32),
        "wireless-protocol": Choice(("802.11", "any", "nstreme", "tdma")),
    },
    local=(
        Arg("interface", Ref(("interface",)), is_required=True, always=True),
        *_texts(
            "3gpp iw-asra iw-authentication-types iw-connection-capabilities iw-esr iw-hessid iw-hotspot20"
            " iw-hotspot20-dgaf iw-internet iw-ipv4-availability iw-ipv6-availability iw-network-type iw-realms"
            " iw-roaming-ois iw-uesa iw-venue"
        ),
    ),
    first_id=0,
)

_ACCESS = of_schema(
    "/interface/wireless/access-list",
    noun="access list entry",
    kinds={
        "allow-signal-out-of-range": Time(words=("always",)),
        "interface": Ref(("interface", "list"), ("any",)),
        "private-algo": _WEP,
        "vlan-id": Int(1, 4095),
        "vlan-mode": Choice(("default", "no-tag", "use-service-tag", "use-tag")),
    },
    local=(Arg("time", Text()),),
    first_id=0,
)

MENUS = (_SECURITY, _RADIO, _CONNECT, _ACCESS)
