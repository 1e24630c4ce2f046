"""Plans, their two written forms, rollback texts and the guard, against a router twin's own idea of what they do."""

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
import yaml
from row_subtests import for_each_row

from atlantis_netcfg.core.versions import Version
from atlantis_netcfg.emulator.routeros import Device, ManagementSpec, RouterSpec
from atlantis_netcfg.emulator.routeros.answers import Answer, Caller
from atlantis_netcfg.emulator.routeros.spec import Radio
from atlantis_netcfg.routeros import guard
from atlantis_netcfg.routeros._types import Action, Facts, Observation, Plan, Row
from atlantis_netcfg.routeros.commands import console, sentence
from atlantis_netcfg.routeros.desired import DesiredState, from_export, read
from atlantis_netcfg.routeros.guard import ManagementPath
from atlantis_netcfg.routeros.menus import MENUS
from atlantis_netcfg.routeros.observe import printing
from atlantis_netcfg.routeros.planner import plan

UNIT = Path(__file__).parents[3] / "unit"
SITES = sorted((UNIT / "routeros" / "render" / "golden").glob("*-router.rsc"))
CASES = yaml.safe_load((UNIT / "routeros" / "planner" / "guard_cases.yml").read_text(encoding="utf-8"))
POLICIES = frozenset({"api", "read", "write", "policy", "test", "sensitive"})


@dataclass
class Bench:
    """A twin in this process, and one session on it."""

    management: ManagementSpec
    seed: str = ""
    version: str = "7.18.2"
    device: Device = field(init=False)
    caller: Caller = field(init=False)

    def __post_init__(self) -> None:
        spec = RouterSpec(
            name="router",
            version=self.version,
            ports=(*(f"ether{number}" for number in range(1, 9)), "sfp-sfpplus1"),
            packages=("routeros", "wifi-qcom"),
            radios=(Radio(name="wifi1"),),
            management=self.management,
            certificates=("atlantis-api", "atlantis-vpn"),
            seed=self.seed,
        )
        self.device = Device(spec, lambda: 1000.0)
        self.caller = self.device.login("provision", "", via="api-ssl", address=self.management.technician)

    def say(self, *words: str) -> list[Answer]:
        return self.device.run(self.caller, words)

    def rows(self, path: str) -> tuple[Row, ...]:
        answers = self.say(*printing(path).words())
        return tuple(
            dict(word[1:].partition("=")[::2] for word in answer.words) for answer in answers if answer.kind == "!re"
        )

    def observe(self) -> Observation:
        facts = Facts(
            identity="router",
            version=Version.parse(self.version),
            board="RB5009UPr+S+",
            architecture="arm64",
            device_mode={},
            packages=(),
            policies=POLICIES,
            has_safe_mode=True,
            safe_mode_owner=None,
            session_address=self.management.technician,
            history=0,
        )
        return Observation(facts, {path: self.rows(path) for path in MENUS})

    def plan(self, desired: DesiredState) -> Plan:
        return plan("router", desired, self.observe())

    def send(self, action: Action) -> list[str]:
        """Send one action as a sentence; return what the device says against it."""
        path, arguments = sentence(action)
        answers = self.say(path, *(f"={name}={value}" for name, value in arguments))
        return [" ".join(answer.words) for answer in answers if answer.kind == "!trap"]

    def script(self, planned: Plan) -> str:
        """Run all actions as one script; return what it prints."""
        lines = [f'{console(action)}\n:put "ok {action.number}"' for action in planned.actions]
        (reply,) = self.say("/execute", "=script=" + "\n".join(lines), "=as-string=")
        return reply.words[0].removeprefix("=ret=")

    def text(self, *, secrets: bool = True) -> str:
        return self.device.export(show_sensitive=secrets)


def site(path: Path) -> tuple[str, Bench]:
    text = path.read_text(encoding="utf-8")
    found = re.search(r'add address=(10\.64\.(\d+)\.1/24) comment="atlantis: management" interface=(\S+)', text)
    assert found is not None
    return text, Bench(ManagementSpec(address=found[1], port=found[3], technician=f"10.64.{found[2]}.10"))


def body(text: str) -> str:
    """An export without its header, which holds the time."""
    return "\n".join(line for line in text.splitlines() if not line.startswith("#"))


@pytest.mark.parametrize("path", SITES, ids=lambda path: path.stem)
def test_both_forms_of_a_first_configuration_have_the_same_result(path: Path) -> None:
    text, by_sentences = site(path)
    desired = read(text, path.name)
    planned = by_sentences.plan(desired)
    assert [said for action in planned.actions for said in by_sentences.send(action)] == []
    _, by_script = site(path)
    printed = by_script.script(by_script.plan(desired))
    assert printed.split() == " ".join(f"ok {action.number}" for action in planned.actions).split()
    assert by_sentences.text() == by_script.text()
    assert by_sentences.plan(desired).actions == ()
    local = by_sentences.management.local
    assert by_sentences.device.path_open(by_sentences.management.technician, local, "api-ssl")


