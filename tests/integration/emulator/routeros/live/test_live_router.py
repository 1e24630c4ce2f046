"""What an attached router says of its own packets, and of those that others send through it."""

import os
import re
import socket
from collections.abc import Iterator

import pytest
from live_stage import PROBE_TARGETS, STRANGER, TIME_SERVER, LiveStage, live_site
from waiting import wait_until

from atlantis_netcfg.core.errors import NetcfgError

pytestmark = [
    pytest.mark.namespace,
    pytest.mark.skipif(os.geteuid() != 0, reason="making a network namespace needs root"),
]
ADDRESS = "10.10.0.2"
"""Of the router on its link `wifi-ptp`."""
PING_ROW = "ping over wifi-ptp, to test it"


@pytest.fixture(scope="module")
def stage(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LiveStage]:
    with live_site(tmp_path_factory.mktemp("live")) as made:
        yield made


def ping(stage: LiveStage, address: str, *words: str) -> list[dict[str, str]]:
    return stage.rows("/tool/ping", f"=address={address}", *words)


def test_ping_shows_time_and_ttl_of_the_reply(stage: LiveStage) -> None:
    stage.run("wifi-ptp", "sysctl", "-qw", "net.ipv4.ip_default_ttl=33")
    first, second = ping(stage, STRANGER, "=count=2")
    assert (first["ttl"], second["received"], second["packet-loss"]) == ("33", "2", "0")
    for row in (first, second):
        assert re.fullmatch(r"\d+us|\d+ms(\d+us)?", row["time"])
        assert row["time"] != "1ms"


def test_ping_over_a_silent_link_times_out_and_comes_back(stage: LiveStage) -> None:
    stage.silence("wifi-ptp", STRANGER)
    before = stage.packets("answers")
    first, second = ping(stage, STRANGER, "=count=2")
    assert [(row.get("status"), row["packet-loss"]) for row in (first, second)] == [("timeout", "100")] * 2
    assert stage.packets("answers") == before
    stage.silence("wifi-ptp")
    assert [row["received"] for row in ping(stage, STRANGER, "=count=2")] == ["1", "2"]
    assert stage.packets("answers") == before + 2


def test_ping_from_the_satellite_is_dropped_by_its_own_filter(stage: LiveStage) -> None:
    before = stage.packets("satellite, everything else")
    assert ping(stage, STRANGER, "=src-address=10.10.2.2", "=count=3")[-1]["received"] == "0"
    assert stage.packets("satellite, everything else") == before + 3


def test_counters_survive_a_change_of_the_firewall(stage: LiveStage) -> None:
    (before,) = stage.rows("/interface/print", "=stats=", "?default-name=ether1")
    start = stage.packets(PING_ROW)
    stage.run("wifi-ptp", *f"ping -c 3 -i 0.01 {ADDRESS}".split())
    # Connections are tracked: the row meets the first packet of three.
    assert stage.packets(PING_ROW) == start + 1
    stage.console("/ip/firewall/filter/set", f"=numbers={number(stage, 'invalid')}", "=log=yes")
    stage.console("/ip/firewall/filter/set", f"=numbers={number(stage, 'invalid')}", "=log=no")
    assert stage.packets(PING_ROW) == start + 1
    stage.run("wifi-ptp", *f"ping -c 2 -i 0.01 {ADDRESS}".split())
    assert stage.packets(PING_ROW) == start + 2
    (after,) = stage.rows("/interface/print", "=stats=", "?default-name=ether1")
    grown = [int(after[name]) - int(before[name]) for name in ("rx-byte", "tx-byte")]
    assert [5 * 98 <= count < 5 * 98 + 500 for count in grown] == [True, True], grown


def number(stage: LiveStage, comment: str) -> str:
    (row,) = stage.rows("/ip/firewall/filter/print", f"?comment=atlantis: {comment}", "?chain=input")
    return row[".id"]


def test_new_row_begins_at_zero(stage: LiveStage) -> None:
    row = ("/ip/firewall/raw/add", "=chain=prerouting", "=action=accept", "=protocol=icmp", "=comment=atlantis: new")
    for _ in range(2):
        stage.do("console", words=list(row))
        assert stage.packets("new", "/ip/firewall/raw") == 0
        stage.run("wifi-ptp", *f"ping -c 3 -i 0.01 {ADDRESS}".split())
        assert stage.packets("new", "/ip/firewall/raw") == 3
        (stored,) = stage.rows("/ip/firewall/raw/print", "?comment=atlantis: new")
        stage.console("/ip/firewall/raw/remove", f"=numbers={stored['.id']}")


