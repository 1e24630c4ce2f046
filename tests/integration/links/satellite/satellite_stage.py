"""A site on this machine: one network namespace for its router, one for each neighbour, real links between them.

The router's firewall is the translation of its rendered text. Behind every uplink stands a whole world that has all the
addresses which the tests speak of, so that a packet shows by the world in which it arrives over which link it went.
What arrives is what a packet socket on the far end of the link has seen; order on a link is kept, so that a packet
which has not come before a later one (the sentinel) was dropped. No test waits for silence.
"""

import ctypes
import itertools
import os
import socket
import struct
import subprocess
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from ipaddress import ip_address, ip_interface
from pathlib import Path

import pytest
from nft_translation import translate
from waiting import HANG_S

from atlantis_netcfg.routeros.render import RouterView
from atlantis_netcfg.routeros.rsc import Export

WORLD = ("203.0.113.2", "203.0.113.3", "192.0.2.123", "192.0.2.124", "192.0.2.50", "198.51.100.99", "8.8.8.8")
"""Addresses of every world: those of the example inventory, a stranger's, and one for a person's addition."""
ROBOT, PARTNER = "robot", "vpn"
_CLONE_NEWNET = 0x40000000
_ETH_P_IP = 0x0800
_OUTGOING = 4
"""PACKET_OUTGOING of packet(7): what the namespace itself has sent."""
"""For what has to come; a test that waits so long has failed."""
_TOKENS = itertools.count(1)
_LIBC = ctypes.CDLL(None, use_errno=True)


@dataclass(frozen=True)
class Seen:
    """One IPv4 packet on a link, as far as the tests tell packets apart."""

    protocol: str
    src: str
    dst: str
    src_port: int
    dst_port: int
    """Of ICMP: its type."""
    data: bytes = field(repr=False, compare=False, default=b"")

    @property
    def flow(self) -> tuple[str, str, int]:
        """Where it goes: protocol, address, port (ICMP: 0)."""
        return self.protocol, self.dst, 0 if self.protocol == "icmp" else self.dst_port


