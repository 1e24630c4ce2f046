"""Who reaches whom through a real OpenVPN is what `policy.allows` says, for every ordered pair and every protocol.

Server, a site's router with its LAN and technician, a gateway, the control centre, two partners with two devices each,
of which one sees the other's robot. Every file of OpenVPN and the firewall is the product's.
"""

from __future__ import annotations

import itertools
import socket
from contextlib import suppress
from dataclasses import dataclass, replace
from ipaddress import IPv4Address
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from matrix_probe import Probes, answered, asked, datagram
from matrix_stand import BEHIND, BESIDE, CENTRE, ROUTER, SERVER, TECHNICIAN, Vpn, guest, host, vpn

from atlantis_netcfg.site import load
from atlantis_netcfg.vpn.identity import Kind, Standing
from atlantis_netcfg.vpn.policy import Flow, Party, Policy, Protocol, policy

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from matrix_probe import Heard

    from atlantis_netcfg.vpn.identity import Roll

pytestmark = [pytest.mark.namespace, pytest.mark.slow]
SHIPPED = Path(__file__).parents[3] / "inventory"
GATEWAY, SERVER_LAN = "coastal-gateway", "10.64.0.10"
LAPTOP, ZARCO, OTHER, SPARUS = "inesc-laptop", "inesc-zarco", "iqua-laptop", "iqua-sparus"
_TOGETHER = 100
"""Packets at once: a tunnel's interface keeps 500, and drops what comes on top."""
UDP_PORTS = (123, 7409, 7410, 7429, 7430, 7660)
_Try = tuple[Party, Party, Flow]
FLOWS = (
    Flow(Protocol.ICMP),
    *(Flow(Protocol.TCP, port) for port in (22, 7410, 8443)),
    *(Flow(Protocol.UDP, port) for port in UDP_PORTS),
)


@dataclass
class Reach:
    """The stand, its ends, and what is declared of them."""

    made: Vpn
    probes: Probes
    policy: Policy

    def party(self, who: str) -> Party:
        return Party(who, IPv4Address(self.probes.ends[who]))


@pytest.fixture(scope="module")
def reach(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Reach]:
    shipped = load(SHIPPED)
    inesc = shipped.partners["inesc"].model_copy(update={"sees": ("sparus",)})
    declaration = replace(shipped, partners={**shipped.partners, "inesc": inesc})
    wishes = [host(declaration, name) for name in (ROUTER, GATEWAY, CENTRE)]
    for partner, vehicle in (("inesc", "zarco"), ("iqua", "sparus")):
        wishes.append(guest(declaration, partner, "laptop", Kind.LAPTOP))
        wishes.append(guest(declaration, partner, vehicle, Kind.ROBOT, vehicle))
    with vpn(declaration, wishes, tmp_path_factory.mktemp("vpn")) as made:
        roll = made.authority.roll()
        ends = {name: str(member.address) for name, member in roll.members.items()}
        ends |= {SERVER: "10.80.0.1", BESIDE: "10.64.0.77", BEHIND: "10.64.1.22", TECHNICIAN: "10.64.101.10"}
        yield Reach(made, Probes(made, ends, UDP_PORTS), policy(declaration, roll))


def _pairs(reach: Reach) -> Iterator[_Try]:
    ends = [reach.party(who) for who in reach.probes.ends]
    pairs = list(itertools.permutations(ends, 2))
    lan = Party(SERVER, IPv4Address(SERVER_LAN))
    # The control centre stands in that LAN: it needs no tunnel to this address.
    pairs += [(one, lan) for one in ends if one.name not in {SERVER, BESIDE, CENTRE}]
    yield from ((one, other, flow) for one, other in pairs for flow in FLOWS)


