"""The VPN and DDS over a satellite: who hears whom, through a terminal that lets the pilot's addresses alone pass.

And what the standing traffic is reckoned to be, against the bytes of this real OpenVPN and these real participants.

The pilot's VPN in namespaces, with every file as the product writes it; counted are IP packets on the gateway's own
interface, as a provider does. Cyclone DDS of PyPI speaks here; what Fast DDS sends was counted by hand.
The times are shorter than those of a pilot, so that a minute is enough: the figures are reckoned with the same times.
Delay and rates are the declared ones of the satellite (`slow_link.py`). No packet is lost; real airtime loses some.
"""

import re
import socket
import sys
import time
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path

import pytest
from dds_stand import Participant
from matrix_papers import host
from matrix_stand import NET, SERVER, Vpn, vpn
from slow_link import DELAY_S, DOWN_BPS, UP_BPS
from waiting import HANG_S

from atlantis_netcfg.computers.dds import TUNING, ProfileView, profile_in_use, profile_views, profiles
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.inventory.model import Dds, Pace, RosDistribution, RosMiddleware, TelemetryData, TelemetryTopic
from atlantis_netcfg.inventory.satellite_allow_list import allowed_targets
from atlantis_netcfg.links.standing_traffic import DAY_S, NO_VPN, SteadyTopic, TrafficSource, keep_alive, topic_flow
from atlantis_netcfg.operations.common.traffic_budget import declared_pace, standing_traffic
from atlantis_netcfg.vpn.identity import TIMERS, MemberLink

if find_spec("cyclonedds") is None:
    pytest.skip("PyPI has no cyclonedds for this machine", allow_module_level=True)
pytestmark = [pytest.mark.slow, pytest.mark.namespace]
SHIPPED = Path(__file__).parents[4] / "inventory"
PROGRAM = Path(__file__).with_name("programs") / "python_peer.py"
GATEWAY, CENTRE = "coastal-gateway", "scc-control"
TOLERANCE = 0.15
_ANNOUNCE_S, _PING_S, _RENEGOTIATION_S = 5, 2, 15
STEADY = Path(__file__).with_name("programs") / "steady_python.py"
RELIABLE, RELIABLE_DOMAIN = SteadyTopic(1.0, 32, reliable=True), 10
_WORD_HZ, _WORD_BYTES = 2.0, 20
"""Of `python_peer.py`: a header of CDR, a length, and a word of up to twelve characters."""
_COUNT = """\
table ip standing {
  counter up {}
  counter down {}
  chain out { type filter hook output priority 0; oifname "eth0" counter name up; }
  chain in { type filter hook input priority 0; iifname "eth0" counter name down; }
  counter reliable_up {}
  counter reliable_down {}
  chain inside_out { type filter hook output priority 0; oifname "tun0" udp dport 9900-9999 counter name reliable_up; }
  chain inside_in { type filter hook input priority 0; iifname "tun0" udp dport 9900-9999 counter name reliable_down; }
}
"""
_TERMINAL = """\
table ip terminal {
  set admitted { type ipv4_addr . inet_proto . inet_service; elements = { ADMITTED } }
  counter kept_off {}
  chain out {
    type filter hook prerouting priority raw
    ip saddr GATEWAY ip daddr . ip protocol . th dport != @admitted counter name kept_off drop
    ip saddr GATEWAY ip protocol != { tcp, udp } counter name kept_off drop
  }
  chain in {
    type filter hook postrouting priority 200
    ip daddr GATEWAY ip saddr . ip protocol . th sport != @admitted counter name kept_off drop
  }
}
"""


@dataclass(frozen=True)
class Counted:
    """Bytes that a computer has sent and received, and so many seconds."""

    up: float
    down: float
    seconds: float

    def a_day(self) -> tuple[float, float]:
        return self.up * DAY_S / self.seconds, self.down * DAY_S / self.seconds


def read(made: Vpn, name: str) -> int:
    said = made.run(GATEWAY, "nft", "list", "counter", "ip", "standing", name)
    return int(re.findall(r"bytes (\d+)", said)[0])


def count(made: Vpn, seconds: float) -> Counted:
    begun, up, down = time.monotonic(), read(made, "up"), read(made, "down")
    time.sleep(seconds)
    return Counted(read(made, "up") - up, read(made, "down") - down, time.monotonic() - begun)


