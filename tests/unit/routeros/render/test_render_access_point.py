"""The router's access point: its text in either family of radio menus, and whom the twin then registers."""

from dataclasses import replace

import pytest
from render_declared import declaration

from atlantis_netcfg.emulator.routeros import Device, RouterSpec
from atlantis_netcfg.emulator.routeros.answers import Caller
from atlantis_netcfg.emulator.routeros.spec import Environment, NearbyStation, Radio
from atlantis_netcfg.inventory.model import Router, RouterAccessPoint
from atlantis_netcfg.routeros import rsc
from atlantis_netcfg.routeros.render import router

DRIVERS = {"wifi": ("wifi-qcom", "wifi1"), "wireless": ("wireless", "wlan1")}
KEY = "EXAMPLE-coastal-access-point"
STATION = NearbyStation(mac="02:00:5e:00:01:23", ssid="EXAMPLE-ATLANTIS-COASTAL", passphrase=KEY, signal_dbm=-61.0)


def text(menus: str, **changes: object) -> str:
    given = declaration()
    host = given.router("coastal")
    assert isinstance(host.device, Router)
    assert host.device.access_point is not None
    told = {"menus": menus, "standard": "802.11ac" if menus == "wireless" else "802.11ax", **changes}
    radio = RouterAccessPoint.model_validate({**dict(host.device.access_point), **told})
    changed = replace(host, device=host.device.model_copy(update={"access_point": radio}))
    return router(given, changed)


def row(menus: str, **changes: object) -> dict[str, str | None]:
    export = rsc.parse(text(menus, **changes), "coastal-router")
    (found,) = [item for item in export.statements if item.menu == f"/interface/{menus}"]
    return dict(found.values)


def twin(menus: str, *stations: NearbyStation) -> tuple[Device, Caller]:
    package, name = DRIVERS[menus]
    spec = RouterSpec(
        name="coastal-router",
        packages=("routeros", package),
        radios=(Radio(name=name),),
        around=Environment(stations=stations),
        seed=_radio_only(menus),
    )
    device = Device(spec, lambda: 0.0)
    return device, device.login("provision", "", via="api-ssl", address="10.64.101.10")


def _radio_only(menus: str) -> str:
    """The lines of the text that set the radio, as a technician pastes them."""
    lines = text(menus).splitlines()
    kept = [
        line
        for before, line in zip(["", *lines], lines, strict=False)
        if line.startswith(f"/interface {menus}") or before.startswith(f"/interface {menus}")
    ]
    return "\n".join(kept) + "\n"


def registered(menus: str, *stations: NearbyStation) -> list[dict[str, str]]:
    device, caller = twin(menus, *stations)
    said = device.run(caller, [f"/interface/{menus}/registration-table/print"])
    return [dict(word[1:].split("=", 1) for word in answer.words) for answer in said if answer.kind == "!re"]


def test_both_driver_families_get_equivalent_settings() -> None:
    newer, older = row("wifi"), row("wireless")
    assert (newer["configuration.mode"], older["mode"]) == ("ap", "ap-bridge")
    assert newer["configuration.ssid"] == older["ssid"] == "EXAMPLE-ATLANTIS-COASTAL"
    assert newer["channel.frequency"] == older["frequency"] == "5580"
    assert (newer["configuration.country"], older["country"]) == ("Portugal", "portugal")
    rehearsed = row("wifi", country="later"), row("wireless", country="later")
    assert (rehearsed[0]["configuration.country"], rehearsed[1]["country"]) == ("Latvia", "latvia")
    assert (newer["datapath.client-isolation"], older["default-forwarding"]) == ("yes", "no")
    assert newer["security.passphrase"] == KEY


def test_isolation_can_be_declared_off() -> None:
    assert row("wifi", isolated=False)["datapath.client-isolation"] == "no"
    assert row("wireless", isolated=False)["default-forwarding"] == "yes"


def test_wpa3_authentication_is_rendered() -> None:
    assert row("wifi", wpa="wpa3")["security.authentication-types"] == "wpa3-psk"


@pytest.mark.parametrize("menus", list(DRIVERS))
def test_a_station_with_name_and_key_is_registered(menus: str) -> None:
    (found,) = registered(menus, STATION)
    assert found["mac-address"] == "02:00:5E:00:01:23"
    assert found["interface"] == DRIVERS[menus][1]
    assert "-61" in found["signal" if menus == "wifi" else "signal-strength"]


@pytest.mark.parametrize("menus", list(DRIVERS))
@pytest.mark.parametrize("change", [{"passphrase": "EXAMPLE-another"}, {"ssid": "EXAMPLE-OLD"}, {"passphrase": ""}])
def test_other_stations_are_not_registered(menus: str, change: dict[str, str]) -> None:
    assert registered(menus, STATION.model_copy(update=change)) == []


@pytest.mark.parametrize("menus", list(DRIVERS))
def test_disabled_radio_registers_no_station(menus: str) -> None:
    device, caller = twin(menus, STATION)
    name = DRIVERS[menus][1]
    device.run(caller, [f"/interface/{menus}/set", f"=.id={name}", "=disabled=yes"])
    said = device.run(caller, [f"/interface/{menus}/registration-table/print"])
    assert [answer.kind for answer in said if answer.kind != "!empty"] == ["!done"]