@dataclass
class Stage:
    """The namespaces of one site; `uplinks` by the bearer's name."""

    prefix: str
    view: RouterView
    robot: str
    technician: str
    partner: str
    stack: ExitStack

    def name(self, who: str) -> str:
        return f"{self.prefix}-{who}"

    def open(self, who: str, kind: int, protocol: int = 0, family: int = socket.AF_INET) -> socket.socket:
        """A socket that lives in a namespace, whoever uses it."""
        made: list[socket.socket] = []
        with Path("/run/netns", self.name(who)).open("rb") as namespace:

            def enter() -> None:
                if _LIBC.setns(namespace.fileno(), _CLONE_NEWNET) == 0:
                    made.append(socket.socket(family, kind, protocol))

            thread = threading.Thread(target=enter)
            thread.start()
            thread.join()
        assert made, f"no socket in {self.name(who)}"
        made[0].settimeout(HANG_S)
        return made[0]

    def udp(self, who: str, address: str = "0.0.0.0", port: int = 0) -> socket.socket:  # noqa: S104 - own namespace
        made = self.open(who, socket.SOCK_DGRAM)
        made.bind((address, port))
        return made

    def listener(self, who: str, address: str, port: int) -> socket.socket:
        made = self.open(who, socket.SOCK_STREAM)
        made.bind((address, port))
        made.listen()
        return made

    def watch(self, who: str) -> "Watch":
        made = self.open(who, socket.SOCK_RAW, 0, socket.AF_PACKET)  # with a protocol it would hear all interfaces
        made.bind(("near", _ETH_P_IP))
        return Watch(made)

    def run(self, who: str, *words: str, text: str | None = None) -> str:
        """Run a command in a namespace."""
        done = subprocess.run(
            ["ip", "netns", "exec", self.name(who), *words], input=text, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, f"{' '.join(words)}: {done.stderr}\n{text or ''}"
        return done.stdout

    def load(self, export: Export) -> None:
        """Put the firewall of a text in the router's place, and forget every connection."""
        self.run("router", "nft", "-f", "-", text=f"flush ruleset\n{translate(export).text()}")
        self.forget()

    def forget(self) -> None:
        self.run("router", "conntrack", "-F")

    def prefer(self, bearer: str) -> None:
        """Let the default route lead over a bearer, as after a change of link."""
        gateway = next(link.gateway for link in self.view.uplinks if link.name == bearer)
        self.run("router", "ip", "route", "replace", "default", "via", gateway)

    def packets(self, comment: str) -> int:
        """How many packets a rule has met, by its comment."""
        ruleset = self.run("router", "nft", "list", "ruleset").splitlines()
        lines = [line for line in ruleset if f'"{comment}"' in line]
        assert lines, f"no rule says {comment}"
        return sum(int(line.partition("counter packets ")[2].split()[0]) for line in lines)


@dataclass
class Watch:
    """What arrives over a link."""

    socket: socket.socket

    def until(self, token: bytes) -> list[Seen]:
        """Everything up to the packet that holds the token, without it."""
        found: list[Seen] = []
        while True:
            frame, address = self.socket.recvfrom(65536)
            if address[2] == _OUTGOING or not (seen := _seen(frame)):
                continue
            if token in seen.data:
                return found
            found.append(seen)

    def close(self) -> None:
        self.socket.close()


def token() -> bytes:
    """A payload that no other packet has."""
    return b"sentinel-%06d;" % next(_TOKENS)


def send_udp(sender: socket.socket, address: str, port: int, data: bytes = b"x") -> None:
    """Send; the router's own output filter answers a drop with EPERM, which is a drop like any other."""
    with suppress(PermissionError):
        sender.sendto(data, (address, port))


def send_syn(sender: socket.socket, address: str, port: int) -> None:
    """Send the first packet of a TCP connection."""
    sender.setblocking(False)
    with suppress(BlockingIOError, PermissionError):
        sender.connect((address, port))


def send_echo(sender: socket.socket, address: str) -> None:
    """Send an ICMP echo request through a raw socket."""
    number = next(_TOKENS) & 0xFFFF
    head = struct.pack("!BBHHH", 8, 0, 0, number, 1)
    total = sum(struct.unpack("!4H", head))
    total = (total & 0xFFFF) + (total >> 16)
    with suppress(PermissionError):
        sender.sendto(struct.pack("!BBHHH", 8, 0, ~total & 0xFFFF, number, 1), (address, 0))


def _seen(frame: bytes) -> Seen | None:
    packet = frame[14:]
    length = (packet[0] & 0x0F) * 4
    protocol = {1: "icmp", 6: "tcp", 17: "udp"}.get(packet[9])
    if protocol is None:
        return None
    src, dst = (str(ip_address(packet[at : at + 4])) for at in (12, 16))
    if protocol == "icmp":
        return Seen(protocol, src, dst, 0, packet[length], packet[length:])
    src_port, dst_port = struct.unpack("!HH", packet[length : length + 4])
    return Seen(protocol, src, dst, src_port, dst_port, packet[length:])


@contextmanager
def stage(view: RouterView) -> Iterator[Stage]:
    """Build it, and take it down again."""
    if os.geteuid() != 0:
        pytest.skip("making a network namespace needs root")
    # Links keep their order only if one processor handles what one sender sends.
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(before)})
    with ExitStack() as stack:
        made = Stage(
            prefix=f"atl{os.getpid()}",
            view=view,
            robot=str(ip_interface(view.lan.address).network[21]),
            technician=str(ip_interface(view.management.address).network[10]),
            partner="10.80.16.5",
            stack=stack,
        )
        stack.callback(os.sched_setaffinity, 0, before)
        _namespace(made, "router")
        made.run("router", "sysctl", "-qw", "net.ipv4.ip_forward=1")
        lan, management = view.lan, view.management
        _neighbour(made, ROBOT, view.bridge, lan.address, made.robot)
        _neighbour(made, "technician", management.port, management.address, made.technician)
        if view.tunnel is not None:
            _neighbour(made, PARTNER, view.tunnel.interface, "10.80.0.11/16", made.partner)
        for link in view.uplinks:
            _neighbour(made, link.name, link.port, link.interface_address, link.gateway)
            for address in WORLD:
                made.run(link.name, "ip", "address", "add", f"{address}/32", "dev", "lo")
            if link.kind == "satellite":
                made.run("router", "ip", "rule", "add", "from", link.address, "lookup", "100")
                made.run("router", "ip", "route", "add", "default", "via", link.gateway, "table", "100")
        yield made


def _namespace(made: Stage, who: str) -> None:
    subprocess.run(["ip", "netns", "add", made.name(who)], check=True)
    made.stack.callback(subprocess.run, ["ip", "netns", "delete", made.name(who)], check=True)
    for setting in ("conf.all.rp_filter=0", "conf.default.rp_filter=0", "icmp_ratelimit=0"):
        made.run(who, "sysctl", "-qw", f"net.ipv4.{setting}")
    made.run(who, "sysctl", "-qw", "net.ipv6.conf.all.disable_ipv6=1")
    made.run(who, "ip", "link", "set", "lo", "up")


def _neighbour(made: Stage, who: str, port: str, router: str, address: str) -> None:
    """One namespace at the other end of a port of the router; its own end is called `near`."""
    _namespace(made, who)
    length = ip_interface(router).network.prefixlen
    made.run(who, "ip", "link", "add", "near", "type", "veth", "peer", "name", port, "netns", made.name("router"))
    made.run(who, "ip", "address", "add", f"{address}/{length}", "dev", "near")
    made.run(who, "ip", "link", "set", "near", "up")
    made.run("router", "ip", "address", "add", router, "dev", port)
    made.run("router", "ip", "link", "set", port, "up")
    made.run(who, "ip", "route", "add", "default", "via", str(ip_interface(router).ip))
