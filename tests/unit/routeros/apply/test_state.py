"""When two readings are the same state; and how a state is declared so that it can be put back."""

from collections.abc import Mapping

from atlantis_netcfg.core.versions import Version
from atlantis_netcfg.routeros._items import RunTime
from atlantis_netcfg.routeros._types import Action, Facts, Layer, Observation, Plan, Row, Verb
from atlantis_netcfg.routeros.apply._state import differing_menus, digest, find_invalid_rows, plan_hash, restore_target
from atlantis_netcfg.routeros.planner import plan, simulate

FACTS = Facts(
    "router", Version(7, 18, 2), "RB5009", "arm64", {}, (), frozenset({"sensitive"}), True, None, "10.0.0.2", 0
)
POOL, FILTER, VPN, ROUTE = "/ip/pool", "/ip/firewall/filter", "/interface/ovpn-client", "/ip/route"


def observed(**menus: tuple[Row, ...]) -> Observation:
    names = {
        "pool": POOL,
        "filter": FILTER,
        "vpn": VPN,
        "route": ROUTE,
        "ethernet": "/interface/ethernet",
        "note": "/system/note",
    }
    return Observation(FACTS, {names[name]: rows for name, rows in menus.items()})


def pool(name: str, **values: str) -> Mapping[str, str]:
    return {".id": "*1", "name": name, "ranges": "10.0.0.1-10.0.0.9", **values}


def rule(chain: str, **values: str) -> Mapping[str, str]:
    return {".id": "*1", "chain": chain, "action": "accept", **values}


def test_ids_defaults_and_dynamic_rows_are_ignored() -> None:
    one = observed(pool=(pool("a"), pool("b", dynamic="true")))
    other = observed(pool=({**pool("a"), ".id": "*77", "comment": "", "next-pool": "none"},))
    assert differing_menus(one, other) == ()
    assert digest(one) == digest(other)


def test_changed_values_and_rows_are_differences() -> None:
    one = observed(pool=(pool("a"),))
    assert differing_menus(one, observed(pool=(pool("a", comment="x"),))) == ("/ip pool",)
    assert differing_menus(one, observed(pool=(pool("a"), pool("b")))) == ("/ip pool",)
    assert differing_menus(one, observed()) == ("/ip pool",)
    assert digest(one) != digest(observed(pool=(pool("b"),)))


def test_order_matters_only_in_first_match_menus() -> None:
    assert differing_menus(observed(pool=(pool("a"), pool("b"))), observed(pool=(pool("b"), pool("a")))) == ()
    first, second, other = rule("input"), rule("input", protocol="tcp"), rule("forward")
    assert differing_menus(observed(filter=(first, second)), observed(filter=(second, first))) == (
        "/ip firewall filter",
    )
    assert differing_menus(observed(filter=(first, other, second)), observed(filter=(other, first, second))) == ()


def test_named_runtime_changes_of_our_rows_are_no_difference() -> None:
    """A link is given up between two readings: nobody else was there."""
    moves = (RunTime(ROUTE, "distance", "10", "110"),)

    def route(distance: str, comment: str = "atlantis: 4g") -> Observation:
        return observed(route=({".id": "*1", "dst-address": "0.0.0.0/0", "distance": distance, "comment": comment},))

    assert differing_menus(route("10"), route("110"), moves) == differing_menus(route("110"), route("10"), moves) == ()
    assert differing_menus(route("10"), route("110")) == ("/ip route",)
    assert differing_menus(route("10"), route("20"), moves) == ("/ip route",)
    assert differing_menus(route("10", "mine"), route("110", "mine"), moves) == ("/ip route",), "a row of somebody else"


def test_secrets_are_compared_and_never_hashed() -> None:
    one, other = ({".id": "*1", "name": "vpn", "password": secret} for secret in ("hush", "shout"))
    assert differing_menus(observed(vpn=(one,)), observed(vpn=(other,))) == ("/interface ovpn-client",)
    assert digest(observed(vpn=(one,))) == digest(observed(vpn=(other,)))


def test_plan_hash_ignores_secrets() -> None:
    def made(secret: str, subject: str = "vpn") -> Plan:
        values = (("name", "vpn"), ("password", secret))
        action = Action(1, Layer.ATTACHMENT, VPN, Verb.ADD, subject, values=values, secrets=frozenset({"password"}))
        return Plan("router", (action,), "")

    assert plan_hash(made("hush")) == plan_hash(made("shout"))
    assert plan_hash(made("hush")) != plan_hash(made("hush", "another"))


def test_our_invalid_rows_are_listed() -> None:
    rows = (
        rule("input", invalid="true", comment="atlantis: ours"),
        rule("input", invalid="true", comment="theirs"),
        rule("input", invalid="false", comment="atlantis: fine"),
        rule("input", comment="atlantis: off", **{".about": "inactivated, not allowed by device-mode"}),
    )
    assert len(find_invalid_rows(observed(filter=rows))) == 2
    assert "inactivated, not allowed by device-mode" in find_invalid_rows(observed(filter=rows))[1]


def test_restored_state_equals_the_original() -> None:
    before = observed(
        pool=(pool("a", comment="atlantis: a"), pool("b")),
        filter=(rule("input", comment="one"), rule("input", **{"in-interface": "ether1"}), rule("forward")),
        ethernet=({".id": "*1", "default-name": "ether1", "name": "ether1"},),
        note=({"note": ""},),
    )
    now = observed(
        pool=({**pool("b"), ".id": "*2"}, {**pool("c"), ".id": "*3"}),
        filter=({**rule("forward"), ".id": "*4"}, {**rule("input", comment="other"), ".id": "*5"}),
        ethernet=({".id": "*1", "default-name": "ether1", "name": "wan", "comment": "atlantis: link"},),
        note=({"note": "hello"},),
    )
    rows = simulate(now.rows, plan("router", restore_target(before), now))
    assert differing_menus(before, Observation(FACTS, rows)) == ()
