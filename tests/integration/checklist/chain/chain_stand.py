"""The whole way of a robot's data in network namespaces, with real programs and the product's files.

    robot -- access point --+
                            +-- router == wifi-ptp | 4g | satellite == internet -- VPN server -- control centre
    gateway -- cable -------+

Robot, gateway and control centre are members of a real OpenVPN, and each runs a real DDS participant with its rendered
profile. The router is the namespace of tests/integration/links/satellite: Linux with the translation of its rendered
firewall, and a default route that leads over one link. Its change of link is a change of that route, after which
connections are forgotten, as the router's own scripts do. The server is that of tests/integration/vpn/network.

No radio is here: the access point's radio and the three links are pairs of veth. The satellite alone is slow (700 ms,
352 and 704 kbit/s), by the relay of tests/integration/vpn/network, for not every kernel has netem.
"""

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from dds_stand import Participant
from matrix_papers import guest, host
from matrix_stand import NET, Vpn, vpn
from satellite_rendered import rendered
from satellite_stage import ROBOT as ACCESS_POINT
from satellite_stage import Stage, stage
from slow_link import Link

from atlantis_netcfg.computers.base import gateway_base
from atlantis_netcfg.computers.dds import (
    RELEASES,
    MemberDds,
    ProfileView,
    member_files,
    member_view,
    profile_in_use,
    profiles,
)
from atlantis_netcfg.computers.reflector import PROGRAM, SERVICE
from atlantis_netcfg.inventory import Inventory
from atlantis_netcfg.inventory.model import DdsPeer, LinkKind
from atlantis_netcfg.vpn.identity import MemberKind

SITE, VEHICLE = "coastal", "zarco"
GATEWAY, CENTRE = "coastal-gateway", "scc-control"
ROBOT = f"inesc-{VEHICLE}"
MEMBERS = (ROBOT, GATEWAY, CENTRE)
BEARERS = ("wifi-ptp", "4g", "satellite")
WORDS = 3
"""So many words of another participant show that it is heard."""
_PEER = Path(__file__).parents[2] / "computers" / "dds" / "programs" / "python_peer.py"
_LAN = {ROBOT: "10.64.1.23", GATEWAY: "10.64.1.10"}
"""In the site's LAN, as declared."""
_MEET_S = 100.0


@dataclass
class Chain:
    """What stands, by the names of the elements."""

    declaration: Inventory
    site: Stage
    net: Vpn
    folder: Path
    participants: dict[str, Participant] = field(default_factory=dict)
    reflector: dict[str, subprocess.Popen[str]] = field(default_factory=dict)

    def choose(self, bearer: str) -> None:
        """Let the site's traffic leave by this link, as after `provision links use`, or as failover does it."""
        self.site.prefer(bearer)
        self.site.forget()

    @property
    def bearer(self) -> str:
        """By which link the router's default route leads."""
        route = self.site.run("router", "ip", "route", "show", "default").split()
        return next(link.name for link in self.site.view.uplinks if link.gateway == route[2])

    def carried(self) -> dict[str, int]:
        """Packets that each link has carried to the internet so far, by the counter of its far end."""
        return {name: int(self.site.run(name, "cat", "/sys/class/net/near/statistics/rx_packets")) for name in BEARERS}

    def cable(self, who: str, state: str) -> None:
        """Put a computer's cable, or the robot's radio, `down` or `up`."""
        self.net.run(who, "ip", "link", "set", "eth0", state)
        if state == "up":
            gateway = "10.64.0.1" if who == CENTRE else "10.64.1.1"
            self.net.run(who, "ip", "route", "replace", "default", "via", gateway)

    def link(self, bearer: str, state: str) -> None:
        """Put the far end of a link `down` or `up`: the router's own end sees nothing of it but silence."""
        self.site.run(bearer, "ip", "link", "set", "far", state)
        if state == "up":
            self.site.run(bearer, "ip", "route", "replace", "default", "via", "192.0.2.1")

    def meet(self, pairs: set[tuple[str, str]], after: float) -> set[tuple[str, str]]:
        """Wait until the second of each pair has heard the first anew; give the pairs of all who have heard so.

        Those who are not waited for have had as long: each speaks twice a second.
        """
        end = time.monotonic() + _MEET_S
        for speaker, listener in sorted(pairs):
            participant = self.participants[listener]
            participant.wait(partial(self._heard, participant, speaker, after), end)
        return {
            (speaker, listener)
            for listener, participant in self.participants.items()
            for speaker in MEMBERS
            if speaker != listener and self._heard(participant, speaker, after)
        }

    @staticmethod
    def _heard(participant: Participant, speaker: str, after: float) -> bool:
        lines = [line.split() for line in list(participant.lines)]
        got = [float(words[0]) for words in lines if words[1:3] == ["got", speaker]]
        return sum(at > after for at in got) >= WORDS


