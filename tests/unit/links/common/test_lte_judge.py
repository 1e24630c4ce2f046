from pathlib import Path
from typing import Any

import yaml
from row_subtests import for_each_row

from atlantis_netcfg.links.lte import LteReading, Registration
from atlantis_netcfg.links.lte.judge import LteSubscription, judge, link_state, quality

CASES: list[dict[str, Any]] = yaml.safe_load((Path(__file__).parent / "lte_judge_cases.yml").read_text("utf-8"))


def reading(case: dict[str, Any]) -> LteReading:
    given = {"state": "registered_home", "address": "10.9.0.7", **case["reading"]}
    return LteReading(source="routeros", **{**given, "state": Registration(given["state"])})


def wanted(case: dict[str, Any]) -> LteSubscription:
    given = dict(case.get("wanted", {}))
    return LteSubscription(**{**given, "bands": tuple(given.get("bands", ()))})


def ident(case: dict[str, Any]) -> str:
    return str(case["name"])


@for_each_row("case", CASES, ids=ident)
def test_findings_and_state(case: dict[str, Any]) -> None:
    found = judge(reading(case), wanted(case))
    assert [f"{one.verdict} {one.code}: {one.message}" for one in found] == case["findings"]
    assert all(one.hint for one in found)
    assert link_state(reading(case)) == case["state"]


def test_every_state_has_its_own_finding() -> None:
    registered = {Registration.REGISTERED_HOME, Registration.REGISTERED_ROAMING}
    told = {state: judge(LteReading(source="at", state=state), LteSubscription()) for state in Registration}
    assert all(len(found) == 1 for state, found in told.items() if state not in registered)
    assert len({found[0].code for state, found in told.items() if state not in registered}) == 7
    assert len({found[0].hint for state, found in told.items() if state not in registered}) == 7


def test_shown_values_contain_no_secrets() -> None:
    shown = quality(LteReading(source="routeros"))
    assert not {"imei", "imsi", "iccid", "pin"} & shown.keys()
    assert {value for name, value in shown.items() if name != "registration"} == {None}
