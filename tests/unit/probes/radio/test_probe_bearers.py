"""The links of a location, as the columns Wi-Fi, 4G, Satellite and Ethernet show what `provision links` found."""

from __future__ import annotations

import pytest
from radio_cases import Case, check, codes

from atlantis_netcfg.bearers import BearerFinding
from atlantis_netcfg.checklist.probes import (
    AllowListTestRequest,
    AllowListTestResult,
    LinkStatusRequest,
    LinkStatusResult,
    Trouble,
)
from atlantis_netcfg.checklist.probes.bearer_probe import BearerProbe, _registered
from atlantis_netcfg.checklist.probes.satellite import AllowListProbe, _there
from atlantis_netcfg.core.events import Verdict

REACHED = BearerFinding(
    Verdict.PASS, "reached", "VPN server (203.0.113.2 udp 1194) was reached after 35 s over the satellite"
)
REFUSED = BearerFinding(
    Verdict.PASS, "refused", "second address (203.0.113.3) is refused by the router, nothing was sent"
)
NOT_TRIED = BearerFinding(
    Verdict.INCONCLUSIVE, "not-tried", "VPN server (203.0.113.2 udp 1194) could not be tried: no way"
)
LEAK = BearerFinding(
    Verdict.FAIL, "leak", "second address (203.0.113.3) is not allowed, and was reached", "provision the site"
)
QUIET = BearerFinding(
    Verdict.INCONCLUSIVE, "link-not-seen", "second address did not answer, nothing else was reached", "again"
)
UNSEEN = BearerFinding(
    Verdict.WARN, "terminal-not-looked-at", "nobody has looked at the terminal coastal-sat", "open its pages"
)


def looked(
    kind: str, state: str = "up", findings: tuple[BearerFinding, ...] = (), **quality: str | float | None
) -> LinkStatusResult:
    """One bearer of `provision links --json`."""
    answered: dict[str, str | float | None] = {"loss_percent": 0} if state == "up" else {}
    quality |= {name: value for name, value in answered.items() if name not in quality}
    told = {"kind": kind, "state": state, "quality": quality, "findings": [one.as_dict() for one in findings]}
    return LinkStatusResult(None, bearer={**told, "box": "coastal-box"})


def proved(
    *findings: BearerFinding, seconds: float = 90.0, bill: str = "336 B, billed as 5.0 kB, 0.04 EUR"
) -> dict[str, AllowListTestResult]:
    return {"prove": AllowListTestResult(None, findings=findings, seconds=seconds, bill=bill)}


AWAY = {"look": LinkStatusResult(Trouble.NO_PLACE, "coastal-router: connection refused")}
BRIDGE = {"look": looked("wifi_ptp", port="ether1", rtt_ms=1.0, loss_percent=0, signal_dbm=-49.0, tx_rate_mbps=130.0)}
UNIT = {
    "look": looked(
        "lte",
        rtt_ms=61.5,
        loss_percent=0,
        registration="registered_home",
        operator="EXAMPLE",
        rsrp_dbm=-97.0,
        sinr_db=6.0,
    )
}
TERMINAL = {
    "look": looked("satellite", "unknown", (UNSEEN,), port="ether3", port_link="up", next_hop_seen="yes", firmware=None)
}

