"""Names that move, addresses behind NAT, boxes in the wrong subnet, and what probes prove."""

from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any

import pytest
import yaml

from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.links.satellite import (
    WINDOW_S,
    Attempt,
    Backup,
    ExpectedOutcome,
    NamedTarget,
    ProbeOutcome,
    SatelliteEvidence,
    SatelliteProbe,
    judge_attempt,
    judge_carrier_nat,
    judge_evidence,
    judge_factory_address,
    judge_names,
)

VPN = NamedTarget("VPN server", "vpn.example.org", "203.0.113.2", "pilot.vpn in group_vars/all/pilot.yml")


@pytest.mark.parametrize(
    ("resolved", "told"),
    [
        ({"203.0.113.2"}, None),
        (
            {"203.0.113.9"},
            (Verdict.FAIL, "allow-list-name-moved", "resolves it to 203.0.113.9, the allow-list permits 203"),
        ),
        (
            {"203.0.113.8", "203.0.113.9"},
            (Verdict.FAIL, "allow-list-name-moved", "203.0.113.8, 203.0.113.9, the allow-list permits 203.0.113.2"),
        ),
        ({"203.0.113.2", "203.0.113.9"}, (Verdict.WARN, "allow-list-name-has-more", "but also 203.0.113.9")),
        (set(), (Verdict.WARN, "allow-list-name-unknown", "this computer finds no address for vpn.example.org")),
        (None, (Verdict.INCONCLUSIVE, "allow-list-name-not-asked", "could not resolve vpn.example.org (VPN server)")),
    ],
)
def test_moved_name_is_reported(resolved: set[str] | None, told: tuple[Verdict, str, str] | None) -> None:
    answers = {"vpn.example.org": None if resolved is None else frozenset(resolved)}
    found = judge_names([VPN], answers, "this computer")
    if told is None:
        assert found == ()
        return
    ((verdict, code, words),) = [told]
    assert [(one.verdict, one.code) for one in found] == [(verdict, code)]
    assert words in found[0].message
    assert found[0].hint


def test_unresolved_name_is_inconclusive() -> None:
    assert [one.verdict for one in judge_names([VPN], {}, "the router")] == [Verdict.INCONCLUSIVE]


@pytest.mark.parametrize(
    ("address", "shared"),
    [
        ("100.64.0.1", True),
        ("100.127.255.254", True),
        ("100.128.0.1", False),
        ("172.31.7.9", True),
        ("172.32.0.1", False),
        ("10.1.2.3", True),
        ("192.168.100.4", True),
        ("203.0.113.7", False),
        (None, False),
        ("N/A", False),
        ("", False),
    ],
)
def test_address_behind_carrier_nat_is_reported(address: str | None, *, shared: bool) -> None:
    quiet = judge_carrier_nat("satellite", address, forwards=False)
    loud = judge_carrier_nat("satellite", address, forwards=True)
    assert [one.verdict for one in quiet] == ([Verdict.WARN] if shared else [])
    assert [one.verdict for one in loud] == ([Verdict.FAIL] if shared else [])
    assert all(str(address) in one.message for one in quiet + loud)


@pytest.mark.parametrize(
    ("answers", "factory", "code"),
    [
        (True, None, None),
        (True, "192.168.1.1", "factory-address-answers"),
        (False, "192.168.1.1", "box-in-wrong-subnet"),
        (False, None, "box-silent"),
    ],
)
def test_terminal_in_the_wrong_subnet_is_reported(answers: bool, factory: str | None, code: str | None) -> None:  # noqa: FBT001 - a case
    found = judge_factory_address("coastal-sat", "ether3", "10.10.2.1", answers=answers, answers_at_factory=factory)
    assert [one.code for one in found] == ([] if code is None else [code])


def test_declared_factory_address_is_accepted() -> None:
    here = "192.168.1.1"
    assert judge_factory_address("coastal-sat", "ether3", here, answers=True, answers_at_factory=here) == ()


