"""`/interface/wifi`: radios of the packages `wifi-qcom`, `wifi-qcom-ac` and similar (802.11ac wave 2, ax, be).

A property that is not set is inherited: interface, profile of the interface, configuration profile, profile of that
(Manual, WiFi, Configuration profiles), so nothing has a default here. Only the values set in the row itself are read
(`print config`). `aaa.*`, `interworking.*` and `steering.*` do not concern a bridge and are left alone. In the command
trees the menu is a list, since virtual access points can be added; here it contains the board's radios only.
"""

from __future__ import annotations

from dataclasses import replace

from atlantis_netcfg.core.versions import Version
from atlantis_netcfg.routeros._types import Layer
from atlantis_netcfg.routeros.menus import _model

_SINCE = Version.parse("7.13")
"""First version of this menu; before, it was called `/interface/wifiwave2` (Manual, WiFi)."""

_CHANNEL = (
    _model.text("band", None),
    _model.words("frequency", None),
    _model.text("width", None),
    _model.text("skip-dfs-channels", None),
    _model.words("secondary-frequency", None),
    _model.text("reselect-interval", None),
    *_model.since("7.19", _model.text("reselect-time", None)),
    *_model.since("7.20", _model.boolean("deprioritize-unii-3-4", None)),
)
_SECURITY = (
    _model.words("authentication-types", None),
    _model.secret(_model.text("passphrase", None)),
    _model.words("encryption", None),
    _model.text("group-encryption", None),
    _model.time("group-key-update"),
    _model.text("management-protection", None),
    _model.text("management-encryption", None),
    _model.text("wps", None),
    _model.boolean("disable-pmkid", None),
    _model.text("connect-group", None),
    _model.text("connect-priority", None),
    _model.words("dh-groups", None),
    _model.boolean("eap-accounting", None),
    *_model.texts("eap-anonymous-identity eap-certificate-mode eap-tls-certificate eap-username"),
    _model.words("eap-methods", None),
    _model.secret(_model.text("eap-password", None)),
    *(_model.boolean(name, None) for name in ("ft", "ft-over-ds", "ft-preserve-vlanid")),
    *_model.texts("ft-mobility-domain ft-nas-identifier"),
    _model.time("ft-r0-key-lifetime"),
    _model.time("ft-reassociation-deadline"),
    *_model.texts("owe-transition-interface sae-anti-clogging-threshold sae-max-failure-rate sae-pwe"),
    *_model.since("7.17", _model.text("multi-passphrase-group", None)),
    *_model.since("7.21", _model.text("beacon-protection", None)),
)
_DATAPATH = (
    _model.interface("bridge"),
    _model.number("bridge-cost"),
    _model.text("bridge-horizon", None),
    _model.boolean("client-isolation", None),
    _model.text("interface-list", None),
    _model.text("vlan-id", None),
    *_model.since("7.19", _model.text("traffic-processing", None)),
    *_model.since("7.20", _model.text("openflow-switch", None)),
)
_CONFIGURATION = (
    _model.text("mode", None),
    _model.text("ssid", None),
    _model.text("country", None),
    _model.text("manager", None),
    _model.number("tx-power"),
    _model.number("antenna-gain"),
    *_model.since("7.14", _model.number("distance")),
    _model.boolean("hide-ssid", None),
    _model.words("chains", None),
    _model.words("tx-chains", None),
    _model.time("beacon-interval"),
    _model.number("dtim-period"),
    _model.text("multicast-enhance", None),
    _model.text("qos-classifier", None),
    *_model.since("7.17", _model.text("installation", None), _model.boolean("station-roaming", None)),
    *_model.since("7.18", _model.number("max-clients")),
    *_model.since("7.21", _model.text("hw-protection-mode", None)),
)


def _inside(name: str, fields: tuple[_model.Field, ...]) -> tuple[_model.Field, ...]:
    """Prefix a profile's properties as the rows above it name them (`channel.width`), with the profile's name first."""
    return (_model.text(name, None), *(replace(each, name=f"{name}.{each.name}") for each in fields))


def _profile(name: str, fields: tuple[_model.Field, ...]) -> _model.Menu:
    return _model.Menu(
        f"/interface/wifi/{name}",
        _model.Shape.LIST,
        Layer.FOUNDATION,
        keys=("name",),
        subject="{name}",
        since=_SINCE,
        has_config_view=name == "configuration",
        fields=(_model.text("name", None), _model.COMMENT, _model.DISABLED, *fields),
    )


_OTHERS = _model.texts("aaa interworking steering")
_PROFILES = (*_inside("channel", _CHANNEL), *_inside("security", _SECURITY), *_inside("datapath", _DATAPATH), *_OTHERS)

_RADIO = _model.Menu(
    "/interface/wifi",
    _model.Shape.FIXED,
    Layer.FOUNDATION,
    keys=("default-name",),
    subject="{default-name}",
    flags=("running", "inactive", "bound", "master"),
    since=_SINCE,
    has_config_view=True,
    fields=(
        _model.interface("default-name"),
        _model.like("default-name", _model.interface("name")),
        _model.COMMENT,
        _model.boolean("disabled", "yes"),
        *_inside("configuration", _CONFIGURATION),
        *_PROFILES,
        _model.text("arp", "enabled"),
        _model.text("arp-timeout", "auto"),
        _model.number("mtu", "1500"),
        _model.boolean("disable-running-check"),
        *_model.keep(
            _model.number("l2mtu"),
            _model.mac("mac-address"),
            _model.mac("radio-mac"),
            _model.interface("master-interface"),
        ),
    ),
)

MENUS = (
    _profile("channel", _CHANNEL),
    _profile("security", _SECURITY),
    _profile("datapath", _DATAPATH),
    _profile("configuration", (*_CONFIGURATION, *_PROFILES)),
    _RADIO,
)
