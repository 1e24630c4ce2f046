import pytest
import trees
from radio_cases import NOBODY, Case, check, codes, listed, pings, way

from atlantis_netcfg.checklist.probes import Answer, CommandResult, Place, RouterOsQuery, Rows, RunProgram, Trouble
from atlantis_netcfg.checklist.probes.wifi import RegisteredProbe
from atlantis_netcfg.core.reading_programs import is_allowed
from atlantis_netcfg.inventory.model import WifiEndpoint

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
NEWER = {"wireless": NO_MENU, "wifi": wifi()}
NEITHER = {"wireless": NO_MENU, "wifi": NO_MENU}

LISTED = listed(__file__)
CASES = (
    Case("healthy, older menus"),
    Case("healthy, newer menus, in small letters", NEWER),
    Case("too strong", {"wireless": wireless(**{"signal-strength": "-22dBm@6Mbps"})}),
    Case(
        "weak, and one antenna off",
        {
            "wireless": wireless(
                **{"signal-strength": "-77", "signal-strength-ch0": "-77", "signal-strength-ch1": "-96"}
            )
        },
    ),
    Case("too slow", {"wireless": wireless(**{"tx-rate": "6Mbps"})}, {"rate_mbps": 24.0}),
    Case("the keys differ", {"wireless": NO_MENU, "wifi": wifi(authorized="false")}),
    Case("loses packets", {"ping": pings(17, address="10.64.1.23")}),
    Case("registered, and silent", {"ping": pings(0, address="10.64.1.23")}),
    Case("the gateway has its address", {"route": way("lo", "10.64.1.23")}),
    Case("no access point of ours", endpoint={"seen_by": None}),
    Case(
        "absent, another one is there",
        {"wireless": Rows(None, rows=({"mac-address": "02:00:5E:00:01:24"},)), "ping": pings(0, address="10.64.1.23")},
    ),
    Case(
        "absent, several others are there",
        {"wireless": Rows(None, rows=({"mac-address": "02:00:5E:00:01:24"}, {"mac-address": "02:00:5E:00:01:25"}))},
    ),
    Case("absent, nobody is there", {"wireless": Rows(None, rows=())}),
    Case("the device has no radio", NEITHER),
    Case("the device is not reached, nor is the gateway", {"wireless": AWAY, "wifi": AWAY, "ping": NOBODY}),
    Case(
        "garbage",
        {
            "wireless": wireless(**{"signal-strength": "N/A", "signal-strength-ch0": "?"}),
            "ping": CommandResult(None, out=""),
        },
    ),
    Case("slow", {"ping": pings(mean=250.1, address="10.64.1.23")}),
    Case("nobody knows its MAC address", probe={"mac": None}),
    Case("nobody knows its address", probe={"address": None}),
)


def probe(case: Case) -> RegisteredProbe:
    declared = {"role": "station", "seen_by": "coastal-ap", **case.endpoint}
    made = {"address": "10.64.1.23", "mac": MAC, **case.probe}
    return RegisteredProbe("Zarco", Place.GATEWAY, WifiEndpoint.model_validate(declared), **made)


@pytest.mark.parametrize("case", CASES, ids=str)
def test_findings_match_the_case(case: Case) -> None:
    check(case, LISTED, probe(case), HEALTHY)


def test_every_code_has_its_case() -> None:
    assert list(LISTED) == [case.name for case in CASES]
    assert codes(LISTED) == {
        *("answers", "association-unseen", "chain-imbalance", "loss", "mac-unknown", "no-address", "no-radio"),
        *("not-asked", "not-authorised", "not-registered", "own-address", "ping-not-understood", "rate-low"),
        *("registered", "signal-strong", "signal-unknown", "signal-weak", "silent", "slow"),
    }


@pytest.mark.parametrize("version", trees.VERSIONS)
def test_device_has_the_queried_commands(version: str) -> None:
    tree = trees.Tree(version)
    asked = [one for one in probe(CASES[0]).asks() if isinstance(one, RouterOsQuery)]
    assert {one.host for one in asked} == {"coastal-ap"}
    assert all(tree.has_command(one.query.menu, one.query.command) for one in asked)


def test_only_a_ping_is_sent_without_our_own_access_point() -> None:
    asked = probe(Case("", endpoint={"seen_by": None})).asks()
    assert [one.name for one in asked] == ["route", "ping"]
    assert all(isinstance(one, RunProgram) and is_allowed(one.argv) for one in asked)
