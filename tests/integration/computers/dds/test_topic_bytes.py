"""What messages of a topic cost, against bytes of real participants: Cyclone DDS of PyPI and Fast DDS of Debian.

Two computers in namespaces; every topic has a domain of its own, so that the packets of each are counted by their ports
on the gateway's interface, as IP packets. The participants announce themselves before and after, but not while it is
counted. In CI over plain routing; as a campaign also inside a real OpenVPN over the satellite's delay and rates, where
heartbeats and fragments are repeated. No packet is lost; nothing here is a ROS node.
"""

import re
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path

import pytest
from dds_stand import CENTRE, GATEWAY, Participant, Stand, routed, tunnelled
from slow_link import DELAY_S, UP_BPS
from waiting import wait_until

from atlantis_netcfg.computers.dds import SIZES, profile_views, profiles
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.inventory.model import Dds, DdsPath, RosDistribution, RosMiddleware
from atlantis_netcfg.links.standing_traffic import NO_VPN, DdsMessages, LinkPace, SteadyTopic

if find_spec("cyclonedds") is None:
    pytest.skip("PyPI has no cyclonedds for this machine", allow_module_level=True)
pytestmark = [pytest.mark.slow, pytest.mark.namespace]
PROGRAMS = Path(__file__).with_name("programs")
SHIPPED = Path(__file__).parents[4] / "inventory"
HOSTS = {GATEWAY: ("coastal-gateway", "satellite"), CENTRE: ("scc-control", "uplink")}
TOLERANCE = 0.15
_QUIET_S = 100
"""Between two announcements: none falls into what is counted."""
_FIRST_DOMAIN = 10
CABLE = LinkPace(rtt_s=0.0, up_bps=1e9)
SATELLITE = LinkPace(rtt_s=2 * DELAY_S, up_bps=UP_BPS)
ON_THE_CABLE = (
    SteadyTopic(1.0, 32, reliable=True),
    SteadyTopic(4.0, 32, reliable=True),
    SteadyTopic(4.0, 32),
    SteadyTopic(5.0, 6000, reliable=True),
    SteadyTopic(5.0, 6000),
)
OVER_THE_SATELLITE = (SteadyTopic(1.0, 32, reliable=True), SteadyTopic(4.0, 32), SteadyTopic(0.4, 6000, reliable=True))


@dataclass(frozen=True)
class Kind:
    """An implementation, and how its participants are told of their profile."""

    middleware: RosMiddleware
    release: str
    variable: str
    file: str


CYCLONE = Kind(RosMiddleware.CYCLONE_DDS, "pypi", "CYCLONEDDS_URI", "cyclonedds.xml")
FAST = Kind(RosMiddleware.FAST_DDS, "humble", "FASTRTPS_DEFAULT_PROFILES_FILE", "fastdds.xml")


@dataclass(frozen=True)
class Domain:
    """One topic of one implementation."""

    number: int
    kind: Kind
    topic: SteadyTopic

    @property
    def typed(self) -> str:
        """As the programs read it."""
        reliability = "reliable" if self.topic.reliable else "best-effort"
        return f"{self.number}:{self.topic.size_bytes}:{self.topic.rate_hz:g}:{reliability}"

    @property
    def ports(self) -> str:
        """Of all its participants."""
        first = 7400 + 250 * self.number
        return f"{first}-{first + 99}"

    def expected(self, pace: LinkPace) -> tuple[float, float]:
        """Bytes a message, up and down, as they are reckoned."""
        cost = DdsMessages(1200, 1100, SIZES[self.kind.middleware], NO_VPN).cost(self.topic, pace)
        return cost.bytes_up, cost.bytes_down

    def __str__(self) -> str:
        return f"{self.kind.middleware} {self.typed}"


def domains(topics: Sequence[SteadyTopic], *kinds: Kind) -> list[Domain]:
    cases = [(kind, topic) for kind in kinds for topic in topics]
    return [Domain(number, kind, topic) for number, (kind, topic) in enumerate(cases, start=_FIRST_DOMAIN)]


def declared(over: DdsPath, topics: Sequence[SteadyTopic]) -> Inventory:
    """As many participants as a process has: what they announce at first must not fill the satellite's queue."""
    declaration = load(SHIPPED)
    dds = Dds(distribution=RosDistribution.HUMBLE, over=over, participants=len(topics))
    return replace(declaration, pilot=declaration.pilot.model_copy(update={"dds": dds}))


def environment(declaration: Inventory, who: str, kind: Kind, folder: Path) -> Mapping[str, str]:
    """The computer's own profile, with its announcements far apart."""
    host, bearer = HOSTS[who]
    views = profile_views(declaration, declaration.hosts[host], kind.release)
    view = next(each for each in views if each.link == bearer)
    assert (view.tuning.message_bytes, view.tuning.fragment_bytes) == (1200, 1100)
    quiet = replace(view, tuning=replace(view.tuning, announce_s=_QUIET_S))
    path = folder / f"{who}-{kind.file}"
    path.write_text(profiles(quiet)[f"{bearer}/{kind.file}"], encoding="utf-8")
    return {kind.variable: str(path)}


