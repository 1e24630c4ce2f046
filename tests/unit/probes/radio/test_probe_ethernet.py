from __future__ import annotations

import pytest
import trees
from radio_cases import NOBODY, Case, check, codes, pings, printed, way
from row_subtests import for_each_row

from atlantis_netcfg.checklist.probes import Answer, CommandResult, Place, RouterOsQuery, Rows, RunProgram, Trouble
from atlantis_netcfg.checklist.probes.ethernet import CabledProbe
from atlantis_netcfg.core.reading_programs import allowed
from atlantis_netcfg.declaration.model import EthernetEndpoint

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
CALLED = "FAIL port-renamed: port ether5 of coastal-router is called {}, so that what is told under that name is"
CALLED += " not about it"
LINK = "PASS link: port ether5 of coastal-router has a link of 1Gbps"
ANSWERS = "PASS answers: ECA ROV (10.64.1.26) answers 20 of 20 pings, in 0.6 ms"
AWAY = Rows(Trouble.NO_PLACE, "coastal-router: connection refused")
SILENT = {"ping": pings(0, address="10.64.1.26"), "neigh": printed("[]\n")}
NONE = "FAIL silent: ECA ROV (10.64.1.26) answers none of 20 pings"

CASES = (
    Case(
        "healthy",
        (LINK, ANSWERS),
        evidence=(
            "measured pings answered by ECA ROV from the gateway: 20 of 20",
            "measured round trip to ECA ROV from the gateway, mean: 0.6 ms",
            "measured round trip to ECA ROV from the gateway, longest: 1.2 ms",
            "read way from the gateway: eth0",
            f"read network card that answers for 10.64.1.26: {MAC}",
            "read rate at port ether5 of coastal-router: 1Gbps",
            "read full duplex at port ether5 of coastal-router: true",
            "read frames received broken at port ether5 of coastal-router: 0",
            "read frames not sent at port ether5 of coastal-router: 0",
            "read times that the link was lost at port ether5 of coastal-router: 1",
        ),
    ),
    Case("healthy, no port declared", (ANSWERS,), probe={"router": None}),
    Case(
        "healthy, a router without `monitor`",
        (LINK.removesuffix(" of 1Gbps"), ANSWERS),
        {"monitor": Rows(None, "no such command", None)},
    ),
    Case("healthy, a router that counts nothing", (LINK, ANSWERS), {"interfaces": Rows(None, "not permitted", None)}),
    # sick
    Case(
        "another card answers",
        (
            LINK,
            ANSWERS,
            (
                "FAIL other-card: 02:00:5E:00:01:99 answers for 10.64.1.26, and the network card of ECA ROV is"
                " 02:00:5E:00:01:26"
            ),
        ),
        {"neigh": neighbour("02:00:5e:00:01:99")},
    ),
    Case("an old entry of a card that does not answer", (LINK, NONE), SILENT | {"neigh": neighbour(state="FAILED")}),
    Case(
        "one ping is lost",
        (LINK, "WARN loss: ECA ROV (10.64.1.26) answers 19 of 20 pings: 5 % are lost, above 0 %"),
        {"ping": pings(19, address="10.64.1.26")},
    ),
    Case(
        "a broken cable",
        (
            "PASS link: port ether5 of coastal-router has a link of 10Mbps",
            "WARN rate-low: port ether5 of coastal-router runs at 10Mbps only",
            "WARN half-duplex: port ether5 of coastal-router runs in half duplex",
            "WARN rx-errors: port ether5 of coastal-router has counted 47 frames received broken since it was started",
            "WARN tx-errors: port ether5 of coastal-router has counted 3 frames not sent since it was started",
            "FAIL loss: ECA ROV (10.64.1.26) answers 12 of 20 pings: 40 % are lost, above 0 %",
        ),
        {
            "monitor": monitor(rate="10Mbps", **{"full-duplex": "false"}),
            "interfaces": port(**{"rx-error": "47", "tx-error": "3"}),
            "ping": pings(12, address="10.64.1.26"),
        },
    ),
    Case(
        "port switched off",
        ("FAIL port-disabled: port ether5 of coastal-router is switched off", NONE),
        SILENT | {"interfaces": port(disabled="true", running="false"), "monitor": monitor(status="no-link")},
    ),
    Case(
        "nobody tells the card that has answered",
        (
            LINK,
            ANSWERS,
            "INCONCLUSIVE card-unseen: the gateway does not tell which network card answers for 10.64.1.26",
        ),
        {"neigh": printed("[]\n")},
    ),
    Case(
        "the card of another address",
        (
            LINK,
            ANSWERS,
            "INCONCLUSIVE card-unseen: the gateway does not tell which network card answers for 10.64.1.26",
        ),
        {"neigh": printed(neighbour().out.replace("10.64.1.26", "10.64.1.27"))},
    ),
    Case(
        "nobody has declared its card",
        (LINK, ANSWERS, "WARN whose-unknown: nothing tells whether it is ECA ROV that answers at 10.64.1.26"),
        probe={"mac": None},
    ),
    Case(
        "the gateway has its address",
        (LINK, "FAIL own-address: the gateway itself has the address of ECA ROV, 10.64.1.26: its pings never leave it"),
        {"route": way("lo", "10.64.1.26")},
    ),
    Case(
        "behind the router, and not on the cable",
        (
            LINK,
            ANSWERS,
            (
                "FAIL not-on-the-cable: packets to ECA ROV (10.64.1.26) leave by way of 10.64.1.1: it is not on the"
                " site's cable"
            ),
        ),
        {"route": printed('[{"dst":"10.64.1.26","gateway":"10.64.1.1","dev":"eth0","flags":[]}]\n')},
    ),
    Case(
        "every answer comes twice",
        (LINK, "FAIL answered-twice: ECA ROV (10.64.1.26) answers 20 of 20 pings, and 20 answers came twice"),
        {"ping": pings(address="10.64.1.26", twice=20)},
    ),
    Case(
        "one answer comes twice",
        (LINK, "WARN answered-twice: ECA ROV (10.64.1.26) answers 20 of 20 pings, and 1 answers came twice"),
        {"ping": pings(address="10.64.1.26", twice=1)},
    ),
    Case(
        "duplicates are no answers",
        (
            LINK,
            "FAIL answered-twice: ECA ROV (10.64.1.26) answers 10 of 20 pings, and 10 answers came twice",
            "FAIL loss: ECA ROV (10.64.1.26) answers 10 of 20 pings: 50 % are lost, above 0 %",
        ),
        {
            "ping": printed(
                pings(10, address="10.64.1.26", twice=10).out.replace("10 received, +10", "20 received, +10")
            )
        },
    ),
    Case(
        "somebody else answers",
        (
            LINK,
            "FAIL another-answers: 10.64.1.99 answers in place of ECA ROV (10.64.1.26)",
            "FAIL silent: ECA ROV (10.64.1.26) answers none of 20 pings",
        ),
        {"ping": printed(pings(address="10.64.1.26").out.replace("from 10.64.1.26", "from 10.64.1.99"))},
    ),
    Case(
        "somebody else was asked",
        (
            LINK,
            (
                "INCONCLUSIVE ping-not-understood: no ping was sent to ECA ROV (10.64.1.26) from the gateway: PING"
                " 10.64.1.99 (10.64.1.99) 56(84) bytes of data."
            ),
        ),
        {"ping": pings(address="10.64.1.99")},
    ),
    Case(
        "answers are damaged",
        (LINK, "FAIL answers-damaged: answers of ECA ROV (10.64.1.26) came back damaged"),
        {"ping": pings(address="10.64.1.26", more="wrong data byte #16 should be 0x10 but was 0x11\n")},
    ),
    Case(
        "the ping was cut short",
        (
            LINK,
            "INCONCLUSIVE ping-cut-short: only 2 of 20 pings were sent to ECA ROV (10.64.1.26), and 2 were answered",
        ),
        {"ping": printed(pings(2, address="10.64.1.26").out.replace("20 packets", "2 packets").replace("90%", "0%"))},
    ),
    Case(
        "another port answers",
        ("PASS link: port ether5 of coastal-router has a link", ANSWERS),
        {"monitor": monitor(name="ether4", status="no-link")},
    ),
    # absent
    Case(
        "not plugged in",
        ("FAIL port-down: port ether5 of coastal-router has no link", NONE),
        SILENT | {"interfaces": port(running="false"), "monitor": monitor(status="no-link", rate="")},
    ),
    Case(
        "not plugged in, and the router has no `monitor`",
        ("FAIL port-down: port ether5 of coastal-router has no link", NONE),
        SILENT | {"interfaces": port(running="false"), "monitor": Rows(None, "", None)},
    ),
    Case(
        "the port is called otherwise",
        (CALLED.format("robots there"), ANSWERS),
        {"interfaces": port(name="robots", **{"default-name": "ether5"}), "monitor": Rows(None, "", None)},
    ),
    Case(
        "two ports have swapped their names",
        (CALLED.format("ether4 there"), ANSWERS),
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
    Case("a port with its own name", (LINK, ANSWERS), {"interfaces": port(**{"default-name": "ether5"})}),
    Case(
        "no such port",
        ("FAIL no-port: coastal-router has no port ether5", ANSWERS),
        {"interfaces": Rows(None, rows=({"name": "ether1", "running": "true"},)), "monitor": Rows(None, "", None)},
    ),
    Case(
        "no way",
        (LINK, "FAIL no-route: the gateway has no route to ECA ROV (10.64.1.26)"),
        {"route": printed("", 2, "RTNETLINK answers: Network is unreachable\n")},
    ),
    Case(
        "no address is known",
        (LINK, "INCONCLUSIVE no-address: no address of ECA ROV is known here: it was not asked whether it answers"),
        probe={"address": None},
    ),
    Case(
        "nobody is reached",
        (
            "INCONCLUSIVE not-asked: coastal-router could not be asked: coastal-router: connection refused",
            "INCONCLUSIVE not-asked: the gateway could not be asked: coastal-gateway: connection timed out",
        ),
        {"monitor": AWAY, "interfaces": AWAY, "route": NOBODY, "neigh": NOBODY, "ping": NOBODY},
    ),
    # garbage
    Case(
        "garbage",
        (
            "INCONCLUSIVE port-unknown: coastal-router says `unknown` of the link of port ether5",
            "INCONCLUSIVE ping-not-understood: no ping was sent to ECA ROV (10.64.1.26) from the gateway: pong",
        ),
        {
            "monitor": monitor(status="unknown"),
            "interfaces": port(**{"rx-error": "many"}),
            "ping": printed("pong\n"),
            "neigh": printed("]["),
            "route": printed('[{"dst":"10.64.1.26","dev":"eth0"}, 4]'),
        },
    ),
    Case(
        "a router that says nothing of its port",
        ("INCONCLUSIVE port-unknown: coastal-router says nothing of the link of port ether5", ANSWERS),
        {"monitor": Rows(None, rows=()), "interfaces": Rows(None, "", None)},
    ),
    # slow
    Case(
        "slow",
        (
            LINK,
            "PASS answers: ECA ROV (10.64.1.26) answers 20 of 20 pings, in 180 ms",
            "WARN slow: ECA ROV answers after 180 ms in the mean, above 100 ms",
        ),
        {"ping": pings(mean=180, address="10.64.1.26")},
    ),
)


def probe(case: Case) -> CabledProbe:
    endpoint = EthernetEndpoint.model_validate({"router_port": "ether5", **case.endpoint})
    made = {"address": "10.64.1.26", "mac": MAC, "router": "coastal-router", **case.probe}
    return CabledProbe(name="ECA ROV", place=Place.GATEWAY, endpoint=endpoint, **made)


@for_each_row("case", CASES, ids=str)
def test_judged(case: Case) -> None:
    check(case, probe(case), HEALTHY)


def test_every_code_has_its_case() -> None:
    assert codes(CASES) == {
        "another-answers",
        "answered-twice",
        "answers",
        "answers-damaged",
        "card-unseen",
        "half-duplex",
        "link",
        "loss",
        "no-address",
        "no-port",
        "no-route",
        "not-asked",
        "not-on-the-cable",
        "other-card",
        "own-address",
        "ping-cut-short",
        "ping-not-understood",
        "port-disabled",
        "port-renamed",
        "port-down",
        "port-unknown",
        "rate-low",
        "rx-errors",
        "silent",
        "slow",
        "tx-errors",
        "whose-unknown",
    }


@pytest.mark.parametrize("version", trees.VERSIONS)
def test_the_router_has_the_words(version: str) -> None:
    tree = trees.Tree(version)
    asked = [one.query for one in probe(CASES[0]).asks() if isinstance(one, RouterOsQuery)]
    assert len(asked) == 2
    for query in asked:
        assert tree.has_command(query.menu, query.command)
        assert {name for name, _ in query.arguments} <= tree.arguments(query.menu, query.command)


def test_every_program_is_on_the_list() -> None:
    asked = [one for one in probe(CASES[0]).asks() if isinstance(one, RunProgram)]
    assert [" ".join(one.argv) for one in asked] == [
        "ip -j route get 10.64.1.26",
        "ping -n -c 20 -i 0.2 -W 2 10.64.1.26",
        "ip -j neigh show to 10.64.1.26",
    ]
    assert all(allowed(one.argv) for one in asked)
    assert [one.turn for one in asked] == ["", "10.64.1.26", "10.64.1.26"], "who has answered is known after the ping"
