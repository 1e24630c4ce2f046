"""Which rows lead and count the test packets, and what is concluded from what the router counted."""

import asyncio
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import cast

import pytest

from atlantis_netcfg.core.errors import DeviceError
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.links.qualify.measured_run import LinkCount
from atlantis_netcfg.operations.allow_list_test.plan import MARK
from atlantis_netcfg.operations.qualify import routing
from atlantis_netcfg.routeros.api import Command, Reply, Session

FLOW = routing.MeasuredFlow("10.64.101.10", 40000, "203.0.113.2", 862)
LINKS = {"ether1": "wifi", "ether2": "4g"}


@dataclass
class CountingRouter:
    """Answers two questions: the counting rows, and the ports."""

    counted: list[dict[str, str]] = field(default_factory=list)
    ports: list[dict[str, str]] = field(default_factory=list)

    async def flight(self, commands: Sequence[Command]) -> list[Reply]:
        assert [command.path for command in commands] == ["/ip/firewall/mangle/print", "/interface/print"]
        assert commands[0].queries == (f"?comment={MARK}",)
        return [Reply(rows=tuple(self.counted)), Reply(rows=tuple(self.ports))]


def read(router: CountingRouter) -> routing.FlowCounts:
    return asyncio.run(routing.counters(cast("Session", router)))


def test_rule_routes_only_the_flow_and_counts_it_on_each_port() -> None:
    there = Reply(rows=({".id": "*9", "dynamic": "true"}, {".id": "*A"}, {".id": "*B"}))
    rule, *counting = routing.rows(FLOW, "4g", ["ether1", "ether2"], there, Reply())
    assert (rule.path, dict(rule.arguments)) == (
        "/routing/rule/add",
        {
            "action": "lookup-only-in-table",
            "comment": MARK,
            "src-address": "10.64.101.10/32",
            "dst-address": "203.0.113.2/32",
            "table": "via-4g",
            "place-before": "*A",
        },
    )
    told = [dict(command.arguments) for command in counting]
    assert all(command.path == "/ip/firewall/mangle/add" for command in counting)
    assert [(row.get("out-interface"), row.get("in-interface")) for row in told] == [
        ("ether1", None),
        (None, "ether1"),
        ("ether2", None),
        (None, "ether2"),
    ]
    assert {(row["action"], row["chain"], row["comment"], row["protocol"]) for row in told} == {
        ("passthrough", "forward", MARK, "udp")
    }
    assert [(row["src-address"], row["src-port"], row["dst-address"], row["dst-port"]) for row in told[:2]] == [
        ("10.64.101.10", "40000", "203.0.113.2", "862"),
        ("203.0.113.2", "862", "10.64.101.10", "40000"),
    ]


def test_tunnel_is_routed_and_counted_regardless_of_its_port() -> None:
    tunnel = routing.MeasuredFlow("10.64.101.10", None, "203.0.113.2", 1194)
    rule, up, down = routing.rows(tunnel, "4g", ["ether2"], Reply(), Reply())
    assert dict(rule.arguments)["dst-address"] == "203.0.113.2/32"
    told = [
        {name: value for name, value in row.arguments if name.endswith(("-port", "-address"))} for row in (up, down)
    ]
    assert told == [
        {"src-address": "10.64.101.10", "dst-address": "203.0.113.2", "dst-port": "1194"},
        {"src-address": "203.0.113.2", "src-port": "1194", "dst-address": "10.64.101.10"},
    ]


def test_counts_are_reported_by_link() -> None:
    ports = [{"name": "radio", "default-name": "ether1", "rx-byte": "100", "tx-byte": "50"}]
    before = read(CountingRouter(ports=ports))
    counted = [
        {"out-interface": "ether1", "packets": "7", "bytes": "980"},
        {"in-interface": "ether1", "packets": "6", "bytes": "840"},
        {"out-interface": "ether2", "packets": "0", "bytes": "0"},
        {"in-interface": "ether2", "packets": "0", "bytes": "0"},
    ]
    after = read(CountingRouter(counted, [{**ports[0], "rx-byte": "1100", "tx-byte": "1250"}]))
    wifi, mobile = routing.link_counts(LINKS, before, after)
    assert wifi == LinkCount(
        link="wifi",
        test_packets_up=7,
        test_bytes_up=980,
        test_packets_down=6,
        test_bytes_down=840,
        port_bytes_up=1200,
        port_bytes_down=1000,
    )
    assert (mobile.test_packets_up, mobile.port_bytes_up) == (0, None)
    assert routing.link_counts(LINKS, before, None) == (LinkCount(link="wifi"), LinkCount(link="4g"))
    assert routing.link_counts(LINKS, after, before)[0].port_bytes_up is None, "a counter that began anew tells nothing"