def _matrix(reach: Reach, declared: Policy, *, others: int = 0) -> None:
    """Send everything; wait for what is allowed and for the count of what is not; then look for leaks."""
    every = list(_pairs(reach))
    denied = [one for one in every if not declared.allows(*one)]
    allowed = [one for one in every if declared.allows(*one)]
    reach.probes.heard.clear()
    before = reach.made.counter("p_denied")
    for some in _batches(denied, _TOGETHER):
        _send(reach, some)
        before += len(some)
        assert reach.probes.wait(lambda: reach.made.counter("p_denied") >= before)  # noqa: B023 - waited for here
    for some in _batches(allowed, _TOGETHER):
        _send(reach, some)
        expected = {how(*one) for one in some for how in (asked, answered) if _is_heard(how, one)}
        assert reach.probes.wait(lambda: expected <= reach.probes.heard), _told(expected - reach.probes.heard)  # noqa: B023
    leaks = {how(*one) for one in denied for how in (asked, answered) if _is_heard(how, one)}
    assert reach.probes.heard & leaks == set()
    assert before <= reach.made.counter("p_denied") <= before + others
    assert len(allowed) > 150
    assert len(denied) > 400


def _batches(every: list[_Try], size: int) -> Iterator[list[_Try]]:
    yield from (every[at : at + size] for at in range(0, len(every), size))


def _is_heard(how: Callable[[Party, Party, Flow], Heard], one: _Try) -> bool:
    """The server's own packet socket stands before its firewall: of a question to it only the answer is a proof."""
    return how is answered or one[1].name != SERVER


def _send(reach: Reach, some: Iterable[_Try]) -> None:
    for source, destination, flow in some:
        with suppress(PermissionError):  # of the server's own output chain, where it counts as well
            reach.probes.send(source.name, str(destination.address), flow)


def _told(missing: set[Heard]) -> str:
    return "\n".join(sorted(str(one) for one in missing))


def test_everybody_reaches_whom_he_may_and_nobody_else(reach: Reach) -> None:
    _matrix(reach, reach.policy)


def test_whoever_sends_in_anothers_name_is_not_heard(reach: Reach) -> None:
    """OpenVPN itself drops what comes through a tunnel; the firewall what comes from the server's own LAN."""
    zarco, laptop, centre = (reach.probes.ends[who] for who in (ZARCO, LAPTOP, CENTRE))
    before = reach.made.counter("p_spoofed")
    lies = [
        (OTHER, laptop, zarco),
        (OTHER, "10.80.0.21", centre),
        (OTHER, "10.64.0.77", centre),
        (OTHER, "10.80.0.1", zarco),
    ]
    lies += [(BESIDE, laptop, zarco), (BESIDE, "10.64.1.22", centre), (BESIDE, "10.80.0.1", zarco)]
    reach.probes.heard.clear()
    for who, source, destination in lies:
        raw = reach.made.socket(who, socket.AF_INET, socket.SOCK_RAW, socket.IPPROTO_RAW)
        raw.sendto(datagram(source, destination, 7409), (destination, 0))
    _after(reach, [(OTHER, CENTRE), (BESIDE, CENTRE)])
    assert {(one.source, one.port) for one in reach.probes.heard if one.port == 7409} == set()
    assert reach.made.counter("p_spoofed") - before == 2, "the kernel itself drops its own address"


def _after(reach: Reach, pairs: list[tuple[str, str]]) -> None:
    """Wait for pings that were sent after what is looked for: order is kept on a way."""
    ping = Flow(Protocol.ICMP)
    for one, other in pairs:
        reach.probes.send(one, reach.probes.ends[other], ping)
    expected = {answered(reach.party(one), reach.party(other), ping) for one, other in pairs}
    assert reach.probes.wait(lambda: expected <= reach.probes.heard), _told(expected - reach.probes.heard)


