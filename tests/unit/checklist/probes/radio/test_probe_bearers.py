"""The links of a location, as the columns Wi-Fi, 4G, Satellite and Ethernet show what `provision links` found."""

import pytest
from radio_cases import Case, check, codes, listed

from atlantis_netcfg.checklist.probes import (
    AllowListTestRequest,
    AllowListTestResult,
    LinkStatusRequest,
    LinkStatusResult,
    Trouble,
)
from atlantis_netcfg.checklist.probes.link_probe import LinkProbe, _check_registration
from atlantis_netcfg.checklist.probes.satellite import AllowListProbe, _there
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.links import LinkFinding

REACHED = LinkFinding(
    Verdict.PASS, "reached", "VPN server (203.0.113.2 udp 1194) was reached after 35 s over the satellite"
)
REFUSED = LinkFinding(
    Verdict.PASS, "refused", "second address (203.0.113.3) is refused by the router, nothing was sent"
)
NOT_TRIED = LinkFinding(
    Verdict.INCONCLUSIVE, "not-tried", "VPN server (203.0.113.2 udp 1194) could not be tried: no way"
)
LEAK = LinkFinding(
    Verdict.FAIL, "leak", "second address (203.0.113.3) is not allowed, and was reached", "provision the site"
)
QUIET = LinkFinding(
    Verdict.INCONCLUSIVE, "link-not-seen", "second address did not answer, nothing else was reached", "again"
)
UNSEEN = LinkFinding(
    Verdict.WARN, "terminal-not-looked-at", "nobody has looked at the terminal coastal-sat", "open its pages"
)


def looked(
    kind: str, state: str = "up", findings: tuple[LinkFinding, ...] = (), **quality: str | float | None
) -> LinkStatusResult:
    """One bearer of `provision links --json`."""
    answered: dict[str, str | float | None] = {"loss_percent": 0} if state == "up" else {}
    quality |= {name: value for name, value in answered.items() if name not in quality}
    told = {"kind": kind, "state": state, "quality": quality, "findings": [one.as_dict() for one in findings]}
    return LinkStatusResult(None, link={**told, "box": "coastal-box"})


def proved(
    *findings: LinkFinding, seconds: float = 90.0, bill: str = "336 B, billed as 5.0 kB, 0.04 EUR"
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

LISTED = listed(__file__)
BRIDGES = (
    Case("healthy"),
    Case(
        "too strong",
        {
            "look": looked(
                "wifi_ptp",
                "up",
                (
                    LinkFinding(
                        Verdict.WARN,
                        "signal-strong",
                        "coastal-cpe: scc-cpe is heard with -20 dBm, above -35 dBm: receivers saturate",
                        "reduce `tx_power_dbm` at the other end",
                    ),
                ),
            )
        },
    ),
    Case("its box says that it is up, and nobody was asked over it", {"look": looked("wifi_ptp", loss_percent=None)}),
    Case(
        "a finding without a hint gets one",
        {
            "look": looked(
                "wifi_ptp", "down", (LinkFinding(Verdict.FAIL, "device-unreachable", "coastal-cpe cannot be read"),)
            )
        },
    ),
    Case("nobody says anything", {"look": looked("wifi_ptp", "unknown")}),
    Case("garbage", {"look": LinkStatusResult(None, link={})}),
    Case("absent", AWAY),
    Case("the site has no such link", {"look": LinkStatusResult(None)}),
)
UNITS = (
    Case("healthy"),
    Case(
        "registered, and nobody was asked over it",
        {"look": looked("lte", loss_percent=None, registration="registered_home", operator="EXAMPLE")},
    ),
    Case("a plain cable modem", {"look": looked("lte")}),
    Case(
        "roams and may not",
        {
            "look": looked(
                "lte",
                "down",
                (
                    LinkFinding(
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
    Case("absent", AWAY),
)
TERMINALS = (
    Case("healthy, nobody has looked at its pages"),
    Case(
        "not heard of late", {"look": looked("satellite", "unknown", port="ether3", port_link="up", next_hop_seen="no")}
    ),
    Case(
        "absent",
        {
            "look": looked(
                "satellite",
                "down",
                (LinkFinding(Verdict.FAIL, "port-down", "port ether3 of the router has no link", "plug it in"),),
                port="ether3",
                port_link="down",
            )
        },
    ),
    Case("the router says nothing of the port", {"look": looked("satellite", "unknown", port=None, port_link=None)}),
)
PROOFS = (
    Case("healthy", proved(REACHED, REFUSED)),
    Case("another link carries the traffic", proved(NOT_TRIED, REFUSED, UNSEEN)),
    Case("a leak", proved(REACHED, LEAK)),
    Case("nothing was reached", proved(NOT_TRIED, QUIET, bill="")),
    Case("nothing to try", proved(UNSEEN)),
    Case("absent", {"prove": AllowListTestResult(Trouble.NO_PLACE, "coastal-router: connection refused")}),
    Case("refused, for nobody pays", {"prove": AllowListTestResult(Trouble.DENIED, "nobody has accepted the cost")}),
)


@pytest.mark.parametrize("case", BRIDGES, ids=str)
def test_bridge(case: Case) -> None:
    check(case, LISTED["bridges"], LinkProbe("wifi-ptp"), BRIDGE)


@pytest.mark.parametrize("case", UNITS, ids=str)
def test_unit(case: Case) -> None:
    check(case, LISTED["units"], LinkProbe("4g", _check_registration), UNIT)


@pytest.mark.parametrize("case", TERMINALS, ids=str)
def test_terminal(case: Case) -> None:
    check(case, LISTED["terminals"], LinkProbe("satellite", _there), TERMINAL)


@pytest.mark.parametrize("case", PROOFS, ids=str)
def test_proof(case: Case) -> None:
    check(case, LISTED["proofs"], AllowListProbe("satellite", "coastal"), {})


def test_every_code_has_its_case() -> None:
    tables = {"bridges": BRIDGES, "units": UNITS, "terminals": TERMINALS, "proofs": PROOFS}
    assert {kind: list(cases) for kind, cases in LISTED.items()} == {
        kind: [case.name for case in table] for kind, table in tables.items()
    }
    assert codes(*LISTED.values()) >= {
        *("not-asked", "nothing-proved", "not-tried", "nothing-tried", "proved", "proved-in-part"),
        *("state-unknown", "terminal-not-seen", "terminal-there", "up"),
    }


def test_probe_sends_one_request() -> None:
    assert LinkProbe("4g").asks() == (LinkStatusRequest("look", "4g"),)
    assert AllowListProbe("satellite", "coastal").asks() == (AllowListTestRequest("prove", "satellite"),)
