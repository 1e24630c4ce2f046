"""The radio menus of the twin: rows of the board, profiles that are inherited, what is refused."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "emulator" / "routeros"))

from twin_bench import Bench, make

from atlantis_netcfg.emulator.routeros import EmulatorSpec, RadioPair, RouterSpec, SiteSpec
from atlantis_netcfg.emulator.routeros.radio import RadioSettings, settings_of

WIRELESS = {"packages": ("routeros", "wireless"), "radios": ({"name": "wlan1"},)}
WIFI = {"packages": ("routeros", "wifi-qcom"), "radios": ({"name": "wifi1"},)}


def settings(bench: Bench, name: str) -> RadioSettings:
    found = settings_of(bench.device.core, name)
    assert found is not None
    return found


def test_radios_need_their_package() -> None:
    assert settings_of(make(radios=({"name": "wlan1"},)).device.core, "wlan1") is None
    assert make(radios=({"name": "wlan1"},)).say("/interface/wireless/print") == [
        "!trap =category=0 =message=no such command prefix",
        "!done",
    ]
    assert make(version="7.12", radios=({"name": "wlan1"},)).value("/interface/wireless", "default-name") == "wlan1"
    assert make(**WIFI).value("/interface/wifi", "default-name") == "wifi1"


def test_a_radio_is_an_interface() -> None:
    bench = make(**WIRELESS)
    assert bench.value("/interface", "type", "?name=wlan1") == "wlan"
    assert bench.script("/interface bridge add name=b\n/interface bridge port add bridge=b interface=wlan1") == ""
    assert bench.say("/interface/wireless/remove", "=.id=wlan1")[0].startswith("!trap")
    assert (
        bench.say("/interface/wireless/add", "=name=x")[0] == "!trap =message=failure: master interface not specified"
    )


def test_secrets_are_hidden_unless_show_sensitive() -> None:
    bench = make(**WIRELESS)
    bench.script('/interface wireless set wlan1 nv2-preshared-key="very secret" nv2-security=enabled')
    assert "very secret" in bench.device.export(show_sensitive=True)
    assert "very secret" not in bench.device.export()


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("=mode=bridges", "input does not match any value of mode"),
        ("=nv2-cell-radius=5", "value of nv2-cell-radius out of range (10..200)"),
        ("=tdma-period-size=11", "value of tdma-period-size out of range (1..10)"),
        ("=security-profile=none", "input does not match any value of security-profile"),
        ("=sssid=x", "unknown parameter sssid"),
    ],
)
def test_invalid_values_are_refused_with_the_device_message(word: str, message: str) -> None:
    (trap, _) = make(**WIRELESS).say("/interface/wireless/set", "=.id=wlan1", word)
    assert f"=message={message}" in trap


def test_values_are_inherited_in_the_documented_order() -> None:
    bench = make(**WIFI)
    said = bench.script(
        "/interface wifi security add name=deep passphrase=from-profile-of-configuration\n"
        "/interface wifi channel add name=direct width=20mhz frequency=5500\n"
        "/interface wifi channel add name=deep width=20/40mhz band=5ghz-ax\n"
        "/interface wifi configuration add name=all ssid=configured country=Portugal security=deep channel=deep"
        " channel.width=20/40/80mhz\n"
        "/interface wifi set wifi1 configuration=all channel=direct configuration.mode=station-bridge disabled=no"
    )
    assert said == ""
    found = settings(bench, "wifi1")
    assert (found.ssid, found.mode, found.passphrase) == (
        "configured",
        "station-bridge",
        "from-profile-of-configuration",
    )
    assert (found.width, found.band, found.frequency) == ("20mhz", "5ghz-ax", 5500)
    bench.script("/interface wifi set wifi1 configuration.ssid=own")
    assert settings(bench, "wifi1").ssid == "own"


def test_print_config_shows_only_the_values_of_the_row() -> None:
    bench = make(**WIFI)
    bench.script(
        "/interface wifi configuration add name=all ssid=configured\n/interface wifi set wifi1 configuration=all"
    )
    assert bench.value("/interface/wifi", "configuration.ssid") == "configured"
    (row, _) = bench.say("/interface/wifi/print", "=config=")
    assert "configuration.ssid" not in row
    assert "=configuration=all" in row


def test_monitor_once() -> None:
    bench = make(**WIRELESS)
    assert bench.say("/interface/wireless/monitor", "=numbers=wlan1", "=once=")[0] == "!re =status=disabled"
    bench.script("/interface wireless set wlan1 disabled=no")
    assert bench.say("/interface/wireless/monitor", "=.id=wlan1", "=once=")[0] == "!re =status=searching-for-network"
    assert bench.say("/interface/wireless/monitor", "=numbers=wlan9", "=once=")[0].startswith("!trap")
    assert bench.count("/interface/wireless/registration-table") == 0


def test_radio_pair_needs_two_different_existing_radios() -> None:
    twins = tuple(EmulatorSpec(router=RouterSpec(name=name)) for name in ("near", "far"))
    with pytest.raises(ValueError, match="there is no radio wlan1 on a twin called near"):
        SiteSpec(name="quay", emulators=twins, pairs=(RadioPair(near="near", far="far"),))
    with pytest.raises(ValueError, match="cannot be both ends"):
        RadioPair(near="one", far="one")