def pilot(*links: str) -> Inventory:
    """The shipped pilot with Cyclone DDS, and one vehicle that publishes what `python_peer.py` does.

    DDS crosses these links of the coastal site.
    """
    declaration = load(SHIPPED)
    coastal = declaration.sites["coastal"]
    bearers = tuple(one.model_copy(update={"dds": one.name in links}) for one in coastal.bearers)
    dds = Dds(distribution=RosDistribution.HUMBLE, middleware=RosMiddleware.CYCLONE_DDS)
    topic = TelemetryTopic(topic="/proof", data=TelemetryData.NUMBERS, rate_hz=_WORD_HZ, size_bytes=_WORD_BYTES)
    silent = {name: one.model_copy(update={"telemetry": ()}) for name, one in declaration.vehicles.items()}
    sparus = declaration.vehicles["sparus"].model_copy(update={"telemetry": (topic,)})
    return replace(
        declaration,
        pilot=declaration.pilot.model_copy(update={"dds": dds}),
        vehicles={**silent, "sparus": sparus},
        sites={**declaration.sites, "coastal": coastal.model_copy(update={"bearers": bearers})},
    )


def speaker(made: Vpn, name: str, folder: Path) -> Participant:
    """A participant with the computer's own profile, in the dialect of Cyclone DDS 11."""
    return started(made, name, folder / f"{name}.xml", slowest(made, name), PROGRAM, name[:7], "0")


def slowest(made: Vpn, name: str) -> ProfileView:
    return max(
        profile_views(made.declaration, made.declaration.hosts[name], "pypi"), key=lambda one: one.tuning.announce_s
    )


def reliable(made: Vpn, name: str, role: str, folder: Path) -> Participant:
    """One that writes or reads a reliable topic in a domain of its own, and announces itself before and after."""
    case = f"{RELIABLE_DOMAIN}:{RELIABLE.size_bytes}:{RELIABLE.rate_hz:g}:reliable"
    view = slowest(made, name)
    quiet = replace(view, tuning=replace(view.tuning, announce_s=1000))
    return started(made, name, folder / f"{name}-reliable.xml", quiet, STEADY, role, case)


def started(made: Vpn, name: str, path: Path, view: ProfileView, *program: object) -> Participant:
    path.write_text(profiles(view)[f"{view.link}/cyclonedds.xml"], encoding="utf-8")
    command = (sys.executable, *map(str, program))
    return Participant(name, made.start(name, *command, environment={"CYCLONEDDS_URI": str(path)}))


def terminal(made: Vpn) -> None:
    """Put a terminal with the allow-list of the declaration between the gateway and everything else."""
    bearer = next(one for one in made.declaration.sites["coastal"].bearers if one.name == "satellite")
    admitted = ", ".join(
        f"{one.address} . {one.transport} . {one.port}" for one in allowed_targets(made.declaration.pilot, bearer)
    )
    address = made.run(GATEWAY, "hostname", "-I").split()[0]
    made.run(NET, "nft", "-f", "-", text=_TERMINAL.replace("ADMITTED", admitted).replace("GATEWAY", address))


def kept_off(made: Vpn) -> int:
    """Packets that the terminal has not let through."""
    said = made.run(NET, "nft", "list", "counter", "ip", "terminal", "kept_off")
    return int(re.findall(r"packets (\d+)", said)[0])


