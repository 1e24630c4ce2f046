"""The sites joined: packets from a LAN through its router, a link, an operator and the internet, and back."""

import os
import re
import socket
import struct
import time
from collections.abc import Iterator
from ipaddress import IPv4Address

import pytest
from flows_bench import SITES, inventory, rows
from waiting import HANG_S

from atlantis_netcfg.emulator.lab.hosts import MachineError, NamespaceSockets
from atlantis_netcfg.emulator.routeros.dataplane.namespace import RouterNamespace
from atlantis_netcfg.inventory import Host
from atlantis_netcfg.operations.flows.intent import RouterIntent
from atlantis_netcfg.operations.pilot_network import link_watch
from atlantis_netcfg.operations.pilot_network.network import PilotNetwork, open_network

pytestmark = [
    pytest.mark.namespace,
    pytest.mark.skipif(os.geteuid() != 0, reason="making a network namespace needs root"),
]
DECLARED = inventory()
COASTAL = DECLARED.hosts["coastal-router"]
TIME_SERVER = str(DECLARED.pilot.time_servers[0].address)
SATELLITE = next(link for link in DECLARED.sites["coastal"].bearers if link.kind.traits.allow_list)
CHECKED_OVER_ONE_LINK = {address for link in DECLARED.sites["coastal"].bearers for address in link.canaries}


class Stand:
    """The network, whose routers are at the rows of their rendered texts."""

    def __init__(self) -> None:
        self.states = {f"{site}-router": rows(DECLARED, site) for site in SITES}
        self.routers: dict[str, RouterNamespace] = {}
        self.network: PilotNetwork
        self.gateway = ""

    def attach(self, host: Host, namespace: str) -> None:
        self.routers[host.name] = RouterNamespace(namespace)
        self.use(host, DECLARED.sites[host.site].bearers[0].name)

    def use(self, host: Host, name: str) -> None:
        link = next(link for link in DECLARED.sites[host.site].bearers if link.name == name)
        port = RouterIntent(DECLARED, host, link).link_ports[name]
        self.routers[host.name].apply(self.states[host.name].with_default_route(link.gateway, port))

    def ping(self, namespace: str, address: str) -> float | None:
        """The round trip in seconds; None without an answer."""
        try:
            text = self.network.run(namespace, "ping", "-c", "1", "-W", "3", address)
        except MachineError:
            return None
        result = re.search(r"time=([0-9.]+) ms", text)
        assert result is not None, text
        return float(result[1]) / 1000


@pytest.fixture(scope="module")
def stand() -> Iterator[Stand]:
    result = Stand()
    with open_network(DECLARED, [DECLARED.hosts[name] for name in result.states], result.attach) as network:
        result.network = network
        result.gateway = network.add_host(COASTAL, "gateway", IPv4Address("10.64.1.10"))
        yield result


@pytest.mark.parametrize(("link", "least_s"), [("wifi-ptp", 0.004), ("4g", 0.06), ("satellite", 0.7)])
def test_each_link_carries_with_its_own_delay(stand: Stand, link: str, least_s: float) -> None:
    stand.use(COASTAL, link)
    before = {name: each.up.delivered_bytes for (_, name), each in stand.network.links.items()}
    round_trip_s = stand.ping(stand.gateway, TIME_SERVER)
    if link == "satellite":  # its allow-list: time servers for NTP alone
        assert round_trip_s is None
        round_trip_s = _ask_time(stand)
    assert round_trip_s is not None
    assert round_trip_s >= least_s
    carried = {name for (_, name), each in stand.network.links.items() if each.up.delivered_bytes > before[name]}
    assert link in carried


def test_a_cut_link_is_silent_until_it_is_mended(stand: Stand) -> None:
    stand.use(COASTAL, "4g")
    carrier = stand.network.links["coastal", "4g"]
    assert stand.ping(stand.gateway, TIME_SERVER) is not None
    carrier.is_up = False
    assert stand.ping(stand.gateway, TIME_SERVER) is None
    carrier.is_up = True
    assert stand.ping(stand.gateway, TIME_SERVER) is not None


