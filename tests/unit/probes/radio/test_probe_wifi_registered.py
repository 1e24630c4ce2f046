from __future__ import annotations

import pytest
import trees
from radio_cases import NOBODY, Case, check, codes, pings, way

from atlantis_netcfg.checklist.probes import Answer, CommandResult, Place, RouterOsQuery, Rows, RunProgram, Trouble
from atlantis_netcfg.checklist.probes.wifi import RegisteredProbe
from atlantis_netcfg.core.reading_programs import allowed
from atlantis_netcfg.declaration.model import WifiEndpoint

MAC = "02:00:5E:00:01:23"


def wireless(**more: str) -> Rows:
    """A row of the older menus, with units in its text (devices.md, section 8)."""
    row = {
        "interface": "wlan2",
        "mac-address": MAC,
        "signal-strength": "-58dBm@6Mbps",
        "signal-strength-ch0": "-60",
        "signal-strength-ch1": "-61",
        "signal-to-noise": "47",
        "tx-rate": "130Mbps-20MHz/2S",
        "rx-rate": "117Mbps-20MHz/2S",
        "uptime": "15m54s",
    }
    return Rows(None, rows=({"interface": "wlan2", "mac-address": "02:00:5E:00:01:24"}, {**row, **more}))


def wifi(**more: str) -> Rows:
    """A row of the newer menus."""
    row = {
        "interface": "wifi2",
        "mac-address": MAC.lower(),
        "signal": "-58",
        "authorized": "true",
        "uptime": "6h24m21s",
    }
    return Rows(None, rows=({**row, **more},))


NO_MENU = Rows(None, "no such command", None)
AWAY = Rows(Trouble.NO_PLACE, "coastal-ap: connection timed out")
HEALTHY: dict[str, Answer] = {"wireless": wireless(), "wifi": NO_MENU, "ping": pings(address="10.64.1.23")}
ANSWERS = "PASS answers: Zarco (10.64.1.23) answers 20 of 20 pings, in 3.2 ms"
UP = "PASS registered: Zarco is registered at coastal-ap, heard with -58 dBm"
NEWER = {"wireless": NO_MENU, "wifi": wifi()}
NEITHER = {"wireless": NO_MENU, "wifi": NO_MENU}

