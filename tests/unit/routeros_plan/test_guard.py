from pathlib import Path
from typing import Any

import pytest
import yaml
from plan_world import facts, observed, rows
from row_subtests import for_each_row

from atlantis_netcfg.routeros import guard
from atlantis_netcfg.routeros._types import Observed
from atlantis_netcfg.routeros.desired import read
from atlantis_netcfg.routeros.guard import ManagementPath
from atlantis_netcfg.routeros.guard._state import State
from atlantis_netcfg.routeros.planner import plan

HERE = Path(__file__).parent
DEVICE = (HERE / "guard_device.rsc").read_text(encoding="utf-8")
CASES = yaml.safe_load((HERE / "guard_cases.yml").read_text(encoding="utf-8"))
GOLDEN = HERE.parent / "render" / "golden"


def device(case: dict[str, Any]) -> Observed:
    known, also = rows(DEVICE), rows(case.get("also", ""))
    both = {
        menu: found + tuple({**row, ".id": f"*A{row['.id'][1:]}"} for row in also[menu] if ".id" in row)
        for menu, found in known.items()
    }
    instead = case.get("instead", "/")
    return Observed(facts(case.get("version", "7.18.2")), both | {menu: also[menu] for menu in also if menu == instead})


@for_each_row("case", CASES, ids=lambda case: case["name"])
def test_case(case: dict[str, Any]) -> None:
    path = ManagementPath(case.get("technician", "10.64.101.10"), case.get("local", "10.64.101.1"))
    there = device(case)
    planned = plan("r", read(case["desired"]), there)
    assert planned.actions
    assert list(guard.objections(planned, there, path)) == case.get("objections", [])
    assert guard.touches(planned, there, path) is case["touches"]


def test_an_interface_that_is_not_there_stands_for_itself() -> None:
    assert State(observed(DEVICE).rows, ManagementPath("10.64.101.10", "10.64.101.1")).ports("gone") == {"gone"}


def test_there_are_cases_enough_and_none_twice() -> None:
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


def adopted(text: str) -> tuple[Observed, ManagementPath]:
    management = next(line for line in text.splitlines() if 'comment="atlantis: management" interface=' in line)
    address = management.split("address=")[1].split("/")[0]
    site, port = address.split(".")[2], management.split("interface=")[1]
    ports = "\n".join(f"set [ find default-name=ether{n} ] name=ether{n} poe-out=auto-on" for n in range(1, 9))
    services = "\n".join(f"set {name}" for name in SERVICES.split())
    services += "\nset api-ssl port=8729 certificate=atlantis-api"
    filled = ADOPTED.format(ports=ports, site=site, port=port, services=services)
    return observed(filled), ManagementPath(f"10.64.{site}.10", address)


@pytest.mark.parametrize("name", sorted(path.name for path in GOLDEN.glob("*-router.rsc")))
def test_a_first_configuration_of_our_sites_keeps_the_technician_in(name: str) -> None:
    text = (GOLDEN / name).read_text(encoding="utf-8")
    there, path = adopted(text)
    planned = plan(name, read(text, name), there)
    assert planned.weight > 60
    assert guard.objections(planned, there, path) == ()
    assert guard.touches(planned, there, path)


def test_the_guard_says_which_menus_it_must_see() -> None:
    planned = plan("r", read("/ip address"), observed(DEVICE))
    path = ManagementPath("10.64.101.10", "10.64.101.1")
    part = Observed(facts(), {menu: rows(DEVICE)[menu] for menu in guard.MENUS})
    assert guard.objections(planned, part, path) == guard.objections(planned, observed(DEVICE), path)
    assert guard.objections(planned, Observed(facts(), {"/ip/pool": ()}), path) == ()


@pytest.mark.parametrize("number", [0, 1, 2])
def test_settings_of_any_number_of_rows_are_no_fault_of_the_guard(number: int) -> None:
    """Reading refuses two of them; the guard goes by the first."""
    settings = {"/routing/settings": ({"policy-rules": "user,main"},) * number}
    there = Observed(facts("7.22"), {**rows(DEVICE), **settings})
    planned = plan("r", read("/routing rule\nadd action=drop comment=atlantis dst-address=10.64.101.0/24\n"), there)
    (objection,) = guard.objections(planned, there, ManagementPath("10.64.101.10", "10.64.101.1"))
    assert objection.startswith("answers to you at 10.64.101.10 go by 10.64.101.0/24 on ether8; then the routing rule")
