"""With the generated profiles real participants meet without multicast, and again after a satellite's 70 s of silence.

Cyclone DDS of PyPI and of Debian and Fast DDS of Debian, each between two computers of the shipped pilot: over plain
routing and through the pilot's VPN, of which the gateway is a member over a satellite. All share one outage. Debian's
versions (Cyclone DDS 0.10.2, Fast DDS 2.9.1) stand for those of Humble and Jazzy; nothing here runs Foxy's own (0.7,
2.1).
"""

import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import pytest
from dds_stand import CENTRE, DEFAULT_DOMAIN, GATEWAY, Participant, Stand, Tunnelled, routed, speak, tunnelled

from atlantis_netcfg.computers.dds import GAP_S, ProfileView, profile_views, profiles
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.inventory.model import Dds, DdsPath, RosDistribution

PROGRAMS = Path(__file__).with_name("programs")
SHIPPED = Path(__file__).parents[4] / "inventory"
HOSTS = {GATEWAY: ("coastal-gateway", "satellite"), CENTRE: ("scc-control", "uplink")}
CYCLONE, FAST = "CYCLONEDDS_URI", "FASTRTPS_DEFAULT_PROFILES_FILE"
_MEET_S = 70.0
"""Three announcements of the satellite's profile; those who have met are not waited for."""
if find_spec("cyclonedds") is None:
    pytest.skip("PyPI has no cyclonedds for this machine", allow_module_level=True)
pytestmark = [pytest.mark.slow, pytest.mark.namespace]


@dataclass(frozen=True)
class Kind:
    """An implementation: the release whose dialect it speaks, and how it is told of its profile."""

    release: str
    program: str
    variable: str
    file: str


KINDS = {
    "cyclone-pypi": Kind("pypi", "python_peer.py", CYCLONE, "cyclonedds.xml"),
    "cyclone-debian": Kind("humble", "cyclone_peer", CYCLONE, "cyclonedds.xml"),
    "fast-debian": Kind("humble", "fast_peer", FAST, "fastdds.xml"),
}
SHORT, NONE = "cyclone-pypi with a lease of 10 s", "cyclone-pypi without a profile"


@dataclass
class Told:
    """What came of one pair."""

    stand: Stand | Tunnelled
    gateway: Participant
    centre: Participant
    cut: float = 0.0
    mended: float = 0.0

    @property
    def both(self) -> tuple[Participant, Participant]:
        return self.gateway, self.centre

    def said(self) -> str:
        lines = [f"{one.name} {line}" for one in self.both for line in one.lines]
        return "\n".join([f"cut at {self.cut:.1f}, mended at {self.mended:.1f}", *lines])

    def _heard(self, one: Participant) -> bool:
        return len(one.heard(self.mended)) >= 3

    def met(self, end: float) -> bool:
        """Whether both have heard the other three times since the link was mended, or since the start."""
        return all(one.wait(partial(self._heard, one), end) for one in self.both)


def declared(over: DdsPath) -> Inventory:
    declaration = load(SHIPPED)
    dds = Dds(distribution=RosDistribution.HUMBLE, over=over)
    return replace(declaration, pilot=declaration.pilot.model_copy(update={"dds": dds}))


def view(declaration: Inventory, who: str, release: str = "humble") -> ProfileView:
    host, bearer = HOSTS[who]
    return next(one for one in profile_views(declaration, declaration.hosts[host], release) if one.link == bearer)


