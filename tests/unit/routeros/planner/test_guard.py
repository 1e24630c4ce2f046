from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml
from plan_world import facts, observed, rows
from row_subtests import for_each_row

from atlantis_netcfg.routeros import guard
from atlantis_netcfg.routeros._types import Observation
from atlantis_netcfg.routeros.desired import read
from atlantis_netcfg.routeros.guard import ManagementPath
from atlantis_netcfg.routeros.guard._state import State
from atlantis_netcfg.routeros.planner import plan

HERE = Path(__file__).parent
DEVICE = (HERE / "guard_device.rsc").read_text(encoding="utf-8")
CASES = yaml.safe_load((HERE / "guard_cases.yml").read_text(encoding="utf-8"))
GOLDEN = HERE.parent / "render" / "golden"


def device(case: dict[str, Any]) -> Observation:
    known, also = rows(DEVICE), rows(case.get("also", ""))
    both = {
        menu: found + tuple({**row, ".id": f"*A{row['.id'][1:]}"} for row in also[menu] if ".id" in row)
        for menu, found in known.items()
    }
    instead = case.get("instead", "/")
    return Observation(
        facts(case.get("version", "7.18.2")), both | {menu: also[menu] for menu in also if menu == instead}
    )


@for_each_row("case", CASES, ids=lambda case: case["name"])
def test_guard_decides_as_the_case_says(case: dict[str, Any]) -> None:
    path = ManagementPath(case.get("technician", "10.64.101.10"), case.get("local", "10.64.101.1"))
    there = device(case)
    planned = plan("r", read(case["desired"]), there)
    assert planned.actions
    assert list(guard.objections(planned, there, path)) == case.get("objections", [])
    assert guard.touches(planned, there, path) is case["touches"]


ORDERS = {
    "no routes": "/ip route",
    "a blackhole in front of the technician": "/ip route\nadd blackhole comment=atlantis dst-address={technician}/32",
    "another gateway": "/ip route\nadd comment=atlantis distance=1 gateway=10.64.1.253",
    "one more route elsewhere": "/ip route\nadd comment=atlantis dst-address=203.0.113.0/24 gateway=10.64.1.253",
}
"""Changes of routes alone."""


def way_back_of(there: Observation) -> Observation:
    """What is read of a device before its order of links is changed."""
    return replace(there, rows={menu: there.rows[menu] for menu in guard.WAY_BACK})


@for_each_row("case", CASES, ids=lambda case: case["name"])
def test_route_plan_keeping_the_return_path_has_no_objection(case: dict[str, Any]) -> None:
    """On the device of every case: what is not read then would not have objected."""
    there, technician = device(case), case.get("technician", "10.64.101.10")
    path = ManagementPath(technician, case.get("local", "10.64.101.1"))
    for text in ORDERS.values():
        planned = plan("r", read(text.format(technician=technician)), there)
        moves = guard.moves_answers(planned, way_back_of(there), path)
        assert moves or not guard.objections(planned, there, path)
        assert moves is guard.moves_answers(planned, there, path)


def test_some_route_plans_do_move_the_return_path() -> None:
    there, near, far = observed(DEVICE), "10.64.101.10", "10.80.0.5"

    def moving(technician: str) -> list[str]:
        path = ManagementPath(technician, "10.64.101.1")
        plans = {name: plan("r", read(text.format(technician=technician)), there) for name, text in ORDERS.items()}
        return [name for name, planned in plans.items() if guard.moves_answers(planned, way_back_of(there), path)]

    assert moving(near) == ["a blackhole in front of the technician"]
    assert moving(far) == list(ORDERS)


UNREAD = {
    "/certificate": ("/certificate\nadd name=another", None),
    "/interface/list": (
        """/interface list\nadd name=SIDE include=LAN
/ip firewall filter\nadd action=drop chain=output comment=side out-interface-list=SIDE""",
        "/ip firewall filter: the rule `output drop side` would drop the router's responses to you",
    ),
    "/interface/list/member": (
        "/ip firewall filter\nadd action=drop chain=output comment=lan out-interface-list=LAN",
        "/ip firewall filter: the rule `output drop lan` would drop the router's responses to you",
    ),
    "/ip/dhcp-client": ("/ip dhcp-client\nadd interface=ether8 disabled=false", None),
    "/ip/firewall/filter": (
        "/ip firewall filter\nadd action=drop chain=output comment=lan out-interface=bridge-lan",
        "/ip firewall filter: the rule `output drop lan` would drop the router's responses to you",
    ),
    "/ip/firewall/mangle": (
        "/ip firewall mangle\nadd action=mark-routing chain=output comment=lan out-interface=bridge-lan",
        "/ip firewall mangle: the rule `output mark-routing lan` would route the router's responses to you",
    ),
    "/ip/firewall/nat": (
        "/ip firewall nat\nadd action=redirect chain=dstnat comment=lan in-interface=bridge-lan",
        "/ip firewall nat: the rule `dstnat redirect lan` would send your new sessions elsewhere",
    ),
    "/ip/service": ("/ip service\nset api-ssl disabled=true port=8730", None),
}
"""Menus that are not read while the answers stay, and rows of them that would harm answers by the LAN, or harm nobody
by a change of routes."""