@pytest.mark.parametrize("path", SITES, ids=lambda path: path.stem)
def test_plan_from_the_own_export_is_empty(path: Path) -> None:
    text, bench = site(path)
    for action in bench.plan(read(text)).actions:
        bench.send(action)
    planned = bench.plan(from_export(bench.text(secrets=False), MENUS))
    assert planned.diff == ""
    assert planned.actions == ()


@pytest.mark.parametrize("path", SITES, ids=lambda path: path.stem)
def test_rollback_to_a_saved_export_reproduces_it(path: Path) -> None:
    text, bench = site(path)
    before = bench.text(secrets=False)
    forward = bench.plan(read(text))
    for action in forward.actions:
        bench.send(action)
    assert body(bench.text()) != body(before)
    changed = dict.fromkeys(action.menu for action in forward.actions)
    back = bench.plan(from_export(before, changed))
    assert [said for action in back.actions for said in bench.send(action)] == []
    assert body(bench.text()) == body(before)


FIREWALL = """\
# atlantis:entire /ip firewall filter
/ip firewall filter
add action=accept chain=input comment="atlantis: b" protocol=udp
add action=accept chain=input comment="atlantis: a" protocol=tcp
add action=jump chain=input comment="atlantis: x" jump-target=x protocol=icmp
add action=return chain=x comment="atlantis: y" icmp-options=8:0
add action=accept chain=forward comment="atlantis: f" dst-port=22,80-90 protocol=tcp
add action=accept chain=input comment="atlantis: c" protocol=igmp
"""


def test_moves_and_replacements_reach_the_order_of_the_text() -> None:
    bench = Bench(ManagementSpec())
    first = read(FIREWALL)
    bench.script(bench.plan(first))
    lines = FIREWALL.splitlines()
    second = read("\n".join([*lines[:2], lines[3], lines[7], lines[2].replace("udp", "gre"), *lines[4:7]]))
    for desired in (second, first, second):
        planned = bench.plan(desired)
        assert bench.script(planned).split() == " ".join(f"ok {each.number}" for each in planned.actions).split()
        wanted = [item.defined_values["comment"] for item in desired.items["/ip/firewall/filter"]]
        assert [row["comment"] for row in bench.rows("/ip/firewall/filter") if "comment" in row] == wanted
        assert bench.plan(desired).actions == ()


def simple(case: dict[str, Any]) -> bool:
    return not {"also", "technician", "local"} & set(case)


@for_each_row("case", [case for case in CASES if simple(case)], ids=lambda case: case["name"])
def test_plan_that_cuts_access_to_the_emulator_has_objections(case: dict[str, Any]) -> None:
    bench = Bench(ManagementSpec(), seed=SEED, version=case.get("version", "7.18.2"))
    bench.say("/user/set", "=.id=provision", "=comment=atlantis: provisioner")
    path = ManagementPath(bench.management.technician, bench.management.local)
    assert bench.device.path_open(path.technician, path.local, path.service)
    planned = bench.plan(read(case["desired"]))
    objections = guard.objections(planned, bench.observe(), path)
    refused = [said for action in planned.actions for said in bench.send(action)]
    if not bench.device.path_open(path.technician, path.local, path.service):
        assert objections
    assert refused == case.get("refused", [])
    assert bool(objections) == bool(case.get("objections"))


SEED = """\
/interface bridge
add comment="atlantis: LAN" name=bridge-lan
/interface bridge port
add bridge=bridge-lan comment="atlantis: LAN" interface=ether2
/interface list
add comment=atlantis name=MGMT
add comment=atlantis name=LAN
/interface list member
add comment=atlantis interface=ether8 list=MGMT
add comment=atlantis interface=bridge-lan list=LAN
/ip address
add address=10.64.1.1/24 comment="atlantis: LAN" interface=bridge-lan
/ip firewall address-list
add address=10.64.101.0/24 comment=atlantis list=management
/ip firewall filter
add action=accept chain=input comment="atlantis: management" dst-port=22,8729 protocol=tcp src-address-list=management
add action=accept chain=input comment="atlantis: answers" connection-state=established,related,untracked
add action=drop chain=input comment="atlantis: everything else"
/ip route
add comment=atlantis dst-address=0.0.0.0/0 gateway=10.64.1.254
/ip service
set api-ssl address=10.64.101.0/24,10.80.0.0/24 certificate=atlantis-api
"""
