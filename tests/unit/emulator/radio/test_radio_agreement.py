"""Which radios find each other: cases as data, each one change to two ends that agree."""

from dataclasses import replace
from typing import Any

import pytest
from row_subtests import for_each_row

from atlantis_netcfg.emulator.routeros import Air
from atlantis_netcfg.emulator.routeros.radio import Driver, RadioSettings, why_not
from atlantis_netcfg.emulator.routeros.radio._law import find_rule, free_space_loss_db, signal_dbm, span

AP = RadioSettings(
    driver=Driver.WIRELESS,
    mac="48:A9:8A:00:00:01",
    radio_name="ap",
    is_enabled=True,
    mode="bridge",
    bridges_stations=True,
    protocol="802.11",
    ssid="link",
    band="5ghz-a/n",
    width="20mhz",
    frequency=5500,
    scans=None,
    country="portugal",
    outdoor=True,
    lawless=False,
    authentication=frozenset({"wpa2-psk"}),
    passphrase="secret key",
    nv2_key="nv2 key",
    reach_km=30.0,
    power_dbm=25.0,
    gain_dbi=16.0,
    refuses=frozenset(),
    admits=frozenset(),
)
STATION = replace(AP, mac="48:A9:8A:00:00:02", mode="station-bridge", frequency=None)
WIFI: dict[str, Any] = {"driver": Driver.WIFI, "band": "5ghz-ax", "nv2_key": None, "reach_km": 2.0}

CASES: dict[str, tuple[dict[str, Any], dict[str, Any], dict[str, Any], str]] = {
    "as they are": ({}, {}, {}, ""),
    "access point off": ({"is_enabled": False}, {}, {}, "a radio is disabled"),
    "station off": ({}, {"is_enabled": False}, {}, "a radio is disabled"),
    "two access points": ({}, {"mode": "ap-bridge"}, {}, "both ends are access points"),
    "two stations": ({"mode": "station"}, {}, {}, "no end is an access point"),
    "plain station": ({}, {"mode": "station"}, {}, "the station does not bridge"),
    "no bridge mode": ({"bridges_stations": False}, {}, {}, "the station does not bridge"),
    "other driver": ({}, WIFI, {}, "station-bridge does not work between the two drivers"),
    "both new drivers": ({**WIFI, "mode": "ap"}, WIFI, {}, ""),
    "other name": ({"ssid": "new"}, {}, {}, "the network names differ"),
    "any name": ({}, {"ssid": ""}, {}, ""),
    "nv2 and 802.11": ({"protocol": "nv2"}, {}, {}, "the protocols differ"),
    "802.11 and nv2": ({}, {"protocol": "nv2"}, {}, "the protocols differ"),
    "nv2 and a station that tries it": ({"protocol": "nv2"}, {"protocol": "nv2-nstreme-802.11"}, {}, ""),
    "802.11 and a station that tries it": ({}, {"protocol": "nv2-nstreme-802.11"}, {}, ""),
    "nv2 and any": ({"protocol": "nv2"}, {"protocol": "any"}, {}, ""),
    "nstreme and nv2-nstreme": ({"protocol": "nstreme"}, {"protocol": "nv2-nstreme"}, {}, ""),
    "802.11 and nv2-nstreme": ({}, {"protocol": "nv2-nstreme"}, {}, "the protocols differ"),
    "other passphrase": ({"passphrase": "other"}, {}, {}, "the keys differ"),
    "passphrase without meaning for nv2": ({"protocol": "nv2", "passphrase": "other"}, {"protocol": "nv2"}, {}, ""),
    "other nv2 key": ({"protocol": "nv2", "nv2_key": "other"}, {"protocol": "nv2"}, {}, "the keys differ"),
    "one end without nv2 key": ({"protocol": "nv2", "nv2_key": None}, {"protocol": "nv2"}, {}, "the keys differ"),
    "more ways of authentication": ({"authentication": frozenset({"wpa2-psk", "wpa3-psk"})}, {}, {}, ""),
    "no way in common": ({"authentication": frozenset({"wpa3-psk"})}, {}, {}, "the keys differ"),
    "other width": ({"width": "20/40mhz-Ce"}, {}, {}, "the channel widths differ"),
    "other band": ({"band": "2ghz-b/g/n", "frequency": 2412}, {}, {}, "the bands differ"),
    "no standard in common": ({"band": "5ghz-onlyac"}, {"band": "5ghz-a/n"}, {}, "the bands differ"),
    "channel of another band": ({"frequency": 2412}, {}, {}, "the radio does not have this channel"),
    "indoor channel outdoors": ({"frequency": 5180}, {}, {}, "the country does not allow this channel"),
    "indoor channel indoors": ({"frequency": 5180, "outdoor": False}, {"outdoor": False}, {}, ""),
    "no such channel": ({"frequency": 5480}, {}, {}, "the country does not allow this channel"),
    "unknown country": ({"country": "atlantis"}, {}, {}, "the country does not allow this channel"),
    "superchannel": ({"frequency": 5480, "lawless": True}, {"lawless": True}, {}, ""),
    "superchannel of one end": (
        {"frequency": 5480, "lawless": True},
        {},
        {},
        "the station's country does not allow this channel",
    ),
    "station looks there": ({}, {"scans": ((5490, 5510),)}, {}, ""),
    "station looks elsewhere": ({}, {"scans": ((5600, 5700),)}, {}, "the station does not look on this channel"),
    "turned away": ({"refuses": frozenset({"*"})}, {}, {}, "a list turns the other end away"),
    "named and let in": ({"refuses": frozenset({"*"}), "admits": frozenset({STATION.mac})}, {}, {}, ""),
    "radar": ({}, {}, {"radar_mhz": (5500,)}, "a radar is on this channel"),
    "too far": ({}, {}, {"distance_m": 100_000.0, "loss_db": 20.0}, "the ends are too far apart"),
    "beyond the cell of nv2": (
        {"protocol": "nv2"},
        {"protocol": "nv2"},
        {"distance_m": 31_000.0},
        "ranging timeout: the ends are set to a shorter distance",
    ),
    "beyond 2 km without distance": (
        {**WIFI, "mode": "ap"},
        WIFI,
        {"distance_m": 3000.0},
        "ranging timeout: the ends are set to a shorter distance",
    ),
}


