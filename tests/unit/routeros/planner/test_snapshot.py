"""A state that was read back, as text: it says all of what it can say, and is what it was when it is read."""

from pathlib import Path

import pytest
from plan_world import observed

from atlantis_netcfg.operations.restore import for_replacement
from atlantis_netcfg.routeros import snapshot
from atlantis_netcfg.routeros.desired import DesiredState, read
from atlantis_netcfg.routeros.menus import MENUS
from atlantis_netcfg.routeros.planner import plan

GOLDEN = Path(__file__).parent / "golden"


def every_menu_of(text: str) -> DesiredState:
    """Nothing is declared, in the menus of the text."""
    paths = [path for path in MENUS if f"{MENUS[path].title}\n" in text and not MENUS[path].readonly]
    return read("".join(f"{MENUS[path].title}\n" for path in paths))


@pytest.mark.parametrize("name", ["rows", "ordered"])
def test_device_matches_its_snapshot(name: str) -> None:
    text = (GOLDEN / f"{name}.device.rsc").read_text(encoding="utf-8")
    device = observed(text)
    state = snapshot.write("r", every_menu_of(text), device)
    again = snapshot.read(state, "state")
    assert again.notes == ()
    assert plan("r", again, device).actions == ()
    assert snapshot.write("r", again, device).splitlines()[3:] != []


def test_empty_snapshot_still_lists_the_menus_read() -> None:
    state = snapshot.write("r", read("/ip pool\n/ip dns\n"), observed(""))
    assert state == (
        "# confirmed state of r: the inventory's menus as they were read back, without secrets\n# by RouterOS "
        "7.18.2\n# model = RB5009UPr+S+\n/ip pool\n/ip dns\n"
    )
    assert snapshot.read(state, "state").entire == {"/ip/pool", "/ip/dns"}


def test_snapshot_contains_no_secrets_or_hardware_values() -> None:
    declared = "/interface bridge\n/interface ethernet\n/interface ovpn-client\n/ip address\n"
    device = (
        "/interface ethernet\nset [ find default-name=ether1 ] name=wan mac-address=02:00:00:00:00:01 l2mtu=1598\n"
        "/interface bridge\nadd name=lan admin-mac=02:00:00:00:00:02 auto-mac=no\n"
        "/interface ovpn-client\nadd connect-to=v name=vpn password=swordfish mac-address=02:00:00:00:00:03\n"
        "/ip address\nadd address=10.0.0.1/24 interface=lan network=10.0.0.0\n"
    )
    state = snapshot.write("r", read(declared), observed(device))
    assert "swordfish" not in state
    assert "02:00:00" not in state
    assert "l2mtu" not in state
    assert "network=" not in state
    assert "name=wan" in state


def test_system_row_is_identified_by_name() -> None:
    device = "/system logging action\nadd name=memory memory-lines=2000 default=true\n"
    state = snapshot.write("r", read("/system logging action\n"), observed(device))
    assert "set [ find name=memory ] memory-lines=2000" in state


def test_referenced_port_is_named_even_with_its_factory_name() -> None:
    device = (
        "/interface ethernet\nset [ find default-name=ether1 ] name=ether1\n"
        "set [ find default-name=ether2 ] name=ether2\nset [ find default-name=ether3 ] name=ether3\n"
        "/interface bridge port\nadd bridge=lan interface=ether2\n"
        "/ip route\nadd dst-address=0.0.0.0/0 gateway=10.0.0.9%ether3 routing-table=main\n"
    )
    declared = read("/interface ethernet\n/interface bridge port\n/ip route\n")
    state = snapshot.write("r", declared, observed(device))
    assert "default-name=ether1" not in state
    assert "set [ find default-name=ether2 ] name=ether2" in state
    assert "set [ find default-name=ether3 ] name=ether3" in state


def test_declared_value_is_written_even_if_it_is_the_default() -> None:
    row = "/ip route\nadd blackhole dst-address=10.0.0.0/8 routing-table=main scope=30\n"
    assert "scope=30" in snapshot.write("r", read(row), observed(row))
    assert "scope=30" not in snapshot.write("r", read("/ip route\n"), observed(row))


def test_replacement_takes_secrets_from_the_inventory() -> None:
    declared = read("/interface ovpn-client\nadd connect-to=v name=vpn password=swordfish\n")
    saved = snapshot.read("/interface ovpn-client\nadd connect-to=v name=vpn\nadd connect-to=w name=old\n", "state")
    ours, old = for_replacement(saved, declared).items["/interface/ovpn-client"]
    assert (ours.values["password"], ours.unknown) == ("swordfish", frozenset())
    assert ("password" in old.values, old.unknown) == (False, frozenset({"password"}))
    planned = plan("r", for_replacement(saved, declared), observed(""))
    assert planned.notes == ("/interface ovpn-client: `password` of old is not in the saved export: enter it by hand",)
    assert "swordfish" not in planned.diff


def test_service_certificate_stays_with_the_device() -> None:
    saved = snapshot.read("/ip service\nset [ find name=api-ssl ] certificate=old port=8729\n", "state")
    device = observed("/ip service\nset api-ssl certificate=new port=8729 disabled=false")
    assert plan("r", for_replacement(saved, saved), device).actions == ()
    (action,) = plan("r", saved, device).actions
    assert action.values == (("certificate", "old"),)


def test_newly_declared_menus_are_named_and_left() -> None:
    saved = snapshot.read("/ip pool\n", "state")
    declared = read("/ip pool\n/ip dns\nset allow-remote-requests=yes\n")
    assert for_replacement(saved, declared).notes == ("not in the saved state and left unchanged: /ip dns",)