def test_multicast_and_broadcast_reach_nobody(reach: Reach) -> None:
    """OpenVPN would give the server's to every client."""
    groups = {"239.255.0.1": "p_multicast", "224.0.0.1": "p_multicast", "10.80.255.255": "p_denied"}
    watches = {
        who: reach.made.socket(who, socket.AF_PACKET, socket.SOCK_DGRAM, socket.htons(0x0800))
        for who in (ZARCO, SPARUS)
    }
    for address, counter in groups.items():
        sender = reach.made.socket(SERVER, socket.AF_INET, socket.SOCK_DGRAM)
        sender.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        sender.setsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, b"tun0")
        before = reach.made.counter(counter)
        with pytest.raises(PermissionError):
            sender.sendto(b"all", (address, 7400))
        assert reach.made.counter(counter) == before + 1
    group = socket.inet_aton("239.255.0.1") + socket.inet_aton("10.80.0.1")
    listening = reach.made.socket(SERVER, socket.AF_INET, socket.SOCK_DGRAM)
    listening.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group)
    sender = reach.made.socket(LAPTOP, socket.AF_INET, socket.SOCK_DGRAM)
    sender.setsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, b"tun0")
    before = reach.made.counter("p_denied")
    sender.sendto(b"all", ("239.255.0.1", 7400))
    reach.probes.heard.clear()
    _after(reach, [(CENTRE, ZARCO), (CENTRE, SPARUS), (LAPTOP, CENTRE)])
    for watch in watches.values():
        assert not any(packet[16] >= 224 or packet[16:20] == b"\x0a\x50\xff\xff" for packet in _waiting(watch))
    assert reach.made.counter("p_denied") == before + 1


def _waiting(watch: socket.socket) -> Iterator[bytes]:
    watch.setblocking(False)
    try:
        while True:
            yield watch.recv(65536)
    except BlockingIOError:
        return


def test_ipv6_goes_nowhere(reach: Reach) -> None:
    made = reach.made
    made.run(SERVER, "sysctl", "-qw", "net.ipv6.conf.tun0.disable_ipv6=0", "net.ipv6.conf.all.forwarding=1")
    made.run(SERVER, "ip", "address", "add", "fd00::1/64", "dev", "tun0", "nodad")
    sender = made.socket(SERVER, socket.AF_INET6, socket.SOCK_DGRAM)
    before = made.counter("p_ipv6")
    with pytest.raises(PermissionError):
        sender.sendto(b"six", ("fd00::2", 7410))
    assert made.counter("p_ipv6") > before


def test_the_server_gets_its_answers(reach: Reach) -> None:
    made = reach.made
    for who in (SPARUS, ROUTER, BEHIND):
        with made.socket(SERVER, socket.AF_INET, socket.SOCK_STREAM) as client:
            client.settimeout(20)
            with pytest.raises(ConnectionRefusedError):
                client.connect((reach.probes.ends[who], 2222))


def test_who_is_taken_from_the_members_is_cut_in_the_middle_of_a_flow(reach: Reach) -> None:
    """Nothing is flushed, and his tunnel is still up; all others go on. It comes last: it changes the firewall."""
    made, roll = reach.made, reach.made.authority.roll()
    listening = made.socket(ZARCO, socket.AF_INET, socket.SOCK_STREAM)
    listening.bind((reach.probes.ends[ZARCO], 2222))
    listening.listen()
    client = made.socket(LAPTOP, socket.AF_INET, socket.SOCK_STREAM)
    client.settimeout(20)
    client.connect((reach.probes.ends[ZARCO], 2222))
    server, _ = listening.accept()
    with server:
        client.sendall(b"one")
        assert server.recv(100) == b"one"
        without = _revoked(roll, ZARCO)
        made.load(without)
        before = made.counter("p_denied")
        client.sendall(b"two")
        server.sendall(b"three")
        assert reach.probes.wait(lambda: made.counter("p_denied") >= before + 2)
        for end in (client, server):
            end.setblocking(False)
            with pytest.raises(BlockingIOError):
                end.recv(100)
            end.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
        client.close()
    _matrix(reach, policy(made.declaration, without), others=20)  # the connection that was cut is repeated, and reset
    made.load(roll)


def _revoked(roll: Roll, name: str) -> Roll:
    member = roll.members[name]
    dead = tuple(replace(one, standing=Standing.REVOKED) for one in member.certificates)
    return replace(roll, members={**roll.members, name: replace(member, certificates=dead)})
