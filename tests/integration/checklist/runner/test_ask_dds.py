"""The check of DDS on a computer where real participants run: with the site's profile, without, and on `lo` alone."""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import IO

import pytest
from own_asked import GATEWAY, check, findings, inside
from waiting import wait_until

from atlantis_netcfg.computers.dds import profile_views, profiles
from atlantis_netcfg.inventory import load

if find_spec("cyclonedds") is None:
    pytest.skip("PyPI has no cyclonedds for this machine", allow_module_level=True)
pytestmark = [pytest.mark.slow, pytest.mark.namespace]
SHIPPED = load(Path(__file__).parents[4] / "inventory")
PEER = Path(__file__).parents[2] / "computers" / "dds" / "programs" / "python_peer.py"
CYCLONE = (sys.executable, str(PEER))
DECLARED, OTHER = 0, 42
"""Domains."""
SITE = "the site's"
"""A profile as the product writes it."""
LOOPBACK = """\
<CycloneDDS><Domain Id="any">
  <General>
    <Interfaces><NetworkInterface name="lo" multicast="false"/></Interfaces><AllowMulticast>false</AllowMulticast>
  </General>
  <Discovery><ParticipantIndex>auto</ParticipantIndex><Peers><Peer Address="127.0.0.1"/></Peers></Discovery>
</Domain></CycloneDDS>
"""
"""What ROS_LOCALHOST_ONLY=1 comes to."""
SQUATTER = (
    "import socket\nheld = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2)]\n"
    "for port, one in enumerate(held, 7410): one.bind(('', port))\n"
    "print('bound', flush=True)\n"
    "while True:\n    data, source = held[0].recvfrom(65535)\n    held[0].sendto(data, source)\n"
)
"""It sends back all that it gets."""


@dataclass(frozen=True)
class Case:
    """Participants, and what is to be said of them."""

    name: str
    domains: tuple[int, ...]
    finding: str
    ports: str
    answering: str = "none"
    """Addresses that participants name."""
    profile: str | None = SITE
    squatter: bool = False
    """A program that speaks no DDS holds the ports of the first participant."""

    def __str__(self) -> str:
        return self.name


CASES = (
    Case(
        "nobody",
        (),
        "INCONCLUSIVE nobody-announces: no program uses DDS on coastal-gateway in domain 0, so nothing is announced",
        "none",
    ),
    Case(
        "two",
        (DECLARED, DECLARED),
        "PASS answers: 2 DDS participants on coastal-gateway respond at 10.80.0.21, in domain 0",
        "7410, 7412",
        "10.80.0.21",
    ),
    Case(
        "in another domain",
        (OTHER,),
        "FAIL other-domain: DDS on coastal-gateway runs in domain 42; the inventory says 0",
        "17910",
    ),
    Case(
        "without its profile",
        (DECLARED,),
        "FAIL without-profile: DDS on coastal-gateway runs in domain 0 without the site's profile: "
        "no other site finds it",
        "7400",
        profile=None,
    ),
    Case(
        "on the loopback alone",
        (DECLARED,),
        "INCONCLUSIVE nobody-answers: no DDS participant responds at 10.80.0.21 of coastal-gateway in domain 0, "
        "although its ports are in use",
        "7410",
        profile=LOOPBACK,
    ),
    Case(
        "another program at its ports",
        (),
        "INCONCLUSIVE nobody-answers: no DDS participant responds at 10.80.0.21 of coastal-gateway in domain 0, "
        "although its ports are in use",
        "7410",
        squatter=True,
    ),
)


@contextmanager
def computer() -> Iterator[str]:
    """A namespace with the gateway's address in the tunnel, by its name; no datagram leaves it."""
    if os.geteuid() != 0:
        pytest.skip("making a network namespace needs root")
    name, address = f"dds-check-{os.getpid()}", "10.80.0.21/16"
    subprocess.run(["ip", "netns", "add", name], check=True)
    try:
        lines = ("link set lo up", "link add tun0 type bridge", f"address add {address} dev tun0", "link set tun0 up")
        subprocess.run(["ip", "-n", name, "-batch", "-"], input="\n".join(lines), text=True, check=True)
        yield name
    finally:
        subprocess.run(["ip", "netns", "delete", name], check=True)


