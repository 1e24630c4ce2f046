"""What a router's answers about its links mean: refusals, missing fields and unknown words are None, never 0."""

from collections.abc import Mapping
from dataclasses import astuple
from pathlib import Path
from typing import Any

import pytest
import yaml

from atlantis_netcfg.links.policy import LinkRoute
from atlantis_netcfg.operations.links.session import Echo, SeenNeighbour, SessionPort, questions, read
from atlantis_netcfg.routeros.api import Reply, Trap

CASES = yaml.safe_load(Path(__file__).with_name("router_reading_cases.yml").read_text(encoding="utf-8"))
WAYS = (
    LinkRoute("wifi-ptp", "10.10.0.1", "10.10.0.2", ("198.51.100.11", "198.51.100.12"), "ether1", "wifi_ptp"),
    LinkRoute("satellite", "10.10.2.1", "10.10.2.2", ("198.51.100.91",), "ether3", "satellite", is_metered=True),
)
MENUS = ("resource", "interface", "route", "arp", "filter", "scheduler")


def replies(case: Mapping[str, Any]) -> list[Reply]:
    answers = [case.get(menu, []) for menu in MENUS] + case.get("pings", [[], []])
    return [Reply(trap=Trap("no such command")) if one == "refused" else Reply(rows=tuple(one)) for one in answers]


def plain(value: object) -> object:
    if isinstance(value, dict):
        return {name: plain(one) for name, one in value.items()}
    if isinstance(value, tuple):
        return [plain(one) for one in value]
    if isinstance(value, SessionPort | Echo | SeenNeighbour):
        return list(astuple(value))
    return value


@pytest.mark.parametrize("name", CASES)
def test_replies_are_interpreted(name: str) -> None:
    case = CASES[name]
    _, probes = questions(WAYS)
    reading = read(replies(case), probes)
    assert {each: plain(getattr(reading, each)) for each in case["read"]} == case["read"]


def test_no_probe_is_sent_over_the_satellite() -> None:
    asked, probes = questions(WAYS)
    assert [probe.target for probe in probes] == ["198.51.100.11", "198.51.100.12"]
    words = " ".join(word for command in asked for word in command.words())
    assert "198.51.100.91" not in words
    assert "10.10.2" not in words


def test_every_request_is_read_only() -> None:
    asked, _ = questions(WAYS)
    assert {command.path.rpartition("/")[2] for command in asked} == {"print", "ping"}
