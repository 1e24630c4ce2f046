"""`/interface/wireless`: radios of the package `wireless`, their security profiles, connect and access lists.

Values and defaults: Manual, Wireless Interface. Properties that the twin's radios do not obey (rates, retries, WDS,
802.11u ...) are texts. The factory's row of a radio holds what the manual leaves to the card: band, frequency, SSID.
"""

from __future__ import annotations

from atlantis_netcfg.emulator.routeros.menus._model import COMMENT, DISABLED, Arg, Menu, Select, Shape, Unique
from atlantis_netcfg.emulator.routeros.values import Bool, Choice, Choices, Int, Mac, Pattern, Ref, Text, Time

_SWITCH = Choice(("disabled", "enabled"))
_TAKEN = Unique(("name",), "failure: already have interface with such name")
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


_SECURITY = Menu(
    "/interface/wireless/security-profiles",
    Shape.LIST,
    (
        Arg("name", Text(empty=False), ""),
        Arg("authentication-types", Choices(("wpa-psk", "wpa2-psk", "wpa-eap", "wpa2-eap")), ""),
        COMMENT,
        Arg("disable-pmkid", Bool(), "no"),
        Arg("eap-methods", Text(), ""),
        Arg("group-ciphers", _CIPHERS, "aes-ccm"),
        Arg("group-key-update", Time(30, 3600), "5m"),
        Arg("interim-update", Time(), "0s"),
        Arg("management-protection", Choice(("allowed", "disabled", "required")), "disabled"),
        Arg("management-protection-key", Text(), "", secret=True),
        Arg("mode", Choice(("dynamic-keys", "none", "static-keys-optional", "static-keys-required")), "none"),
        Arg("mschapv2-password", Text(), "", secret=True),
        Arg("mschapv2-username", Text(), ""),
        Arg("radius-called-format", Choice(("mac", "mac:ssid", "ssid")), "mac:ssid"),
        Arg("radius-eap-accounting", Bool(), "no"),
        Arg("radius-mac-accounting", Bool(), "no"),
        Arg("radius-mac-authentication", Bool(), "no"),
        Arg("radius-mac-caching", Time(words=("disabled",)), "disabled"),
        Arg("radius-mac-format", Text(), "XX:XX:XX:XX:XX:XX"),
        Arg("radius-mac-mode", Choice(("as-username", "as-username-and-password")), "as-username"),
        *(Arg(f"static-algo-{number}", _WEP, "none") for number in range(4)),
        *(Arg(f"static-key-{number}", Text(), "", secret=True) for number in range(4)),
        Arg("static-sta-private-algo", _WEP, "none"),
        Arg("static-sta-private-key", Text(), "", secret=True),
        Arg("static-transmit-key", Choice(("key-0", "key-1", "key-2", "key-3")), "key-0"),
        Arg("supplicant-identity", Text(), ""),
        Arg("tls-certificate", Ref(("certificate",), ("none",)), "none"),
        Arg("tls-mode", Text(), "no-certificates"),
        Arg("unicast-ciphers", _CIPHERS, "aes-ccm"),
        Arg("wpa-pre-shared-key", Pattern(r"|[ -~]{8,64}"), "", secret=True),
        Arg("wpa2-pre-shared-key", Pattern(r"|[ -~]{8,64}"), "", secret=True),
    ),
    noun="security profile",
    space="security-profile",
    unique=(_EXISTS,),
    factory=({"name": "default", "supplicant-identity": "MikroTik"},),
    builtin_flag="default",
    select=Select.FIND_NAME,
    first_id=0,
)