def time_client(stage: LiveStage) -> dict[str, str]:
    (row,) = stage.rows("/system/ntp/client/print")
    return row


def test_time_client_asks_as_soon_as_it_is_enabled(stage: LiveStage) -> None:
    with stage.socket("wifi-ptp", socket.SOCK_DGRAM, (TIME_SERVER, 123)) as server:
        stage.console("/system/ntp/client/set", "=enabled=no")
        stage.console("/system/ntp/client/set", "=enabled=yes")
        request, client = server.recvfrom(100)
        assert (len(request), request[0] & 7, client[0]) == (48, 3, ADDRESS)
        assert time_client(stage)["status"] == "waiting"
        server.sendto(bytes(48), client)
        wait_until(lambda: "synced-server" in time_client(stage), lambda: str(time_client(stage)))
        assert time_client(stage)["synced-server"] == TIME_SERVER


def status(stage: LiveStage, port: int) -> str:
    """What a row of netwatch that opens a connection says after one test."""
    where = ("=type=tcp-conn", f"=host={STRANGER}", f"=port={port}", "=interval=10s", "=timeout=800ms")
    stage.console("/tool/netwatch/add", *where, "=start-delay=0s", "=comment=a connection")
    stage.do("wait", seconds=5)
    (row,) = stage.rows("/tool/netwatch/print", "?comment=a connection")
    stage.console("/tool/netwatch/remove", f"=numbers={row['.id']}")
    return row["status"]


def test_netwatch_opens_tcp_connections(stage: LiveStage) -> None:
    with stage.socket("wifi-ptp", socket.SOCK_STREAM, (STRANGER, 443)) as server:
        server.listen()
        assert status(stage, 443) == "up"
        assert status(stage, 444) == "down"
        stage.silence("wifi-ptp", STRANGER)
        assert status(stage, 443) == "down"
        stage.silence("wifi-ptp")


def test_configuration_is_applied_when_the_command_has_ended(stage: LiveStage) -> None:
    stage.console("/ip/address/add", "=address=10.99.0.1/24", "=interface=ether1")
    assert "10.99.0.1/24" in stage.run("router", "ip", "-br", "address")
    (row,) = stage.rows("/ip/address/print", "?address=10.99.0.1/24")
    stage.console("/ip/address/remove", f"=numbers={row['.id']}")
    assert "10.99.0.1/24" not in stage.run("router", "ip", "-br", "address")


def test_router_that_is_attached_again_goes_on(stage: LiveStage) -> None:
    stage.do("attach", namespace=None)
    assert ping(stage, STRANGER, "=count=1")[0].get("status") == "timeout"  # in thought, nobody answers there
    for again in ("attach", "restart"):
        stage.do(again, **({"namespace": stage.name("router")} if again == "attach" else {}))
        assert ping(stage, STRANGER, "=count=1")[0]["received"] == "1"


def test_router_that_is_detached_drops_the_probes_that_wait_for_a_response(stage: LiveStage) -> None:
    stage.silence("wifi-ptp", *PROBE_TARGETS["wifi-ptp"])
    for _ in range(10):  # one of these moments is within the timeout of a probe
        stage.wait(1)
        stage.do("attach", namespace=None)
        stage.wait(2)
        stage.do("attach", namespace=stage.name("router"))
    stage.silence("wifi-ptp")
    assert ping(stage, STRANGER, "=count=1")[0]["received"] == "1"


def test_counters_begin_at_zero_after_a_reboot(stage: LiveStage) -> None:
    stage.run("wifi-ptp", *f"ping -c 1 {ADDRESS}".split())
    assert stage.packets(PING_ROW) > 0
    stage.do("reboot")
    assert stage.packets(PING_ROW) == 0
    stage.run("wifi-ptp", *f"ping -c 1 {ADDRESS}".split())
    assert stage.packets(PING_ROW) == 1


def test_namespace_that_does_not_exist_is_refused(stage: LiveStage) -> None:
    with pytest.raises(NetcfgError, match="there is no network namespace nowhere"):
        stage.do("attach", namespace="nowhere")
    stage.do("attach", namespace=stage.name("router"))