@pytest.mark.parametrize("menu", UNREAD)
def test_unread_menu_matters_only_if_the_return_path_moves(menu: str) -> None:
    also, objection = UNREAD[menu]
    there = device({"also": also})
    away = plan("r", read(ORDERS["one more route elsewhere"]), there)
    moved = plan("r", read("/ip route\nadd comment=atlantis distance=1 gateway=10.64.1.254"), there)
    near, far = ManagementPath("10.64.101.10", "10.64.101.1"), ManagementPath("10.80.0.5", "10.64.101.1")
    assert not guard.moves_answers(away, way_back_of(there), near)
    assert guard.objections(away, there, near) == ()
    assert guard.moves_answers(moved, way_back_of(there), far)
    first, *_ = found = guard.objections(moved, there, far)
    assert any("responses to you at 10.80.0.5 take" in each for each in found)
    assert objection is None or first.startswith(objection)


def test_every_guard_menu_is_read_or_has_a_case() -> None:
    """Users are read before every change, and address lists because the sign of a run is a row of them."""
    elsewhere = {"/user", "/user/group", "/ip/firewall/address-list"}
    assert {*UNREAD, *guard.WAY_BACK, *elsewhere} == set(guard.MENUS)


def test_unknown_interface_is_its_own_only_port() -> None:
    assert State(observed(DEVICE).rows, ManagementPath("10.64.101.10", "10.64.101.1")).ports("gone") == {"gone"}


def test_at_least_25_unique_cases_exist() -> None:
    assert len({case["name"] for case in CASES}) == len(CASES) >= 25


ADOPTED = """\
/interface ethernet
{ports}
/interface wifi
set [ find default-name=wifi1 ] name=wifi1
/ip address
add address=10.64.{site}.1/24 comment="atlantis: management" interface={port} network=10.64.{site}.0
/ip service
{services}
/system logging action
add name=memory target=memory
/certificate
add name=atlantis-api
/user
add group=full name=provision
/user group
add name=full policy=local,telnet,ssh,ftp,reboot,read,write,policy,test,winbox,password,web,sniff,sensitive,api
"""
SERVICES = "telnet ftp www ssh www-ssl api winbox"


def adopted(text: str) -> tuple[Observation, ManagementPath]:
    management = next(line for line in text.splitlines() if 'comment="atlantis: management" interface=' in line)
    address = management.split("address=")[1].split("/")[0]
    site, port = address.split(".")[2], management.split("interface=")[1]
    ports = "\n".join(f"set [ find default-name=ether{n} ] name=ether{n} poe-out=auto-on" for n in range(1, 9))
    services = "\n".join(f"set {name}" for name in SERVICES.split())
    services += "\nset api-ssl port=8729 certificate=atlantis-api"
    filled = ADOPTED.format(ports=ports, site=site, port=port, services=services)
    return observed(filled), ManagementPath(f"10.64.{site}.10", address)


@pytest.mark.parametrize("name", sorted(path.name for path in GOLDEN.glob("*-router.rsc")))
def test_first_configuration_of_our_sites_keeps_the_technician_connected(name: str) -> None:
    text = (GOLDEN / name).read_text(encoding="utf-8")
    there, path = adopted(text)
    planned = plan(name, read(text, name), there)
    assert planned.weight > 60
    assert guard.objections(planned, there, path) == ()
    assert guard.touches(planned, there, path)


def test_guard_needs_only_its_listed_menus() -> None:
    planned = plan("r", read("/ip address"), observed(DEVICE))
    path = ManagementPath("10.64.101.10", "10.64.101.1")
    part = Observation(facts(), {menu: rows(DEVICE)[menu] for menu in guard.MENUS})
    assert guard.objections(planned, part, path) == guard.objections(planned, observed(DEVICE), path)
    assert guard.objections(planned, Observation(facts(), {"/ip/pool": ()}), path) == ()


@pytest.mark.parametrize("number", [0, 1, 2])
def test_guard_accepts_any_number_of_settings_rows(number: int) -> None:
    """Reading refuses two of them; the guard goes by the first."""
    settings = {"/routing/settings": ({"policy-rules": "user,main"},) * number}
    there = Observation(facts("7.22"), {**rows(DEVICE), **settings})
    planned = plan("r", read("/routing rule\nadd action=drop comment=atlantis dst-address=10.64.101.0/24\n"), there)
    (objection,) = guard.objections(planned, there, ManagementPath("10.64.101.10", "10.64.101.1"))
    assert objection.startswith(
        "responses to you at 10.64.101.10 take 10.64.101.0/24 on ether8; after this change the routing rule"
    )
