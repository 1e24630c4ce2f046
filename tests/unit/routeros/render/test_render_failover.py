"""Where the rendered routes lead while links fail."""

from itertools import permutations

import pytest
from render_declared import SITES, declaration, with_site
from render_routes import BLACKHOLE, Router, World
from test_render_text import parsed

from atlantis_netcfg.routeros.render import router_view

INTERNET = "93.184.216.34"
PTP = frozenset({"198.51.100.11", "198.51.100.12"})
LTE = frozenset({"198.51.100.21", "198.51.100.22"})


@pytest.mark.parametrize(
    ("world", "leaves"),
    [
        (World(), {"ether1"}),
        (World(silent=frozenset({"198.51.100.11"})), {"ether1"}),
        (World(silent=PTP), {"ether2"}),
        (World(down=frozenset({"ether1"})), {"ether2"}),
        (World(silent=LTE), {"ether1"}),
        (World(silent=PTP | LTE), {"ether3"}),
        (World(silent=PTP, down=frozenset({"ether2"})), {"ether3"}),
        # Nothing good is left: a link that was given up is still better than no way out.
        (World(silent=PTP | LTE, down=frozenset({"ether3"})), {"ether2"}),
        (World(silent=PTP | LTE, down=frozenset({"ether2", "ether3"})), set()),
    ],
)
def test_coastal_fails_over(world: World, leaves: set[str]) -> None:
    coastal = Router(parsed("coastal"), world)
    assert coastal.exits(INTERNET) == leaves
    assert coastal.exits("203.0.113.2", src="10.10.2.2") == leaves


@pytest.mark.parametrize(
    ("world", "leaves"),
    [
        (World(), {"ether1"}),
        (World(silent=frozenset({"198.51.100.31", "198.51.100.32"})), {"ether2"}),
        (World(down=frozenset({"ether1"})), {"ether2"}),
    ],
)
def test_te4sea_fails_over(world: World, leaves: set[str]) -> None:
    assert Router(parsed("te4sea"), world).exits(INTERNET) == leaves


def test_probe_target_uses_its_own_link_or_the_blackhole() -> None:
    export = parsed("coastal")
    for canaries, port in ((PTP, "ether1"), (LTE, "ether2")):
        for canary in canaries:
            assert Router(export, World()).exits(canary) == {port}
            assert Router(export, World(down=frozenset({port}))).exits(canary) == {BLACKHOLE}


@pytest.mark.parametrize("site", SITES)
def test_every_probe_target_has_a_blackhole_route(site: str) -> None:
    rows = parsed(site).statements
    routes = [row for row in rows if row.menu == "/ip/route"]
    bearers = declaration().sites[site].bearers
    declared = {f"{canary}/32" for bearer in bearers for canary in bearer.canaries}
    held = {str(row.get("dst-address")): row for row in routes if row.get("blackhole") is not None}
    assert declared <= set(held)
    assert all((held[canary].get("distance"), held[canary].get("scope")) == ("254", "30") for canary in declared)
    watched = [str(row.get("host")) for row in rows if row.menu == "/tool/netwatch"]
    assert sorted(watched) == sorted(3 * [str(canary) for bearer in bearers[:-1] for canary in bearer.canaries])


def test_only_free_links_use_check_gateway() -> None:
    routes = [row for row in parsed("coastal").statements if row.menu == "/ip/route"]
    checks = {(row.get("check-gateway"), row.get("gateway")) for row in routes if row.get("check-gateway")}
    assert checks == {("ping", "198.51.100.11"), ("ping", "198.51.100.12"), ("arp", "10.10.1.1")}


def test_nothing_is_probed_over_the_satellite() -> None:
    rows = parsed("coastal").statements
    satellite = declaration().sites["coastal"].bearers[-1]
    asked = [row for row in rows if row.menu == "/tool/netwatch" or row.get("check-gateway")]
    words = " ".join(f"{row.get('host')} {row.get('gateway')} {row.get('dst-address')}" for row in asked)
    assert len(asked) == 16
    assert str(satellite.gateway) not in words


