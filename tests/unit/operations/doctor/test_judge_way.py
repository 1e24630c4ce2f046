"""The way to a router: each state of a laptop's network with everything that is said of it."""

from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
import yaml
from laptop_network import PLACE, Plug, lines, network, route
from row_subtests import for_each_row

from atlantis_netcfg.operations.doctor.network import IpPrints, NetworkUnreadable, facts_of, managed_of
from atlantis_netcfg.operations.doctor.reachability import (
    RouterAnswer,
    RouterPlace,
    judge_ports,
    judge_router,
    judge_way,
    why_not_contacted,
)

HERE = route("10.64.101.1", "eth0", source="10.64.101.10")
CONNECTED = route("10.64.101.0/24", "eth0", source="10.64.101.10")
WIFI = Plug("wlan0", addresses=("192.168.1.7/24",), wireless=True, speed=None)
HOME = route("default", "wlan0", "192.168.1.1", "192.168.1.7")
OVER_WIFI = route("10.64.101.1", "wlan0", "192.168.1.1", "192.168.1.7")
READY = Plug("eth0", addresses=("10.64.101.10/24",))


LISTED: dict[str, list[str]] = yaml.safe_load(Path(__file__).with_name("judge_way.yml").read_text(encoding="utf-8"))


@dataclass(frozen=True)
class Case:
    plugs: tuple[Plug, ...]
    taken: dict[str, Any] | None = None
    matching: tuple[dict[str, Any], ...] = ()
    defaults: tuple[dict[str, Any], ...] = ()
    place: RouterPlace = field(default=PLACE)


CASES = {
    "all well, and Wi-Fi beside it": Case((READY, WIFI), HERE, (CONNECTED, HOME), (HOME,)),
    "no wired port at all": Case((WIFI,), OVER_WIFI, (HOME,), (HOME,)),
    "the port is switched off": Case((Plug("eth0", "off"),)),
    "the address is there, and no cable": Case((replace(READY, state="no cable"),), HERE, (CONNECTED,)),
    "a damaged cable": Case((replace(READY, speed=10),), HERE, (CONNECTED,)),
    "a cable and no address; the router is looked for over Wi-Fi": Case(
        (Plug("eth0"), WIFI), OVER_WIFI, (HOME,), (HOME,)
    ),
    "NetworkManager looks after the port": Case((Plug("eth0", managed=True),)),
    "two cables, and nothing tells them apart": Case((Plug("eth0"), Plug("eth1"))),
    "the office's cable is in the other port: the free one is meant": Case(
        (Plug("eth0", addresses=("192.0.2.7/24",)), Plug("eth1")),
        route("10.64.101.1", "eth0", "192.0.2.1", "192.0.2.7"),
        (route("default", "eth0", "192.0.2.1"),),
        (route("default", "eth0", "192.0.2.1"),),
    ),
    "the only cable is the office's": Case(
        (Plug("eth0", addresses=("192.0.2.7/24",)),),
        route("10.64.101.1", "eth0", "192.0.2.1", "192.0.2.7"),
        (route("default", "eth0", "192.0.2.1"),),
        (route("default", "eth0", "192.0.2.1"),),
    ),
    "another address of the network": Case(
        (replace(READY, addresses=("10.64.101.55/24",)),),
        route("10.64.101.1", "eth0", source="10.64.101.55"),
        (CONNECTED,),
    ),
    "the right address with a wrong length": Case((replace(READY, addresses=("10.64.101.10/32",)),)),
    "the router's own address": Case(
        (replace(READY, addresses=("10.64.101.1/24",)),), route("10.64.101.1", "lo", source="10.64.101.1"), (CONNECTED,)
    ),
    "a source that the router's firewall drops": Case(
        (READY,), route("10.64.101.1", "eth0", source="192.0.2.7"), (CONNECTED,)
    ),
    "Wi-Fi is in the same network, and takes the packets": Case(
        (READY, replace(WIFI, addresses=("10.64.101.77/24",))),
        route("10.64.101.1", "wlan0", source="10.64.101.77"),
        (route("10.64.101.0/24", "wlan0"), CONNECTED),
    ),
    "a VPN brings a narrower route": Case(
        (READY, Plug("tun0", kind="tun", speed=None)),
        route("10.64.101.1", "tun0", source="10.64.101.10"),
        (route("10.64.101.0/25", "tun0"), CONNECTED),
    ),
    "the laptop's own traffic would take the site's links": Case(
        (READY,), HERE, (CONNECTED,), (route("default", "eth0", "10.64.101.1"),)
    ),
    "a container's bridge and its ends are no ports of the laptop": Case(
        (
            READY,
            Plug("docker0", kind="bridge"),
            Plug("veth1", kind="veth", master="docker0"),
            Plug("veth2", kind="veth"),
        ),
        HERE,
        (CONNECTED,),
    ),
    "from far away, by a route of the VPN": Case(
        (Plug("tun0", kind="tun", addresses=("10.80.0.5/24",)),),
        route("10.64.101.1", "tun0", "10.80.0.1", "10.80.0.5"),
        (route("10.64.0.0/16", "tun0", "10.80.0.1"), HOME),
        (HOME,),
        replace(PLACE, link="4g", is_metered=True),
    ),
    "from far away, and only the default route leads there": Case(
        (WIFI,), OVER_WIFI, (HOME,), (HOME,), replace(PLACE, link="4g", is_metered=True)
    ),
    "from far away, without any route": Case((WIFI,), place=replace(PLACE, link="4g", is_metered=True)),
    "from far away, with an address that is not admitted": Case(
        (Plug("tun0", kind="tun", addresses=("10.81.0.5/24",)),),
        route("10.64.101.1", "tun0", source="10.81.0.5"),
        (route("10.64.0.0/16", "tun0"),),
        place=replace(PLACE, link="4g", is_metered=True),
    ),
}


