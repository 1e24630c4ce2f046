"""irtt (Debian) beside our sender in one run, over a link of the same shape, and as the judge of our figures."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from test_qualify_real_sockets import KEY, reflector

from atlantis_netcfg.emulator.udp_link import LinkShape, UdpRelay
from atlantis_netcfg.qualify.budget import Budget, BudgetGuard
from atlantis_netcfg.qualify.figures import train_figures
from atlantis_netcfg.qualify.samples import PacketSent, ReflectorCounted, ReplyReceived, StreamEnded, TrainBegan
from atlantis_netcfg.qualify.session import ReflectorPeer, Train, TrainPlan, run
from atlantis_netcfg.qualify.transport import UdpTransport

if TYPE_CHECKING:
    from atlantis_netcfg.qualify.samples import Sample

sys.path.insert(0, str(Path(__file__).parents[2] / "unit" / "qualify"))

from tolerances import tolerances

IRTT = Path(__file__).parents[3] / ".venv-setup" / "debian" / "irtt" / "usr" / "bin" / "irtt"
UP = LinkShape(delay_s=0.15, jitter_s=0.01, loss=0.02)
DOWN = LinkShape(delay_s=0.15, jitter_s=0.01, loss=0.02)


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as opened:
        opened.bind(("127.0.0.1", 0))
        return int(opened.getsockname()[1])


PRESENT = pytest.mark.skipif(not IRTT.exists(), reason="no irtt in .venv-setup: `make test` unpacks it")
pytestmark = pytest.mark.slow


def _beside(tmp_path: Path) -> tuple[list[Sample], dict[str, Any]]:
    port = _free_port()
    with (
        subprocess.Popen([IRTT, "server", "-b", f"127.0.0.1:{port}"], stdout=subprocess.DEVNULL) as server,
        UdpRelay(("127.0.0.1", port), UP, DOWN, seed=1) as theirs,
        reflector(tmp_path / "far") as (_, ours_port),
        UdpRelay(("127.0.0.1", ours_port), UP, DOWN, seed=2) as ours,
        UdpTransport(ours.address) as transport,
    ):
        host, relayed = theirs.address
        told = tmp_path / "irtt.json"
        words = ["-i", "50ms", "-d", "6s", "-l", "172", "-q", "-o", str(told), f"{host}:{relayed}"]
        with subprocess.Popen([IRTT, "client", *words]) as client:
            samples: list[Sample] = []
            peer = ReflectorPeer(KEY)
            train = Train("t", TrainPlan(172, 0.05, 6, timeout_s=3), peer, transport, samples.append)
            run(transport, peer, [train], BudgetGuard(Budget(), time.monotonic))
            assert client.wait(timeout=60) == 0
        server.terminate()
    return samples, json.loads(told.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[Sample], dict[str, Any]]:
    """Our samples, and what irtt wrote."""
    return _beside(tmp_path_factory.mktemp("beside"))


@PRESENT
def test_irtt_and_we_see_the_same_least_round_trip(both: tuple[list[Sample], dict[str, Any]]) -> None:
    """Upper percentiles are late by what this machine is busy with: the emulated link and its two ends share it."""
    samples, told = both
    rtt = train_figures(samples, "t").rtt
    assert rtt is not None
    assert rtt.min == pytest.approx(told["stats"]["rtt"]["min"] / 1e9, rel=tolerances()["judge_share"])
    assert rtt.min >= UP.delay_s + DOWN.delay_s


@PRESENT
def test_our_figures_of_its_samples_are_its_own(both: tuple[list[Sample], dict[str, Any]]) -> None:
    _, told = both
    stats, figures = told["stats"], train_figures(_samples_of_irtt(told), "irtt")
    exact = tolerances()["rtt_s"]
    assert figures.rtt is not None
    assert figures.up is not None
    assert figures.rtt.min == pytest.approx(stats["rtt"]["min"] / 1e9, abs=exact)
    assert figures.rtt.max == pytest.approx(stats["rtt"]["max"] / 1e9, abs=exact)
    # Its median is the mean of the two in the middle.
    assert figures.rtt.p50 == pytest.approx(stats["rtt"]["median"] / 1e9, rel=tolerances()["judge_share"])
    loss = figures.loss
    assert loss.sent == stats["packets_sent"]
    assert loss.received == stats["packets_received"]
    assert loss.up == stats["packets_sent"] - stats["server_packets_received"]
    assert loss.down == stats["server_packets_received"] - stats["packets_received"]
    least = min(trip["delay"]["send"] for trip in told["round_trips"] if trip["lost"] == "false")
    worst = max(trip["delay"]["send"] for trip in told["round_trips"] if trip["lost"] == "false")
    assert figures.up.above_min.max == pytest.approx((worst - least) / 1e9, abs=exact)


def _samples_of_irtt(told: dict[str, Any]) -> list[Sample]:
    """Its raw round trips as samples of ours."""
    trips = told["round_trips"]
    begin = trips[0]["timestamps"]["client"]["send"]
    origin, wall = begin["monotonic"], begin["wall"]
    samples: list[Sample] = [TrainBegan("irtt", 0, wall, 172, 0.05, 6, 3, 28, authenticated=False, synchronised=False)]
    numbers = 0
    for trip in trips:
        client, server = trip["timestamps"]["client"], trip["timestamps"]["server"]
        # As by the clock since 1970: what it calls the delay one way is by that.
        samples.append(PacketSent("irtt", trip["seqno"], client["send"]["monotonic"] - origin))
        if trip["lost"] == "false":
            at = client["receive"]["monotonic"] - origin
            received, replied = server["receive"]["wall"], server["send"]["wall"]
            samples.append(ReplyReceived("irtt", trip["seqno"], at, numbers, received, replied, 172, 64, 1))
            numbers += 1
    samples.append(ReflectorCounted("irtt", told["stats"]["server_packets_received"], 0, 0, numbers))
    samples.append(StreamEnded("irtt", 60_000_000_000, "done"))
    return samples
