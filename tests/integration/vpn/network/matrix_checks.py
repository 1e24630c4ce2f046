"""What the firewall of a stand is held to, packet by packet; each check can be asked again and again.

Its own counters are the second witness: what is denied is counted once, whatever else is waited for.
"""

import itertools
import socket
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from ipaddress import IPv4Address

import pytest
from matrix_probe import Heard, Probes, answered, asked, datagram
from matrix_stand import (
    BEHIND,
    BESIDE,
    CENTRE,
    ENGINEER,
    LAN_GATEWAY,
    LAN_STRANGER,
    LAN_ZARCO,
    ROUTER,
    SERVER,
    TECHNICIAN,
    Vpn,
)

from atlantis_netcfg.vpn.policy import MEMBERS_SET, TABLE, Flow, Party, Policy, Protocol, policy

GATEWAY, SERVER_LAN = "coastal-gateway", "10.64.0.10"
LAPTOP, ZARCO, OTHER, SPARUS = "inesc-laptop", "inesc-zarco", "iqua-laptop", "iqua-sparus"
ON_ONE_ROUTER = {
    BEHIND: "10.64.1.22",
    LAN_ZARCO: "10.64.1.23",
    LAN_GATEWAY: "10.64.1.10",
    LAN_STRANGER: "10.64.1.150",
    TECHNICIAN: "10.64.101.10",
}
BESIDE_ALL = {SERVER: "10.80.0.1", BESIDE: "10.64.0.77", ENGINEER: "10.64.100.10", **ON_ONE_ROUTER}
UDP_PORTS = (123, 7409, 7410, 7429, 7430, 7660)
_TOGETHER = 100
"""Packets at once: a tunnel's interface keeps 500, and drops what comes on top."""
_MANY = 20
"""More than the kernel itself sends meanwhile."""
_PING = Flow(Protocol.ICMP)
FLOWS = (
    _PING,
    *(Flow(Protocol.TCP, port) for port in (22, 7410, 8443)),
    *(Flow(Protocol.UDP, port) for port in UDP_PORTS),
)
_Try = tuple[Party, Party, Flow]


@dataclass
class Reach:
    """The stand, its ends, and what is declared of them."""

    made: Vpn
    probes: Probes
    policy: Policy

    def party(self, who: str) -> Party:
        return Party(who, IPv4Address(self.probes.ends[who]))

    def wait_for(self, expected: set[Heard]) -> None:
        arrived = self.probes.wait(lambda: expected <= self.probes.heard)
        assert arrived, "\n".join(sorted(str(one) for one in expected - self.probes.heard))


def matrix(reach: Reach, declared: Policy | None = None, *, others: int = 0) -> None:
    """Send everything; wait for what is allowed and for the count of what is not; then look for leaks.

    `others`: how many packets besides may have been denied meanwhile.
    """
    declared = declared or reach.policy
    allowed, denied = list[_Try](), list[_Try]()
    for one in _pairs(reach):
        (allowed if declared.allows(*one) else denied).append(one)
    reach.probes.heard.clear()
    before = reach.made.counter("p_denied")
    for some in _batches(denied):
        _send(reach, some)
        before += len(some)
        assert reach.probes.wait(lambda: reach.made.counter("p_denied") >= before)  # noqa: B023 - waited for here
    for some in _batches(allowed):
        _send(reach, some)
        reach.wait_for(_signs(some))
    assert reach.probes.heard & _signs(denied) == set()
    assert before <= reach.made.counter("p_denied") <= before + others
    assert len(allowed) > 150
    assert len(denied) > 400


def _pairs(reach: Reach) -> Iterator[_Try]:
    ends = [reach.party(who) for who in reach.probes.ends]
    pairs = [pair for pair in itertools.permutations(ends, 2) if not _beside_the_server(*(one.name for one in pair))]
    lan = Party(SERVER, IPv4Address(SERVER_LAN))
    # The control centre stands in that LAN: it needs no tunnel to this address.
    pairs += [(one, lan) for one in ends if one.name not in {SERVER, BESIDE, ENGINEER, CENTRE}]
    yield from ((one, other, flow) for one, other in pairs for flow in FLOWS)