ALLOWED = Attempt(
    "VPN server",
    "203.0.113.2 udp 1194",
    ExpectedOutcome.REACHED,
    SatelliteProbe.ICMP,
    ProbeOutcome.ANSWERED,
    71.4,
    WINDOW_S,
)
FORBIDDEN = replace(ALLOWED, expected_outcome=ExpectedOutcome.REFUSED, outcome=ProbeOutcome.SILENT, after_s=None)


@pytest.mark.parametrize(
    ("attempt", "verdict", "words"),
    [
        (ALLOWED, Verdict.PASS, "was reached after 71 s over the satellite"),
        (replace(ALLOWED, outcome=ProbeOutcome.SILENT), Verdict.FAIL, "did not respond within 90 s"),
        (
            replace(ALLOWED, outcome=ProbeOutcome.SILENT, window_s=89.9),
            Verdict.INCONCLUSIVE,
            "s without a response are a normal gap of this link",
        ),
        (
            replace(
                ALLOWED, outcome=ProbeOutcome.SILENT, probe=SatelliteProbe.UDP_COUNTER, note="no responses were counted"
            ),
            Verdict.INCONCLUSIVE,
            "no responses were counted",
        ),
        (replace(ALLOWED, outcome=ProbeOutcome.REFUSED_HERE), Verdict.FAIL, "is allowed, but the router refuses it"),
        (
            replace(ALLOWED, outcome=ProbeOutcome.NOT_TRIED, note="no way"),
            Verdict.INCONCLUSIVE,
            "could not be tested: no way",
        ),
        (FORBIDDEN, Verdict.PASS, "was not reached within 90 s"),
        (replace(FORBIDDEN, outcome=ProbeOutcome.REFUSED_HERE), Verdict.PASS, "nothing was sent"),
        (
            replace(FORBIDDEN, outcome=ProbeOutcome.ANSWERED),
            Verdict.FAIL,
            "is not allowed, but was reached over the satellite",
        ),
        (replace(FORBIDDEN, outcome=ProbeOutcome.ANSWERED, filter_open=True), Verdict.WARN, "only the router enforces"),
        (replace(FORBIDDEN, filter_open=True), Verdict.PASS, "the terminal or the network blocks it"),
        (replace(FORBIDDEN, filter_open=True, window_s=30.0), Verdict.INCONCLUSIVE, "too short to tell"),
    ],
)
def test_probe_outcomes_are_judged(attempt: Attempt, verdict: Verdict, words: str) -> None:
    found = judge_attempt(attempt, link_seen=True)
    assert found.verdict is verdict
    assert words in found.message


def test_refusal_over_a_dead_link_is_inconclusive() -> None:
    for attempt in (FORBIDDEN, replace(FORBIDDEN, filter_open=True)):
        assert judge_attempt(attempt, link_seen=False).verdict is Verdict.INCONCLUSIVE
    here = replace(FORBIDDEN, outcome=ProbeOutcome.REFUSED_HERE)
    assert judge_attempt(here, link_seen=False).verdict is Verdict.PASS


# What is said of a terminal that nobody can ask.


CASES: list[dict[str, Any]] = yaml.safe_load(Path(__file__).with_name("satellite_cases.yml").read_text("utf-8"))
TODAY = date(2026, 11, 21)


def evidence(seen_on: str = "2026-11-01", backup: str | None = None, *, allow_list: bool = True) -> SatelliteEvidence:
    return SatelliteEvidence(
        firmware="1.2.3",
        allow_list=allow_list,
        by="INESC",
        seen_on=date.fromisoformat(seen_on),
        backup_file=None if backup is None else "sat.bin",
        backup_sha256=None if backup is None else backup * 64,
    )


@pytest.mark.parametrize("case", CASES, ids=lambda case: str(case["case"]))
def test_evidence_is_judged(case: dict[str, Any]) -> None:
    declared = None if case["evidence"] is None else evidence(**case["evidence"])
    file = Backup("evidence/sat.bin", case["file"] * 64) if "file" in case else None
    found = judge_evidence("coastal-sat", declared, file, case.get("confirmed"), TODAY)
    assert [[one.verdict.value, one.code, one.message] for one in found] == case["told"]
    assert all(one.hint for one in found)
