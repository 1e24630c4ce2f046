"""`/interface/wifi`: radios of the packages `wifi-qcom`, `wifi-qcom-ac` and their kin (802.11ac wave 2, ax, be).

A property that is not given is inherited: interface, profile of the interface, configuration profile, profile of that
(Manual, WiFi, Configuration profiles), so nothing has a default here. Only what a row itself says is read
(`print config`). `aaa.*`, `interworking.*` and `steering.*` are no matter of a bridge and are left alone. The command
trees call the menu a list, since it also takes virtual access points; to us it is the radios of the board.
"""

from __future__ import annotations

from dataclasses import replace

from atlantis_netcfg.core.versions import Version
from atlantis_netcfg.routeros._types import Layer
from atlantis_netcfg.routeros.menus._model import (
    COMMENT,
    DISABLED,
    Field,
    Menu,
    Shape,
    boolean,
    interface,
    keep,
    like,
    mac,
    number,
    secret,
    since,
    text,
    texts,
    time,
    words,
)

_SINCE = Version.parse("7.13")
"""Before, the same menu was called `/interface/wifiwave2` (Manual, WiFi)."""

_CHANNEL = (
    text("band", None),
    words("frequency", None),
    text("width", None),
    text("skip-dfs-channels", None),
    words("secondary-frequency", None),
    text("reselect-interval", None),
    *since("7.19", text("reselect-time", None)),
    *since("7.20", boolean("deprioritize-unii-3-4", None)),
)
_SECURITY = (
    words("authentication-types", None),
    secret(text("passphrase", None)),
    words("encryption", None),
    text("group-encryption", None),
    time("group-key-update"),
    text("management-protection", None),
    text("management-encryption", None),
    text("wps", None),
    boolean("disable-pmkid", None),
    text("connect-group", None),
    text("connect-priority", None),
    words("dh-groups", None),
    boolean("eap-accounting", None),
    *texts("eap-anonymous-identity eap-certificate-mode eap-tls-certificate eap-username"),
    words("eap-methods", None),
    secret(text("eap-password", None)),
    *(boolean(name, None) for name in ("ft", "ft-over-ds", "ft-preserve-vlanid")),
    *texts("ft-mobility-domain ft-nas-identifier"),
    time("ft-r0-key-lifetime"),
    time("ft-reassociation-deadline"),
    *texts("owe-transition-interface sae-anti-clogging-threshold sae-max-failure-rate sae-pwe"),
    *since("7.17", text("multi-passphrase-group", None)),
    *since("7.21", text("beacon-protection", None)),
)
_DATAPATH = (
    interface("bridge"),
    number("bridge-cost"),
    text("bridge-horizon", None),
    boolean("client-isolation", None),
    text("interface-list", None),
    text("vlan-id", None),
    *since("7.19", text("traffic-processing", None)),
    *since("7.20", text("openflow-switch", None)),
)
_CONFIGURATION = (
    text("mode", None),
    text("ssid", None),
    text("country", None),
    text("manager", None),
    number("tx-power"),
    number("antenna-gain"),
    *since("7.14", number("distance")),
    boolean("hide-ssid", None),
    words("chains", None),
    words("tx-chains", None),
    time("beacon-interval"),
    number("dtim-period"),
    text("multicast-enhance", None),
    text("qos-classifier", None),
    *since("7.17", text("installation", None), boolean("station-roaming", None)),
    *since("7.18", number("max-clients")),
    *since("7.21", text("hw-protection-mode", None)),
)


def _inside(name: str, fields: tuple[Field, ...]) -> tuple[Field, ...]:
    """Name a profile's properties as rows above it do (`channel.width`), with the profile's own name before them."""
    return (text(name, None), *(replace(each, name=f"{name}.{each.name}") for each in fields))


def _profile(name: str, fields: tuple[Field, ...]) -> Menu:
    return Menu(
        f"/interface/wifi/{name}",
        Shape.LIST,
        Layer.FOUNDATION,
        keys=("name",),
        subject="{name}",
        since=_SINCE,
        has_config_view=name == "configuration",
        fields=(text("name", None), COMMENT, DISABLED, *fields),
    )


_OTHERS = texts("aaa interworking steering")
_PROFILES = (*_inside("channel", _CHANNEL), *_inside("security", _SECURITY), *_inside("datapath", _DATAPATH), *_OTHERS)

_RADIO = Menu(
    "/interface/wifi",
    Shape.FIXED,
    Layer.FOUNDATION,
    keys=("default-name",),
    subject="{default-name}",
    flags=("running", "inactive", "bound", "master"),
    since=_SINCE,
    has_config_view=True,
    fields=(
        interface("default-name"),
        like("default-name", interface("name")),
        COMMENT,
        boolean("disabled", "yes"),
        *_inside("configuration", _CONFIGURATION),
        *_PROFILES,
        text("arp", "enabled"),
        text("arp-timeout", "auto"),
        number("mtu", "1500"),
        boolean("disable-running-check"),
        *keep(number("l2mtu"), mac("mac-address"), mac("radio-mac"), interface("master-interface")),
    ),
)

MENUS = (
    _profile("channel", _CHANNEL),
    _profile("security", _SECURITY),
    _profile("datapath", _DATAPATH),
    _profile("configuration", (*_CONFIGURATION, *_PROFILES)),
    _RADIO,
)