_RADIO = Menu(
    "/interface/wireless",
    Shape.LIST,
    (
        Arg("name", Text(empty=False), ""),
        Arg("adaptive-noise-immunity", Choice(("ap-and-client-mode", "client-mode", "none")), "none"),
        Arg("allow-sharedkey", Bool(), "no"),
        Arg("ampdu-priorities", Text(), "0"),
        Arg("amsdu-limit", Int(0, 8192), "8192"),
        Arg("amsdu-threshold", Int(0, 8192), "8192"),
        Arg("antenna-gain", Int(), "0"),
        Arg("area", Text(), ""),
        Arg("arp", _ARP, "enabled"),
        Arg("arp-timeout", Time(words=("auto",)), "auto"),
        Arg("band", Choice(_BANDS)),
        Arg("basic-rates-a/g", Text(), "6Mbps"),
        Arg("basic-rates-b", Text(), "1Mbps"),
        Arg("bridge-mode", _SWITCH, "enabled"),
        Arg("channel-width", Choice(_WIDTHS), "20mhz"),
        COMMENT,
        Arg("compression", Bool(), "no"),
        Arg("country", Text(empty=False), "etsi"),
        Arg("default-ap-tx-limit", Int(), "0"),
        Arg("default-authentication", Bool(), "yes"),
        Arg("default-client-tx-limit", Int(), "0"),
        Arg("default-forwarding", Bool(), "yes"),
        Arg("disable-running-check", Bool(), "no"),
        Arg("disabled", Bool(), "yes"),
        Arg("disconnect-timeout", Time(0, 15), "3s"),
        Arg("distance", Int(words=("dynamic", "indoors")), "dynamic"),
        Arg("frame-lifetime", Int(), "0"),
        Arg("frequency", Int(words=("auto",))),
        Arg("frequency-mode", Choice(("manual-txpower", "regulatory-domain", "superchannel")), "regulatory-domain"),
        Arg("frequency-offset", Int(-2147483648, 2147483647), "0"),
        Arg("guard-interval", Choice(("any", "long")), "any"),
        Arg("hide-ssid", Bool(), "no"),
        Arg("hw-fragmentation-threshold", Int(256, 3000, words=("disabled",)), "disabled"),
        Arg("hw-protection-mode", Choice(("cts-to-self", "none", "rts-cts")), "none"),
        Arg("hw-protection-threshold", Int(0, 65535), "0"),
        Arg("hw-retries", Int(0, 15), "7"),
        Arg("installation", Choice(("any", "indoor", "outdoor")), "any"),
        Arg("interworking-profile", Text(), "disabled"),
        Arg("keepalive-frames", _SWITCH, "enabled"),
        Arg("l2mtu", Int(0, 65536), "1600"),
        Arg("mac-address", Mac(), ""),
        Arg("master-interface", Ref(("interface",))),
        Arg("max-station-count", Int(1, 2007), "2007"),
        Arg("mode", Choice(_MODES), "station"),
        Arg("mtu", Int(32, 2290), "1500"),
        Arg("multicast-buffering", _SWITCH, "enabled"),
        Arg("multicast-helper", Choice(("default", "disabled", "dhcp", "full")), "default"),
        Arg("noise-floor-threshold", Text(), "default"),
        Arg("nv2-cell-radius", Int(10, 200), "30"),
        Arg("nv2-downlink-ratio", Int(20, 80), "50"),
        Arg(
            "nv2-mode",
            Choice(("dynamic-downlink", "fixed-downlink", "sync-master", "sync-slave")),
            "dynamic-downlink",
        ),
        Arg("nv2-noise-floor-offset", Int(0, 20, words=("default",)), "default"),
        Arg("nv2-preshared-key", Text(longest=64), "", secret=True),
        Arg("nv2-qos", Choice(("default", "frame-priority")), "default"),
        Arg("nv2-queue-count", Int(2, 8), "2"),
        Arg("nv2-security", _SWITCH, "disabled"),
        Arg("nv2-sync-secret", Text(), "", secret=True),
        Arg("on-fail-retry-time", Time(0.1, 1), "100ms"),
        Arg("preamble-mode", Choice(("both", "long", "short")), "both"),
        Arg("radio-name", Text(), ""),
        Arg("rate-selection", Choice(("advanced", "legacy")), "advanced"),
        Arg("rate-set", Choice(("configured", "default")), "default"),
        Arg("scan-list", Text(), "default"),
        Arg("secondary-frequency", Text(), ""),
        Arg("security-profile", Ref(("security-profile",)), "default"),
        Arg("skip-dfs-channels", Choice(("10min-cac", "all", "disabled")), "disabled"),
        Arg("ssid", Text(longest=32), ""),
        Arg("station-bridge-clone-mac", Mac(), _NO_MAC),
        Arg("station-roaming", _SWITCH, "disabled"),
        Arg("tdma-period-size", Int(1, 10), "2"),
        Arg("tx-power", Int(-30, 40)),
        Arg("tx-power-mode", Choice(("all-rates-fixed", "card-rates", "default", "manual-table")), "default"),
        Arg("update-stats-interval", Time(words=("disabled",)), "disabled"),
        Arg("vlan-id", Int(1, 4095), "1"),
        Arg("vlan-mode", Choice(("no-tag", "use-service-tag", "use-tag")), "no-tag"),
        Arg("wds-cost-range", Text(), "50-150"),
        Arg("wds-default-bridge", Ref(("bridge",), ("none",)), "none"),
        Arg("wds-default-cost", Int(0, 200000000), "100"),
        Arg("wds-ignore-ssid", Bool(), "no"),
        Arg("wds-mode", Choice(("disabled", "dynamic", "dynamic-mesh", "static", "static-mesh")), "disabled"),
        Arg("wireless-protocol", Choice(_PROTOCOLS), "any"),
        Arg("wmm-support", Choice(("disabled", "enabled", "required")), "disabled"),
        *_texts(
            "antenna-mode burst-time ht-basic-mcs ht-supported-mcs prism-cardtype rx-chains supported-rates-a/g"
            " supported-rates-b tx-chains vht-basic-mcs vht-supported-mcs wps-mode"
        ),
    ),
    noun="device",
    space="interface",
    unique=(_TAKEN,),
    flags=("running",),
    select=Select.DEFAULT_NAME,
)