def test_the_server_sees_the_operator_and_not_the_site(stand: Stand) -> None:
    stand.use(COASTAL, "4g")
    inside = NamespaceSockets(stand.network.namespace("net"))
    server = inside.socket(socket.SOCK_DGRAM)
    server.bind(("198.51.100.21", 5000))
    server.settimeout(5)
    here = NamespaceSockets(stand.gateway)
    client = here.socket(socket.SOCK_DGRAM)
    client.sendto(b"who is it", ("198.51.100.21", 5000))
    data, (address, _) = server.recvfrom(100)
    assert data == b"who is it"
    assert address.startswith("198.18.")
    for each in (server, client):
        each.close()
    inside.close()
    here.close()


def test_nobody_in_the_internet_reaches_a_lan(stand: Stand) -> None:
    stand.use(COASTAL, "wifi-ptp")
    stand.network.run(stand.network.namespace("net"), "ip", "route", "add", "10.64.0.0/16", "via", "203.0.113.2")
    assert stand.ping(stand.network.namespace("net"), "10.64.0.10") is None
    assert stand.ping(stand.network.namespace("net"), "10.64.1.10") is None


def _ask_time(stand: Stand) -> float:
    """Send an SNTP request from the gateway; the answer must have our own time, and comes after so many seconds."""
    inside = NamespaceSockets(stand.gateway)
    client = inside.socket(socket.SOCK_DGRAM)
    client.settimeout(5)
    begin = time.monotonic()
    client.sendto(bytes([0x23, *bytes(39), *b"ourstamp"]), (TIME_SERVER, 123))
    data = client.recv(100)
    took_s = time.monotonic() - begin
    assert data[24:32] == b"ourstamp"
    (seconds,) = struct.unpack("!I", data[40:44])
    assert abs(seconds - 2_208_988_800 - time.time()) < 2
    client.close()
    inside.close()
    return took_s


def test_a_satellite_carries_only_what_its_allow_list_has(stand: Stand) -> None:
    stand.use(COASTAL, SATELLITE.name)
    with link_watch.watch_link(stand.network.links["coastal", SATELLITE.name]) as watch:
        assert link_watch.send_strangers(stand.network, COASTAL, SATELLITE) > 2 * len(stand.network.servers)
        _ask_time(stand)
    assert set(watch.counts) == {link_watch.Destination("udp", IPv4Address(TIME_SERVER), 123)}
    assert watch.strangers(DECLARED.pilot, SATELLITE) == []


def test_what_the_allow_list_lacks_is_reported_when_a_link_carries_it(stand: Stand) -> None:
    stand.use(COASTAL, "4g")
    mobile = next(link for link in DECLARED.sites["coastal"].bearers if link.name == "4g")
    strangers = {
        link_watch.Destination(protocol, address, 53)
        for address in stand.network.servers
        for protocol in ("tcp", "udp")
        if address not in CHECKED_OVER_ONE_LINK
    }
    with link_watch.watch_link(stand.network.links["coastal", "4g"]) as watch:
        link_watch.send_strangers(stand.network, COASTAL, mobile)
        end = time.monotonic() + HANG_S
        while not strangers <= set(watch.counts) and time.monotonic() < end:
            time.sleep(0.02)
    assert strangers - set(watch.counts) == set()
    lines = watch.strangers(DECLARED.pilot, SATELLITE)
    assert all(any(line.endswith(f" to {stranger}") for line in lines) for stranger in strangers)


def test_a_probe_is_seen_on_the_link_in_use_alone(stand: Stand) -> None:
    stand.use(COASTAL, SATELLITE.name)
    for name, is_in_use in ((SATELLITE.name, True), ("4g", False)):
        with link_watch.watch_link(stand.network.links["coastal", name]) as watch:
            assert link_watch.sees_probe(watch, stand.network, COASTAL) is is_in_use