@pytest.fixture(scope="module")
def programs(tmp_path_factory: pytest.TempPathFactory) -> Mapping[Kind, Sequence[str]]:
    """The participants; that of Fast DDS is built."""
    fast = tmp_path_factory.mktemp("programs") / "steady_fast"
    source = PROGRAMS / "steady_fast.cpp"
    done = subprocess.run(
        ["g++", "-o", str(fast), str(source), "-lfastrtps", "-lfastcdr"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return {CYCLONE: (sys.executable, str(PROGRAMS / "steady_python.py")), FAST: (str(fast),)}


class Counters:
    """Bytes of each domain on an interface of the gateway."""

    def __init__(self, stand: Stand, interface: str, counted: Sequence[Domain]) -> None:
        self.stand = stand
        chains = {"up": ("output", "oifname"), "down": ("input", "iifname")}
        lines = ["table ip topics {", *(f"counter {way}{each.number} {{}}" for way in chains for each in counted)]
        for way, (hook, name) in chains.items():
            lines.append(f"chain {way} {{ type filter hook {hook} priority 0;")
            lines += [
                f'{name} "{interface}" udp dport {each.ports} counter name {way}{each.number}' for each in counted
            ]
            lines.append("}")
        stand.run(GATEWAY, "nft", "\n".join([*lines, "}"]))

    def read(self) -> Mapping[str, int]:
        said = self.stand.run(GATEWAY, "nft", "list", "counters", "table", "ip", "topics")
        return {name: int(count) for name, count in re.findall(r"counter (\w+) \{\s+packets \d+ bytes (\d+)", said)}


def heard(readers: Iterable[Participant]) -> Counter[int]:
    """Messages of each domain so far."""
    return Counter(int(line.split()[2]) for reader in readers for line in list(reader.lines) if " got " in line)


def counted(
    stand: Stand, interface: str, of: Sequence[Domain], readers: Sequence[Participant], seconds: float
) -> dict[Domain, tuple[float, float]]:
    """Bytes a message, up and down, once every topic has been heard."""
    wait_until(lambda: all(heard(readers)[each.number] for each in of), lambda: heard(readers), 0.1)
    time.sleep(3)  # what was said while they met has been acknowledged
    counters, before = Counters(stand, interface, of), heard(readers)
    time.sleep(seconds)
    bytes_, messages = counters.read(), heard(readers) - before
    return {
        each: (bytes_[f"up{each.number}"] / messages[each.number], bytes_[f"down{each.number}"] / messages[each.number])
        for each in of
    }


def talk(
    stand: Stand, declaration: Inventory, of: Sequence[Domain], programs: Mapping[Kind, Sequence[str]], folder: Path
) -> list[Participant]:
    """The gateway writes, the control centre reads; the readers."""
    readers = []
    for kind in dict.fromkeys(each.kind for each in of):
        typed = [each.typed for each in of if each.kind is kind]
        for who, role in ((CENTRE, "read"), (GATEWAY, "write")):
            told = environment(declaration, who, kind, folder)
            process = stand.start(who, *programs[kind], role, *typed, environment=told)
            speaker = Participant(kind.middleware.value, process)
            readers += [speaker] * (role == "read")
    return readers


def sent_again(domain: Domain) -> bool:
    """Reliable messages of Fast DDS in fragments: how many of these are asked for again is not the same each time."""
    fits = domain.topic.size_bytes <= 1100
    return domain.kind is FAST and domain.topic.reliable and not fits


def differences(found: Mapping[Domain, tuple[float, float]], pace: LinkPace) -> list[str]:
    """Those whose bytes of both directions together are not as reckoned, in words."""
    return [
        f"{domain}: {up:.0f} up and {down:.0f} down, and reckoned are {domain.expected(pace)}"
        for domain, (up, down) in found.items()
        if up + down != pytest.approx(sum(domain.expected(pace)), rel=TOLERANCE)
    ]


def test_topic_traffic_on_the_lan_matches_the_estimate(tmp_path: Path, programs: Mapping[Kind, Sequence[str]]) -> None:
    declaration, of = declared(DdsPath.LAN, ON_THE_CABLE), domains(ON_THE_CABLE, CYCLONE, FAST)
    addresses = [declaration.pilot.dds.address_of(declaration.hosts[host].device) for host, _ in HOSTS.values()]  # type: ignore[union-attr, arg-type]
    with routed(*addresses) as stand:
        readers = talk(stand, declaration, of, programs, tmp_path)
        found = counted(stand, "eth0", of, readers, 12)
    assert differences(found, CABLE) == []
    quiet = [each for each in of if not each.topic.reliable]
    assert [found[each][1] for each in quiet] == [0.0] * len(quiet)


@pytest.mark.campaign
@pytest.mark.parametrize("kind", [CYCLONE, FAST], ids=lambda kind: kind.middleware.value)
def test_topic_traffic_over_the_satellite_matches_the_estimate(
    tmp_path: Path, programs: Mapping[Kind, Sequence[str]], kind: Kind
) -> None:
    """Inside the tunnel, one implementation at a time; what the VPN adds is `test_standing_bytes.py`'s."""
    declaration, of = declared(DdsPath.VPN, OVER_THE_SATELLITE), domains(OVER_THE_SATELLITE, kind)
    with tunnelled(declaration, tmp_path) as stand:
        readers = talk(stand, declaration, of, programs, tmp_path)
        found = counted(stand, "tun0", of, readers, 30)
    again = {each: found.pop(each) for each in of if sent_again(each)}
    assert differences(found, SATELLITE) == []
    for domain, (up, _) in again.items():
        once = replace(domain, topic=replace(domain.topic, reliable=False)).expected(SATELLITE)[0]
        assert 1.5 * once < up < (1 + TOLERANCE) * domain.expected(SATELLITE)[0], f"{domain}: {up:.0f}"
    assert len(again) == (kind is FAST)