_CONNECT = Menu(
    "/interface/wireless/connect-list",
    Shape.LIST,
    (
        Arg("allow-signal-out-of-range", Time(words=("always",)), "0s"),
        Arg("area-prefix", Text(), ""),
        COMMENT,
        Arg("connect", Bool(), "yes"),
        DISABLED,
        Arg("interface", Ref(("interface",)), required=True, always=True),
        Arg("interworking", Text(), "any"),
        Arg("mac-address", Mac(), _NO_MAC),
        Arg("security-profile", Ref(("security-profile",), ("none",)), "none"),
        Arg("signal-range", Text(), "-120..120"),
        Arg("ssid", Text(longest=32), ""),
        Arg("wireless-protocol", Choice(("802.11", "any", "nstreme", "tdma")), "any"),
        *_texts(
            "3gpp iw-asra iw-authentication-types iw-connection-capabilities iw-esr iw-hessid iw-hotspot20"
            " iw-hotspot20-dgaf iw-internet iw-ipv4-availability iw-ipv6-availability iw-network-type iw-realms"
            " iw-roaming-ois iw-uesa iw-venue"
        ),
    ),
    noun="connect list entry",
    first_id=0,
)

_ACCESS = Menu(
    "/interface/wireless/access-list",
    Shape.LIST,
    (
        Arg("allow-signal-out-of-range", Time(words=("always",)), "0s"),
        Arg("ap-tx-limit", Int(), "0"),
        Arg("authentication", Bool(), "yes"),
        Arg("client-tx-limit", Int(), "0"),
        COMMENT,
        DISABLED,
        Arg("forwarding", Bool(), "yes"),
        Arg("interface", Ref(("interface", "list"), ("any",)), "any"),
        Arg("mac-address", Mac(), _NO_MAC),
        Arg("management-protection-key", Text(), "", secret=True),
        Arg("private-algo", _WEP, "none"),
        Arg("private-key", Text(), "", secret=True),
        Arg("private-pre-shared-key", Text(), "", secret=True),
        Arg("signal-range", Text(), "-120..120"),
        Arg("time", Text()),
        Arg("vlan-id", Int(1, 4095), "1"),
        Arg("vlan-mode", Choice(("default", "no-tag", "use-service-tag", "use-tag")), "default"),
    ),
    noun="access list entry",
    first_id=0,
)

MENUS = (_SECURITY, _RADIO, _CONNECT, _ACCESS)
