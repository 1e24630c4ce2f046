import pytest
import trees
from radio_cases import NOBODY, Case, check, codes, listed, pings, printed, way
from row_subtests import for_each_row

from atlantis_netcfg.checklist.probes import Answer, CommandResult, Place, RouterOsQuery, Rows, RunProgram, Trouble
from atlantis_netcfg.checklist.probes.ethernet import CabledProbe
from atlantis_netcfg.core.reading_programs import is_allowed
from atlantis_netcfg.inventory.model import EthernetEndpoint

MAC = "02:00:5E:00:01:26"


def neighbour(mac: str = MAC.lower(), state: str = "REACHABLE") -> CommandResult:
    """`ip -j neigh show to`."""
    return printed(f'[{{"dst":"10.64.1.26","dev":"eth0","lladdr":"{mac}","state":["{state}"]}}]\n')


def port(**more: str) -> Rows:
    """`/interface/print` of the router."""
    row = {
        "name": "ether5",
        "running": "true",
        "disabled": "false",
        "rx-error": "0",
        "tx-error": "0",
        "link-downs": "1",
    }
    return Rows(None, rows=({"name": "ether4", "running": "false"}, {**row, **more}))


def monitor(**more: str) -> Rows:
    """`/interface/ethernet/monitor once`."""
    told = {"name": "ether5", "status": "link-ok", "auto-negotiation": "done", "rate": "1Gbps", "full-duplex": "true"}
    return Rows(None, rows=({**told, **more},))


HEALTHY: dict[str, Answer] = {
    "route": way("eth0", "10.64.1.26"),
    "neigh": neighbour(),
    "ping": pings(mean=0.6, address="10.64.1.26"),
    "monitor": monitor(),
    "interfaces": port(),
}
AWAY = Rows(Trouble.NO_PLACE, "coastal-router: connection refused")
SILENT = {"ping": pings(0, address="10.64.1.26"), "neigh": printed("[]\n")}

LISTED = listed(__file__)
CASES = (
    Case("healthy"),
    Case("healthy, no port declared", probe={"router": None}),
    Case("healthy, a router without `monitor`", {"monitor": Rows(None, "no such command", None)}),
    Case("healthy, a router that counts nothing", {"interfaces": Rows(None, "not permitted", None)}),
    # sick
    Case("another card answers", {"neigh": neighbour("02:00:5e:00:01:99")}),
    Case("an old entry of a card that does not answer", SILENT | {"neigh": neighbour(state="FAILED")}),
    Case("one ping is lost", {"ping": pings(19, address="10.64.1.26")}),
    Case(
        "a broken cable",
        {
            "monitor": monitor(rate="10Mbps", **{"full-duplex": "false"}),
            "interfaces": port(**{"rx-error": "47", "tx-error": "3"}),
            "ping": pings(12, address="10.64.1.26"),
        },
    ),
    Case(
        "port switched off",
        SILENT | {"interfaces": port(disabled="true", running="false"), "monitor": monitor(status="no-link")},
    ),
    Case("nobody tells the card that has answered", {"neigh": printed("[]\n")}),
    Case("the card of another address", {"neigh": printed(neighbour().out.replace("10.64.1.26", "10.64.1.27"))}),
    Case("nobody has declared its card", probe={"mac": None}),
    Case("the gateway has its address", {"route": way("lo", "10.64.1.26")}),
    Case(
        "behind the router, and not on the cable",
        {"route": printed('[{"dst":"10.64.1.26","gateway":"10.64.1.1","dev":"eth0","flags":[]}]\n')},
    ),
    Case("every answer comes twice", {"ping": pings(address="10.64.1.26", twice=20)}),
    Case("one answer comes twice", {"ping": pings(address="10.64.1.26", twice=1)}),
    Case(
        "duplicates are no answers",
        {
            "ping": printed(
                pings(10, address="10.64.1.26", twice=10).out.replace("10 received, +10", "20 received, +10")
            )
        },
    ),
    Case(
        "somebody else answers",
        {"ping": printed(pings(address="10.64.1.26").out.replace("from 10.64.1.26", "from 10.64.1.99"))},
    ),
    Case("somebody else was asked", {"ping": pings(address="10.64.1.99")}),
    Case(
        "answers are damaged",
        {"ping": pings(address="10.64.1.26", more="wrong data byte #16 should be 0x10 but was 0x11\n")},
    ),
    Case(
        "the ping was cut short",
        {"ping": printed(pings(2, address="10.64.1.26").out.replace("20 packets", "2 packets").replace("90%", "0%"))},
    ),
    Case("another port answers", {"monitor": monitor(name="ether4", status="no-link")}),
    # absent
    Case(
        "not plugged in", SILENT | {"interfaces": port(running="false"), "monitor": monitor(status="no-link", rate="")}
    ),
    Case(
        "not plugged in, and the router has no `monitor`",
        SILENT | {"interfaces": port(running="false"), "monitor": Rows(None, "", None)},
    ),
    Case(
        "the port is called otherwise",
        {"interfaces": port(name="robots", **{"default-name": "ether5"}), "monitor": Rows(None, "", None)},
    ),
    Case(
        "two ports have swapped their names",
        {
            "interfaces": Rows(
                None,
                rows=(
                    {"name": "ether5", "default-name": "ether4", "running": "true"},
                    {"name": "ether4", "default-name": "ether5", "running": "false"},
                ),
            )
        },
    ),
    Case("a port with its own name", {"interfaces": port(**{"default-name": "ether5"})}),
    Case(
        "no such port",
        {"interfaces": Rows(None, rows=({"name": "ether1", "running": "true"},)), "monitor": Rows(None, "", None)},
    ),
    Case("no way", {"route": printed("", 2, "RTNETLINK answers: Network is unreachable\n")}),
    Case("no address is known", probe={"address": None}),
    Case("nobody is reached", {"monitor": AWAY, "interfaces": AWAY, "route": NOBODY, "neigh": NOBODY, "ping": NOBODY}),
    # garbage
    Case(
        "garbage",
        {
            "monitor": monitor(status="unknown"),
            "interfaces": port(**{"rx-error": "many"}),
            "ping": printed("pong\n"),
            "neigh": printed("]["),
            "route": printed('[{"dst":"10.64.1.26","dev":"eth0"}, 4]'),
        },
    ),
    Case(
        "a router that says nothing of its port", {"monitor": Rows(None, rows=()), "interfaces": Rows(None, "", None)}
    ),
    # slow
    Case("slow", {"ping": pings(mean=180, address="10.64.1.26")}),
)


