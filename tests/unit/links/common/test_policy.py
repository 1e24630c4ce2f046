"""Which bearer is active, from route rows as a router prints them; and pings that test a link."""

from row_subtests import for_each_row

from atlantis_netcfg.links.policy import LinkRoute, active_link, active_links, probe_commands

PTP = LinkRoute("wifi-ptp", "10.10.0.1", "10.10.0.2", ("198.51.100.11", "198.51.100.12"), "ether1", "wifi_ptp")
LTE = LinkRoute("4g", "10.10.1.1", "10.10.1.2", ("198.51.100.21", "198.51.100.22"), "ether2", "lte", is_metered=True)
SAT = LinkRoute("satellite", "10.10.2.1", "10.10.2.2", (), "ether3", "satellite", is_metered=True)
BEARERS = (PTP, LTE, SAT)
Row = dict[str, str]


def route(gateway: str, **values: str) -> Row:
    given = {name.replace("_", "-"): value for name, value in values.items()}
    return {"dst-address": "0.0.0.0/0", "gateway": gateway, "routing-table": "main", "active": "true"} | given


CASES: dict[str, tuple[list[Row], str | None]] = {
    "no route at all": ([], None),
    "one canary": ([route("198.51.100.11", distance="10")], "wifi-ptp"),
    "both canaries of one link are one bearer": ([route("198.51.100.11"), route("198.51.100.12")], "wifi-ptp"),
    "two links at once": ([route("198.51.100.11"), route("198.51.100.21")], None),
    "a stranger's route beside ours": ([route("198.51.100.11"), route("192.0.2.77")], None),
    "a stranger's route": ([route("192.0.2.77")], None),
    "by the next hop": ([route("10.10.2.1", distance="30")], "satellite"),
    "by the port": ([route("ether2")], "4g"),
    "by what the router resolved": ([route("203.0.113.9", immediate_gw="10.10.1.1%ether2")], "4g"),
    "by the port of what it resolved": ([route("203.0.113.9", immediate_gw="203.0.113.9%ether3")], "satellite"),
    "with the table of its gateway": ([route("10.10.0.1@main")], "wifi-ptp"),
    "not active": ([route("198.51.100.11", active="false"), route("10.10.2.1")], "satellite"),
    "active is not said": ([{"dst-address": "0.0.0.0/0", "gateway": "10.10.2.1"}], None),
    "disabled": ([route("198.51.100.11", disabled="true"), route("198.51.100.21", disabled="false")], "4g"),
    "yes and no, as version 6 says": (
        [route("198.51.100.11", disabled="yes"), route("10.10.2.1", active="yes")],
        "satellite",
    ),
    "a blackhole is nobody's": ([route("198.51.100.11", blackhole="")], None),
    "a blackhole, as the API prints it": ([route("", blackhole="true")], None),
    "not a blackhole": ([route("198.51.100.11", blackhole="false")], "wifi-ptp"),
    "dynamic, of DHCP": ([route("10.10.1.1", dynamic="true", distance="2")], "4g"),
    "of another table": ([route("10.10.0.1@main", routing_table="via-wifi-ptp"), route("10.10.2.1")], "satellite"),
    "no default": ([route("198.51.100.11") | {"dst-address": "10.0.0.0/8"}], None),
    "the table is not said": ([{"gateway": "10.10.1.1", "active": "true"}], "4g"),
    "the nearer one": ([route("198.51.100.11", distance="110"), route("10.10.2.1", distance="30")], "satellite"),
}


@for_each_row("case", CASES)
def test_active_link(case: str) -> None:
    rows, expected = CASES[case]
    assert active_link(rows, BEARERS) == expected
    assert active_link(rows[::-1], BEARERS) == expected


def test_active_links_are_ordered_by_preference() -> None:
    rows = [route("10.10.2.1"), route("198.51.100.21"), route("198.51.100.11")]
    assert active_links(rows, BEARERS) == ("wifi-ptp", "4g", "satellite")
    assert active_links([route("192.0.2.77")], BEARERS) == ()


def test_probes_use_their_own_link_and_skip_the_satellite() -> None:
    watched = LinkRoute(
        "satellite", "10.10.2.1", "10.10.2.2", ("198.51.100.31",), "ether3", "satellite", is_metered=True
    )
    probes = probe_commands((PTP, LTE, watched), count=2)
    assert [(probe.link, probe.target) for probe in probes] == [
        ("wifi-ptp", "198.51.100.11"),
        ("wifi-ptp", "198.51.100.12"),
        ("4g", "198.51.100.21"),
        ("4g", "198.51.100.22"),
    ]
    own = {"wifi-ptp": "10.10.0.2", "4g": "10.10.1.2"}
    assert all(dict(probe.arguments)["src-address"] == own[probe.link] for probe in probes)
    assert {(probe.path, dict(probe.arguments)["count"], probe.wire_bytes) for probe in probes} == {
        ("/tool/ping", "2", 336)
    }