@pytest.mark.parametrize(
    ("hold_down_s", "fail_back_s"), [(20, 0), (20, 120), (21, 60), (45, 45), (200, 600), (600, 3600)]
)
@pytest.mark.parametrize("probe_s", [10, 30, 600])
def test_netwatch_intervals_meet_the_configured_times(hold_down_s: int, fail_back_s: int, probe_s: int) -> None:
    given = declaration()
    times = {"hold_down_s": hold_down_s, "fail_back_s": fail_back_s, "metered_probe_s": probe_s}
    failover = given.sites["coastal"].failover.model_copy(update=times)
    view = router_view(with_site(given, "coastal", failover=failover), given.router("coastal"))
    for link in view.probed_uplinks:
        judged = link.probing
        assert judged is not None
        starts_s = 3.0  # netwatch waits so long before a row begins (start-delay)
        silence_s = starts_s + (judged.silence - 1) * judged.silence_gap_s + 2 * judged.timeout_s
        assert hold_down_s <= silence_s <= hold_down_s + 10
        assert fail_back_s <= (judged.steady - 1) * judged.steady_gap_s <= fail_back_s + 1
        assert judged.watch_s == (probe_s if link.name == "4g" else 5)
        assert judged.silence <= 40
        assert judged.steady <= 60


def test_netwatch_reacts_before_check_gateway() -> None:
    for link in router_view(declaration(), declaration().router("coastal")).probed_uplinks:
        judged = link.probing
        assert judged is not None
        if judged.has_gateway_check:
            assert judged.watch_s + judged.timeout_s < 10 + 1  # two questions 10 s apart and a time-out


def test_link_is_probed_from_its_own_address_without_detour() -> None:
    export = parsed("coastal")
    ports = {"10.10.0.2": "ether1", "10.10.1.2": "ether2", "10.10.2.2": "ether3"}
    for address, port in ports.items():
        assert Router(export, World()).exits(INTERNET, src=address) == {port}
        assert Router(export, World(down=frozenset({port}))).exits(INTERNET, src=address) == set()
        assert Router(export, World()).exits("10.64.101.10", src=address) == {"ether8"}


@pytest.mark.parametrize("site", ["coastal", "te4sea"])
def test_vpn_networks_never_leave_unencrypted(site: str) -> None:
    export = parsed(site)
    for behind in ("10.80.0.1", "10.80.16.7", "10.64.0.10"):
        assert Router(export, World()).exits(behind) == {"ovpn-scc"}
        assert Router(export, World(down=frozenset({"ovpn-scc"}))).exits(behind) == {BLACKHOLE}


def test_control_centre_routes_vpn_networks_to_its_server() -> None:
    scc = Router(parsed("scc"), World())
    for behind in ("10.80.0.11", "10.80.20.1", "10.64.1.21", "10.64.2.10"):
        assert scc.exits(behind) == {"bridge-lan"}
    assert scc.exits("10.10.0.2", src="203.0.113.2") == {"ether2"}


def test_admitted_management_networks_of_other_sites_are_routed_too() -> None:
    given = declaration()
    management = given.sites["te4sea"].management
    admit = (*management.admit, given.sites["scc"].management.network)
    opened = with_site(given, "te4sea", management=management.model_copy(update={"admit": admit}))
    assert Router(parsed("te4sea", given), World()).exits("10.64.100.10") == {"ether1"}
    assert Router(parsed("te4sea", opened), World()).exits("10.64.100.10") == {"ovpn-scc"}


def test_any_link_order_and_probe_choice_fails_over_in_order() -> None:
    given = declaration()
    ports = {"wifi-ptp": "ether1", "4g": "ether2", "satellite": "ether3"}
    for order in permutations(given.sites["coastal"].bearers):
        for unprobed in (None, "wifi-ptp", "4g"):
            bearers = tuple(b.model_copy(update={"canaries": ()}) if b.name == unprobed else b for b in order)
            export = parsed("coastal", with_site(given, "coastal", bearers=bearers))
            lost: frozenset[str] = frozenset()
            for bearer in bearers:
                assert Router(export, World(down=lost)).exits(INTERNET) == {ports[bearer.name]}
                lost |= {ports[bearer.name]}
            assert Router(export, World(down=lost)).exits(INTERNET) == set()
