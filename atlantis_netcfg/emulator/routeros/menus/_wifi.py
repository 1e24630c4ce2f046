"""`/interface/wifi`: radios of `wifi-qcom` and similar packages, with the profiles from which they inherit.

Keywords are those that the console of 7.21.5 offers. Rows have no defaults: unset values are inherited (Manual, WiFi,
Configuration profiles; see radio/_read.py). `aaa.*`, `interworking.*`, `steering.*` are texts.
"""

from __future__ import annotations

from atlantis_netcfg.emulator.routeros import values
from atlantis_netcfg.emulator.routeros.menus import _model
from atlantis_netcfg.emulator.routeros.schema import offered_values

_EXISTS = _model.Unique(("name",), "failure: item with such name already exists")


def _choices(menu: str, names: str, *, several: bool = False) -> dict[str, values.ValueType]:
    """Map arguments to the values that the console offers."""
    words_by_name = {
        name: tuple(word.strip('"') for word in offered_values(f"/interface/wifi/{menu}", name))
        for name in names.split()
    }
    return {
        name: values.Choices(words, is_ordered=False) if several else values.Choice(words)
        for name, words in words_by_name.items()
    }


_KINDS: dict[str, dict[str, values.ValueType]] = {
    "channel": {
        "frequency": values.Pattern(r"\d{4}(-\d{4}(/\d+)?)?(,\d{4}(-\d{4}(/\d+)?)?)*"),
        **_choices("channel", "band skip-dfs-channels width"),
    },
    "security": {
        "passphrase": values.Pattern(r"|[ -~]{8,63}"),
        **_choices("security", "authentication-types encryption", several=True),
        **_choices("security", "beacon-protection group-encryption management-encryption management-protection wps"),
    },
    "datapath": {
        "bridge": values.Ref(("bridge",), ("none",)),
        "bridge-horizon": values.Int(words=("none",)),
        "interface-list": values.Ref(("list",)),
        "vlan-id": values.Int(1, 4095, words=("none",)),
    },
    "configuration": {
        "antenna-gain": values.Int(0, 30),
        "beacon-interval": values.Time(0.1, 1),
        "distance": values.Int(0, 1000),
        "dtim-period": values.Int(1, 255),
        "max-clients": values.Int(1, 1000),
        "ssid": values.Text(longest=32),
        "tx-power": values.Int(0, 40),
        **_choices(
            "configuration",
            "country hw-protection-mode installation manager mode multicast-enhance qos-classifier",
        ),
    },
}
"""Accepted values of each argument, by profile."""
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


_INHERITED_ARGS = tuple(
    _model.Arg(f"{group}.{name}", values.Text())
    for group, names in (("aaa", _AAA), ("interworking", _INTERWORKING), ("steering", _STEERING))
    for name in names.split()
)


def _inside(*profiles: str) -> dict[str, values.ValueType]:
    """Return a profile's properties with prefix, as rows use them (`channel.width`), and the profile's name."""
    profile_refs: dict[str, values.ValueType] = {profile: values.Ref((f"wifi-{profile}",)) for profile in profiles}
    return profile_refs | {f"{profile}.{name}": kind for profile in profiles for name, kind in _KINDS[profile].items()}


def _profile(name: str, kinds: dict[str, values.ValueType], local: tuple[_model.Arg, ...] = ()) -> _model.EmulatedMenu:
    return _model.of_schema(
        f"/interface/wifi/{name}",
        noun=f"wifi {name}",
        kinds=_KINDS[name] | kinds,
        local=(_model.Arg("name", values.Text(empty=False), is_required=True), *local),
        space=f"wifi-{name}",
        unique=(_EXISTS,),
    )


_RADIO = _model.of_schema(
    "/interface/wifi",
    noun="device",
    shape=_model.Shape.LIST,
    kinds={
        "arp": values.Choice(("disabled", "enabled", "local-proxy-arp", "proxy-arp", "reply-only")),
        "arp-timeout": values.Time(words=("auto",)),
        "mtu": values.Int(32, 2290),
        **_inside(*_KINDS),
    },
    local=(
        _model.Arg("name", values.Text(empty=False), ""),
        *_INHERITED_ARGS,
        _model.Arg("l2mtu", values.Int(32, 2290), "1560"),
        _model.Arg("mac-address", values.Mac(), ""),
    ),
    without=("default-name",),
    space="interface",
    unique=(_model.Unique(("name",), "failure: already have interface with such name"),),
    flags=("running", "inactive", "bound", "master"),
    select=_model.Select.DEFAULT_NAME,
)

MENUS = (
    _profile("channel", {}),
    _profile("security", {}),
    _profile("datapath", {}),
    _profile("configuration", _inside("channel", "security", "datapath"), _INHERITED_ARGS),
    _RADIO,
)