@contextmanager
def chain(declaration: Inventory, folder: Path) -> Iterator[Chain]:
    """Build it, with Wi-Fi in use, and take it down again."""
    wishes = [host(declaration, GATEWAY), host(declaration, CENTRE)]
    wishes.append(guest(declaration, "inesc", VEHICLE, MemberKind.ROBOT, VEHICLE))
    text = rendered(SITE)
    with ExitStack() as stack:
        site = stack.enter_context(stage(text.view))
        net = stack.enter_context(vpn(declaration, wishes, folder))
        made = Chain(declaration, site, net, folder)
        _join(made)
        site.load(text.export)
        made.choose(BEARERS[0])
        for name in MEMBERS:
            _equip(made, name)
        yield made


def _join(made: Chain) -> None:
    """Bring robot and gateway behind the router, and each link of it to the internet."""
    site, bridge = made.site, made.site.view.bridge
    for words in (
        f"link set {bridge} down",
        f"link set {bridge} name port-ap",
        "address flush dev port-ap",
        f"link add {bridge} type bridge",
        f"address add {site.view.lan.address} dev {bridge}",
        f"link set port-ap master {bridge}",
        "link set port-ap up",
        f"link set {bridge} up",
    ):
        site.run("router", "ip", *words.split())
    site.run(ACCESS_POINT, "ip", "link", "set", "near", "down")  # the stage's own neighbour is not needed
    for number, name in enumerate((ROBOT, GATEWAY)):
        _behind(made, name, f"port{number}")
    for number, name in enumerate(BEARERS):
        _to_internet(made, name, 201 + number)
    for name in (ROBOT, GATEWAY):
        _slowly(made, name)


def _slowly(made: Chain, name: str) -> None:
    """Lead a member's tunnel through a slow relay of its own when it comes by satellite: its port tells whose it is."""
    (row,) = made.net.run(name, "ss", "-Huna").splitlines()
    port = row.split()[3].rpartition(":")[2]
    slow = made.net.links[name] = Link(made.net.name(NET), ("10.64.0.10", 1194))
    made.net.stack.callback(slow.close)
    rule = f"ip saddr 192.0.2.203 udp sport {port} udp dport 1194 redirect to :{slow.port}"
    made.net.run(NET, "nft", f"insert rule ip nat before {rule}")


def _behind(made: Chain, name: str, port: str) -> None:
    near, router = made.net.name(name), made.site.name("router")
    made.net.run(name, "ip", "link", "delete", "eth0")
    add = ["ip", "link", "add", "eth0", "netns", near, "type", "veth", "peer", "name", port, "netns", router]
    subprocess.run(add, check=True)
    made.site.run("router", "ip", "link", "set", port, "master", made.site.view.bridge)
    made.site.run("router", "ip", "link", "set", port, "up")
    made.net.run(name, "ip", "address", "add", f"{_LAN[name]}/24", "dev", "eth0")
    made.cable(name, "up")
    made.net.run(name, "ip", "route", "delete", "10.64.0.0/16")  # that of somebody who tries, in the matrix