@pytest.mark.parametrize(
    "links", [("wifi-ptp", "4g", "satellite"), ("wifi-ptp", "satellite")], ids=["named", "not named by the centre"]
)
def test_idle_vpn_and_dds_traffic_over_the_satellite_matches_the_estimate(
    links: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tuning = replace(TUNING[Pace.SATELLITE], announce_s=_ANNOUNCE_S)
    monkeypatch.setitem(TUNING, Pace.SATELLITE, tuning)
    declaration = pilot(*links)
    wishes = [host(declaration, GATEWAY), host(declaration, CENTRE)]
    with vpn(declaration, wishes, tmp_path, slow=[GATEWAY], before=terminal) as made:
        for name in (GATEWAY, CENTRE, SERVER):
            made.run(name, "sysctl", "-qw", "net.ipv4.icmp_ratelimit=1000")  # Linux' own; the stand has none
        made.run(GATEWAY, "nft", "-f", "-", text=_COUNT)
        both = [speaker(made, name, tmp_path) for name in (GATEWAY, CENTRE)]
        for one in both:
            assert one.wait(lambda one=one: len(one.heard()) > 20, time.monotonic() + HANG_S), one.lines  # type: ignore[misc]
        reader, _ = reliable(made, CENTRE, "read", tmp_path), reliable(made, GATEWAY, "write", tmp_path)
        assert reader.wait(lambda: len(reader.heard()) > 3, time.monotonic() + HANG_S), reader.lines
        before = [read(made, name) for name in ("reliable_up", "reliable_down")]
        counted = count(made, 8 * _ANNOUNCE_S)
        inside = [
            read(made, name) - first for name, first in zip(("reliable_up", "reliable_down"), before, strict=True)
        ]
        assert [one.lost() for one in both] == [[], []]
        assert quickest_answer_ms(made) >= 2000 * DELAY_S
        assert (made.counter("p_spoofed"), kept_off(made)) == (0, 0)
        knock(made)
        assert kept_off(made) == 3
    (satellite,) = (one for one in standing_traffic(declaration, "coastal") if one.link.name == "satellite")
    flows = [one for one in satellite.flows if one.source in {TrafficSource.DDS, TrafficSource.TELEMETRY}]
    view = profile_in_use(declaration, declaration.hosts[GATEWAY])
    pace = declared_pace(declaration.sites["coastal"].bearers[-1])
    word = view.messages.cost(SteadyTopic(_WORD_HZ, _WORD_BYTES), pace)
    back = topic_flow([(_WORD_HZ, word)], 1)  # the control centre's participant says words, too
    assert {one.source for one in flows} == {TrafficSource.DDS, TrafficSource.TELEMETRY}
    bare = replace(view.messages, vpn=NO_VPN).cost(RELIABLE, pace)
    messages = counted.seconds * RELIABLE.rate_hz
    assert [nbytes / messages for nbytes in inside] == pytest.approx([bare.bytes_up, bare.bytes_down], rel=TOLERANCE)
    steady = topic_flow([(RELIABLE.rate_hz, view.messages.cost(RELIABLE, pace))], 1)
    expected = sum(one.up for one in flows) + steady.up, sum(one.down for one in flows) + back.up + steady.down
    assert counted.a_day() == pytest.approx(expected, rel=TOLERANCE)
    around = [(bare.packets_up, bare.bytes_up), (bare.packets_down, bare.bytes_down)]
    standing = [
        total - nbytes * DAY_S / counted.seconds * (1 + packets * view.vpn.bytes / size)
        for total, nbytes, (packets, size) in zip(counted.a_day(), inside, around, strict=True)
    ]
    assert standing == pytest.approx([expected[0] - steady.up, expected[1] - steady.down], rel=TOLERANCE)


def quickest_answer_ms(made: Vpn) -> float:
    """Of pings from the gateway to the control centre, through the tunnel."""
    address = made.authority.membership().members[CENTRE].address
    said = made.run(GATEWAY, "ping", "-c", "3", "-W", "5", str(address))
    return min(float(each) for each in re.findall(r"time=([\d.]+) ms", said))


def knock(made: Vpn) -> None:
    """So that the terminal does not stay at nothing for want of packets: a stranger, another port, and no UDP."""
    plain = made.socket(GATEWAY, socket.AF_INET, socket.SOCK_DGRAM)
    endpoint = str(made.declaration.pilot.vpn.endpoint)
    plain.sendto(b"x", ("198.51.100.99", 443))
    plain.sendto(b"x", (endpoint, 1195))
    stream = made.socket(GATEWAY, socket.AF_INET, socket.SOCK_STREAM | socket.SOCK_NONBLOCK)
    stream.connect_ex((endpoint, 1194))


def test_emulated_link_has_the_declared_satellite_rate() -> None:
    rate = next(one.rate for one in load(SHIPPED).sites["coastal"].bearers if one.name == "satellite")
    assert (rate.rtt_ms, rate.up_kbps * 1000, rate.down_kbps * 1000) == (2000 * DELAY_S, UP_BPS, DOWN_BPS)


def test_idle_tunnel_traffic_matches_the_estimate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(TIMERS, MemberLink.SATELLITE, (_PING_S, 300))
    monkeypatch.setattr("atlantis_netcfg.vpn.identity.RENEGOTIATION_S", _RENEGOTIATION_S)
    declaration = pilot()
    with vpn(declaration, [host(declaration, GATEWAY)], tmp_path) as made:
        made.run(GATEWAY, "nft", "-f", "-", text=_COUNT)
        before = renegotiations(made)
        counted = count(made, 62)
        renewed = renegotiations(made) - before
    assert renewed >= 3, made.said[SERVER]
    # OpenVPN draws each interval between nine tenths of the declared one and all of it: take what it has really done.
    expected = keep_alive(_PING_S, counted.seconds / renewed, None, None)
    assert counted.a_day() == pytest.approx((expected.up, expected.down), rel=TOLERANCE)


def renegotiations(made: Vpn) -> int:
    """How often the server has begun to give the gateway's session new keys."""
    return "".join(made.said[SERVER]).count("TLS: soft reset")