def written(declaration: Inventory, who: str, kind: Kind, folder: Path) -> Path:
    """The computer's profile for an implementation, as `provision robot dds` writes it."""
    one = view(declaration, who, kind.release)
    path = folder / f"{who}-{kind.release}-{kind.file}"
    path.write_text(profiles(one)[f"{one.link}/{kind.file}"], encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def programs(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Sequence[str]]:
    """The participants, built from their sources."""
    built = tmp_path_factory.mktemp("programs")
    for command in (
        ["idlc", "-l", "c", "-x", "final", "-o", str(built), str(PROGRAMS / "proof.idl")],
        [
            "gcc",
            "-I",
            str(built),
            "-o",
            str(built / "cyclone_peer"),
            str(PROGRAMS / "cyclone_peer.c"),
            str(built / "proof.c"),
            "-lddsc",
        ],
        ["g++", "-o", str(built / "fast_peer"), str(PROGRAMS / "fast_peer.cpp"), "-lfastrtps", "-lfastcdr"],
    ):
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
    return {
        "python_peer.py": (sys.executable, str(PROGRAMS / "python_peer.py")),
        "cyclone_peer": (str(built / "cyclone_peer"),),
        "fast_peer": (str(built / "fast_peer"),),
    }


@pytest.fixture(scope="module")
def outage(
    tmp_path_factory: pytest.TempPathFactory, programs: Mapping[str, Sequence[str]]
) -> Iterator[Mapping[str, Told]]:
    """All pairs on both ways: they meet, both links are cut for 70 s, they are waited for again."""
    folder = tmp_path_factory.mktemp("outage")
    with ExitStack() as stack:
        told: dict[str, Told] = {}
        for way in DdsPath:
            declaration = declared(way)
            gateway, centre = (view(declaration, who).address for who in (GATEWAY, CENTRE))
            below = folder / way
            below.mkdir()
            made = routed(gateway, centre) if way is DdsPath.LAN else tunnelled(declaration, below)
            stand = stack.enter_context(made)
            told |= {f"{name} {way}": pair for name, pair in _pairs(stand, declaration, programs, below)}
        yield _lived_through(told)


def _pairs(
    stand: Stand, declaration: Inventory, programs: Mapping[str, Sequence[str]], folder: Path
) -> Iterator[tuple[str, Told]]:
    for domain, (name, kind) in enumerate(KINDS.items(), start=1):
        files = {who: written(declaration, who, kind, folder) for who in HOSTS}
        yield (
            name,
            _pair(stand, programs[kind.program], domain, {who: {kind.variable: str(files[who])} for who in HOSTS}),
        )
    if isinstance(stand, Tunnelled):
        return  # the others are about the participants, and would have their share of the slow link
    kind, python = KINDS["cyclone-pypi"], programs["python_peer.py"]
    short = {}
    for who in HOSTS:
        path = written(declaration, who, kind, folder)
        text = path.read_text(encoding="utf-8")
        assert text.count("<LeaseDuration>120s<") == 1
        path = path.with_name(f"short-{path.name}")
        path.write_text(text.replace("<LeaseDuration>120s<", "<LeaseDuration>10s<"), encoding="utf-8")
        short[who] = {kind.variable: str(path)}
    yield SHORT, _pair(stand, python, 11, short)
    yield NONE, _pair(stand, python, DEFAULT_DOMAIN, {who: {} for who in HOSTS})


def _pair(stand: Stand, program: Sequence[str], domain: int, environment: Mapping[str, Mapping[str, str]]) -> Told:
    gateway, centre = (speak(stand, who, program, domain, environment[who]) for who in (GATEWAY, CENTRE))
    return Told(stand, gateway, centre)


def _lived_through(told: dict[str, Told]) -> dict[str, Told]:
    stands = {pair.stand.prefix: pair.stand for pair in told.values()}.values()
    expected = {name: pair for name, pair in told.items() if not name.startswith(NONE)}
    end = time.monotonic() + _MEET_S
    assert [f"{name}: {pair.said()}" for name, pair in expected.items() if not pair.met(end)] == []
    for stand in stands:
        stand.cut()
    cut = time.monotonic()
    time.sleep(GAP_S)
    mended = time.monotonic()
    for stand in stands:
        stand.mend()
    for pair in told.values():
        pair.cut, pair.mended = cut, mended
    end = time.monotonic() + _MEET_S
    for pair in expected.values():
        pair.met(end)
    return told


def test_real_participants_survive_a_satellite_outage(outage: Mapping[str, Told]) -> None:
    """One test, because the outage is real time and two workers of xdist would each have one."""
    for way in DdsPath:
        for name in KINDS:
            _meet_and_meet_again(outage[f"{name} {way}"])
        assert outage[f"cyclone-pypi {way}"].stand.multicast_sent("announced") == 0
    _stay_up(outage[f"cyclone-pypi {DdsPath.VPN}"].stand)
    _give_the_other_up(outage[f"{SHORT} {DdsPath.LAN}"])
    _never_meet(outage[f"{NONE} {DdsPath.LAN}"])


def _stay_up(stand: Stand) -> None:
    """The tunnel has outlived the silence: it came up once."""
    assert isinstance(stand, Tunnelled)
    assert stand.tunnels() == 1, "".join(stand.vpn.said["coastal-gateway"])
    assert stand.vpn.counter("p_spoofed") == 0


def _meet_and_meet_again(pair: Told) -> None:
    for one in pair.both:
        assert len(one.heard()) > len(one.heard(pair.cut)) >= 3, pair.said()
        assert [at for at in one.heard(pair.cut + 2) if at < pair.mended] == [], pair.said()
        assert len(one.heard(pair.mended)) >= 3, pair.said()
        assert one.lost() == [], pair.said()


def _give_the_other_up(pair: Told) -> None:
    """With a short lease: what the proof would look like if the lease did not matter."""
    for one in pair.both:
        assert [at for at in one.lost() if pair.cut < at < pair.mended] != [], pair.said()


def _never_meet(pair: Told) -> None:
    """Without a profile: what the proof would look like if the router passed multicast."""
    assert [one.heard() for one in pair.both] == [[], []], pair.said()
    assert pair.stand.multicast_sent("default") > 0
