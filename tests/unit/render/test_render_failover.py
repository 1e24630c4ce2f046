"""Where the rendered routes lead while links fail."""

from __future__ import annotations

from itertools import permutations

import pytest
from render_declared import SITES, declaration, with_site
from render_routes import BLACKHOLE, Router, World
from test_render_text import parsed

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
        (World(silent=PTP | LTE, down=frozenset({"ether3"})), set()),
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


def test_a_canary_answers_over_its_own_link_or_not_at_all() -> None:
    export = parsed("coastal")
    for canaries, port in ((PTP, "ether1"), (LTE, "ether2")):
        for canary in canaries:
            assert Router(export, World()).exits(canary) == {port}
            assert Router(export, World(down=frozenset({port}))).exits(canary) == {BLACKHOLE}


@pytest.mark.parametrize("site", SITES)
def test_every_canary_has_its_blackhole(site: str) -> None:
    routes = [row for row in parsed(site).statements if row.menu == "/ip/route"]
    probed = {f"{row.get('gateway')}/32" for row in routes if row.get("check-gateway") == "ping"}
    declared = {f"{canary}/32" for bearer in declaration().sites[site].bearers for canary in bearer.canaries}
    held = {str(row.get("dst-address")): row for row in routes if row.get("blackhole") is not None}
    assert probed == declared
    assert probed <= set(held)
    assert all((held[canary].get("distance"), held[canary].get("scope")) == ("254", "30") for canary in probed)


def test_a_link_is_probed_from_its_own_address_and_has_no_way_round() -> None:
    export = parsed("coastal")
    ports = {"10.10.0.2": "ether1", "10.10.1.2": "ether2", "10.10.2.2": "ether3"}
    for address, port in ports.items():
        assert Router(export, World()).exits(INTERNET, src=address) == {port}
        assert Router(export, World(down=frozenset({port}))).exits(INTERNET, src=address) == set()
        assert Router(export, World()).exits("10.64.101.10", src=address) == {"ether8"}


@pytest.mark.parametrize("site", ["coastal", "te4sea"])
def test_what_is_behind_the_vpn_never_leaves_in_the_clear(site: str) -> None:
    export = parsed(site)
    for behind in ("10.80.0.1", "10.80.16.7", "10.64.0.10"):
        assert Router(export, World()).exits(behind) == {"ovpn-scc"}
        assert Router(export, World(down=frozenset({"ovpn-scc"}))).exits(behind) == {BLACKHOLE}


def test_control_centre_sends_what_is_behind_the_vpn_to_its_server() -> None:
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


def test_any_order_of_preference_and_any_choice_of_probes() -> None:
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
