"""Which routes are active: distance, scopes, recursion, tables (Manual, IP Routing)."""

from twin_bench import Bench, make

from atlantis_netcfg.emulator.routeros.values import spell

LINKS = """\
/ip address add address=10.10.0.2/30 interface=ether1
/ip address add address=10.10.1.2/30 interface=ether2
/ip route add dst-address=198.51.100.1/32 gateway=10.10.0.1 scope=10 comment=canary
/ip route add dst-address=198.51.100.1/32 blackhole distance=254 comment=hole
/ip route add gateway=198.51.100.1 target-scope=11 comment=first
/ip route add gateway=10.10.1.1 distance=2 comment=second
"""


def active(router: Bench, comment: str) -> str | None:
    return router.value("/ip/route", "active", f"?comment={comment}")


def test_recursive_route_through_the_probe_target() -> None:
    router = make()
    router.script(LINKS)
    assert active(router, "canary") == "true"
    assert active(router, "hole") == "false"
    assert active(router, "first") == "true"
    assert active(router, "second") == "false"
    assert router.value("/ip/route", "immediate-gw", "?comment=first") == "10.10.0.1%ether1"


def test_dead_link_fails_over_to_the_second_link() -> None:
    router = make()
    router.script(LINKS + "/interface ethernet disable ether1")
    assert active(router, "canary") == "false"
    assert active(router, "hole") == "true"
    assert active(router, "first") == "false"
    assert active(router, "second") == "true"


def test_scopes_decide_which_gateways_are_valid() -> None:
    router = make()
    router.script(LINKS + "/ip route\nset [find comment=first] target-scope=10\nset [find comment=canary] scope=30")
    assert active(router, "first") == "false"
    assert active(router, "second") == "true"


def test_equal_distance_is_ecmp() -> None:
    router = make()
    router.script(LINKS + "/ip route set [find comment=second] distance=1")
    assert active(router, "first") == "true"
    assert active(router, "second") == "true"


def test_gateway_with_routing_table_and_vrf() -> None:
    router = make()
    router.script(
        LINKS + "/routing table add fib name=via-2\n"
        "/ip route add gateway=10.10.1.1@main routing-table=via-2 comment=pinned\n"
    )
    assert active(router, "pinned") == "true"
    assert router.value("/ip/route", "gateway", "?comment=pinned") == "10.10.1.1@main"
    router.say("/routing/table/disable", "=.id=via-2")
    assert active(router, "pinned") == "false"
    router.say("/routing/table/remove", "=.id=via-2")
    assert (router.value("/ip/route", "routing-table", "?comment=pinned") or "").startswith("*")


def test_interfaces_as_gateways() -> None:
    router = make()
    router.script(
        "/ip route add dst-address=10.5.0.0/16 gateway=ether3 comment=up\n"
        "/interface ovpn-client add name=vpn connect-to=a.example user=u disabled=no\n"
        "/ip route add dst-address=10.6.0.0/16 gateway=vpn comment=down\n"
        "/ip route add dst-address=10.7.0.0/16 gateway=10.9.9.9%ether4 comment=both\n"
    )
    assert active(router, "up") == "true"
    assert active(router, "down") == "false"
    assert active(router, "both") == "true"
    assert router.value("/ip/route", "gateway", "?comment=both") == "10.9.9.9%ether4"


def test_connected_routes_follow_their_address() -> None:
    router = make()
    router.script(LINKS)
    query = "?dst-address=10.10.0.0/30"
    number = router.value("/ip/route", ".id", query)
    assert router.value("/ip/route", "connect", query) == "true"
    assert router.value("/ip/route", "distance", query) == "0"
    router.say("/interface/disable", "=.id=ether1")
    assert router.value("/ip/route", "active", query) == "false"
    router.say("/interface/enable", "=.id=ether1")
    assert router.value("/ip/route", ".id", query) == number


def test_dangling_reference_is_printed_as_id() -> None:
    class Nobody:
        def id_of(self, space: str, name: str) -> int | None:
            return None if (space, name) else 0

        def name_of(self, space: str, number: int) -> str | None:
            return None if (space, number) else ""

    assert spell("!\x01list:1F\x02,x", Nobody()) == "!*1F,x"
