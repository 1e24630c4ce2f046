"""The pilot's VPN in network namespaces: real OpenVPN with the product's files, and the product's firewall.

    members -- [192.0.2.0/24] -- net -- [10.64.0.0/24, the server's LAN] -- server, scc-control, a bystander
    coastal-router also has a LAN behind it, with two robots, a gateway and something unknown, and a technician

`net` is the internet and the router of the server's site at once: it leads the public port to the server. What a member
sends there may pass a slow link with outages. Keys are from an authority of its own; nothing here is installed.
"""

import itertools
import os
import socket
import subprocess
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

import pytest
from matrix_papers import issued, write
from slow_link import SATELLITE, Link, open_in
from waiting import HANG_S

from atlantis_netcfg.emulator.udp_link import LinkShape
from atlantis_netcfg.inventory import Inventory
from atlantis_netcfg.vpn import server as product
from atlantis_netcfg.vpn.authority.authority import Authority
from atlantis_netcfg.vpn.authority.model import EnrolmentRequest
from atlantis_netcfg.vpn.identity import MembershipList

NET, SERVER = "net", "server"
BESIDE, BEHIND, TECHNICIAN, ENGINEER = "beside", "behind", "technician", "engineer"
LAN_ZARCO, LAN_GATEWAY, LAN_STRANGER = "lan-zarco", "lan-gateway", "lan-stranger"
ROUTER, CENTRE = "coastal-router", "scc-control"
_NUMBERS = itertools.count()


