"""The satellite's filter, proved on packets: real links, real routing, real connection tracking."""

import socket
from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import pytest
from satellite_rendered import SITES, rendered
from satellite_stage import PARTNER, ROBOT, WORLD, Seen, Stage, send_echo, send_syn, send_udp, stage, token
from waiting import HANG_S

from atlantis_netcfg.routeros.rsc import Export

pytestmark = pytest.mark.namespace

VPN = ("203.0.113.2", 1194)
NTP = ("192.0.2.123", 123)
DECLARED = {("udp", *VPN), ("udp", *NTP), ("udp", "192.0.2.124", 123)}
STRANGER = ("8.8.8.8", 443)
DROP = "atlantis: satellite, everything else"
PORTS = (22, 53, 80, 123, 443, 1194, 1195, 8729)


@pytest.fixture(scope="module", params=SITES)
def site(request: pytest.FixtureRequest) -> Iterator[tuple[Stage, Export]]:
    text = rendered(request.param)
    with stage(text.view) as made:
        yield made, text.export


@pytest.fixture
def built(site: tuple[Stage, Export]) -> Stage:
    """The stage with the whole firewall, and the satellite in use."""
    made, export = site
    made.load(export)
    made.prefer("satellite")
    return made


def every_flow(made: Stage, who: str, addresses: tuple[str, ...]) -> None:
    """Send a first packet of everything: each address with UDP and TCP to each port, and an echo request."""
    echo = made.open(who, socket.SOCK_RAW, socket.IPPROTO_ICMP)
    datagrams = made.udp(who)
    streams = []
    for address in addresses:
        send_echo(echo, address)
        for port in PORTS:
            send_udp(datagrams, address, port)
            streams.append(made.open(who, socket.SOCK_STREAM))
            send_syn(streams[-1], address, port)
    for one in (echo, datagrams, *streams):
        one.close()


def leaving(made: Stage, who: str, addresses: tuple[str, ...]) -> set[tuple[str, str, int]]:
    """What of everything that `who` sends comes out at the far end of the satellite."""
    watch = made.watch("satellite")
    every_flow(made, who, addresses)
    mark = token()
    with made.udp("router") as sentinel:
        send_udp(sentinel, *VPN, mark)
        found = watch.until(mark)
    watch.close()
    return {seen.flow for seen in found}


def answered(made: Stage) -> bytes:
    """Let the robot ask the VPN server over the satellite and be answered; the answer's payload."""
    mark = token()
    with made.udp("satellite", *VPN) as server, made.udp(ROBOT) as client:
        client.sendto(b"question", VPN)
        data, asker = server.recvfrom(100)
        assert data == b"question"
        server.sendto(mark, asker)
        assert client.recv(100) == mark
    return mark


def terminal(made: Stage) -> str:
    return next(link.gateway for link in made.view.uplinks if link.kind == "satellite")


def test_robot_reaches_only_declared_targets(built: Stage) -> None:
    assert leaving(built, ROBOT, (*WORLD, terminal(built))) == DECLARED


def test_router_reaches_only_declared_targets_and_its_terminal(built: Stage) -> None:
    own = {(protocol, terminal(built), port) for protocol, port in product(("udp", "tcp"), PORTS)}
    assert leaving(built, "router", (*WORLD, terminal(built))) == DECLARED | own | {("icmp", terminal(built), 0)}


def test_technician_also_reaches_the_terminal(built: Stage) -> None:
    own = {(protocol, terminal(built), port) for protocol, port in product(("udp", "tcp"), PORTS)}
    assert leaving(built, "technician", (*WORLD, terminal(built))) == DECLARED | own | {("icmp", terminal(built), 0)}


def test_a_partner_of_the_vpn_reaches_nothing_by_satellite(built: Stage) -> None:
    assert leaving(built, PARTNER, (*WORLD, terminal(built))) == set()


def test_another_uplink_carries_all_packets(built: Stage) -> None:
    """So that the tests above do not pass for want of packets."""
    other = built.view.uplinks[0].name
    built.prefer(other)
    watch = built.watch(other)
    every_flow(built, ROBOT, WORLD)
    mark = token()
    with built.udp(ROBOT) as sentinel:
        send_udp(sentinel, *VPN, mark)
        flows = {seen.flow for seen in watch.until(mark)}
    watch.close()
    assert flows == {*product(("udp", "tcp"), WORLD, PORTS), *(("icmp", address, 0) for address in WORLD)}


def test_filter_leaks_without_its_last_rule(site: tuple[Stage, Export]) -> None:
    """So that the tests above cannot pass whatever the filter says."""
    made, export = site
    made.load(replace(export, statements=tuple(row for row in export.statements if row.get("comment") != DROP)))
    made.prefer("satellite")
    assert ("tcp", *STRANGER) in leaving(made, ROBOT, WORLD)


def test_udp_flow_of_another_link_does_not_continue_over_the_satellite(built: Stage) -> None:
    other = built.view.uplinks[0].name
    built.prefer(other)
    with built.udp(other, *STRANGER) as server, built.udp(ROBOT) as client:
        client.sendto(b"one", STRANGER)
        server.sendto(b"answer", server.recvfrom(100)[1])
        assert client.recv(100) == b"answer"
        built.prefer("satellite")
        watch = built.watch("satellite")
        client.sendto(b"two", STRANGER)
        assert watch.until(_sentinel(built)) == []
        assert built.packets(DROP) == 1
        built.prefer(other)
        client.sendto(b"three", STRANGER)
        assert server.recv(100) == b"three"
    watch.close()


