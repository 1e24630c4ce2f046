"""What a router twin answers, read: identity, ports, and who was heard on them, joined over four menus."""

from collections.abc import Mapping
from typing import Any

import pytest

from atlantis_netcfg.emulator.routeros.device import Device
from atlantis_netcfg.emulator.routeros.spec import DiscoveryNeighbour, Environment, ModemSpec, RouterSpec, User
from atlantis_netcfg.inventory.model import NumberMask
from atlantis_netcfg.records.asbuilt import routeros
from atlantis_netcfg.records.asbuilt.record import CableState, Origin
from atlantis_netcfg.routeros.api import Command, Reply, Trap

PORTS = ("ether1", "ether2", "ether3", "ether4", "ether5")
SEED = """
/interface bridge
add name=bridge-lan
/interface bridge port
add bridge=bridge-lan interface=ether4
add bridge=bridge-lan interface=ether5
/ip address
add address=10.64.1.1/24 interface=bridge-lan
add address=10.10.0.2/29 interface=ether1
/ip neighbor discovery-settings
set discover-interface-list=all
"""
MAC = "02:00:5E:00:01:23"
DECLARED = {MAC: "coastal-gateway", "10.10.0.1": "next hop of wifi-ptp"}


class Box:
    """A twin that answers commands as the session of the API gives them."""

    def __init__(self, seed: str = SEED, modem: ModemSpec | None = None, **around: Any) -> None:  # noqa: ANN401 - fields
        spec = RouterSpec(
            name="box", serial_number="EXAMPLE1", users=(User(name="provision"),), seed=seed, modem=modem,
            neighbours=("10.10.0.1",), around=Environment(**around),
        )  # fmt: skip
        self.device = Device(spec, lambda: 1000.0)
        self.caller = self.device.login("provision", "", via="api-ssl", address="10.64.101.10")

    def ask(self, command: Command) -> Reply:
        answers = self.device.run(self.caller, list(command.words()))
        rows = [dict(word[1:].partition("=")[::2] for word in one.words) for one in answers if one.kind == "!re"]
        traps = [word.partition("message=")[2] for one in answers if one.kind == "!trap" for word in one.words]
        trap = next((Trap(text) for text in traps if text), None)
        return Reply(rows=tuple(rows), trap=trap)

    def read(
        self, modem: str | None = None, mask: NumberMask = NumberMask.LAST4, refuses: Mapping[str, str] | None = None
    ) -> routeros.RouterOsFacts:
        found = []
        for command in routeros.questions(PORTS, modem):
            why = (refuses or {}).get(command.path)
            found.append(self.ask(command) if why is None else Reply(trap=Trap(why)))
        return routeros.read(found, PORTS, modem, mask, DECLARED)


def test_router_facts_are_read() -> None:
    facts = Box().read().facts
    assert {name: fact.value for name, fact in facts.items()} == {
        "model": "RB5009UPr+S+",
        "serial": "EXAMPLE1",
        "version": "7.18.2 (stable)",
        "boot_firmware": "7.18.2",
    }
    assert {fact.origin for fact in facts.values()} == {Origin.READ}


def test_commands_only_read_and_fit_in_one_batch() -> None:
    asked = routeros.questions([f"ether{number}" for number in range(1, 14)], "lte1")
    assert {command.path.rpartition("/")[2] for command in asked} == {"print", "monitor"}
    assert all(("once", "") in command.arguments for command in asked if command.path.endswith("monitor"))
    assert len(asked) <= 24


def test_port_link_speed_and_mac_are_read() -> None:
    box = Box()
    box.device.run(box.caller, ["/interface/ethernet/disable", "=numbers=ether3"])
    ports = {port.name: port for port in box.read().ports}
    assert (ports["ether1"].link, ports["ether1"].speed) == (CableState.UP, "1Gbps")
    assert (ports["ether3"].link, ports["ether3"].speed) == (CableState.DOWN, None)
    assert len({port.mac for port in ports.values()}) == len(ports) == 8


def test_neighbours_are_joined_by_mac_and_named_from_the_inventory() -> None:
    called = DiscoveryNeighbour(identity="EXAMPLE-gw", interface="ether1", mac="02:00:5e:00:02:01", address="10.10.0.6")
    found = Box(plugged={"ether4": (MAC,)}, cards={"10.64.1.23": MAC}, called=(called,)).read()
    heard = {port.name: port.neighbours for port in found.ports if port.neighbours}
    (gateway,) = heard["ether4"]
    assert (gateway.mac, gateway.address, gateway.by) == (MAC, "10.64.1.23", ("bridge", "ARP"))
    assert gateway.declared == "coastal-gateway"
    hop, named = sorted(heard["ether1"], key=lambda item: item.address or "")
    assert (hop.address, hop.by, hop.declared) == ("10.10.0.1", ("ARP",), "next hop of wifi-ptp")
    assert (named.name, named.by) == ("EXAMPLE-gw", ("neighbour discovery",))
    assert found.elsewhere == ()


def test_bridge_neighbour_with_unknown_port_is_listed_separately() -> None:
    found = Box(cards={"10.64.1.23": MAC}).read()
    assert [(item.mac, item.by) for item in found.elsewhere] == [(MAC, ("ARP",))]
    assert all(item.mac != MAC for port in found.ports for item in port.neighbours)


def test_disabled_neighbour_discovery_is_noted() -> None:
    off = Box(SEED.replace("discover-interface-list=all", "discover-interface-list=none"))
    note = "neighbour discovery is off on the device, so it learns no names"
    assert note in off.read().notes
    assert note not in Box().read().notes


def test_renamed_port_is_listed_by_its_factory_name() -> None:
    box = Box()
    box.device.run(box.caller, ["/interface/ethernet/set", "=numbers=ether2", "=name=EXAMPLE"])
    found = box.read()
    assert "ether2 is called EXAMPLE" in found.notes
    port = next(port for port in found.ports if port.name == "ether2")
    assert (port.link, port.speed) == (CableState.UP, None)


@pytest.mark.parametrize("menu", ["/system/resource/print", "/interface/print"])
def test_refused_standard_menu_is_listed_as_missing(menu: str) -> None:
    found = Box().read(refuses={menu: "not enough permissions (9)"})
    assert found.missing == (f"the device refuses {menu.removesuffix('/print')}: not enough permissions (9)",)


def test_board_without_a_serial_number_gets_none() -> None:
    found = Box().read(refuses={"/system/routerboard/print": "no such command prefix"})
    assert (found.facts["serial"].value, found.facts["serial"].origin) == (None, Origin.NOT_READ)
    assert found.facts["model"].value == "RB5009UPr+S+"
    assert "the device refuses /system/routerboard: no such command prefix" in found.notes
    assert found.missing == ()


@pytest.mark.parametrize(
    ("mask", "imei"),
    [(NumberMask.LAST4, "***********0000"), (NumberMask.FULL, "***************"), (NumberMask.NONE, "001017000000000")],
)
def test_the_numbers_of_a_modem_are_masked_as_declared(mask: NumberMask, imei: str) -> None:
    facts = Box("", ModemSpec()).read("lte1", mask).facts
    assert (facts["modem"].value, facts["modem_firmware"].value) == ("Quectel EG18-EA", "EG18EAPAR01A12M4G")
    assert facts["imei"].value == imei


def test_modem_under_another_name_is_marked_not_read() -> None:
    facts = Box("", ModemSpec()).read("lte9").facts
    assert {facts[name].origin for name in ("modem", "imei", "iccid")} == {Origin.NOT_READ}
