"""Packets that somebody else has carried: the router leads and counts them by its own rows, right or wrong."""

from typing import Any

import pytest
from twin_bench import TECHNICIAN, Bench, row

from atlantis_netcfg.emulator.routeros.network.traffic import carry
from atlantis_netcfg.emulator.routeros.spec import RouterSpec

FAR = "203.0.113.2"
ROWS = (
    "/ip/address/add address=10.10.1.2/29 interface=ether2",
    "/ip/address/add address=10.10.2.2/29 interface=ether3",
    "/routing/table/add name=via-sat fib",
    "/ip/route/add dst-address=0.0.0.0/0 gateway=10.10.1.1",
    "/ip/route/add dst-address=0.0.0.0/0 gateway=10.10.2.1@main routing-table=via-sat",
    "/ip/firewall/filter/add chain=forward action=accept",
)
LED = f"/routing/rule/add action=lookup-only-in-table src-address={TECHNICIAN}/32 dst-address={FAR}/32 table=via-sat"
FLOW = f"protocol=udp src-address={TECHNICIAN} src-port=40000 dst-address={FAR} dst-port=862"
BACK = f"protocol=udp src-address={FAR} src-port=862 dst-address={TECHNICIAN} dst-port=40000"


def bench(*more: str) -> Bench:
    made = Bench(RouterSpec(name="router"))
    for command in (*ROWS, *more):
        made.script(command)
    for port in ("ether2", "ether3"):
        made.script(f"/ip/firewall/mangle/add chain=forward action=passthrough out-interface={port} {FLOW}")
        made.script(f"/ip/firewall/mangle/add chain=forward action=passthrough in-interface={port} {BACK}")
    assert made.count("/ip/firewall/mangle") == 4
    return made


def carried(made: Bench, target_port: int = 862) -> dict[str, Any]:
    return carry(made.device.core, TECHNICIAN, 40000, FAR, target_port, (7, 980), (6, 840))


def counter(made: Bench, menu: str, name: str, query: str) -> str:
    """`print` tells counters where they are asked for."""
    found = [row(answer) for answer in made.device.run(made.caller, [f"{menu}/print", f"=.proplist={name}", query])]
    return found[0][name]


def counted(made: Bench) -> dict[str, tuple[str, str]]:
    return {
        port: (
            counter(made, "/ip/firewall/mangle", "packets", f"?out-interface={port}"),
            counter(made, "/ip/firewall/mangle", "packets", f"?in-interface={port}"),
        )
        for port in ("ether2", "ether3")
    }


def test_rule_routes_flow_over_other_link_where_it_is_counted() -> None:
    made = bench(LED)
    assert carried(made) == {"port": "ether3", "passed": True}
    assert counted(made) == {"ether2": ("0", "0"), "ether3": ("7", "6")}
    assert counter(made, "/ip/firewall/mangle", "bytes", "?out-interface=ether3") == "980"
    assert counter(made, "/interface", "tx-byte", "?name=ether3") == "980"
    assert counter(made, "/interface", "rx-byte", "?name=ether3") == "840"


def test_without_rule_flow_uses_the_best_link_and_is_counted_there() -> None:
    made = bench()
    assert carried(made)["port"] == "ether2"
    assert counted(made) == {"ether2": ("7", "6"), "ether3": ("0", "0")}


def test_another_flow_is_not_counted() -> None:
    made = bench(LED)
    assert carried(made, target_port=863)["port"] == "ether3"
    assert counted(made) == {"ether2": ("0", "0"), "ether3": ("0", "0")}


@pytest.mark.parametrize(("match", "down"), [("out-interface=ether3", "0"), ("in-interface=ether3", "6")])
def test_mangle_counts_packets_that_the_filter_drops(match: str, down: str) -> None:
    made = bench(LED)
    made.script(f"/ip/firewall/filter/add chain=forward action=drop {match} place-before=0")
    assert carried(made) == {"port": "ether3", "passed": False}
    assert counted(made)["ether3"] == ("7", down)


def test_nothing_passes_without_a_route() -> None:
    made = bench(f"/routing/rule/add action=unreachable dst-address={FAR}/32", LED)
    assert carried(made) == {"port": None, "passed": False}
    assert counted(made) == {"ether2": ("0", "0"), "ether3": ("0", "0")}