def test_tcp_connection_of_another_link_does_not_continue_over_satellite(built: Stage) -> None:
    other = built.view.uplinks[0].name
    built.prefer(other)
    with built.listener(other, *STRANGER) as listening, built.open(ROBOT, socket.SOCK_STREAM) as client:
        client.connect(STRANGER)
        server, _ = listening.accept()
        server.sendall(b"hello")
        assert client.recv(100) == b"hello"
        built.prefer("satellite")
        watch = built.watch("satellite")
        client.sendall(b"two")
        assert watch.until(_sentinel(built)) == []
        assert built.packets(DROP) >= 1
        built.prefer(other)
        server.settimeout(HANG_S)
        assert server.recv(100) == b"two"
        server.close()
    watch.close()


def test_declared_flow_continues_over_the_satellite(built: Stage) -> None:
    """As a connection of its own: Linux gives up a masqueraded one whose way out has changed, with one packet."""
    other = built.view.uplinks[0].name
    built.prefer(other)
    with built.udp(other, *VPN) as server, built.udp(ROBOT) as client:
        client.sendto(b"one", VPN)
        assert server.recv(100) == b"one"
        built.prefer("satellite")
        watch = built.watch("satellite")
        client.sendto(b"two", VPN)
        client.sendto(b"three", VPN)
        found = watch.until(_sentinel(built))
    watch.close()
    assert [(seen.src, *seen.flow, seen.data[8:]) for seen in found] == [(_own(built), "udp", *VPN, b"three")]
    assert built.packets(DROP) == 0


def test_responses_of_declared_targets_are_accepted(built: Stage) -> None:
    assert answered(built)
    assert built.packets("atlantis: answers of VPN server") == 1


def test_no_connection_can_be_opened_from_the_satellite(built: Stage) -> None:
    """Neither to the router nor through it, from whatever address, also from those on the allow-list."""
    local = next(link.address for link in built.view.uplinks if link.kind == "satellite")
    built.run("satellite", "ip", "route", "replace", built.robot, "via", local)
    inside, outside = built.watch(ROBOT), built.watch("satellite")
    ours = built.udp("router", port=1194)
    for address in (*WORLD, terminal(built)):
        for target in (local, built.robot):
            _knock(built, address, target)
    answer = answered(built)
    assert inside.until(answer) == []
    with built.udp("router") as sentinel:
        mark = token()
        send_udp(sentinel, *VPN, mark)
        back = [seen for seen in outside.until(mark) if seen.flow != ("udp", *VPN)]
    assert back == []
    ours.setblocking(False)
    with pytest.raises(BlockingIOError):
        ours.recv(100)
    for one in (inside, outside, ours):
        one.close()
    # Three kinds of packets from each address to each of the two; answers and their questions are not among them.
    assert built.packets("atlantis: satellite, everything else that comes in") == 3 * 2 * (len(WORLD) + 1)


def test_response_to_a_flow_of_another_link_is_dropped_on_the_satellite(built: Stage) -> None:
    other = built.view.uplinks[0]
    built.run("satellite", "ip", "route", "replace", other.address, "via", _own(built))
    built.prefer(other.name)
    with built.udp(other.name, *STRANGER) as server, built.udp(ROBOT) as client:
        client.sendto(b"one", STRANGER)
        asker = server.recvfrom(100)[1]
        inside = built.watch(ROBOT)
        with built.udp("satellite", *STRANGER) as forged:
            forged.sendto(b"from the wrong side", asker)
        built.prefer("satellite")
        assert inside.until(answered(built)) == []
        server.sendto(b"from the right side", asker)
        assert client.recv(100) == b"from the right side"
    inside.close()


def test_icmp_error_about_a_declared_flow_is_accepted(built: Stage) -> None:
    """Nobody listens on the time server's port: its ICMP error reaches the robot, as path MTU discovery needs."""
    with built.udp(ROBOT) as client:
        client.connect(NTP)
        client.send(b"what time is it?")
        with pytest.raises(ConnectionRefusedError):
            client.recv(100)
    assert built.packets("atlantis: errors on the way") == 1


def test_drops_are_counted_and_a_sample_is_logged(built: Stage) -> None:
    with built.udp(ROBOT) as client:
        for _ in range(60):
            send_udp(client, *STRANGER)
    assert built.packets(DROP) == 60
    # The limit's burst of five, and what ten a minute add while sixty packets are sent.
    assert 5 <= built.packets("atlantis: what is kept off, a sample") < 60


def _sentinel(made: Stage) -> bytes:
    """Send the last packet of a test over the satellite."""
    mark = token()
    with made.udp(ROBOT) as sentinel:
        send_udp(sentinel, *VPN, mark)
    return mark


def _own(made: Stage) -> str:
    return next(link.address for link in made.view.uplinks if link.kind == "satellite")


def _knock(made: Stage, src: str, dst: str) -> None:
    """Three first packets from outside: a datagram, an echo request, a TCP connection."""
    echo = made.open("satellite", socket.SOCK_RAW, socket.IPPROTO_ICMP)
    echo.bind((src, 0))
    send_echo(echo, dst)
    datagram, stream = made.udp("satellite", src), made.open("satellite", socket.SOCK_STREAM)
    send_udp(datagram, dst, 1194)
    stream.bind((src, 0))
    send_syn(stream, dst, 8729)
    for one in (echo, datagram, stream):
        one.close()


def test_captured_packets_are_distinguished() -> None:
    seen = Seen("udp", "10.0.0.1", "10.0.0.2", 1, 2)
    assert seen.flow == ("udp", "10.0.0.2", 2)
    assert replace(seen, protocol="icmp", dst_port=8).flow == ("icmp", "10.0.0.2", 0)
