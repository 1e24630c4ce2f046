"""The item of the gateway's own access point: judged on what the emulated `iw` prints."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from atlantis_netcfg.checklist.probes import Cell, Step
from atlantis_netcfg.checklist.probes.base import CommandResult, Place, RunProgram
from atlantis_netcfg.checklist.probes.site_checks import steps
from atlantis_netcfg.checklist.runner.simulated._world import gateway_computer
from atlantis_netcfg.core.reading_programs import is_allowed
from atlantis_netcfg.emulator.linux import ComputerSpec, InterfaceSpec
from atlantis_netcfg.emulator.linux._ip import iw
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.inventory.model import Gateway, GatewayAccessPoint, Router

SHIPPED = load(Path(__file__).parents[5] / "inventory")
RADIO = GatewayAccessPoint.model_validate(
    {
        "interface": "wlan3",
        "ssid": "EXAMPLE-COASTAL-GATEWAY",
        "standard": "802.11ac",
        "band": "5ghz",
        "frequency_mhz": 5500,
        "country": "portugal",
        "key": "EXAMPLE-gateway-key",
        "network": "10.71.1.0/24",
        "address": "10.71.1.1",
    }
)
VEHICLES = ("zarco", "stork", "mares")


def declared() -> Inventory:
    """The gateway opens a network, and the router none."""
    gateway, router = SHIPPED.hosts["coastal-gateway"], SHIPPED.hosts["coastal-router"]
    assert isinstance(gateway.device, Gateway)
    assert isinstance(router.device, Router)
    changed = {
        gateway.name: replace(gateway, device=gateway.device.model_copy(update={"access_point": RADIO})),
        router.name: replace(router, device=router.device.model_copy(update={"access_point": None})),
    }
    return replace(SHIPPED, hosts={**SHIPPED.hosts, **changed})


def item(declaration: Inventory) -> Step | None:
    made = steps(Cell(declaration, "coastal", None, "site"))
    return next((step for step in made if step.name == "access-point"), None)


def codes(**changes: Any) -> dict[str, str]:  # noqa: ANN401 - fields of the radio
    """Verdict of each finding when the radio is as it should be but for these."""
    declaration = declared()
    step = item(declaration)
    assert step is not None
    assert step.probe is not None
    spec = gateway_computer(declaration, declaration.hosts["coastal-gateway"], VEHICLES)
    results = {}
    for question in step.probe.asks():
        assert isinstance(question, RunProgram)
        assert question.place is Place.GATEWAY
        assert is_allowed(question.argv)
        code, out, err = iw(_changed(spec, changes), question.argv)
        results[question.name] = CommandResult(None, rc=code, out=out, err=err)
    return {finding.code: str(finding.verdict) for finding in step.probe.judge(results).findings}


def _changed(spec: ComputerSpec, changes: dict[str, Any]) -> ComputerSpec:
    def radio(interface: InterfaceSpec) -> InterfaceSpec:
        return interface.model_copy(update=changes) if interface.name == "wlan3" else interface

    return spec.model_copy(update={"interfaces": tuple(map(radio, spec.interfaces))})


def test_gateway_without_a_network_has_no_item() -> None:
    assert item(SHIPPED) is None


def test_open_network_with_known_stations_passes() -> None:
    assert codes() == {"network-open": "PASS", "stations": "PASS"}


def test_open_network_without_stations_passes() -> None:
    assert codes(stations=()) == {"network-open": "PASS"}


def test_stopped_hostapd_fails() -> None:
    assert codes(type="managed", association=None)["network-closed"] == "FAIL"


def test_missing_radio_fails() -> None:
    assert codes(name="wlan9") == {"radio-missing": "FAIL"}


def test_radar_wait_is_inconclusive() -> None:
    assert codes(association=None) == {"network-not-yet-open": "INCONCLUSIVE"}


@pytest.mark.parametrize(
    ("field", "value", "code", "verdict"),
    [("ssid", "EXAMPLE-OLD", "other-network", "FAIL"), ("frequency_mhz", 5580, "other-channel", "WARN")],
)
def test_network_different_from_inventory_is_reported(field: str, value: object, code: str, verdict: str) -> None:
    spec = gateway_computer(declared(), declared().hosts["coastal-gateway"], VEHICLES)
    radio = spec.interface("wlan3")
    assert radio is not None
    assert radio.association is not None
    assert codes(association=radio.association.model_copy(update={field: value}))[code] == verdict


def test_unknown_station_is_a_warning() -> None:
    spec = gateway_computer(declared(), declared().hosts["coastal-gateway"], VEHICLES)
    radio = spec.interface("wlan3")
    assert radio is not None
    stranger = radio.stations[0].model_copy(update={"bssid": "02:00:5E:00:09:99"})
    assert codes(stations=(*radio.stations, stranger))["unknown-station"] == "WARN"
