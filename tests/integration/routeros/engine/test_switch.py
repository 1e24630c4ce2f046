"""The text of a switch, written to an emulated one on real sockets, and what would cut the way to it."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from engine_bench import Bench, on

from atlantis_netcfg.emulator.routeros import ManagementSpec, Radio
from atlantis_netcfg.inventory import load
from atlantis_netcfg.inventory.model import Switch
from atlantis_netcfg.routeros import Status
from atlantis_netcfg.routeros.render import switch

DECLARATION = load(Path(__file__).parents[4] / "inventory")
PORTS = ("ether1", "ether2", "ether3")
USES: Mapping[str, str] = {"ether1": "uplink", "ether2": "lan", "ether3": "lan"}
RADIO = {
    "ssid": "EXAMPLE-BUOY",
    "standard": "802.11ax",
    "band": "5ghz",
    "frequency_mhz": 5580,
    "country": "portugal",
    "key": "EXAMPLE-buoy-key",
}


def text(uses: Mapping[str, str] = USES, isolated: str = "", **changes: object) -> str:
    ports = [{"name": name, "use": use, "isolated": name == isolated} for name, use in uses.items()]
    access = {"address": "10.64.1.5", "password": "EXAMPLE-switch"}
    device = Switch.model_validate({"kind": "switch", "access": access, "ports": ports, **changes})
    return switch(DECLARATION, replace(DECLARATION.hosts["coastal-router"], name="coastal-switch", device=device))


def bench(tmp_path: Path, desired: str, version: str = "7.18.2", **spec: Any) -> Bench:  # noqa: ANN401 - fields of RouterSpec
    """An adopted one: its address is on the port of the cable to the router, and packets come from the router."""
    management = ManagementSpec(address="10.64.1.5/24", port="ether1", technician="10.64.1.1")
    return Bench(
        tmp_path, desired, spec={"version": version, "ports": PORTS, "poe_ports": (), "management": management, **spec}
    )


@pytest.mark.parametrize("version", ["7.18.2", "7.21.5"])
def test_switch_converges_twice(tmp_path: Path, version: str) -> None:
    async def act(bench: Bench) -> None:
        first = await bench.converge()
        assert (first.status, first.protection) == ("changed", "safe-mode")
        again = await bench.converge()
        assert (again.status, again.planned_count) == ("unchanged", 0)

    on(bench(tmp_path, text(isolated="ether3"), version), act)


def test_access_point_on_a_switch_converges_twice(tmp_path: Path) -> None:
    async def act(bench: Bench) -> None:
        assert (await bench.converge()).status == "changed"
        assert (await bench.converge()).status == "unchanged"
        assert "interface=wifi1" in bench.export().replace("\\\n    ", "")

    radio: dict[str, Any] = {"radios": (Radio(name="wifi1"),), "packages": ("routeros", "wifi-qcom")}
    on(bench(tmp_path, text(access_point=RADIO), **radio), act)


def test_port_isolation_is_added_and_removed(tmp_path: Path) -> None:
    async def act(bench: Bench) -> None:
        assert (await bench.converge()).status == "changed"
        assert "horizon" not in bench.export()
        bench.text = text(isolated="ether3")
        one = await bench.converge()
        assert (one.status, one.planned_count) == ("changed", 1)
        assert "horizon=1" in bench.export()
        bench.text = text()
        back = await bench.converge()
        assert back.status == "changed"
        assert "horizon" not in bench.export()

    on(bench(tmp_path, text()), act)


def test_a_plan_that_cuts_the_cable_to_the_router_is_refused(tmp_path: Path) -> None:
    """The cable is in ether1; who declares it elsewhere, and this port off, would never be heard again."""

    async def act(bench: Bench) -> None:
        assert (await bench.converge()).status == "changed"
        before = bench.export()
        bench.text = text({"ether1": "off", "ether2": "uplink", "ether3": "lan"})
        refused = await bench.converge()
        assert (refused.status, refused.confirmed_count) == (Status.REFUSED, 0)
        assert "ether1" in refused.message
        assert bench.export() == before

    on(bench(tmp_path, text()), act)
