"""`/interface/wifi`: radios of `wifi-qcom` and its kin, with the profiles from which they inherit.

Words are those that the console of 7.21.5 offers. Nothing has a default in a row: what is not given is inherited
(Manual, WiFi, Configuration profiles; see radio/inherited.py). `aaa.*`, `interworking.*`, `steering.*` are texts.
"""

from __future__ import annotations

from dataclasses import replace

from atlantis_netcfg.emulator.routeros.menus._model import (
    COMMENT,
    DISABLED,
    Arg,
    Menu,
    Select,
    Shape,
    Unique,
    of_schema,
)
from atlantis_netcfg.emulator.routeros.schema import offered
from atlantis_netcfg.emulator.routeros.values import Bool, Choice, Choices, Int, Mac, Pattern, Ref, Text, Time

PROFILES = ("channel", "configuration", "datapath", "security")
"""Menus of profiles; each is also the name of the property that names one."""

_EXISTS = Unique(("name",), "failure: item with such name already exists")


def _choice(menu: str, name: str) -> Arg:
    return Arg(name, Choice(tuple(word.strip('"') for word in offered(f"/interface/wifi/{menu}", name))))


def _choices(menu: str, name: str) -> Arg:
    return Arg(name, Choices(offered(f"/interface/wifi/{menu}", name), ordered=False))


def _texts(names: str) -> tuple[Arg, ...]:
    return tuple(Arg(name, Text()) for name in names.split())


_CHANNEL = (
    _choice("channel", "band"),
    Arg("deprioritize-unii-3-4", Bool()),
    Arg("frequency", Pattern(r"\d{4}(-\d{4}(/\d+)?)?(,\d{4}(-\d{4}(/\d+)?)?)*")),
    Arg("reselect-interval", Text()),
    Arg("reselect-time", Text()),
    Arg("secondary-frequency", Text()),
    _choice("channel", "skip-dfs-channels"),
    _choice("channel", "width"),
)
_SECURITY = (
    _choices("security", "authentication-types"),
    _choice("security", "beacon-protection"),
    Arg("disable-pmkid", Bool()),
    _choices("security", "encryption"),
    *(Arg(name, Bool()) for name in ("eap-accounting", "ft", "ft-over-ds", "ft-preserve-vlanid")),
    Arg("eap-password", Text(), secret=True),
    *(Arg(name, Time()) for name in ("ft-r0-key-lifetime", "ft-reassociation-deadline", "group-key-update")),
    _choice("security", "group-encryption"),
    _choice("security", "management-encryption"),
    _choice("security", "management-protection"),
    Arg("passphrase", Pattern(r"|[ -~]{8,63}"), secret=True),
    _choice("security", "wps"),
    *_texts(
        "connect-group connect-priority dh-groups eap-anonymous-identity eap-certificate-mode eap-methods"
        " eap-tls-certificate eap-username ft-mobility-domain ft-nas-identifier multi-passphrase-group"
        " owe-transition-interface sae-anti-clogging-threshold sae-max-failure-rate sae-pwe"
    ),
)
_DATAPATH = (
    Arg("bridge", Ref(("bridge",), ("none",))),
    Arg("bridge-cost", Int()),
    Arg("bridge-horizon", Int(words=("none",))),
    Arg("client-isolation", Bool()),
    Arg("interface-list", Ref(("list",))),
    *_texts("openflow-switch traffic-processing"),
    Arg("vlan-id", Int(1, 4095, words=("none",))),
)
_CONFIGURATION = (
    Arg("antenna-gain", Int(0, 30)),
    Arg("beacon-interval", Time(0.1, 1)),
    _choice("configuration", "country"),
    Arg("distance", Int(0, 1000)),
    Arg("dtim-period", Int(1, 255)),
    Arg("hide-ssid", Bool()),
    _choice("configuration", "hw-protection-mode"),
    _choice("configuration", "installation"),
    _choice("configuration", "manager"),
    Arg("max-clients", Int(1, 1000)),
    _choice("configuration", "mode"),
    _choice("configuration", "multicast-enhance"),
    _choice("configuration", "qos-classifier"),
    Arg("ssid", Text(longest=32)),
    Arg("station-roaming", Bool()),
    Arg("tx-power", Int(0, 40)),
    *_texts("chains tx-chains"),
)
_AAA = "called-format calling-format interim-update mac-caching nas-identifier password-format username-format"
_INTERWORKING = (
    "3gpp-info 3gpp-info-raw authentication-types connection-capabilities domain-names esr hessid hotspot20"
    " hotspot20-dgaf internet ipv4-availability ipv6-availability network-type operational-classes operator-names"
    " realms realms-raw roaming-ois uesa venue venue-names wan-at-capacity wan-downlink wan-downlink-load"
    " wan-measurement-duration wan-status wan-symmetric wan-uplink wan-uplink-load"
)
_STEERING = (
    "2g-probe-delay neighbor-group rrm transition-request-count transition-request-period transition-threshold"
    " transition-threshold-time transition-time wnm"
)


def _inside(name: str, args: tuple[Arg, ...], *, reference: bool = True) -> tuple[Arg, ...]:
    profile = Arg(name, Ref((f"wifi-{name}",)) if reference else Text())
    return (profile, *(replace(arg, name=f"{name}.{arg.name}") for arg in args))


_OTHERS = (
    *_inside("channel", _CHANNEL),
    *_inside("security", _SECURITY),
    *_inside("datapath", _DATAPATH),
    *_inside("aaa", _texts(_AAA), reference=False),
    *_inside("interworking", _texts(_INTERWORKING), reference=False),
    *_inside("steering", _texts(_STEERING), reference=False),
)


def _profile(name: str, args: tuple[Arg, ...]) -> Menu:
    return Menu(
        f"/interface/wifi/{name}",
        Shape.LIST,
        (Arg("name", Text(empty=False), required=True), COMMENT, DISABLED, *args),
        noun=f"wifi {name}",
        space=f"wifi-{name}",
        unique=(_EXISTS,),
    )


_RADIO = of_schema(
    "/interface/wifi",
    noun="device",
    shape=Shape.LIST,
    kinds={
        "arp": Choice(("disabled", "enabled", "local-proxy-arp", "proxy-arp", "reply-only")),
        "arp-timeout": Time(words=("auto",)),
        "mtu": Int(32, 2290),
    },
    local=(
        Arg("name", Text(empty=False), ""),
        *_inside("configuration", _CONFIGURATION),
        *_OTHERS,
        Arg("l2mtu", Int(32, 2290), "1560"),
        Arg("mac-address", Mac(), ""),
    ),
    without=("default-name",),
    space="interface",
    unique=(Unique(("name",), "failure: already have interface with such name"),),
    flags=("running", "inactive", "bound", "master"),
    select=Select.DEFAULT_NAME,
)

MENUS = (
    _profile("channel", _CHANNEL),
    _profile("security", _SECURITY),
    _profile("datapath", _DATAPATH),
    _profile("configuration", (*_CONFIGURATION, *_OTHERS)),
    _RADIO,
)
