"""`provision inventory doctor site=…` on a real network: what it says of each state, and that what it advises helps."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from laptop_stand import MINE, LaptopStand, laptop

pytestmark = [pytest.mark.namespace, pytest.mark.slow]


@pytest.fixture
def at(tmp_path: Path) -> Iterator[LaptopStand]:
    with laptop(tmp_path) as stand:
        yield stand


def verdicts(at: LaptopStand) -> dict[str, str]:
    return {name: item["verdict"] for name, item in at.look().items()}


@pytest.mark.smoke
def test_advised_command_sets_the_missing_address(at: LaptopStand) -> None:
    at.cable("eth0")
    found = at.look()
    assert found["port"]["verdict"] == "PASS"
    assert found["address"]["verdict"] == "FAIL"
    assert found["route"] | {"commands": []} == {
        "section": "way",
        "name": "route",
        "verdict": "FAIL",
        "measured": "no route to 10.64.101.1",
        "hint": "",
        "commands": [],
    }
    assert found["router"] | {"section": ""} == {
        "section": "",
        "name": "router",
        "verdict": "SKIP",
        "measured": "not contacted: its route is not correct yet",
        "hint": "",
        "commands": [],
    }
    at.serve("eth0")
    at.obey(found["address"])
    after = at.look()
    assert after["address"]["measured"] == "10.64.101.10/24 on eth0"
    assert after["route"]["measured"] == "10.64.101.1 is routed to eth0, from 10.64.101.10"
    assert after["router"]["verdict"] == "WARN"
    assert after["router"]["commands"] == ["provision device trust site=coastal"]


def test_router_receives_one_handshake_and_no_data(at: LaptopStand) -> None:
    at.cable("eth0", address=MINE)
    digest = at.serve("eth0")
    file = at.inventory / "host_vars" / "coastal-router.yml"
    file.write_text(file.read_text().replace("access: {", f"access: {{fingerprint: {digest}, "))
    found = at.look()
    assert found["router"]["measured"] == "coastal-router responds with the known certificate; no login was made"
    assert found["dates"]["verdict"] == "PASS"
    assert at.heard() == ["said b''"]


def test_another_certificate_fails(at: LaptopStand) -> None:
    at.cable("eth0", address=MINE)
    at.serve("eth0")
    file = at.inventory / "host_vars" / "coastal-router.yml"
    file.write_text(file.read_text().replace("access: {", f"access: {{fingerprint: {'ab' * 32}, "))
    assert at.look()["router"]["verdict"] == "FAIL"


def test_no_device_is_contacted_over_a_metered_link(at: LaptopStand) -> None:
    at.cable("eth0", address="10.80.0.5/24")
    at.ip("route", "add", "10.64.0.0/16", "dev", "eth0")
    at.serve("eth0")
    found = at.look("via=satellite")
    assert found["route"]["verdict"] == "PASS"
    assert found["router"]["measured"] == "not contacted: satellite is metered"
    assert at.heard() == []


def test_silent_router_fails(at: LaptopStand) -> None:
    at.cable("eth0", address=MINE)
    found = at.look()
    assert found["route"]["verdict"] == "PASS"
    assert found["router"]["verdict"] == "FAIL"


def test_advised_command_enables_a_disabled_port(at: LaptopStand) -> None:
    at.cable("eth0", up=False)
    found = at.look()
    assert found["port"]["measured"] == "eth0 is disabled"
    at.obey(found["port"])
    assert at.look()["port"]["verdict"] == "PASS"


def test_missing_cable_fails(at: LaptopStand) -> None:
    at.cable("eth0", address=MINE)
    at.unplug("eth0")
    found = at.look()
    assert found["port"]["verdict"] == "FAIL"
    assert found["port"]["measured"] == "eth0 is enabled but detects no cable (no carrier)"
    assert found["address"]["verdict"] == "PASS"
    assert found["router"]["verdict"] == "SKIP"


def test_laptop_without_ethernet_port(at: LaptopStand) -> None:
    assert at.look()["port"]["measured"] == "this laptop has no Ethernet port"


@pytest.mark.parametrize("address", ["192.168.88.5/24", "10.64.101.1/24", "10.64.101.10/32", "10.64.101.55/24"])
def test_advised_command_corrects_a_wrong_address(at: LaptopStand, address: str) -> None:
    at.cable("eth0", address=address)
    found = at.look()
    assert found["address"]["verdict"] != "PASS"
    at.obey(found["address"])
    assert {name: verdict for name, verdict in verdicts(at).items() if name in ("address", "route")} == {
        "address": "PASS",
        "route": "PASS",
    }


def test_advised_commands_fix_two_ports_in_one_network(at: LaptopStand) -> None:
    at.cable("wlan9", address="10.64.101.77/24")
    at.cable("eth0", address=MINE)
    found = at.look()
    assert found["route"]["measured"] == "10.64.101.1 is routed to wlan9, not to eth0"
    assert found["other ports"]["verdict"] == "WARN"
    at.obey(found["route"])
    assert verdicts(at)["route"] == "PASS"
    at.obey(found["other ports"])
    assert verdicts(at)["other ports"] == "PASS"


def test_advised_command_removes_a_narrower_route(at: LaptopStand) -> None:
    at.cable("eth0", address=MINE)
    at.cable("tun9")
    at.ip("route", "add", "10.64.101.0/25", "dev", "tun9")
    found = at.look()
    assert found["route"]["measured"] == "10.64.101.1 is routed to tun9, not to eth0"
    assert found["other ports"]["measured"] == "10.64.101.0/25 is routed to tun9: also in the router's network"
    at.obey(found["other ports"])
    assert verdicts(at)["route"] == "PASS"


def test_advised_command_removes_the_default_route_over_the_site(at: LaptopStand) -> None:
    at.cable("eth0", address=MINE)
    at.ip("route", "add", "default", "via", "10.64.101.1", "dev", "eth0")
    found = at.look()
    assert found["default route"]["verdict"] == "WARN"
    at.obey(found["default route"])
    assert verdicts(at)["default route"] == "PASS"


def test_two_cables_are_a_warning(at: LaptopStand) -> None:
    at.cable("eth0")
    at.cable("eth1")
    assert at.look()["port"]["verdict"] == "WARN"


def test_terminal_output(at: LaptopStand) -> None:
    """The last lines alone say what is wrong and what to type; nothing is wider than a terminal."""
    at.cable("eth0")
    done = at.provision("inventory", "doctor", "site=coastal", program=True)
    assert done.returncode == 6, done.stdout
    assert [line for line in done.stdout.splitlines() if len(line) > 80 and str(at.folder) not in line] == []
    text = re.sub(r"\d+ (?=[A-Z])", "N ", done.stdout)
    assert "  FAIL address             no port has an address in 10.64.101.0/24" in text
    assert "       type: sudo ip address add 10.64.101.10/24 dev eth0\n" in text
    assert re.search(r"^FAIL: N FAIL, ", text, re.MULTILINE)