@for_each_row("name", CASES, ids=str)
def test_each_case_prints_the_listed_lines(name: str) -> None:
    case = CASES[name]
    facts = network(*case.plugs, taken=case.taken, matching=case.matching, defaults=case.defaults)
    assert lines(*judge_way(case.place, facts)) == LISTED[name]


def test_every_case_is_listed() -> None:
    assert list(LISTED) == [*CASES, *ROUTERS]


def test_port_name_is_shell_quoted() -> None:
    facts = network(Plug("a;b"))
    assert judge_way(PLACE, facts)[1].commands == ("sudo ip address add 10.64.101.10/24 dev 'a;b'",)


@pytest.mark.parametrize(
    ("plugs", "expected"),
    [
        ((), ["WARN ports: this laptop has no Ethernet port", "  plug in a USB Ethernet adapter"]),
        ((WIFI,), ["WARN ports: this laptop has no Ethernet port", "  plug in a USB Ethernet adapter"]),
        (
            (READY, Plug("eth1", "no cable"), Plug("eth2", "off")),
            ["PASS ports: eth0 has a cable connected (10.64.101.10/24); eth1 detects no cable; eth2 is disabled"],
        ),
    ],
)
def test_ports_are_judged_without_a_site(plugs: tuple[Plug, ...], expected: list[str]) -> None:
    assert lines(judge_ports(network(*plugs))) == expected


@pytest.mark.parametrize("printed", ["no JSON", "{}", '[{"ifname": 1}]', '[{"flags": []}]', "[1]", "null"])
def test_unparsable_output_is_not_taken_for_an_empty_network(printed: str) -> None:
    with pytest.raises(NetworkUnreadable):
        facts_of(IpPrints(printed, "[]", "[]"), {}, frozenset())


def test_connections_managed_by_network_manager() -> None:
    printed = "eth0:connected\nwlan0:disconnected\ndocker0:unmanaged\nlo:unmanaged (externally)\n"
    assert managed_of(printed) == {"eth0", "wlan0"}


def test_router_is_contacted_only_over_a_working_unmetered_link() -> None:
    good = judge_way(PLACE, network(READY, taken=HERE, matching=(CONNECTED,)))
    assert why_not_contacted(PLACE, good) is None
    paid = replace(PLACE, is_metered=True, link="4g")
    assert why_not_contacted(paid, ()) == "not contacted: 4g is metered"
    bad = judge_way(PLACE, network(Plug("eth0")))
    assert why_not_contacted(PLACE, bad) == "not contacted: its route is not correct yet"


PIN = "ab" * 32
FROM, UNTIL = datetime(2026, 1, 1, tzinfo=UTC), datetime(2036, 1, 1, tzinfo=UTC)
SHOWN = RouterAnswer(None, PIN, FROM, UNTIL)


ROUTERS = {
    "the known certificate": (PIN, SHOWN, 2026),
    "the known certificate, written otherwise": (":".join(["AB"] * 32), SHOWN, 2026),
    "a certificate that is not known": (None, SHOWN, 2026),
    "another certificate": ("cd" * 32, SHOWN, 2026),
    "a clock that is behind": (PIN, SHOWN, 2025),
    "a certificate that has ended": (PIN, SHOWN, 2037),
    "no answer": (PIN, RouterAnswer("10.64.101.1:8729 did not respond within 5 s"), 2026),
}


@pytest.mark.parametrize("name", ROUTERS)
def test_router_response_verdicts(name: str) -> None:
    pin, answer, now = ROUTERS[name]
    items = judge_router(replace(PLACE, pin=pin), answer, datetime(now, 11, 25, tzinfo=UTC))
    assert lines(*items) == LISTED[name]
