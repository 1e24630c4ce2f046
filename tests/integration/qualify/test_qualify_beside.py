"""irtt (Debian) beside our sender in one run, each over an emulated link of the same shape: the medians agree."""

from __future__ import annotations

import json
import socket
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from test_qualify_real_sockets import KEY, reflector

from atlantis_netcfg.emulator.udp_link import LinkShape, UdpRelay
from atlantis_netcfg.qualify.budget import Budget, BudgetGuard
from atlantis_netcfg.qualify.figures import train_figures
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


@pytest.mark.slow
@pytest.mark.skipif(not IRTT.exists(), reason="no irtt in .venv-setup: `make test` unpacks it")
def test_irtt_and_we_see_the_same_round_trip(tmp_path: Path) -> None:
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
    rtt = train_figures(samples, "t").rtt
    trips = json.loads(told.read_text(encoding="utf-8"))["round_trips"]
    judged = statistics.median(trip["delay"]["rtt"] / 1e9 for trip in trips if trip["lost"] == "false")
    assert rtt is not None
    assert rtt.p50 == pytest.approx(judged, rel=tolerances()["judge_share"])
    assert rtt.p50 == pytest.approx(0.3 + 2 * 0.01 * 0.67, rel=tolerances()["rtt_real_share"])