def probe(case: Case) -> CabledProbe:
    endpoint = EthernetEndpoint.model_validate({"router_port": "ether5", **case.endpoint})
    made = {"address": "10.64.1.26", "mac": MAC, "router": "coastal-router", **case.probe}
    return CabledProbe(name="ECA ROV", place=Place.GATEWAY, endpoint=endpoint, **made)


@for_each_row("case", CASES, ids=str)
def test_findings_match_the_case(case: Case) -> None:
    check(case, LISTED, probe(case), HEALTHY)


def test_every_code_has_its_case() -> None:
    assert list(LISTED) == [case.name for case in CASES]
    assert codes(LISTED) == {
        *("another-answers", "answered-twice", "answers", "answers-damaged", "card-unseen", "half-duplex"),
        *("link", "loss", "no-address", "no-port", "no-route", "not-asked", "not-on-the-cable", "other-card"),
        *("own-address", "ping-cut-short", "ping-not-understood", "port-disabled", "port-renamed", "port-down"),
        *("port-unknown", "rate-low", "rx-errors", "silent", "slow", "tx-errors", "whose-unknown"),
    }


@pytest.mark.parametrize("version", trees.VERSIONS)
def test_router_has_the_queried_commands(version: str) -> None:
    tree = trees.Tree(version)
    asked = [one.query for one in probe(CASES[0]).asks() if isinstance(one, RouterOsQuery)]
    assert len(asked) == 2
    for query in asked:
        assert tree.has_command(query.menu, query.command)
        assert {name for name, _ in query.arguments} <= tree.arguments(query.menu, query.command)


def test_every_program_is_allowed() -> None:
    asked = [one for one in probe(CASES[0]).asks() if isinstance(one, RunProgram)]
    assert [" ".join(one.argv) for one in asked] == [
        "ip -j route get 10.64.1.26",
        "ping -n -c 20 -i 0.2 -W 2 10.64.1.26",
        "ip -j neigh show to 10.64.1.26",
    ]
    assert all(is_allowed(one.argv) for one in asked)
    assert [one.turn for one in asked] == ["", "10.64.1.26", "10.64.1.26"], "who has answered is known after the ping"
