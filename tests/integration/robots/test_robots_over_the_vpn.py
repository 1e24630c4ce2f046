"""Robots of a site's LAN and a control centre, joined by a real OpenVPN: heard in seconds, and again after 70 s.

The stand is that of tests/integration/vpn/network: the routers' tunnels carry DDS between the LANs, with the product's
firewall at the server. Mock robots and listeners have the profile that the product writes for them. All share one
outage.
"""

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
from dds_stand import Participant
from matrix_papers import host
from matrix_stand import BEHIND, CENTRE, LAN_GATEWAY, LAN_ZARCO, ROUTER, Vpn, vpn

from atlantis_netcfg.computers.dds import GAP_S
from atlantis_netcfg.emulator.udp_link import LinkShape

if find_spec("cyclonedds") is None:
    pytest.skip("PyPI has no cyclonedds for this machine", allow_module_level=True)
import robots_far

pytestmark = [pytest.mark.slow, pytest.mark.namespace]
HERE = Path(__file__).parent
AT = {LAN_ZARCO: "10.64.1.23", BEHIND: "10.64.1.22", LAN_GATEWAY: "10.64.1.10", CENTRE: "10.64.0.11"}
HONEST = {"eca_rov", "girona500", "mares", "sparus", "stork", "zarco"}
SOON_S, AGAIN_S = 5.0, 10.0
"""Until six robots are heard: at the beginning, and after the outage."""
MOBILE = (LinkShape(20_000_000, 0.03, queue_bytes=2_000_000),) * 2
_TRIES = 4
LIES = {
    "missing_topic": ["declared", "topic-missing"],
    "wrong_type": ["declared", "topic-type"],
    "seldom": ["declared", "configuration-rate"],
    "often": ["declared", "topic-rate-above"],
    "stranger": ["unknown", "robot-unknown"],
    "twice": ["declared", "namespace-twice"],
}


@dataclass
class Site:
    """The stand, and programs in it."""

    net: Vpn

    def start(self, who: str, *words: str) -> Participant:
        program = [sys.executable, "-P", str(HERE / "robots_far.py"), *words, AT[who]]
        environment = {"PYTHONPATH": str(HERE)}
        return Participant(who, self.net.start(who, *program, environment=environment))

    def discover(self, who: str, seconds: int) -> subprocess.Popen[str]:
        program = [sys.executable, "-P", str(HERE / "robots_far.py"), "discover", str(seconds), AT[who]]
        words = ["ip", "netns", "exec", self.net.name(who), *program]
        environment = {**os.environ, "PYTHONPATH": str(HERE)}
        return subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)


def told(listener: subprocess.Popen[str]) -> dict[str, Any]:
    out, err = listener.communicate(timeout=120)
    assert not err
    document: dict[str, Any] = json.loads(out)
    return document


def heard(listener: Participant, after: float) -> dict[str, float]:
    """When each robot's configuration came first after a time."""
    rows = [line.split() for line in list(listener.lines)]
    times: dict[str, float] = {}
    for row in rows:
        if float(row[0]) > after and row[1] in HONEST:
            times.setdefault(row[1], float(row[0]))
    return times


def wait_for(robots: Participant) -> None:
    assert robots.wait(lambda: robots.lines, time.monotonic() + 60)
    assert robots.lines[0].endswith(" robots"), robots.lines


def began(listener: Participant) -> float:
    assert listener.wait(lambda: listener.lines, time.monotonic() + 60)
    return float(listener.lines[0].split()[0])


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    declaration = robots_far.declared()
    wishes = [host(declaration, ROUTER), host(declaration, CENTRE)]
    with vpn(declaration, wishes, tmp_path_factory.mktemp("vpn"), slow=[ROUTER], shapes=MOBILE) as net:
        # The pilot's DDS goes between the LANs: the control centre takes its router's way, not its own tunnel.
        net.run(CENTRE, "ip", "route", "delete", "10.64.0.0/16", "dev", "tun0")
        yield Site(net)


def test_control_centre_hears_robots_again_after_an_outage(site: Site) -> None:
    """One test, because the outage is real time and all share it."""
    robots = [site.start(LAN_ZARCO, "honest"), site.start(BEHIND, "liars")]
    for each in robots:
        wait_for(each)
    watcher = site.start(CENTRE, "watch")
    start = began(watcher)
    assert watcher.wait(lambda: heard(watcher, start).keys() == HONEST, start + SOON_S), watcher.lines
    expected = {
        "robots": {**{name: ["declared"] for name in HONEST}, **LIES, "away": ["missing", "robot-missing"]},
        "exit": 6,
        "others": {},
    }
    for _ in range(_TRIES):  # on a busy machine a mock may publish too seldom for a while
        first = told(site.discover(CENTRE, 16))
        if first == expected:
            break
    assert first == expected
    site.net.links[ROUTER].cut()
    cut = time.monotonic()
    silence = told(site.discover(CENTRE, 5))
    assert silence["exit"] == 6
    assert silence["robots"] == {name: ["missing", "robot-missing"] for name in [*HONEST, "away"]}
    time.sleep(max(0.0, cut + GAP_S - time.monotonic()))
    assert heard(watcher, cut + 2) == {}
    site.net.links[ROUTER].mend()
    mended = time.monotonic()
    new = site.start(CENTRE, "watch")
    start = began(new)
    assert watcher.wait(lambda: heard(watcher, mended).keys() == HONEST, mended + AGAIN_S), watcher.lines[-20:]
    assert new.wait(lambda: heard(new, start).keys() == HONEST, start + AGAIN_S), new.lines


def test_robots_of_another_dds_domain_are_reported_as_such(site: Site) -> None:
    robots = site.start(BEHIND, "foreign")
    wait_for(robots)
    found = told(site.discover(LAN_GATEWAY, 12))
    robots.process.kill()
    assert found["others"] == {AT[BEHIND]: [robots_far.FOREIGN]}
    assert found["robots"]["away"] == ["missing", "other-domain", "robot-missing"]
    assert found["exit"] == 6