def _to_internet(made: Chain, name: str, number: int) -> None:
    """A link's operator: it forwards, and translates to an address of its own."""
    far, net, port = made.site.name(name), made.net.name(NET), f"isp{number}"
    subprocess.run(
        ["ip", "link", "add", "far", "netns", far, "type", "veth", "peer", "name", port, "netns", net], check=True
    )
    made.net.run(NET, "ip", "link", "set", port, "master", "wan")
    made.net.run(NET, "ip", "link", "set", port, "up")
    made.site.run(name, "ip", "address", "delete", f"{made.declaration.pilot.vpn.endpoint}/32", "dev", "lo")
    made.site.run(name, "ip", "address", "add", f"192.0.2.{number}/24", "dev", "far")
    made.site.run(name, "sysctl", "-qw", "net.ipv4.ip_forward=1")
    made.link(name, "up")
    made.site.run(name, "nft", "-f", "-", text=_OPERATOR)


_OPERATOR = """\
table ip operator {
  chain out {
    type nat hook postrouting priority 100;
    oifname "far" masquerade
  }
}
"""


def _equip(made: Chain, name: str) -> None:
    """What the roles bring: firewall and reflector of our own computers, and a participant with its profile."""
    if name != ROBOT:
        files = {
            file.path: file for file in gateway_base(made.declaration, made.declaration.hosts[name]).configuration.files
        }
        made.net.run(name, "nft", "-f", "-", text=files["/etc/nftables.conf"].content)
        reflect(made, name)
    view = _view(made, name)
    texts = member_files(view) if name == ROBOT else {"cyclonedds.xml": profiles(view)[f"{view.link}/cyclonedds.xml"]}
    profile = made.folder / f"{name}.xml"
    profile.write_text(texts["cyclonedds.xml"], encoding="utf-8")
    speak = made.net.start(
        name, sys.executable, str(_PEER), name, str(view.domain), environment={"CYCLONEDDS_URI": f"file://{profile}"}
    )
    made.participants[name] = Participant(name, speak)


def reflect(made: Chain, name: str) -> None:
    """Start what answers the checklists, by the command of its unit."""
    files = {
        file.path: file.content
        for file in gateway_base(made.declaration, made.declaration.hosts[name]).configuration.files
    }
    program = made.folder / "reflector.py"
    program.write_text(files[PROGRAM], encoding="utf-8")
    unit = files[f"/etc/systemd/system/{SERVICE}"]
    command = next(line for line in unit.splitlines() if line.startswith("ExecStart="))
    words = command.removeprefix("ExecStart=").replace(PROGRAM, str(program)).split()
    started = made.reflector[name] = made.net.start(name, *words)
    assert started.stdout is not None
    made.net.stack.callback(started.stdout.close)


def _view(made: Chain, name: str) -> ProfileView:
    """The profile that is in use, in the dialect of PyPI's Cyclone DDS."""
    members = made.net.authority.membership().members
    dds = made.declaration.pilot.dds
    assert dds is not None
    if name == ROBOT:
        peers = tuple((other, str(members[other].address)) for other in (GATEWAY, CENTRE))
        slowest = LinkKind.SATELLITE.traits.pace
        member = MemberDds(name, str(members[name].address), slowest, peers, dds.distribution)
        return replace(member_view(made.declaration, member), release=RELEASES["pypi"])
    robot = DdsPeer(name=ROBOT, address=members[ROBOT].address)
    pilot = made.declaration.pilot.model_copy(update={"dds": dds.model_copy(update={"peers": (robot,)})})
    declaration = replace(made.declaration, pilot=pilot)
    return replace(profile_in_use(declaration, declaration.hosts[name]), release=RELEASES["pypi"])


def end(process: subprocess.Popen[str]) -> None:
    """As a crash does it: the other end is not told."""
    process.kill()
    process.wait()