@contextmanager
def participant(
    namespace: str, domain: int, number: int, environment: dict[str, str], program: tuple[str, ...] = CYCLONE
) -> Iterator[IO[str]]:
    """A process that speaks DDS; gives what it says."""
    command = ["ip", "netns", "exec", namespace, *program, f"peer{number}", str(domain)]
    with subprocess.Popen(command, env={**os.environ, **environment}, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            if program is CYCLONE:
                assert " peer + " in process.stdout.readline(), "it hears of itself, once its ports are bound"
            else:
                _bound(namespace, 7410 + 250 * domain)
            yield process.stdout
        finally:
            process.kill()


def _bound(namespace: str, port: int) -> None:
    """Wait until somebody has a port: Fast DDS does not hear of itself."""
    table = ["ip", "netns", "exec", namespace, "cat", "/proc/net/udp"]
    wait_until(lambda: f":{port:04X} " in subprocess.run(table, capture_output=True, text=True, check=True).stdout)


@contextmanager
def squatter(namespace: str) -> Iterator[None]:
    command = ["ip", "netns", "exec", namespace, sys.executable, "-c", SQUATTER]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == "bound\n"
            yield
        finally:
            process.kill()


@pytest.mark.smoke("two")
@pytest.mark.parametrize("case", CASES, ids=str)
def test_participants_are_seen_by_their_ports(case: Case, tmp_path: Path) -> None:
    view = next(iter(profile_views(SHIPPED, SHIPPED.hosts[GATEWAY], "pypi")))
    profile = tmp_path / "cyclonedds.xml"
    text = profiles(view)[f"{view.link}/cyclonedds.xml"] if case.profile == SITE else case.profile or ""
    profile.write_text(text, encoding="utf-8")
    environment = {} if case.profile is None else {"CYCLONEDDS_URI": str(profile)}
    with ExitStack() as stack:
        namespace = stack.enter_context(computer())
        if case.squatter:
            stack.enter_context(squatter(namespace))
        for number, domain in enumerate(case.domains):
            stack.enter_context(participant(namespace, domain, number, environment))
        judged = inside(namespace, check(SHIPPED, "dds"), {})
    assert findings(judged) == [case.finding]
    assert [(one.type, one.what, one.value) for one in judged.evidence] == [
        ("declared", "DDS domain", "0"),
        ("read", "UDP ports of DDS on coastal-gateway", case.ports),
        ("measured", "DDS participants that respond at 10.80.0.21", case.answering),
    ]


@pytest.fixture(scope="module")
def fast_dds(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, ...]:
    """A participant on Debian's Fast DDS, the line of Humble."""
    built = tmp_path_factory.mktemp("fast") / "fast_peer"
    source = PEER.with_name("fast_peer.cpp")
    subprocess.run(["g++", "-o", str(built), str(source), "-lfastrtps", "-lfastcdr"], check=True, capture_output=True)
    return (str(built),)


@pytest.mark.smoke("with its profile")
@pytest.mark.parametrize(
    ("profile", "finding"),
    [
        (SITE, "PASS answers: 1 DDS participant on coastal-gateway responds at 10.80.0.21, in domain 0"),
        (
            "127.0.0.1",
            (
                "INCONCLUSIVE nobody-answers: no DDS participant responds at 10.80.0.21 of coastal-gateway in "
                "domain 0, although its ports are in use"
            ),
        ),
        (
            None,
            (
                "WARN without-profile: 1 DDS participant on coastal-gateway runs without the site's profile: other "
                "sites may not find it, or lose it"
            ),
        ),
    ],
    ids=["with its profile", "on the loopback alone", "without its profile"],
)
def test_fast_dds_participants_are_detected(
    fast_dds: tuple[str, ...], profile: str | None, finding: str, tmp_path: Path
) -> None:
    view = next(iter(profile_views(SHIPPED, SHIPPED.hosts[GATEWAY], "humble")))
    text = profiles(view)[f"{view.link}/fastdds.xml"]
    file = tmp_path / "fastdds.xml"
    file.write_text(text if profile in {SITE, None} else text.replace(view.address, str(profile)), encoding="utf-8")
    environment = {} if profile is None else {"FASTRTPS_DEFAULT_PROFILES_FILE": str(file)}
    with computer() as namespace, participant(namespace, DECLARED, 0, environment, fast_dds):
        assert findings(inside(namespace, check(SHIPPED, "dds"), {})) == [finding]


def test_probe_joins_and_leaves_the_domain(tmp_path: Path) -> None:
    view = next(iter(profile_views(SHIPPED, SHIPPED.hosts[GATEWAY], "pypi")))
    profile = tmp_path / "cyclonedds.xml"
    profile.write_text(profiles(view)[f"{view.link}/cyclonedds.xml"], encoding="utf-8")
    environment = {"CYCLONEDDS_URI": str(profile)}
    with computer() as namespace, participant(namespace, DECLARED, 0, environment) as said:
        inside(namespace, check(SHIPPED, "dds"), {})
        seen = [next(line for line in said if f" peer {sign} " in line).split()[-1] for sign in ("+", "-")]
    assert seen[0] == seen[1]
