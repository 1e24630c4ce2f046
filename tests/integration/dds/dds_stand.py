"""Two computers of the pilot in network namespaces, joined by plain routing or by a real OpenVPN, with a link to cut.

    gateway ---- router ---- centre          the gateway's link is cut at the router's side
                  server (OpenVPN, in the router's place)

The computers have their declared addresses and nothing else; the router passes no multicast. What a participant hears
it says in lines, which a thread keeps; waiting is for lines, not for time.
"""

from __future__ import annotations

import itertools
import os
import re
import subprocess
import threading
import time
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from typing import IO, TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

GATEWAY, ROUTER, CENTRE = "gateway", "router", "centre"
DEFAULT_DOMAIN = 12
"""For participants without a profile; they announce themselves to port 7400 + 250 * 12 of a multicast address."""
_PATIENCE_S = 20.0
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


@contextmanager
def tunnelled(gateway: str, centre: str, server: str, folder: Path) -> Iterator[Stand]:
    """The two addresses in the tunnels of an OpenVPN server that stands in the router's place."""
    with ExitStack() as stack:
        stand = _namespaces(stack, {GATEWAY: gateway, CENTRE: centre})
        _wire(stand, GATEWAY, "10.9.1.2", "10.9.1.1")
        _wire(stand, CENTRE, "10.9.2.2", "10.9.2.1")
        _vpn(stand, server, folder)
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
    end = time.monotonic() + _PATIENCE_S
    while stand.run(who, "cat", "/sys/class/net/eth0/operstate") != "up\n":  # Fast DDS passes others over for good
        assert time.monotonic() < end


def _vpn(stand: Stand, server: str, folder: Path) -> None:
    """OpenVPN as the facts recommend: tun, subnet, client to client, a tunnel MTU of 1400, a restart after 180 s."""
    prints = {who: _certificate(folder, who) for who in (GATEWAY, ROUTER, CENTRE)}
    clients = folder / "clients"
    clients.mkdir()
    for who, address in stand.addresses.items():
        (clients / who).write_text(f"ifconfig-push {address} 255.255.0.0\n")
    network = f"{'.'.join(server.split('.')[:2])}.0.0"
    common: tuple[str, ...] = (
        "--dev",
        "tun0",
        "--dev-type",
        "tun",
        "--topology",
        "subnet",
        "--tun-mtu",
        "1400",
        "--disable-dco",
    )
    common += ("--keepalive", "10", "180", "--dh", "none", "--verb", "3", "--suppress-timestamps")
    openvpn = stand.start(
        *(ROUTER, "openvpn", *common, "--server", network, "255.255.0.0", "nopool", "--client-to-client"),
        *("--client-config-dir", str(clients), "--port", "1194", *_identity(folder, ROUTER)),
        *("--peer-fingerprint", prints[GATEWAY], "--peer-fingerprint", prints[CENTRE]),
    )
    _await(openvpn, "Initialization Sequence Completed")
    for who, remote in ((GATEWAY, "10.9.1.1"), (CENTRE, "10.9.2.1")):
        client = stand.start(
            *(who, "openvpn", *common, "--client", "--nobind", "--remote", remote, "1194", *_identity(folder, who)),
            *("--peer-fingerprint", prints[ROUTER]),
        )
        _await(client, "Initialization Sequence Completed")


def _identity(folder: Path, who: str) -> tuple[str, ...]:
    return ("--cert", str(folder / f"{who}.crt"), "--key", str(folder / f"{who}.key"))


def _certificate(folder: Path, who: str) -> str:
    """Make a key and a certificate that signs itself; give its fingerprint."""
    key, certificate = str(folder / f"{who}.key"), str(folder / f"{who}.crt")
    new = ("req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-days", "2")
    subject = ("-subj", f"/CN={who}", "-keyout", key, "-out", certificate)
    subprocess.run(["openssl", *new, *subject], check=True, capture_output=True)
    shown = ("x509", "-fingerprint", "-sha256", "-noout", "-in", certificate)
    done = subprocess.run(["openssl", *shown], check=True, capture_output=True, text=True)
    return done.stdout.strip().partition("=")[2]


def _await(process: subprocess.Popen[str], words: str) -> None:
    """Read a program's lines up to the one with these words, and go on reading behind the test's back."""
    assert process.stdout is not None
    said = []
    for line in process.stdout:
        said.append(line)
        if words in line:
            threading.Thread(target=_drain, args=(process.stdout,), daemon=True).start()
            return
    pytest.fail(f"it ended:\n{''.join(said)}")


def _drain(lines: IO[str]) -> None:
    with lines:
        lines.read()


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