def _beside_the_server(one: str, other: str) -> bool:
    """What goes by a switch or a router that both are at does not pass the server: nobody in the VPN can forbid it."""
    return {ROUTER, *ON_ONE_ROUTER} >= {one, other} or (one, other) == (CENTRE, BESIDE)


def _batches(every: list[_Try]) -> Iterator[list[_Try]]:
    yield from (every[at : at + _TOGETHER] for at in range(0, len(every), _TOGETHER))


def _signs(some: Iterable[_Try]) -> set[Heard]:
    """By what a flow is known: of a question to the server only the answer is a proof."""
    return {how(*one) for one in some for how in (asked, answered) if how is answered or one[1].name != SERVER}


def _send(reach: Reach, some: Iterable[_Try]) -> None:
    for source, destination, flow in some:
        with suppress(PermissionError):  # of the server's own output chain, where it counts as well
            reach.probes.send(source.name, str(destination.address), flow)


def errors(reach: Reach) -> None:
    """That nobody listens is told to who asked, and by nobody else."""
    closed = Flow(Protocol.UDP, 7411)
    reach.probes.heard.clear()
    reach.probes.send(ZARCO, reach.probes.ends[CENTRE], closed)
    reach.wait_for({Heard(Protocol.ICMP, reach.probes.ends[CENTRE], reach.probes.ends[ZARCO], 3, answer=False)})


def spoofed(reach: Reach) -> None:
    """OpenVPN itself drops what comes through a tunnel; the firewall what comes from the server's own LAN."""
    laptop, zarco, centre = (reach.probes.ends[who] for who in (LAPTOP, ZARCO, CENTRE))
    lies = [(OTHER, laptop, zarco), (OTHER, "10.80.0.21", centre), (OTHER, "10.64.0.77", centre)]
    lies += [(OTHER, "10.80.0.1", zarco), (BESIDE, laptop, zarco), (BESIDE, "10.64.1.22", centre)]
    lies += [(BESIDE, "10.80.0.1", zarco)]
    before = reach.made.counter("p_spoofed")
    reach.probes.heard.clear()
    for who, source, destination in lies:
        with reach.made.socket(who, socket.AF_INET, socket.SOCK_RAW, socket.IPPROTO_RAW) as raw:
            raw.sendto(datagram(source, destination, 7409), (destination, 0))
    _after(reach, (OTHER, CENTRE), (BESIDE, CENTRE))
    assert [one for one in reach.probes.heard if one.port == 7409] == []
    assert reach.made.counter("p_spoofed") == before + 2, "the kernel itself drops its own address"


def _after(reach: Reach, *pairs: tuple[str, str]) -> None:
    """Wait for pings that are sent after what is looked for: order is kept on a way."""
    for one, other in pairs:
        reach.probes.send(one, reach.probes.ends[other], _PING)
    reach.wait_for({answered(reach.party(one), reach.party(other), _PING) for one, other in pairs})


def multicast(reach: Reach) -> None:
    """OpenVPN would give the server's to every client."""
    with ExitStack() as stack:
        watches = [
            stack.enter_context(reach.made.socket(who, socket.AF_PACKET, socket.SOCK_DGRAM, 0))
            for who in (ZARCO, SPARUS)
        ]
        for watch in watches:
            watch.bind(("tun0", 0x0800))  # on eth0 the stand's bridges send IGMP reports of their own
        for address, counter in (("239.255.0.1", "p_multicast"), ("10.80.255.255", "p_denied")):
            _refused(reach, address, counter)
        group = socket.inet_aton("239.255.0.1") + socket.inet_aton("10.80.0.1")
        listening = stack.enter_context(reach.made.socket(SERVER, socket.AF_INET, socket.SOCK_DGRAM))
        listening.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group)
        before = reach.made.counter("p_denied")
        _out(reach, stack, LAPTOP).sendto(b"all", ("239.255.0.1", 7400))
        reach.probes.heard.clear()
        _after(reach, (CENTRE, ZARCO), (CENTRE, SPARUS), (LAPTOP, CENTRE))
        assert [packet for watch in watches for packet in _waiting(watch) if _to_many(packet)] == []
        assert reach.made.counter("p_denied") == before + 1