BRIDGES = (
    Case(
        "healthy",
        ("PASS up: the link is up, a round trip over it takes 1 ms, heard with -49 dBm",),
        evidence=(
            "read state of coastal-box: up",
            "read port of coastal-box: ether1",
            "read rtt of coastal-box: 1 ms",
            "read loss of coastal-box: 0 %",
            "read signal of coastal-box: -49 dBm",
            "read tx rate of coastal-box: 130 Mbit/s",
        ),
    ),
    Case(
        "too strong",
        (
            "PASS up: the link is up",
            "WARN signal-strong: coastal-cpe: scc-cpe is heard with -20 dBm, above -35 dBm: receivers saturate",
        ),
        {
            "look": looked(
                "wifi_ptp",
                "up",
                (
                    BearerFinding(
                        Verdict.WARN,
                        "signal-strong",
                        "coastal-cpe: scc-cpe is heard with -20 dBm, above -35 dBm: receivers saturate",
                        "reduce `tx_power_dbm` at the other end",
                    ),
                ),
            )
        },
    ),
    Case(
        "its box says that it is up, and nobody was asked over it",
        ("INCONCLUSIVE not-tried: its box says that it is up, and nothing was seen to pass",),
        {"look": looked("wifi_ptp", loss_percent=None)},
    ),
    Case(
        "a finding without a hint gets one",
        ("FAIL device-unreachable: coastal-cpe cannot be read",),
        {
            "look": looked(
                "wifi_ptp", "down", (BearerFinding(Verdict.FAIL, "device-unreachable", "coastal-cpe cannot be read"),)
            )
        },
    ),
    Case(
        "nobody says anything",
        ("INCONCLUSIVE state-unknown: nobody says whether wifi-ptp works",),
        {"look": looked("wifi_ptp", "unknown")},
    ),
    Case(
        "garbage",
        ("INCONCLUSIVE state-unknown: nobody says whether wifi-ptp works",),
        {"look": LinkStatusResult(None, bearer={})},
        evidence=("read state of the link: unknown",),
    ),
    Case(
        "absent",
        ("INCONCLUSIVE not-asked: the boxes of wifi-ptp could not be asked: coastal-router: connection refused",),
        AWAY,
    ),
    Case(
        "the site has no such link",
        ("INCONCLUSIVE not-asked: the boxes of wifi-ptp could not be asked: it does not answer",),
        {"look": LinkStatusResult(None)},
    ),
)
UNITS = (
    Case(
        "healthy",
        ("PASS up: the link is up, a round trip over it takes 61.5 ms; the unit says: registered home in EXAMPLE",),
        evidence=(
            "read state of coastal-box: up",
            "read rtt of coastal-box: 61.5 ms",
            "read loss of coastal-box: 0 %",
            "read registration of coastal-box: registered_home",
            "read operator of coastal-box: EXAMPLE",
            "read rsrp of coastal-box: -97 dBm",
            "read sinr of coastal-box: 6 dB",
        ),
    ),
    Case(
        "registered, and nobody was asked over it",
        ("INCONCLUSIVE not-tried: its box says that it is up, and nothing was seen to pass",),
        {"look": looked("lte", loss_percent=None, registration="registered_home", operator="EXAMPLE")},
    ),
    Case("a plain cable modem", ("PASS up: the link is up",), {"look": looked("lte")}),
    Case(
        "roams and may not",
        ("FAIL roaming-not-allowed: coastal-4g: registered, but without data",),
        {
            "look": looked(
                "lte",
                "down",
                (
                    BearerFinding(
                        Verdict.FAIL,
                        "roaming-not-allowed",
                        "coastal-4g: registered, but without data",
                        "`sim.roaming: true`",
                    ),
                ),
                registration="registered_roaming",
            )
        },
    ),
    Case(
        "absent",
        ("INCONCLUSIVE not-asked: the boxes of 4g could not be asked: coastal-router: connection refused",),
        AWAY,
    ),
)
TERMINALS = (
    Case(
        "healthy, nobody has looked at its pages",
        (
            (
                "PASS terminal-there: port ether3 has a link, and the terminal has answered on it;"
                " over the air nothing was sent"
            ),
            "WARN terminal-not-looked-at: nobody has looked at the terminal coastal-sat",
        ),
        evidence=(
            "read state of coastal-box: unknown",
            "read port of coastal-box: ether3",
            "read port link of coastal-box: up",
            "read next hop seen of coastal-box: yes",
        ),
    ),
    Case(
        "not heard of late",
        ("INCONCLUSIVE terminal-not-seen: port ether3 has a link, but the terminal has not answered on it of late",),
        {"look": looked("satellite", "unknown", port="ether3", port_link="up", next_hop_seen="no")},
    ),
    Case(
        "absent",
        ("FAIL port-down: port ether3 of the router has no link",),
        {
            "look": looked(
                "satellite",
                "down",
                (BearerFinding(Verdict.FAIL, "port-down", "port ether3 of the router has no link", "plug it in"),),
                port="ether3",
                port_link="down",
            )
        },
    ),
    Case(
        "the router says nothing of the port",
        ("INCONCLUSIVE state-unknown: nobody says whether satellite works",),
        {"look": looked("satellite", "unknown", port=None, port_link=None)},
    ),
)
PROOFS = (
    Case(
        "healthy",
        (
            "PASS proved: 2 of 2 targets were proved over satellite",
            f"PASS reached: {REACHED.message}",
            f"PASS refused: {REFUSED.message}",
        ),
        proved(REACHED, REFUSED),
        evidence=(
            "measured proof over satellite took: 90 s",
            "measured cost over satellite: 336 B, billed as 5.0 kB, 0.04 EUR",
        ),
    ),
    Case(
        "another link carries the traffic",
        (
            "WARN proved-in-part: 1 of 2 targets were proved over satellite, 1 could not be tried",
            f"WARN not-tried: {NOT_TRIED.message}",
            f"PASS refused: {REFUSED.message}",
            f"WARN terminal-not-looked-at: {UNSEEN.message}",
        ),
        proved(NOT_TRIED, REFUSED, UNSEEN),
    ),
    Case(
        "a leak",
        (
            "PASS proved: 1 of 2 targets were proved over satellite",
            f"PASS reached: {REACHED.message}",
            f"FAIL leak: {LEAK.message}",
        ),
        proved(REACHED, LEAK),
    ),
    Case(
        "nothing was reached",
        (
            "INCONCLUSIVE nothing-proved: none of 2 targets could be proved over satellite",
            f"INCONCLUSIVE not-tried: {NOT_TRIED.message}",
            f"INCONCLUSIVE link-not-seen: {QUIET.message}",
        ),
        proved(NOT_TRIED, QUIET, bill=""),
        evidence=("measured proof over satellite took: 90 s",),
    ),
    Case(
        "nothing to try",
        (
            "INCONCLUSIVE nothing-tried: nothing was tried over satellite",
            f"WARN terminal-not-looked-at: {UNSEEN.message}",
        ),
        proved(UNSEEN),
    ),
    Case(
        "absent",
        ("INCONCLUSIVE not-asked: the satellite's router could not be asked: coastal-router: connection refused",),
        {"prove": AllowListTestResult(Trouble.NO_PLACE, "coastal-router: connection refused")},
    ),
    Case(
        "refused, for nobody pays",
        ("INCONCLUSIVE not-asked: the satellite's router could not be asked: nobody has accepted the cost",),
        {"prove": AllowListTestResult(Trouble.DENIED, "nobody has accepted the cost")},
    ),
)


