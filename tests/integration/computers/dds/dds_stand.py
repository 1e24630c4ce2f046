"""Two computers of the pilot in network namespaces, joined by plain routing or by a real OpenVPN, with a link to cut.

    gateway ---- router ---- centre          the gateway's link is cut at the router's side
    gateway -- satellite -- server -- centre the pilot's VPN, of tests/integration/vpn/network

The computers have their declared addresses and nothing else; the router passes no multicast. What a participant hears
it says in lines, which a thread keeps; waiting is for lines, not for time.
"""

import itertools
import os
import re
import subprocess
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from matrix_papers import host
from matrix_stand import Vpn, vpn
from waiting import wait_until

from atlantis_netcfg.inventory import Inventory

GATEWAY, ROUTER, CENTRE = "gateway", "router", "centre"
DEFAULT_DOMAIN = 12
"""For participants without a profile; they announce themselves to port 7400 + 250 * 12 of a multicast address."""
_NUMBERS = itertools.count()


@dataclass
class Stand:
    """The namespaces of one way; `addresses` are the computers' declared ones on it."""

    prefix: str
    addresses: Mapping[str, str]
    stack: ExitStack

    def name(self, who: str) -> str:
        return f"{self.prefix}-{who}"

    def run(self, who: str, *command: str) -> str:
        """Run a command in a namespace and give what it prints."""
        done = subprocess.run(
            ["ip", "netns", "exec", self.name(who), *command], capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, f"{command}: {done.stderr}"
        return done.stdout

    def start(self, who: str, *command: str, environment: Mapping[str, str] | None = None) -> subprocess.Popen[str]:
        """Start a program in a namespace; it is ended with the stand."""
        process = subprocess.Popen(
            ["ip", "netns", "exec", self.name(who), *command],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env={**os.environ, **(environment or {})},
        )
        self.stack.callback(_end, process)
        return process

    def cut(self) -> None:
        self.run(ROUTER, "ip", "link", "set", "to-gateway", "down")

    def mend(self) -> None:
        self.run(ROUTER, "ip", "link", "set", "to-gateway", "up")

    def multicast_sent(self, counter: str) -> int:
        """UDP packets to multicast addresses that the two computers have sent: `default` in DEFAULT_DOMAIN, else."""
        said = [self.run(who, "nft", "list", "counter", "ip", "seen", counter) for who in (GATEWAY, CENTRE)]
        return sum(int(count) for text in said for count in re.findall(r"packets (\d+)", text))


def _end(process: subprocess.Popen[str]) -> None:
    """Who reads its lines sees their end, and closes them."""
    process.kill()
    process.wait()


@contextmanager
def routed(gateway: str, centre: str) -> Iterator[Stand]:
    """The two addresses in LANs of their own, with a router between them."""
    with ExitStack() as stack:
        stand = _namespaces(stack, {GATEWAY: gateway, CENTRE: centre})
        for who, address in stand.addresses.items():
            _wire(stand, who, address, f"{address.rpartition('.')[0]}.1")
        yield stand


@dataclass
class Tunnelled(Stand):
    """The VPN of the product; the gateway's link to it is a satellite's: 700 ms, 352 and 704 kbit/s."""

    vpn: Vpn

    def name(self, who: str) -> str:
        return self.vpn.name(_HOSTS[who])

    def cut(self) -> None:
        self.vpn.links[_HOSTS[GATEWAY]].cut()

    def mend(self) -> None:
        self.vpn.links[_HOSTS[GATEWAY]].mend()

    def tunnels(self) -> int:
        """How often the gateway's tunnel has come up."""
        return "".join(self.vpn.said[_HOSTS[GATEWAY]]).count("Initialization Sequence Completed")


_HOSTS = {GATEWAY: "coastal-gateway", CENTRE: "scc-control"}


@contextmanager
def tunnelled(declaration: Inventory, folder: Path) -> Iterator[Tunnelled]:
    """The two computers as members of a real OpenVPN, with every file as the product writes it."""
    wishes = [host(declaration, name) for name in _HOSTS.values()]
    with ExitStack() as stack:
        made = stack.enter_context(vpn(declaration, wishes, folder, slow=[_HOSTS[GATEWAY]]))
        membership = made.authority.membership()
        addresses = {who: str(membership.members[name].address) for who, name in _HOSTS.items()}
        stand = Tunnelled(made.prefix, addresses, stack, made)
        for who in _HOSTS:
            stand.run(who, "nft", _COUNT_MULTICAST)
        yield stand


def _namespaces(stack: ExitStack, addresses: Mapping[str, str]) -> Stand:
    if os.geteuid() != 0:
        pytest.skip("making a network namespace needs root")
    stand = Stand(f"dds{os.getpid()}-{next(_NUMBERS)}", addresses, stack)
    for who in (GATEWAY, ROUTER, CENTRE):
        subprocess.run(["ip", "netns", "add", stand.name(who)], check=True)
        stack.callback(subprocess.run, ["ip", "netns", "delete", stand.name(who)], check=True)
        stand.run(who, "ip", "link", "set", "lo", "up")
        stand.run(who, "nft", _COUNT_MULTICAST)
    stand.run(ROUTER, "sysctl", "-qw", "net.ipv4.ip_forward=1")
    return stand


# Cyclone DDS wakes its own threads by a packet to its own socket, over the loopback.
_COUNT_MULTICAST = """\
table ip seen {
  counter announced {}
  counter default {}
  chain out {
    type filter hook output priority 0; policy accept;
    oifname != "lo" ip daddr 224.0.0.0/4 udp dport 10400 counter name default
    oifname != "lo" ip daddr 224.0.0.0/4 udp dport != 10400 counter name announced
  }
}
"""


def _wire(stand: Stand, who: str, address: str, router: str) -> None:
    """Join a computer to the router; its network is a /24."""
    far = f"to-{who}"
    near, there = stand.name(who), stand.name(ROUTER)
    subprocess.run(
        ["ip", "link", "add", "eth0", "netns", near, "type", "veth", "peer", "name", far, "netns", there], check=True
    )
    stand.run(ROUTER, "ip", "address", "add", f"{router}/24", "dev", far)
    stand.run(ROUTER, "ip", "link", "set", far, "up")
    stand.run(who, "ip", "address", "add", f"{address}/24", "dev", "eth0")
    stand.run(who, "ip", "link", "set", "eth0", "up")
    stand.run(who, "ip", "route", "add", "default", "via", router)
    # Fast DDS passes others over for good.
    wait_until(lambda: stand.run(who, "cat", "/sys/class/net/eth0/operstate") == "up\n")


@dataclass
class Participant:
    """A program that talks DDS, and what it has said; times are of the monotonic clock, in seconds."""

    name: str
    process: subprocess.Popen[str]
    lines: list[str] = field(default_factory=list)
    _changed: threading.Condition = field(default_factory=threading.Condition)

    def __post_init__(self) -> None:
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        assert self.process.stdout is not None
        with self.process.stdout:
            for line in self.process.stdout:
                with self._changed:
                    self.lines.append(line.strip())
                    self._changed.notify_all()

    def heard(self, after: float = 0.0) -> list[float]:
        """When it got words of the other."""
        return [at for at in self._times("got") if at > after]

    def lost(self) -> list[float]:
        """When it lost a participant."""
        return self._times("peer -")

    def _times(self, what: str) -> list[float]:
        with self._changed:
            found = [re.match(rf"(\d+\.\d+) {re.escape(what)}", line) for line in self.lines]
        return [float(one[1]) for one in found if one is not None]

    def wait(self, until: Callable[[], object], end: float) -> bool:
        """Wait for what its lines make true; False when it did not come before the end, of the monotonic clock."""
        with self._changed:
            while not until() and time.monotonic() < end:
                self._changed.wait(max(0.0, end - time.monotonic()))
            return bool(until())


def speak(stand: Stand, who: str, program: Sequence[str], domain: int, environment: Mapping[str, str]) -> Participant:
    """Start a participant on a computer."""
    return Participant(who, stand.start(who, *program, who, str(domain), environment=environment))