@dataclass
class Vpn:
    """The namespaces, and whoever has an address in them."""

    prefix: str
    declaration: Inventory
    authority: Authority
    folder: Path
    stack: ExitStack
    members: tuple[str, ...]
    links: dict[str, Link] = field(default_factory=dict)
    """Slow links, by the member that is reached over it."""
    said: dict[str, list[str]] = field(default_factory=dict)
    """What each OpenVPN has said."""
    openvpn: dict[str, subprocess.Popen[str]] = field(default_factory=dict)
    """The processes, for who ends one of them."""

    def name(self, who: str) -> str:
        return f"{self.prefix}-{who}"

    def run(self, who: str, *command: str, text: str | None = None) -> str:
        """Run a command in a namespace and give what it prints."""
        done = subprocess.run(
            ["ip", "netns", "exec", self.name(who), *command], input=text, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, f"{who}: {' '.join(command)}: {done.stderr}"
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

    def socket(self, who: str, *kind: int) -> socket.socket:
        """A socket that lives in a namespace; closed with the stand."""
        made = open_in(self.name(who), *kind)
        self.stack.callback(made.close)
        return made

    def counter(self, name: str) -> int:
        """Packets that a counter of the server's firewall has met."""
        said = self.run(SERVER, "nft", "list", "counter", "inet", "p_atlantis_vpn", name)
        return int(said.partition("packets ")[2].split()[0])

    def load(self, membership: MembershipList | None = None, declaration: Inventory | None = None) -> None:
        """Write what is live at the server, and load its firewall, as a push does."""
        membership = membership or self.authority.membership()
        for file in product.live_files(declaration or self.declaration, membership, self.authority.crl()):
            write(self.placed(file.path), self.placed_text(file.content))
        self.run(SERVER, "nft", "-f", str(self.placed(product.FIREWALL)))

    def placed_text(self, text: str) -> str:
        """The product's paths are below the stand's folder."""
        for path in ("/etc/openvpn/atlantis", "/run/atlantis-vpn", "/etc/atlantis"):
            text = text.replace(path, f"{self.folder}{path}")
        return text

    def placed(self, path: str) -> Path:
        return self.folder / path.removeprefix("/")


def _end(process: subprocess.Popen[str]) -> None:
    process.kill()
    process.wait()


@contextmanager
def vpn(  # noqa: PLR0913 - each is a choice of a test's
    declaration: Inventory,
    wishes: Sequence[EnrolmentRequest],
    folder: Path,
    slow: Sequence[str] = (),
    before: Callable[[Vpn], None] = lambda _made: None,
    *,
    shapes: tuple[LinkShape, ...] = SATELLITE,
) -> Iterator[Vpn]:
    """A server, and every wish a connected member; members in `slow` have a link of `Vpn.links` of these shapes.

    `before` is done when all stands there and nobody has connected yet.
    """
    if os.geteuid() != 0:
        pytest.skip("making a network namespace needs root")
    with ExitStack() as stack:
        made = Vpn(
            prefix=f"vpn{os.getpid()}-{next(_NUMBERS)}",
            declaration=declaration,
            authority=issued(declaration, wishes, folder),
            folder=folder,
            stack=stack,
            members=tuple(one.name for one in wishes),
        )
        _ground(made)
        for number, name in enumerate(made.members):
            _member(made, name, number + 10, shapes if name in slow else None)
        _behind(made)
        before(made)
        _connect(made)
        yield made


_SETTINGS = (
    *(f"net.ipv4.conf.{which}.{what}=0" for which in ("all", "default") for what in ("rp_filter", "send_redirects")),
    *("net.ipv4.icmp_ratelimit=0", "net.ipv4.ip_forward=1", "net.ipv6.conf.default.disable_ipv6=1"),
)
"""Nothing of the kernel's own stands in for the firewall."""


def _namespace(made: Vpn, who: str) -> None:
    subprocess.run(["ip", "netns", "add", made.name(who)], check=True)
    made.stack.callback(subprocess.run, ["ip", "netns", "delete", made.name(who)], check=True)
    made.run(who, "sysctl", "-qw", *_SETTINGS)
    _ip(made, who, "link set lo up")


def _ip(made: Vpn, who: str, *lines: str) -> None:
    subprocess.run(["ip", "-n", made.name(who), "-batch", "-"], input="\n".join(lines), text=True, check=True)


def _ground(made: Vpn) -> None:
    _namespace(made, NET)
    _ip(
        made,
        NET,
        *("link add wan type bridge", "link set wan up", "address add 192.0.2.1/24 dev wan"),
        *("link add lan type bridge", "link set lan up", "address add 10.64.0.1/24 dev lan"),
        *("link add mgmt type bridge", "link set mgmt up", "address add 10.64.100.1/24 dev mgmt"),
        f"address add {made.declaration.pilot.vpn.endpoint}/32 dev lo",
        *(f"route add {network} via 10.64.0.10" for network in ("10.80.0.0/16", "10.64.1.0/24", "10.64.101.0/24")),
    )
    made.run(NET, "nft", "-f", "-", text=_FORWARD)
    for who, bridge, address in (
        (SERVER, "lan", "10.64.0.10"),
        (BESIDE, "lan", "10.64.0.77"),
        (ENGINEER, "mgmt", "10.64.100.10"),
    ):
        _namespace(made, who)
        _cable(made, who, bridge, f"{address}/24", f"{address.rpartition('.')[0]}.1")


_FORWARD = """\
table ip nat {
  map slow { type ipv4_addr : inet_service; }
  chain before {
    type nat hook prerouting priority dstnat;
    ip daddr 203.0.113.2 udp dport 1194 redirect to :ip saddr map @slow
    ip daddr 203.0.113.2 udp dport 1194 dnat to 10.64.0.10
  }
}
"""


def _cable(made: Vpn, who: str, bridge: str, address: str, gateway: str, at: str = NET) -> None:  # noqa: PLR0913, PLR0917
    near, far = made.name(who), made.name(at)
    port = f"{bridge}{next(_NUMBERS)}"
    add = ["ip", "link", "add", "eth0", "netns", near, "type", "veth", "peer", "name", port, "netns", far]
    subprocess.run(add, check=True)
    _ip(made, at, f"link set {port} master {bridge}", f"link set {port} up")
    _ip(made, who, f"address add {address} dev eth0", "link set eth0 up", f"route add default via {gateway}")


def _member(made: Vpn, name: str, number: int, slow: tuple[LinkShape, ...] | None) -> None:
    """One in the internet; the control centre stands in the server's LAN."""
    _namespace(made, name)
    if name == CENTRE:
        return _cable(made, name, "lan", "10.64.0.11/24", "10.64.0.1")
    _cable(made, name, "wan", f"192.0.2.{number}/24", "192.0.2.1")
    if slow is not None:
        made.links[name] = Link(made.name(NET), ("10.64.0.10", 1194), slow)
        made.stack.callback(made.links[name].close)
        element = f"{{ 192.0.2.{number} : {made.links[name].port} }}"
        made.run(NET, "nft", f"add element ip nat slow {element}")
    return None


def _behind(made: Vpn) -> None:
    """What the router of a site has behind it."""
    if ROUTER not in made.members:
        return
    for bridge, network in (("lan", "10.64.1"), ("mgmt", "10.64.101")):
        _ip(
            made,
            ROUTER,
            *(f"link add {bridge} type bridge", f"link set {bridge} up", f"address add {network}.1/24 dev {bridge}"),
        )
    for who, bridge, address in (
        (BEHIND, "lan", "10.64.1.22"),
        (LAN_ZARCO, "lan", "10.64.1.23"),
        (LAN_GATEWAY, "lan", "10.64.1.10"),
        (LAN_STRANGER, "lan", "10.64.1.150"),
        (TECHNICIAN, "mgmt", "10.64.101.10"),
    ):
        _namespace(made, who)
        _cable(made, who, bridge, f"{address}/24", f"{address.rpartition('.')[0]}.1", at=ROUTER)


def _connect(made: Vpn) -> None:
    host = made.declaration.hosts[made.declaration.pilot.vpn.server]
    conf = made.placed("/etc/openvpn/server/atlantis.conf")
    write(conf, made.placed_text(product.server_conf(made.declaration, host)))
    made.placed("/run/atlantis-vpn").mkdir(parents=True)
    for name in ("ca.crt", "server/server.crt", "server/server.key", "server/tls-crypt-v2.key", "server/tls-crypt.key"):
        source = made.authority.folder / name
        write(made.placed(f"{product.FOLDER}/{source.name}"), source.read_text(encoding="utf-8"))
    made.load()
    _openvpn(made, SERVER, conf).wait()
    for up in [_openvpn(made, name, made.folder / f"{name}.ovpn") for name in made.members]:
        up.wait()
    for name in made.members:  # as somebody who tries: the server pushes no way to sites
        _ip(made, name, "route add 10.64.0.0/16 via 10.80.0.1 dev tun0")


@dataclass
class _Up:
    who: str
    lines: list[str]
    done: threading.Event = field(default_factory=threading.Event)
    up: bool = False

    def wait(self) -> None:
        assert self.done.wait(HANG_S), f"{self.who} does not come up:\n{''.join(self.lines)}"
        assert self.up, f"{self.who} ended:\n{''.join(self.lines)}"

    def listen(self, stdout: IO[str]) -> None:
        with stdout:
            for line in stdout:
                self.lines.append(line)
                if "Initialization Sequence Completed" in line:
                    self.up = True
                    self.done.set()
        self.done.set()


def _openvpn(made: Vpn, who: str, conf: Path) -> _Up:
    process = made.openvpn[who] = made.start(who, "openvpn", "--suppress-timestamps", "--config", str(conf))
    up = _Up(who, made.said.setdefault(who, []))
    assert process.stdout is not None
    threading.Thread(target=up.listen, args=(process.stdout,), daemon=True).start()
    return up