@pytest.mark.parametrize("case", BRIDGES, ids=str)
def test_bridge(case: Case) -> None:
    check(case, BearerProbe("wifi-ptp"), BRIDGE)


@pytest.mark.parametrize("case", UNITS, ids=str)
def test_unit(case: Case) -> None:
    check(case, BearerProbe("4g", _registered), UNIT)


@pytest.mark.parametrize("case", TERMINALS, ids=str)
def test_terminal(case: Case) -> None:
    check(case, BearerProbe("satellite", _there), TERMINAL)


@pytest.mark.parametrize("case", PROOFS, ids=str)
def test_proof(case: Case) -> None:
    check(case, AllowListProbe("satellite", "coastal"), {})


def test_every_code_of_ours_has_its_case() -> None:
    assert codes(BRIDGES, UNITS, TERMINALS, PROOFS) >= {
        "not-asked",
        "nothing-proved",
        "not-tried",
        "nothing-tried",
        "proved",
        "proved-in-part",
        "state-unknown",
        "terminal-not-seen",
        "terminal-there",
        "up",
    }


def test_one_question_serves() -> None:
    assert BearerProbe("4g").asks() == (LinkStatusRequest("look", "4g"),)
    assert AllowListProbe("satellite", "coastal").asks() == (AllowListTestRequest("prove", "satellite"),)
