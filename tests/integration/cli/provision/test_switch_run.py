"""A site with a switch, with a buoy (a switch with a radio) and with the docking station that hangs on it."""

import json
import os
import shutil
from pathlib import Path
from typing import Any

import preforked
import pytest

from atlantis_netcfg.inventory import load
from atlantis_netcfg.operations.common.kinds import is_supported

CHECKOUT = Path(__file__).parents[4]
SWITCH = """\
device:
  kind: switch
  access: {address: 10.64.1.5, password: EXAMPLE-coastal-switch}
  powered_by: {device: coastal-router, port: ether7}
  ports:
    - {name: ether1, use: uplink}
    - {name: ether2, use: lan}
    - {name: ether3, use: lan, isolated: true}
    - {name: ether4, use: lan, poe: {out: auto-on, priority: 5}}
    - {name: ether5, use: "off"}
"""
BUOY = """\
device:
  kind: switch
  access: {address: 10.64.1.6, password: EXAMPLE-coastal-buoy}
  powered_by: {device: coastal-switch, port: ether4}
  ports:
    - {name: ether1, use: uplink}
    - {name: ether2, use: lan}
  access_point:
    ssid: EXAMPLE-COASTAL-BUOY
    standard: 802.11ax
    band: 5ghz
    frequency_mhz: 5500
    country: portugal
    key: EXAMPLE-buoy-key
"""
STATION = """\
  docking-station:
    name: Docking station
    kind: docking_station
    table3: [acoustic]
    ethernet: true
    endpoints:
      acoustic: {driver: evologics, acoustic_address: 9, partner: 2}
      ethernet: {}
"""


def _edit(path: Path, *pairs: tuple[str, str]) -> None:
    text = path.read_text(encoding="utf-8")
    for old, new in pairs:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    path.write_text(text, encoding="utf-8")


@pytest.fixture(scope="module")
def inventory(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The shipped one with them at the coastal site; Zarco is a station of the buoy."""
    folder = shutil.copytree(CHECKOUT / "inventory", tmp_path_factory.mktemp("with-switches") / "inventory")
    names = ("coastal-switch", "coastal-buoy")
    here = "".join(f"            {name}:\n" for name in names)
    group = "".join(f"        {name}:\n" for name in names)
    _edit(
        folder / "hosts.yml",
        ("            coastal-gateway:\n", f"            coastal-gateway:\n{here}"),
        ("    switches:\n      hosts: {} # none in this example\n", f"    switches:\n      hosts:\n{group}"),
    )
    for name, text in zip(names, (SWITCH, BUOY), strict=True):
        (folder / f"host_vars/{name}.yml").write_text(text, encoding="utf-8")
    router = '{name: ether7, use: "off", poe: {out: "off"}}'
    _edit(folder / "host_vars/coastal-router.yml", (router, "{name: ether7, use: lan, poe: {out: auto-on}}"))
    vehicles = folder / "group_vars/all/vehicles.yml"
    vehicles.write_text(
        vehicles.read_text("utf-8").replace("wifi: {role: station}", "wifi: {role: station, seen_by: coastal-buoy}", 1)
        + STATION,
        encoding="utf-8",
    )
    reserved = '      - {name: docking-station, mac: "02:00:5E:00:01:27", address: 10.64.1.27}\n'
    _edit(
        folder / "group_vars/coastal.yml",
        ("stork, mares, eca-rov]", "stork, mares, eca-rov, docking-station]"),
        ("  management:\n", f"{reserved}  management:\n"),
    )
    return folder


def provision(state: Path, *typed: str, code: int) -> str:
    done = preforked.run(typed, env={**os.environ, "ATLANTIS_STATE": str(state)})
    assert done.returncode == code, f"exit {done.returncode}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def test_inventory_is_valid_and_switches_are_supported(inventory: Path) -> None:
    declaration = load(inventory)
    assert [
        name for name, host in declaration.hosts.items() if host.device.kind == "switch" and is_supported(host)
    ] == [
        "coastal-switch",
        "coastal-buoy",
    ]


@pytest.mark.slow
def test_switches_converge_behind_their_router_and_second_run_is_unchanged(inventory: Path, tmp_path: Path) -> None:
    chosen = "device=coastal-router,coastal-switch,coastal-buoy"
    typed = ("site=coastal", chosen, f"inventory={inventory}", "--rehearse", "--yes", "--json")
    told: dict[str, Any] = json.loads(provision(tmp_path, *typed, code=0))["devices"]
    assert set(told) == {"coastal-router", "coastal-switch", "coastal-buoy"}
    for device in told.values():
        assert (device["status"], device["second_pass"]) == ("changed", 0)
        assert device["planned"] == device["confirmed"] > 40
        assert {name: again["planned"] for name, again in device["bearers"].items()} == dict.fromkeys(
            ("lan", "wifi-ptp", "4g", "satellite"), 0
        )


@pytest.mark.slow
def test_station_of_the_buoy_is_found_in_the_registration_table(inventory: Path, tmp_path: Path) -> None:
    typed = ("check", "site=coastal", "vehicle=zarco", "endpoint=wifi", f"inventory={inventory}", "--rehearse")
    items = json.loads(provision(tmp_path, *typed, "--json", code=0))["items"]
    (item,) = [item for item in items if item["id"] == "zarco/wifi"]
    assert item["verdict"] == "PASS"
    assert "coastal-buoy" in json.dumps(item)


@pytest.mark.slow
def test_docking_station_is_checked_over_cable_and_modem(inventory: Path, tmp_path: Path) -> None:
    typed = ("check", "site=coastal", "vehicle=docking-station", f"inventory={inventory}", "--rehearse", "--json")
    items = {item["id"]: item["verdict"] for item in json.loads(provision(tmp_path, *typed, code=6))["items"]}
    assert {name: items[name] for name in ("docking-station/acoustic", "docking-station/ethernet")} == {
        "docking-station/acoustic": "PASS",
        "docking-station/ethernet": "PASS",
    }
