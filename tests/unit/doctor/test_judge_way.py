"""The way to a router: each state of a laptop's network with everything that is said of it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import pytest
from laptop_network import PLACE, Plug, lines, network, route
from row_subtests import for_each_row

from atlantis_netcfg.operations.doctor.network import IpPrints, NetworkUnreadable, facts_of, managed_of
from atlantis_netcfg.operations.doctor.way import RouterAnswer, judge_ports, judge_router, judge_way, why_not_contacted

if TYPE_CHECKING:
    from atlantis_netcfg.operations.doctor.way import RouterPlace

HERE = route("10.64.101.1", "eth0", source="10.64.101.10")
CONNECTED = route("10.64.101.0/24", "eth0", source="10.64.101.10")
WIFI = Plug("wlan0", addresses=("192.168.1.7/24",), wireless=True, speed=None)
HOME = route("default", "wlan0", "192.168.1.1", "192.168.1.7")
OVER_WIFI = route("10.64.101.1", "wlan0", "192.168.1.1", "192.168.1.7")
READY = Plug("eth0", addresses=("10.64.101.10/24",))
QUIET = ["PASS other ports: none reaches into 10.64.101.0/24"]
NO_DEFAULT = ["PASS default route: none: no other traffic of this laptop goes to the site"]
WIFI_DEFAULT = ["PASS default route: wlan0, by the gateway 192.168.1.1"]
NO_ADDRESS = [
    "FAIL address: no port has an address in 10.64.101.0/24, the network of ether8 of coastal-router",
    "  sudo ip address add 10.64.101.10/24 dev eth0",
]


ADMITS = "the declared firewall of coastal-router admits 10.64.101.0/24, 10.80.0.0/24 only"


@dataclass(frozen=True)
class Case:
    name: str
    plugs: tuple[Plug, ...]
    expected: list[str]
    taken: dict[str, Any] | None = None
    matching: tuple[dict[str, Any], ...] = ()
    defaults: tuple[dict[str, Any], ...] = ()
    place: RouterPlace = field(default=PLACE)


CASES = (
    Case(
        "all well, and Wi-Fi beside it",
        (READY, WIFI),
        [
            "PASS port: eth0 has a cable, 1000 Mbit/s",
            "PASS address: 10.64.101.10/24 on eth0",
            "PASS route: 10.64.101.1 goes to eth0, from 10.64.101.10",
            *QUIET,
            *WIFI_DEFAULT,
        ],
        HERE,
        (CONNECTED, HOME),
        (HOME,),
    ),
    Case(
        "no wired port at all",
        (WIFI,),
        [
            "FAIL port: this laptop has no Ethernet port",
            "  plug in a USB Ethernet adapter, then type the same again",
            NO_ADDRESS[0],
            "FAIL route: 10.64.101.1 goes to wlan0, by the gateway 192.168.1.1",
            *QUIET,
            *WIFI_DEFAULT,
        ],
        OVER_WIFI,
        (HOME,),
        (HOME,),
    ),
    Case(
        "the port is switched off",
        (Plug("eth0", "off"),),
        [
            "FAIL port: eth0 is switched off",
            "  sudo ip link set eth0 up",
            *NO_ADDRESS,
            "FAIL route: no route to 10.64.101.1",
            NO_ADDRESS[1],
            *QUIET,
            *NO_DEFAULT,
        ],
    ),
    Case(
        "the address is there, and no cable",
        (replace(READY, state="no cable"),),
        [
            "FAIL port: eth0 is on and sees no cable (no carrier)",
            "  plug the cable into ether8 of coastal-router, and look at the router's power",
            "PASS address: 10.64.101.10/24 on eth0",
            "PASS route: 10.64.101.1 goes to eth0, from 10.64.101.10",
            *QUIET,
            *NO_DEFAULT,
        ],
        HERE,
        (CONNECTED,),
    ),
    Case(
        "a damaged cable",
        (replace(READY, speed=10),),
        [
            "WARN port: eth0 has a cable, at 10 Mbit/s only",
            "  take another cable, or clean the plugs",
            "PASS address: 10.64.101.10/24 on eth0",
            "PASS route: 10.64.101.1 goes to eth0, from 10.64.101.10",
            *QUIET,
            *NO_DEFAULT,
        ],
        HERE,
        (CONNECTED,),
    ),
    Case(
        "a cable and no address; the router is looked for over Wi-Fi",
        (Plug("eth0"), WIFI),
        [
            "PASS port: eth0 has a cable, 1000 Mbit/s",
            *NO_ADDRESS,
            "FAIL route: 10.64.101.1 goes to wlan0, by the gateway 192.168.1.1, and not to eth0",
            NO_ADDRESS[1],
            *QUIET,
            *WIFI_DEFAULT,
        ],
        OVER_WIFI,
        (HOME,),
        (HOME,),
    ),
    Case(
        "NetworkManager looks after the port",
        (Plug("eth0", managed=True),),
        [
            "PASS port: eth0 has a cable, 1000 Mbit/s",
            NO_ADDRESS[0],
            "  sudo nmcli device set eth0 managed no",
            NO_ADDRESS[1],
            "FAIL route: no route to 10.64.101.1",
            "  sudo nmcli device set eth0 managed no",
            NO_ADDRESS[1],
            *QUIET,
            *NO_DEFAULT,
        ],
    ),
    Case(
        "two cables, and nothing tells them apart",
        (Plug("eth0"), Plug("eth1")),
        [
            "WARN port: eth0 and eth1 have a cable: nothing here tells which leads to coastal-router",
            "  plug the cable into ether8 of coastal-router, and look at the router's power",
            *NO_ADDRESS,
            "FAIL route: no route to 10.64.101.1",
            NO_ADDRESS[1],
            *QUIET,
            *NO_DEFAULT,
        ],
    ),
    Case(
        "the office's cable is in the other port: the free one is meant",
        (Plug("eth0", addresses=("192.0.2.7/24",)), Plug("eth1")),
        [
            "WARN port: eth1 and eth0 have a cable: nothing here tells which leads to coastal-router",
            "  plug the cable into ether8 of coastal-router, and look at the router's power",
            NO_ADDRESS[0],
            "  sudo ip address add 10.64.101.10/24 dev eth1",
            "FAIL route: 10.64.101.1 goes to eth0, by the gateway 192.0.2.1, and not to eth1",
            "  sudo ip address add 10.64.101.10/24 dev eth1",
            *QUIET,
            "PASS default route: eth0, by the gateway 192.0.2.1",
        ],
        route("10.64.101.1", "eth0", "192.0.2.1", "192.0.2.7"),
        (route("default", "eth0", "192.0.2.1"),),
        (route("default", "eth0", "192.0.2.1"),),
    ),
    Case(
        "the only cable is the office's",
        (Plug("eth0", addresses=("192.0.2.7/24",)),),
        [
            "PASS port: eth0 has a cable, 1000 Mbit/s",
            *NO_ADDRESS,
            "FAIL route: 10.64.101.1 goes to eth0, by the gateway 192.0.2.1",
            NO_ADDRESS[1],
            *QUIET,
            "PASS default route: eth0, by the gateway 192.0.2.1",
        ],
        route("10.64.101.1", "eth0", "192.0.2.1", "192.0.2.7"),
        (route("default", "eth0", "192.0.2.1"),),
        (route("default", "eth0", "192.0.2.1"),),
    ),
    Case(
        "another address of the network",
        (replace(READY, addresses=("10.64.101.55/24",)),),
        [
            "PASS port: eth0 has a cable, 1000 Mbit/s",
            "WARN address: eth0 has 10.64.101.55/24; declared for this laptop is 10.64.101.10/24",
            "  sudo ip address add 10.64.101.10/24 dev eth0",
            "PASS route: 10.64.101.1 goes to eth0, from 10.64.101.55",
            *QUIET,
            *NO_DEFAULT,
        ],
        route("10.64.101.1", "eth0", source="10.64.101.55"),
        (CONNECTED,),
    ),
    Case(
        "the right address with a wrong length",
        (replace(READY, addresses=("10.64.101.10/32",)),),
        [
            "PASS port: eth0 has a cable, 1000 Mbit/s",
            "FAIL address: eth0 has 10.64.101.10/32; declared for this laptop is 10.64.101.10/24",
            "  sudo ip address add 10.64.101.10/24 dev eth0",
            "FAIL route: no route to 10.64.101.1",
            "  sudo ip address add 10.64.101.10/24 dev eth0",
            *QUIET,
            *NO_DEFAULT,
        ],
    ),
    Case(
        "the router's own address",
        (replace(READY, addresses=("10.64.101.1/24",)),),
        [
            "PASS port: eth0 has a cable, 1000 Mbit/s",
            "FAIL address: eth0 has 10.64.101.1, which is the address of coastal-router itself",
            "  sudo ip address del 10.64.101.1/24 dev eth0",
            "  sudo ip address add 10.64.101.10/24 dev eth0",
            "FAIL route: 10.64.101.1 goes to lo, and not to eth0",
            "  sudo ip address del 10.64.101.1/24 dev eth0",
            "  sudo ip address add 10.64.101.10/24 dev eth0",
            *QUIET,
            *NO_DEFAULT,
        ],
        route("10.64.101.1", "lo", source="10.64.101.1"),
        (CONNECTED,),
    ),
    Case(
        "a source that the router's firewall drops",
        (READY,),
        [
            "PASS port: eth0 has a cable, 1000 Mbit/s",
            "PASS address: 10.64.101.10/24 on eth0",
            f"FAIL route: 10.64.101.1 is reached from 192.0.2.7; {ADMITS}",
            "  sudo ip route replace 10.64.101.1/32 dev eth0 src 10.64.101.10",
            *QUIET,
            *NO_DEFAULT,
        ],
        route("10.64.101.1", "eth0", source="192.0.2.7"),
        (CONNECTED,),
    ),
    Case(
        "Wi-Fi is in the same network, and takes the packets",
        (READY, replace(WIFI, addresses=("10.64.101.77/24",))),
        [
            "PASS port: eth0 has a cable, 1000 Mbit/s",
            "PASS address: 10.64.101.10/24 on eth0",
            "FAIL route: 10.64.101.1 goes to wlan0, and not to eth0",
            "  sudo ip route replace 10.64.101.1/32 dev eth0 src 10.64.101.10",
            "WARN other ports: wlan0 has 10.64.101.77/24: in the router's network too",
            "  sudo ip address del 10.64.101.77/24 dev wlan0",
            *NO_DEFAULT,
        ],
        route("10.64.101.1", "wlan0", source="10.64.101.77"),
        (route("10.64.101.0/24", "wlan0"), CONNECTED),
    ),
    Case(
        "a VPN brings a narrower route",
        (READY, Plug("tun0", kind="tun", speed=None)),
        [
            "PASS port: eth0 has a cable, 1000 Mbit/s",
            "PASS address: 10.64.101.10/24 on eth0",
            "FAIL route: 10.64.101.1 goes to tun0, and not to eth0",
            "  sudo ip route replace 10.64.101.1/32 dev eth0 src 10.64.101.10",
            "WARN other ports: 10.64.101.0/25 goes to tun0: in the router's network too",
            "  sudo ip route del 10.64.101.0/25 dev tun0",
            *NO_DEFAULT,
        ],
        route("10.64.101.1", "tun0", source="10.64.101.10"),
        (route("10.64.101.0/25", "tun0"), CONNECTED),
    ),
    Case(
        "the laptop's own traffic would take the site's links",
        (READY,),
        [
            "PASS port: eth0 has a cable, 1000 Mbit/s",
            "PASS address: 10.64.101.10/24 on eth0",
            "PASS route: 10.64.101.1 goes to eth0, from 10.64.101.10",
            *QUIET,
            "WARN default route: eth0: this laptop's updates and mail would go over the site's links",
            "  sudo ip route del default via 10.64.101.1 dev eth0",
        ],
        HERE,
        (CONNECTED,),
        (route("default", "eth0", "10.64.101.1"),),
    ),
    Case(
        "a container's bridge and its ends are no ports of the laptop",
        (
            READY,
            Plug("docker0", kind="bridge"),
            Plug("veth1", kind="veth", master="docker0"),
            Plug("veth2", kind="veth"),
        ),
        [
            "PASS port: eth0 has a cable, 1000 Mbit/s",
            "PASS address: 10.64.101.10/24 on eth0",
            "PASS route: 10.64.101.1 goes to eth0, from 10.64.101.10",
            *QUIET,
            *NO_DEFAULT,
        ],
        HERE,
        (CONNECTED,),
    ),
    Case(
        "from far away, by a route of the VPN",
        (Plug("tun0", kind="tun", addresses=("10.80.0.5/24",)),),
        ["PASS route: 10.64.101.1 goes to tun0, by the gateway 10.80.0.1, from 10.80.0.5"],
        route("10.64.101.1", "tun0", "10.80.0.1", "10.80.0.5"),
        (route("10.64.0.0/16", "tun0", "10.80.0.1"), HOME),
        (HOME,),
        replace(PLACE, bearer="4g", metered=True),
    ),
    Case(
        "from far away, and only the default route leads there",
        (WIFI,),
        [
            "FAIL route: only the default route leads to 10.64.101.1: wlan0, by the gateway 192.168.1.1",
            "  is the VPN, or the way over 4g, up on this laptop?",
        ],
        OVER_WIFI,
        (HOME,),
        (HOME,),
        replace(PLACE, bearer="4g", metered=True),
    ),
    Case(
        "from far away, without any route",
        (WIFI,),
        ["FAIL route: no route to 10.64.101.1", "  is the VPN, or the way over 4g, up on this laptop?"],
        place=replace(PLACE, bearer="4g", metered=True),
    ),
    Case(
        "from far away, with an address that is not admitted",
        (Plug("tun0", kind="tun", addresses=("10.81.0.5/24",)),),
        [
            f"FAIL route: 10.64.101.1 is reached from 10.81.0.5; {ADMITS}",
            "  is the VPN, or the way over 4g, up on this laptop?",
        ],
        route("10.64.101.1", "tun0", source="10.81.0.5"),
        (route("10.64.0.0/16", "tun0"),),
        place=replace(PLACE, bearer="4g", metered=True),
    ),
)


@for_each_row("case", CASES, ids=lambda case: case.name)
def test_everything_that_is_said(case: Case) -> None:
    facts = network(*case.plugs, taken=case.taken, matching=case.matching, defaults=case.defaults)
    assert lines(*judge_way(case.place, facts)) == case.expected


def test_a_name_of_a_port_is_typed_as_one_word() -> None:
    facts = network(Plug("a;b"))
    assert judge_way(PLACE, facts)[1].commands == ("sudo ip address add 10.64.101.10/24 dev 'a;b'",)


@pytest.mark.parametrize(
    ("plugs", "expected"),
    [
        ((), ["WARN ports: this laptop has no Ethernet port", "  plug in a USB Ethernet adapter"]),
        ((WIFI,), ["WARN ports: this laptop has no Ethernet port", "  plug in a USB Ethernet adapter"]),
        (
            (READY, Plug("eth1", "no cable"), Plug("eth2", "off")),
            ["PASS ports: eth0 has a cable (10.64.101.10/24); eth1 sees no cable; eth2 is switched off"],
        ),
    ],
)
def test_the_ports_where_no_site_is_named(plugs: tuple[Plug, ...], expected: list[str]) -> None:
    assert lines(judge_ports(network(*plugs))) == expected


@pytest.mark.parametrize("printed", ["no JSON", "{}", '[{"ifname": 1}]', '[{"flags": []}]', "[1]", "null"])
def test_what_is_not_understood_is_not_taken_for_an_empty_network(printed: str) -> None:
    with pytest.raises(NetworkUnreadable):
        facts_of(IpPrints(printed, "[]", "[]"), {}, frozenset())


def test_whom_network_manager_looks_after() -> None:
    printed = "eth0:connected\nwlan0:disconnected\ndocker0:unmanaged\nlo:unmanaged (externally)\n"
    assert managed_of(printed) == {"eth0", "wlan0"}


def test_the_router_is_contacted_on_a_right_way_that_costs_nothing() -> None:
    good = judge_way(PLACE, network(READY, taken=HERE, matching=(CONNECTED,)))
    assert why_not_contacted(PLACE, good) is None
    paid = replace(PLACE, metered=True, bearer="4g")
    assert why_not_contacted(paid, ()) == "not contacted: 4g is paid by the byte"
    bad = judge_way(PLACE, network(Plug("eth0")))
    assert why_not_contacted(PLACE, bad) == "not contacted: the way to it is not right yet"


PIN = "ab" * 32
FROM, UNTIL = datetime(2026, 1, 1, tzinfo=UTC), datetime(2036, 1, 1, tzinfo=UTC)
SHOWN = RouterAnswer(None, PIN, FROM, UNTIL)
VALID = "its certificate is valid from 2026-01-01 to 2036-01-01; here it is"
IN_TIME = f"PASS dates: {VALID} 2026-11-25"


@pytest.mark.parametrize(
    ("pin", "answer", "now", "expected"),
    [
        (
            PIN,
            SHOWN,
            2026,
            ["PASS router: coastal-router answers, with the known certificate; nobody logged in", IN_TIME],
        ),
        (
            ":".join(["AB"] * 32),
            SHOWN,
            2026,
            ["PASS router: coastal-router answers, with the known certificate; nobody logged in", IN_TIME],
        ),
        (
            None,
            SHOWN,
            2026,
            [
                "WARN router: coastal-router answers, and its certificate is not known",
                "  provision trust site=coastal",
                IN_TIME,
            ],
        ),
        (
            "cd" * 32,
            SHOWN,
            2026,
            [
                "FAIL router: what answers at 10.64.101.1 shows another certificate than coastal-router",
                "  only if the router was renewed or replaced on purpose:",
                "  provision trust site=coastal",
                IN_TIME,
            ],
        ),
        (
            PIN,
            SHOWN,
            2025,
            [
                "PASS router: coastal-router answers, with the known certificate; nobody logged in",
                f"FAIL dates: {VALID} 2025-11-25",
                "  set this laptop's clock",
                "  sudo timedatectl set-ntp true",
            ],
        ),
        (
            PIN,
            SHOWN,
            2037,
            [
                "PASS router: coastal-router answers, with the known certificate; nobody logged in",
                f"WARN dates: {VALID} 2037-11-25",
                "  renew it, or set this laptop's clock if that is wrong",
            ],
        ),
        (
            PIN,
            RouterAnswer("10.64.101.1:8729 did not answer within 5 s"),
            2026,
            [
                "FAIL router: 10.64.101.1:8729 did not answer within 5 s",
                "  look at the power of coastal-router, and at the cable in ether8",
            ],
        ),
    ],
)
def test_what_the_router_shows(pin: str | None, answer: RouterAnswer, now: int, expected: list[str]) -> None:
    items = judge_router(replace(PLACE, pin=pin), answer, datetime(now, 11, 25, tzinfo=UTC))
    assert lines(*items) == expected
