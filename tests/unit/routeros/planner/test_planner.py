from pathlib import Path
from typing import Any

import pytest
import yaml
from plan_world import lines, observed
from row_subtests import for_each_row

from atlantis_netcfg.routeros._types import Layer, Observation, Plan, RowOwner, Verb
from atlantis_netcfg.routeros.desired import from_export, read
from atlantis_netcfg.routeros.planner import CannotPlan, plan, simulate

CASES = yaml.safe_load((Path(__file__).parent / "planner_cases.yml").read_text(encoding="utf-8"))


def converges(desired_text: str, device: Observation, planned: Plan) -> bool:
    return plan("r", read(desired_text), Observation(device.facts, simulate(device.rows, planned))).actions == ()


@for_each_row("case", CASES, ids=lambda case: case["name"])
def test_plan_matches_the_case(case: dict[str, Any]) -> None:
    device = observed(case["device"])
    desired = read(case["desired"], "x.rsc")
    if "impossible" in case:
        with pytest.raises(CannotPlan) as caught:
            plan("r", desired, device)
        assert str(caught.value) == case["impossible"]
        return
    planned = plan("r", desired, device)
    assert lines(planned) == case.get("actions", [])
    assert list(planned.notes) == case.get("notes", [])
    assert [f"{each.subject}: {each.message}" for each in planned.drift] == case.get("drift", [])
    assert {each.owner for each in planned.drift} <= {RowOwner.OTHER}
    assert bool(planned.diff) == bool(planned.actions)
    assert [action.number for action in planned.actions] == list(range(1, len(planned.actions) + 1))
    assert converges(case["desired"], device, planned)


def test_all_reasons_are_reported_together() -> None:
    desired = read("/ip ssh\nset allow-none-crypto=no\n/ip service\nset telnet disabled=yes")
    with pytest.raises(CannotPlan) as caught:
        plan("r", desired, observed(""))
    assert len(str(caught.value).splitlines()) == 2


def test_a_menu_that_was_not_read_cannot_be_planned() -> None:
    with pytest.raises(KeyError):
        plan("r", read("/ip pool\nadd name=a ranges=10.0.0.1"), Observation(observed("").facts, {}))


def test_actions_carry_layer_subject_and_secrets() -> None:
    text = "/interface ovpn-client\nadd connect-to=v name=vpn password=hidden\n/ip pool\nadd name=p ranges=10.0.0.1"
    vpn, pool = plan("r", read(text), observed("")).actions
    assert (pool.verb, pool.layer, pool.subject, pool.inert) == (Verb.ADD, Layer.FOUNDATION, "p", True)
    assert (vpn.layer, vpn.secrets, vpn.inert) == (Layer.FOUNDATION, frozenset({"password"}), False)
    assert ("password", "********") in vpn.get_masked_values()


@pytest.mark.parametrize(
    ("device", "inert"), [("", True), ("/ip firewall nat\nadd src-address-list=!a chain=srcnat", False)]
)
def test_address_is_inert_only_in_an_unreferenced_list(device: str, *, inert: bool) -> None:
    planned = plan("r", read("/ip firewall address-list\nadd address=10.0.0.1 list=a"), observed(device))
    assert [action.inert for action in planned.actions] == [inert]


def test_missing_secret_is_set_only_if_secrets_are_readable() -> None:
    text, device = "/interface ovpn-client\nadd name=vpn password=x", "/interface ovpn-client\nadd name=vpn"
    assert lines(plan("r", read(text), observed(device))) == ["/interface/ovpn-client/set *1 password=x"]
    assert plan("r", read(text), observed(device, policies=frozenset())).actions == ()


def test_removals_name_a_few_and_count_the_rest() -> None:
    device = "/ip pool\n" + "".join(f"add comment=atlantis name=p{number}\n" for number in range(5))
    (action,) = plan("r", read("/ip pool"), observed(device)).actions
    assert (action.subject, action.weight) == ("p4, p3, p2 and 2 more", 5)


BEFORE = """\
/interface ethernet
set [ find default-name=ether2 ] name=wan
/interface ovpn-client
add connect-to=vpn.example.org name=vpn
/ip dns
set servers=9.9.9.9
/ip service
set www disabled=yes
/ip firewall filter
add action=drop chain=input
"""


def test_restore_covers_omitted_rows_and_keeps_hidden_values() -> None:
    device = observed(
        "/interface ethernet\nset [ find default-name=ether1 ] name=lan comment=x\n"
        "set [ find default-name=ether2 ] name=ether2\n"
        "/interface ovpn-client\nadd connect-to=other name=vpn password=secret\n"
        "/ip dns\nset servers=1.1.1.1 allow-remote-requests=true\n"
        "/ip service\nset www disabled=true port=80\nset www-ssl disabled=true port=443\n"
        "set telnet disabled=true port=23\n"
        "/ip firewall filter\nadd action=accept chain=input comment=atlantis\n/ip ssh\nset strong-crypto=yes"
    )
    menus = [
        "/interface/ethernet",
        "/interface/ovpn-client",
        "/ip/dns",
        "/ip/service",
        "/ip/firewall/filter",
        "/ip/ssh",
    ]
    desired = from_export(BEFORE, menus)
    planned = plan("r", desired, device)
    assert sorted(lines(planned)) == sorted(
        [
            "/interface/ethernet/set *1 name=ether1",
            "/interface/ethernet/set *2 name=wan",
            '/interface/ethernet/set *1 comment=""',
            "/interface/ovpn-client/set *1 connect-to=vpn.example.org",
            "/ip/dns/set servers=9.9.9.9 allow-remote-requests=no",
            "/ip/firewall/filter/add action=drop chain=input place-before=*1",
            "/ip/ssh/set strong-crypto=no",
            "/ip/service/set *3 disabled=no",
            "/ip/firewall/filter/remove *1",
        ]
    )
    assert plan("r", desired, Observation(device.facts, simulate(device.rows, planned))).actions == ()


def test_restore_lists_the_secrets_to_be_entered() -> None:
    planned = plan("r", from_export(BEFORE, ["/interface/ovpn-client"]), observed(""))
    assert lines(planned) == ["/interface/ovpn-client/add connect-to=vpn.example.org name=vpn"]
    assert planned.notes == ("/interface ovpn-client: `password` of vpn is not in the saved export: enter it by hand",)
