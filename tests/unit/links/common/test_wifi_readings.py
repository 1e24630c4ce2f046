from pathlib import Path
from typing import Any

import pytest
import trees
import yaml
from row_subtests import for_each_row

from atlantis_netcfg.links.wifi import Family, WifiReading, WifiSettings, judge, link_state, quality, queries, read

CASES: list[dict[str, Any]] = yaml.safe_load((Path(__file__).parent / "wifi_cases.yml").read_text(encoding="utf-8"))
WANTED: dict[str, Any] = {
    "peer": "scc-cpe",
    "access_point": True,
    "ssid": "atlantis",
    "protocol": "nv2",
    "frequency_mhz": 5500,
}


def reading(case: dict[str, Any]) -> WifiReading:
    family = Family(case["family"])
    return read(family, case["registrations"], case["monitor"], "wifi1" if family is Family.WIFI else None)


def wanted(case: dict[str, Any]) -> WifiSettings:
    own = dict(case.get("wanted", {}))
    if "peer_macs" in own:
        own["peer_macs"] = frozenset(own["peer_macs"])
    return WifiSettings(**{**WANTED, **own})


def plain(value: object) -> object:
    return list(value) if isinstance(value, tuple) else value


def ident(case: dict[str, Any]) -> str:
    return str(case["name"])


@for_each_row("case", CASES, ids=ident)
def test_read(case: dict[str, Any]) -> None:
    found = reading(case)
    assert {name: plain(getattr(found, name)) for name in case.get("reading", {})} == case.get("reading", {})
    if "peer" in case:
        peer = found.peers[0]
        assert {name: plain(getattr(peer, name)) for name in case["peer"]} == case["peer"]


@for_each_row("case", CASES, ids=ident)
def test_findings(case: dict[str, Any]) -> None:
    found = judge(reading(case), wanted(case))
    assert [f"{one.verdict} {one.code}: {one.message}" for one in found] == case["findings"]
    assert all(one.hint for one in found)


@for_each_row("case", CASES, ids=ident)
def test_state_and_quality(case: dict[str, Any]) -> None:
    found = reading(case)
    assert link_state(found) == case["state"]
    shown = quality(found, wanted(case))
    assert {name: shown[name] for name in case.get("quality", {})} == case.get("quality", {})
    assert 0 not in [value for name, value in shown.items() if name.endswith(("_dbm", "_mbps"))]


def test_every_finding_code_has_a_case() -> None:
    told = {line.split(" ")[1].rstrip(":") for case in CASES for line in case["findings"]}
    assert told == {
        *("ccq-low", "chain-imbalance", "not-associated", "not-authorised", "radar-wait", "radio-disabled"),
        *("rate-low", "signal-strong", "signal-unreadable", "signal-weak", "status-unknown"),
        *("stranger-registered", "wrong-peer"),
    }


def test_station_and_access_point_have_different_hints() -> None:
    apart = [case for case in CASES if any("not-associated" in line for line in case["findings"])]
    hints = {judge(reading(case), wanted(case))[0].hint for case in apart}
    assert len(hints) == 2
    assert all(hint is not None and "key" in hint and "protocol" in hint for hint in hints)


@pytest.mark.parametrize("family", Family)
@pytest.mark.parametrize("version", trees.VERSIONS)
def test_queries_exist_on_the_device(family: Family, version: str) -> None:
    tree = trees.Tree(version)
    for query in queries(family, "radio1"):
        assert {name.lstrip(".") for name, _ in query.words} <= tree.arguments(query.menu, query.command)
        assert tree.has_command(query.menu, query.command)