@for_each_row("case", CASES)
def test_agreement(case: str) -> None:
    ap, station, air, expected = CASES[case]
    one, other, between = replace(AP, **ap), replace(STATION, **station), Air(**air)
    assert why_not(one, other, between) == expected
    assert why_not(other, one, between) == expected


def test_signal_level_follows_free_space_loss() -> None:
    assert free_space_loss_db(150.0, 5500) == pytest.approx(90.8, abs=0.05)
    loud = signal_dbm(AP, STATION, 5500, Air(distance_m=150.0))
    assert loud == pytest.approx(-44.8, abs=0.1), "30 dBm EIRP, which the law allows, and 16 dBi"
    assert signal_dbm(AP, STATION, 5500, Air(distance_m=300.0)) == pytest.approx(loud - 6.02, abs=0.01)
    assert signal_dbm(replace(AP, power_dbm=4.0), STATION, 5500, Air()) == pytest.approx(loud - 10)
    assert signal_dbm(AP, STATION, 5500, Air(loss_db=12.5)) == pytest.approx(loud - 12.5)


@pytest.mark.parametrize(
    ("width", "edges"),
    [
        ("20mhz", (5490, 5510)),
        ("10mhz", (5495, 5505)),
        ("20/40mhz-Ce", (5490, 5530)),
        ("20/40mhz-eC", (5470, 5510)),
        ("20/40/80mhz-eeCe", (5450, 5530)),
        ("20/40/80mhz", (5490, 5570)),
    ],
)
def test_span_of_a_channel(width: str, edges: tuple[int, int]) -> None:
    assert span(5500, width) == edges


def test_wide_channel_must_fit_in_the_allowed_range() -> None:
    assert find_rule("portugal", 5500, "20/40mhz-Ce", outdoor=True) is not None
    assert find_rule("portugal", 5500, "20/40mhz-eC", outdoor=True) is None
    assert find_rule("portugal", 5720, "20/40mhz-Ce", outdoor=True) is None