CASES = (
    Case(
        "healthy, older menus",
        (UP, ANSWERS),
        evidence=(
            f"read station registered at coastal-ap: {MAC}",
            "read signal at coastal-ap: -58 dBm",
            "read chains of coastal-ap: -60, -61 dBm",
            "read signal to noise at coastal-ap: 47 dB",
            "read rate sent at by coastal-ap: 130 Mbit/s",
            "read rate received at by coastal-ap: 117 Mbit/s",
            "read registered for, at coastal-ap: 954 s",
            "declared signal wanted: -75 to -35 dBm",
            "measured pings answered by Zarco from the gateway: 20 of 20",
            "measured round trip to Zarco from the gateway, mean: 3.2 ms",
            "measured round trip to Zarco from the gateway, longest: 6.4 ms",
        ),
    ),
    Case("healthy, newer menus, in small letters", (UP, ANSWERS), NEWER),
    Case(
        "too strong",
        (
            "PASS registered: Zarco is registered at coastal-ap, heard with -22 dBm",
            "FAIL signal-strong: coastal-ap hears Zarco with -22 dBm, above -35 dBm: its receiver is overdriven",
            ANSWERS,
        ),
        {"wireless": wireless(**{"signal-strength": "-22dBm@6Mbps"})},
    ),
    Case(
        "weak, and one antenna off",
        (
            "PASS registered: Zarco is registered at coastal-ap, heard with -77 dBm",
            "WARN signal-weak: coastal-ap hears Zarco with -77 dBm, below -75 dBm",
            "WARN chain-imbalance: the chains of coastal-ap hear Zarco 19 dB apart, more than 6 dB",
            ANSWERS,
        ),
        {
            "wireless": wireless(
                **{"signal-strength": "-77", "signal-strength-ch0": "-77", "signal-strength-ch1": "-96"}
            )
        },
    ),
    Case(
        "too slow",
        (UP, "FAIL rate-low: coastal-ap sends to Zarco at 6 Mbit/s, below 24 Mbit/s", ANSWERS),
        {"wireless": wireless(**{"tx-rate": "6Mbps"})},
        {"rate_mbps": 24.0},
    ),
    Case(
        "the keys differ",
        ("FAIL not-authorised: Zarco is registered at coastal-ap, but not authorised: the keys differ", ANSWERS),
        {"wireless": NO_MENU, "wifi": wifi(authorized="false")},
    ),
    Case(
        "loses packets",
        (UP, "WARN loss: Zarco (10.64.1.23) answers 17 of 20 pings: 15 % are lost, above 5 %"),
        {"ping": pings(17, address="10.64.1.23")},
    ),
    Case(
        "registered, and silent",
        (UP, "FAIL silent: Zarco (10.64.1.23) answers none of 20 pings"),
        {"ping": pings(0, address="10.64.1.23")},
    ),
    Case(
        "the gateway has its address",
        (UP, "FAIL own-address: the gateway itself has the address of Zarco, 10.64.1.23: its pings never leave it"),
        {"route": way("lo", "10.64.1.23")},
    ),
    Case(
        "no access point of ours",
        (ANSWERS, "WARN association-unseen: no device of ours sees the association of Zarco, nor its signal"),
        endpoint={"seen_by": None},
    ),
    Case(
        "absent, another one is there",
        (
            "FAIL not-registered: Zarco (02:00:5E:00:01:23) is not registered at coastal-ap; 1 other is",
            "FAIL silent: Zarco (10.64.1.23) answers none of 20 pings",
        ),
        {"wireless": Rows(None, rows=({"mac-address": "02:00:5E:00:01:24"},)), "ping": pings(0, address="10.64.1.23")},
    ),
    Case(
        "absent, several others are there",
        ("FAIL not-registered: Zarco (02:00:5E:00:01:23) is not registered at coastal-ap; 2 others are", ANSWERS),
        {"wireless": Rows(None, rows=({"mac-address": "02:00:5E:00:01:24"}, {"mac-address": "02:00:5E:00:01:25"}))},
    ),
    Case(
        "absent, nobody is there",
        ("FAIL not-registered: Zarco (02:00:5E:00:01:23) is not registered at coastal-ap; nobody else is", ANSWERS),
        {"wireless": Rows(None, rows=())},
    ),
    Case(
        "the device has no radio",
        (
            "INCONCLUSIVE no-radio: coastal-ap has no registration table, in neither of its two menus for radios",
            ANSWERS,
        ),
        NEITHER,
    ),
    Case(
        "the device is not reached, nor is the gateway",
        (
            "INCONCLUSIVE not-asked: coastal-ap could not be asked: coastal-ap: connection timed out",
            "INCONCLUSIVE not-asked: the gateway could not be asked: coastal-gateway: connection timed out",
        ),
        {"wireless": AWAY, "wifi": AWAY, "ping": NOBODY},
    ),
    Case(
        "garbage",
        (
            UP.removesuffix(", heard with -58 dBm"),
            "INCONCLUSIVE signal-unknown: coastal-ap does not say how well it hears Zarco",
            "INCONCLUSIVE ping-not-understood: no ping was sent to Zarco (10.64.1.23) from the gateway",
        ),
        {
            "wireless": wireless(**{"signal-strength": "N/A", "signal-strength-ch0": "?"}),
            "ping": CommandResult(None, out=""),
        },
    ),
    Case(
        "slow",
        (
            UP,
            "PASS answers: Zarco (10.64.1.23) answers 20 of 20 pings, in 250.1 ms",
            "WARN slow: Zarco answers after 250.1 ms in the mean, above 100 ms",
        ),
        {"ping": pings(mean=250.1, address="10.64.1.23")},
    ),
    Case(
        "nobody knows its MAC address",
        (
            "INCONCLUSIVE mac-unknown: nobody has declared the MAC address of Zarco, by which coastal-ap would know it",
            ANSWERS,
        ),
        probe={"mac": None},
    ),
    Case(
        "nobody knows its address",
        (UP, "WARN no-address: no address of Zarco is known here: loss and round trip were not measured"),
        probe={"address": None},
    ),
)


def probe(case: Case) -> RegisteredProbe:
    declared = {"role": "station", "seen_by": "coastal-ap", **case.endpoint}
    made = {"address": "10.64.1.23", "mac": MAC, **case.probe}
    return RegisteredProbe("Zarco", Place.GATEWAY, WifiEndpoint.model_validate(declared), **made)


@pytest.mark.parametrize("case", CASES, ids=str)
def test_judged(case: Case) -> None:
    check(case, probe(case), HEALTHY)


def test_every_code_has_its_case() -> None:
    assert codes(CASES) == {
        "answers",
        "association-unseen",
        "chain-imbalance",
        "loss",
        "mac-unknown",
        "no-address",
        "no-radio",
        "not-asked",
        "not-authorised",
        "not-registered",
        "own-address",
        "ping-not-understood",
        "rate-low",
        "registered",
        "signal-strong",
        "signal-unknown",
        "signal-weak",
        "silent",
        "slow",
    }


@pytest.mark.parametrize("version", trees.VERSIONS)
def test_the_device_has_the_words(version: str) -> None:
    tree = trees.Tree(version)
    asked = [one for one in probe(CASES[0]).asks() if isinstance(one, RouterOsQuery)]
    assert {one.host for one in asked} == {"coastal-ap"}
    assert all(tree.has_command(one.query.menu, one.query.command) for one in asked)


def test_without_an_access_point_of_ours_only_a_ping_is_sent() -> None:
    asked = probe(Case("", (), endpoint={"seen_by": None})).asks()
    assert [one.name for one in asked] == ["route", "ping"]
    assert all(isinstance(one, RunProgram) and allowed(one.argv) for one in asked)