def test_row_without_a_count_is_an_error() -> None:
    with pytest.raises(DeviceError, match="no count"):
        read(CountingRouter([{"out-interface": "ether1"}]))


def judged(
    wifi: tuple[int | None, int | None], mobile: tuple[int, int], sent: int, received: int, lost: int = 0
) -> tuple[Verdict, str]:
    both = {"wifi": wifi, "4g": mobile}
    counts = [LinkCount(link=link, test_packets_up=up, test_packets_down=down) for link, (up, down) in both.items()]
    return routing.judge_way("wifi", counts, sent, received, lost)


@pytest.mark.parametrize(
    ("wifi", "mobile", "sent", "received", "lost", "verdict"),
    [
        ((100, 100), (0, 0), 100, 100, 0, Verdict.PASS),
        ((100, 95), (0, 0), 100, 90, 10, Verdict.PASS),
        ((100, 0), (0, 0), 100, 0, 100, Verdict.PASS),
        ((99, 99), (1, 0), 100, 99, 1, Verdict.FAIL),
        ((100, 99), (0, 1), 100, 100, 0, Verdict.FAIL),
        ((0, 0), (100, 100), 100, 100, 0, Verdict.FAIL),
        ((0, 0), (0, 0), 100, 100, 0, Verdict.FAIL),
        ((0, 0), (0, 0), 0, 0, 0, Verdict.INCONCLUSIVE),
        ((0, 0), (0, 0), 100, 0, 50, Verdict.INCONCLUSIVE),
        ((90, 90), (0, 0), 100, 90, 0, Verdict.INCONCLUSIVE),
        ((130, 100), (0, 0), 100, 100, 0, Verdict.INCONCLUSIVE),
        ((100, 90), (0, 0), 100, 100, 0, Verdict.INCONCLUSIVE),
        ((100, 120), (0, 0), 100, 100, 0, Verdict.INCONCLUSIVE),
        ((None, None), (0, 0), 100, 100, 0, Verdict.INCONCLUSIVE),
    ],
)
def test_route_is_proved_by_router_counters(  # noqa: PLR0913, PLR0917 - a case
    wifi: tuple[int | None, int | None], mobile: tuple[int, int], sent: int, received: int, lost: int, verdict: Verdict
) -> None:
    assert judged(wifi, mobile, sent, received, lost)[0] is verdict


@pytest.mark.parametrize(
    ("mobile", "wifi", "sent", "received", "verdict"),
    [
        ((100, 100), (0, 0), 100, 100, Verdict.PASS),
        ((140, 130), (0, 0), 100, 100, Verdict.PASS),
        ((100, 100), (0, 2), 100, 100, Verdict.PASS),
        ((100, 0), (0, 9), 100, 0, Verdict.PASS),
        ((100, 100), (1, 0), 100, 100, Verdict.FAIL),
        ((100, 100), (0, 3), 100, 100, Verdict.FAIL),
        ((0, 0), (0, 0), 100, 100, Verdict.FAIL),
        ((90, 90), (0, 0), 100, 90, Verdict.INCONCLUSIVE),
        ((100, 90), (0, 0), 100, 100, Verdict.INCONCLUSIVE),
        ((50, 50), (0, 0), 0, 0, Verdict.INCONCLUSIVE),
        ((None, None), (0, 0), 100, 100, Verdict.INCONCLUSIVE),
    ],
)
def test_tunnel_proves_the_route_only_when_all_traffic_used_it(
    mobile: tuple[int | None, int | None], wifi: tuple[int, int], sent: int, received: int, verdict: Verdict
) -> None:
    counts = [tunnel_count("wifi", *wifi), tunnel_count("4g", *mobile)]
    assert (
        routing.judge_tunnel(
            "4g", counts, routing.TunnelTraffic(sent, sent * 192), routing.TunnelTraffic(received, received * 192)
        )[0]
        is verdict
    )


def tunnel_count(link: str, up: int | None, down: int | None, octets: int = 192) -> LinkCount:
    return LinkCount(
        link=link,
        test_packets_up=up,
        test_bytes_up=None if up is None else up * octets,
        test_packets_down=down,
        test_bytes_down=None if down is None else down * octets,
    )


def test_equally_many_shorter_packets_prove_nothing() -> None:
    """The tunnel's own pings are packets of it as well."""
    traffic = routing.TunnelTraffic(100, 19_200)
    assert routing.judge_tunnel("4g", [tunnel_count("4g", 100, 100, 80)], traffic, traffic)[0] is Verdict.INCONCLUSIVE
