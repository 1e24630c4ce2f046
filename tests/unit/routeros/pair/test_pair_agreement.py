"""Plans after which the two ends would not find each other: one word changed at one end, and what is said of it."""

import pytest

from atlantis_netcfg.routeros._types import Action, Layer, Verb
from atlantis_netcfg.routeros.pair._radio import PairRadio, disagreements, drops_link, level_dbm, radio_of

LEGACY = {
    "disabled": "false",
    "mode": "bridge",
    "ssid": "link",
    "channel-width": "20mhz",
    "country": "portugal",
    "band": "5ghz-a/n",
    "wireless-protocol": "802.11",
    "security-profile": "ptp",
    "nv2-security": "enabled",
    "nv2-preshared-key": "nv2 key",
    "security.mode": "dynamic-keys",
    "security.authentication-types": "wpa2-psk",
    "security.wpa2-pre-shared-key": "key",
}
WIFI = {
    "disabled": "false",
    "configuration.mode": "ap",
    "configuration.ssid": "link",
    "configuration.country": "Portugal",
    "channel.width": "20mhz",
    "channel.band": "5ghz-ax",
    "security.authentication-types": "wpa2-psk,wpa3-psk",
    "security.passphrase": "key",
}
MENUS = {"/interface/wireless": LEGACY, "/interface/wifi": WIFI}
STATIONS = {
    "/interface/wireless": {"mode": "station-bridge"},
    "/interface/wifi": {"configuration.mode": "station-bridge"},
}

CASES = [
    ("/interface/wireless", {}, {}, []),
    ("/interface/wireless", {"ssid": "new"}, {}, ["ssid would be new on near and link on far"]),
    ("/interface/wireless", {"disabled": "true"}, {}, ["the radio of near would be disabled"]),
    (
        "/interface/wireless",
        {},
        {"mode": "ap-bridge"},
        ["near would be bridge and far ap-bridge: one has to be the access point"],
    ),
    ("/interface/wireless", {}, {"mode": "station"}, ["far would be station: only station-bridge carries a bridge"]),
    ("/interface/wireless", {"band": "2ghz-b/g/n"}, {}, ["band would be 2ghz-b/g/n on near and 5ghz-a/n on far"]),
    (
        "/interface/wireless",
        {"wireless-protocol": "nv2"},
        {},
        ["wireless-protocol would be nv2 on near and 802.11 on far"],
    ),
    ("/interface/wireless", {"wireless-protocol": "nv2"}, {"wireless-protocol": "nv2-nstreme-802.11"}, []),
    ("/interface/wireless", {"security.wpa2-pre-shared-key": "x"}, {}, ["the keys of near and far would differ"]),
    ("/interface/wireless", {"security.wpa2-pre-shared-key": "*****"}, {}, []),
    (
        "/interface/wireless",
        {"wireless-protocol": "nv2", "nv2-preshared-key": "x"},
        {"wireless-protocol": "nv2"},
        ["the keys of near and far would differ"],
    ),
    ("/interface/wireless", {"security.mode": "none"}, {}, ["the keys of near and far would differ"]),
    ("/interface/wifi", {}, {}, []),
    ("/interface/wifi", {"security.passphrase": "x"}, {}, ["the keys of near and far would differ"]),
    ("/interface/wifi", {"security.authentication-types": "wpa3-psk"}, {}, []),
    (
        "/interface/wifi",
        {"channel.width": "20/40mhz"},
        {},
        ["channel-width would be 20/40mhz on near and 20mhz on far"],
    ),
    (
        "/interface/wifi",
        {"configuration.country": "Latvia"},
        {},
        ["country would be Latvia on near and Portugal on far"],
    ),
]


@pytest.mark.parametrize(("menu", "near", "far", "expected"), CASES)
def test_disagreements_of_two_radios(menu: str, near: dict[str, str], far: dict[str, str], expected: list[str]) -> None:
    one = PairRadio(menu, "wlan1", "A", {**MENUS[menu], **near})
    other = PairRadio(menu, "wlan1", "B", {**MENUS[menu], **STATIONS[menu], **far})
    assert list(disagreements(one, other, ("near", "far"))) == expected


def test_different_drivers_never_bridge() -> None:
    one, other = (PairRadio(menu, "x", "A", values) for menu, values in MENUS.items())
    assert "different drivers" in disagreements(one, other, ("near", "far"))[0]
    assert disagreements(None, other, ("near", "far")) == ("near has no radio with a supported driver",)


def test_radio_values_include_inherited_profiles() -> None:
    rows = {
        "/interface/wifi": (
            {".id": "*5", "default-name": "wifi1", "configuration": "all", "channel": "direct", "mac-address": "A"},
        ),
        "/interface/wifi/configuration": (
            {"name": "all", "ssid": "link", "channel.width": "20/40mhz", "security": "s"},
        ),
        "/interface/wifi/channel": ({"name": "direct", "width": "20mhz"},),
        "/interface/wifi/security": ({"name": "s", "passphrase": "key"},),
    }
    found = radio_of(rows)
    assert found is not None
    assert (found.get("configuration.ssid"), found.get("channel.width"), found.get("security.passphrase")) == (
        "link",
        "20mhz",
        "key",
    )
    assert radio_of(rows, "wifi2") is None


@pytest.mark.parametrize(
    ("menu", "verb", "names", "drops"),
    [
        ("/interface/wireless", Verb.SET, ("ssid",), True),
        ("/interface/wireless", Verb.SET, ("comment",), False),
        ("/interface/wireless/security-profiles", Verb.ADD, ("name",), False),
        ("/interface/wireless/security-profiles", Verb.REMOVE, (), True),
        ("/interface/wireless/access-list", Verb.ADD, ("mac-address",), True),
        ("/interface/wifi/channel", Verb.SET, ("frequency",), True),
        ("/ip/address", Verb.REMOVE, (), False),
    ],
)
def test_what_may_interrupt_a_link(menu: str, verb: Verb, names: tuple[str, ...], drops: bool) -> None:  # noqa: FBT001
    values = tuple((name, "x") for name in names)
    action = Action(number=1, layer=Layer.FOUNDATION, menu=menu, verb=verb, subject="row", values=values)
    assert drops_link(action) is drops


@pytest.mark.parametrize(
    ("row", "level"),
    [
        ({"signal-strength": "-48dBm@6Mbps"}, -48.0),
        ({"signal-strength": "-61"}, -61.0),
        ({"signal": "-72"}, -72.0),
        ({}, None),
    ],
)
def test_signal_level_is_parsed_with_and_without_units(row: dict[str, str], level: float | None) -> None:
    assert level_dbm(row) == level