def _out(reach: Reach, stack: ExitStack, who: str) -> socket.socket:
    """A socket that sends through the tunnel, whatever it is."""
    sender = stack.enter_context(reach.made.socket(who, socket.AF_INET, socket.SOCK_DGRAM))
    sender.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
    sender.setsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, b"tun0")
    return sender


def _refused(reach: Reach, address: str, counter: str) -> None:
    before = reach.made.counter(counter)
    with ExitStack() as stack:
        sender = _out(reach, stack, SERVER)
        with pytest.raises(PermissionError):
            sender.sendto(b"all", (address, 7400))
    assert reach.made.counter(counter) > before


def _to_many(packet: bytes) -> bool:
    return packet[16] >= 224 or packet[16:20] == bytes((10, 80, 255, 255))


def _waiting(watch: socket.socket) -> Iterator[bytes]:
    watch.setblocking(False)
    with suppress(BlockingIOError):
        while True:
            yield watch.recv(65536)


def ipv6(reach: Reach) -> None:
    """Neither the server nor its LAN gets any into the tunnel; OpenVPN itself drops what a client sends."""
    made = reach.made
    made.run(SERVER, "sysctl", "-qw", *(f"net.ipv6.conf.{one}.disable_ipv6=0" for one in ("tun0", "eth0")))
    made.run(SERVER, "sysctl", "-qw", "net.ipv6.conf.all.forwarding=1")
    made.run(BESIDE, "sysctl", "-qw", "net.ipv6.conf.eth0.disable_ipv6=0")
    for who, address, interface in (
        (SERVER, "fd00::1", "tun0"),
        (SERVER, "fd01::1", "eth0"),
        (BESIDE, "fd01::2", "eth0"),
    ):
        made.run(who, "ip", "address", "replace", f"{address}/64", "dev", interface, "nodad")
    made.run(BESIDE, "ip", "route", "replace", "fd00::/64", "via", "fd01::1")
    for who in (SERVER, BESIDE):
        before = made.counter("p_ipv6")
        with made.socket(who, socket.AF_INET6, socket.SOCK_DGRAM) as sender:
            for _ in range(_MANY):
                with suppress(PermissionError):  # the server is told
                    sender.sendto(b"six", ("fd00::2", 7410))
        assert reach.probes.wait(lambda: made.counter("p_ipv6") >= before + _MANY)  # noqa: B023 - waited for here


def answers(reach: Reach) -> None:
    """The server may ask everybody, and hears what it is told."""
    for who in (SPARUS, ROUTER, BEHIND):
        with reach.made.socket(SERVER, socket.AF_INET, socket.SOCK_STREAM) as client:
            client.settimeout(reach.probes.patience_s)
            with pytest.raises(ConnectionRefusedError):
                client.connect((reach.probes.ends[who], 2222))


def untouched(reach: Reach) -> None:
    """What the server's computer passes on that has not to do with the tunnel, it passes on."""
    reach.made.run(BESIDE, "ip", "route", "replace", "192.0.2.1", "via", SERVER_LAN)
    reach.probes.heard.clear()
    reach.probes.send(BESIDE, "192.0.2.1", _PING)
    reach.wait_for({Heard(Protocol.ICMP, "192.0.2.1", reach.probes.ends[BESIDE], 0, answer=True)})


def cut(reach: Reach) -> None:
    """Whose address is taken out of the set of members reaches nobody, though his tunnel is up; all others go on."""
    membership = reach.made.authority.membership()
    without = replace(membership, members={name: one for name, one in membership.members.items() if name != ZARCO})
    element = ("inet", TABLE, MEMBERS_SET, f"{{ {reach.probes.ends[ZARCO]} }}")
    reach.made.run(SERVER, "nft", "delete", "element", *element)
    matrix(reach, policy(reach.made.declaration, without))
    reach.made.run(SERVER, "nft", "add", "element", *element)


CHECKS = (matrix, errors, spoofed, multicast, ipv6, answers, untouched, cut)
