"""What is told of a bearer: canaries are believed before its own box, and a cause is told once."""

from collections.abc import Mapping
from ipaddress import IPv4Network
from pathlib import Path
from typing import Any

import pytest
import yaml
from row_subtests import for_each_row

from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.links import LinkFinding, LinkState, LinkStatus
from atlantis_netcfg.links.policy import LinkRoute
from atlantis_netcfg.operations.links.session import Echo, RouterReading, SeenNeighbour, SessionPort
from atlantis_netcfg.operations.links.status import BoxesStatus, SeenLinks, Silent, link_status, rank, twice

CASES = yaml.safe_load(Path(__file__).with_name("bearer_cases.yml").read_text(encoding="utf-8"))
SILENT = Silent("box", "no response", "has it power?")


def finding(text: str) -> LinkFinding:
    verdict, _, code = text.partition(" ")
    return LinkFinding(Verdict(verdict), code, f"about {code}", "do something")


def reading(case: Mapping[str, Any], name: str = "link", port: str = "ether3") -> RouterReading:
    found = case.get("port", [True, False])
    ports = {} if found == "missing" else {port: SessionPort(found[0], found[1], 0, 0)}
    echoes = tuple(
        Echo(target, sent, received, 4.0 if received else None) for target, sent, received in case.get("echoes", [])
    )
    neighbours = tuple(SeenNeighbour(address, "02:00:5E:00:00:01") for address in case.get("neighbours", []))
    return RouterReading(
        ports=ports,
        port_aliases={port: case["renamed"]} if "renamed" in case else {},
        echoes={name: echoes} if echoes else {},
        neighbours={port: neighbours},
    )


def seen(case: Mapping[str, Any], name: str = "link", port: str = "ether3") -> SeenLinks:
    own = case.get("own", {})
    router = {"silent": SILENT, "unasked": None}.get(case.get("router", ""), reading(case, name, port))
    return SeenLinks(
        route=LinkRoute(name, "10.10.2.1", "10.10.2.2", (), port, "lte"),
        router=router,
        boxes_status=BoxesStatus(
            state=LinkState(own["state"]) if "state" in own else None,
            findings=tuple(finding(one) for one in own.get("findings", [])),
            silent=(SILENT,) if case.get("box") == "silent" else (),
        ),
        active=False,
        box="box",
        next_hop="10.10.2.1",
        network=IPv4Network("10.10.2.0/29"),
    )


@for_each_row("name", CASES)
def test_state_and_findings(name: str) -> None:
    status = link_status(seen(CASES[name]))
    shown = {"state": status.state.value, "findings": [f"{one.verdict.value} {one.code}" for one in status.findings]}
    assert shown == CASES[name]["told"]


def test_quality_has_the_port_and_the_pings() -> None:
    case = {"echoes": [["a", 3, 2], ["b", 3, 3]]}
    assert link_status(seen(case)).quality == {"port": "ether3", "port_link": "up", "rtt_ms": 4.0, "loss_percent": 17}
    silent = link_status(seen({"router": "unasked"})).quality
    assert silent == {"port": "ether3", "port_link": None, "rtt_ms": None, "loss_percent": None}


def test_duplicate_address_is_reported_on_both_links() -> None:
    both = [seen({"neighbours": ["192.168.1.1"]}, name, port) for name, port in (("4g", "ether2"), ("sat", "ether3"))]
    found = twice(both)
    assert [name for name, _ in found] == ["4g", "sat"]
    assert {one.code for _, one in found} == {"address-twice"}
    assert "192.168.1.1 responds on ether2 (4g) and ether3 (sat)" in found[0][1].message
    assert twice(both[:1]) == ()


def status(name: str, state: str, *, active: bool | None) -> LinkStatus:
    return LinkStatus(name, "lte", LinkState(state), active, name == "4g", {}, None)


@pytest.mark.parametrize(
    ("states", "active", "codes"),
    [
        (("up", "up", "unknown"), "wifi", {}),
        (("down", "up", "unknown"), "4g", {"4g": "in-place-of-a-better-one"}),
        (("up", "up", "unknown"), "4g", {"wifi": "not-taken-yet", "4g": "in-place-of-a-better-one"}),
        (("up", "down", "unknown"), "sat", {"wifi": "not-taken-yet", "sat": "in-place-of-a-better-one"}),
        (("up", "up", "unknown"), None, {"wifi": "no-way-out"}),
    ],
)
def test_findings_from_the_preference_order(states: tuple[str, ...], active: str | None, codes: dict[str, str]) -> None:
    names = ("wifi", "4g", "sat")
    given = [status(name, state, active=name == active) for name, state in zip(names, states, strict=True)]
    found = rank(given, 120)
    assert {one.name: finding.code for one in found for finding in one.findings} == codes
    paid = [finding.message for one in found for finding in one.findings if "and it is metered" in finding.message]
    assert len(paid) == (active == "4g")


def test_unreadable_active_link_gives_no_findings() -> None:
    given = [status(name, "up", active=None) for name in ("wifi", "4g")]
    assert rank(given, 120) == tuple(given)
