"""irtt and iperf3 (Debian) beside our sender in one run, over links of the same shape; irtt also judges our figures."""

import contextlib
import itertools
import json
import os
import select
import socket
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from test_qualify_real_sockets import KEY, reflector
from waiting import HANG_S, measure, wait_until

from atlantis_netcfg.emulator.udp_link import HEADERS, LinkShape, UdpRelay
from atlantis_netcfg.links.qualify.budget import Budget, BudgetGuard
from atlantis_netcfg.links.qualify.figures import train_figures
from atlantis_netcfg.links.qualify.messages import DEFAULT_PACKET, MessagePlan, MessageStream
from atlantis_netcfg.links.qualify.messages_down import DownMessageStream
from atlantis_netcfg.links.qualify.reflector.stamp import chunk_room
from atlantis_netcfg.links.qualify.samples import CounterSample, PacketSent, ReplySample, StreamEnd, TrainBegan
from atlantis_netcfg.links.qualify.session import ReflectorPeer, Train, TrainPlan, run
from atlantis_netcfg.links.qualify.transfers import message_figures
from atlantis_netcfg.links.qualify.transport import UdpTransport

sys.path.insert(0, str(Path(__file__).parents[3] / "unit" / "links" / "qualify"))

from collections.abc import Callable, Iterator, Mapping, Sequence

from tolerances import tolerances

from atlantis_netcfg.links.qualify.samples import Sample

DEBIAN = Path(__file__).parents[4] / ".venv-setup" / "debian"
IRTT = DEBIAN / "irtt" / "usr" / "bin" / "irtt"
IPERF3 = DEBIAN / "iperf3" / "usr" / "bin" / "iperf3"
LIBRARIES = ("libiperf0", "libsctp1")
LINK = LinkShape(delay_s=0.15, jitter_s=0.01, loss=0.02)
"""Each way, for round trips."""
LOAD_UP = LinkShape(rate_bps=352_000, delay_s=0.05, queue_bytes=16_000)
LOAD_DOWN = LinkShape(rate_bps=704_000, delay_s=0.05, queue_bytes=16_000)
"""For goodput."""
OFFERED_BPS = {"up": 1.15 * 352_000, "down": 1.15 * 704_000}
SECONDS = 5
CHUNKS = 10
ROOM = chunk_room(DEFAULT_PACKET, is_authenticated=True)
MESSAGE = CHUNKS * ROOM
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        not (IRTT.exists() and IPERF3.exists()), reason="no irtt or iperf3 in .venv-setup: `make test` unpacks them"
    ),
]


@dataclass(frozen=True, slots=True)
class _Beside:
    """What each has written in one run."""

    train: list[Sample]
    load: list[Sample]
    irtt: dict[str, Any]
    iperf3_up: dict[str, Any]
    iperf3_down: dict[str, Any]


def _free_port() -> int:
    """Free for TCP and UDP both."""
    while True:
        with socket.create_server(("127.0.0.1", 0)) as tcp, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp:
            port = int(tcp.getsockname()[1])
            with contextlib.suppress(OSError):
                udp.bind(("127.0.0.1", port))
                return port


@contextlib.contextmanager
def _program(*words: object, **more: Any) -> Iterator[subprocess.Popen[bytes]]:  # noqa: ANN401 - as Popen has them
    with subprocess.Popen([str(word) for word in words], stdout=subprocess.DEVNULL, **more) as process:
        try:
            yield process
        finally:
            process.terminate()


@contextlib.contextmanager
def _server(
    protocol: str, words: Callable[[int], Sequence[object]], environment: Mapping[str, str] | None = None
) -> Iterator[tuple[str, int]]:
    """Start a server at a port; at another one if somebody takes it before the server does."""
    state = "0A" if protocol == "tcp" else "07"
    with contextlib.ExitStack() as stack:
        while True:
            port = _free_port()
            process = stack.enter_context(_program(*words(port), env=environment))
            row = f"0100007F:{port:04X} 00000000:0000 {state}"
            wait_until(lambda: _listens(protocol, row) or process.poll() is not None)  # noqa: B023 - waited for here
            if process.poll() is None:
                yield "127.0.0.1", port
                return


def _listens(protocol: str, row: str) -> bool:
    """By the kernel's table: a connection would be taken for the one test that iperf3 serves."""
    return row in Path(f"/proc/net/{protocol}").read_text(encoding="ascii")


def _iperf3_environment() -> dict[str, str]:
    folders = [place for name in LIBRARIES for place in DEBIAN.glob(f"{name}/usr/lib/*")]
    return {**os.environ, "LD_LIBRARY_PATH": ":".join(map(str, folders))}


class _ControlConnection(threading.Thread):
    """iperf3 has one TCP connection beside its datagrams, to the same port: it goes by without the link."""

    def __init__(self, listener: socket.socket, server: tuple[str, int]) -> None:
        super().__init__(daemon=True)
        self._listener = listener
        self._server = server

    def run(self) -> None:
        near, _ = self._listener.accept()
        with self._listener, near, socket.create_connection(self._server) as far:
            other = {near: far, far: near}
            while True:
                for end in select.select([near, far], [], [])[0]:
                    data = end.recv(65536)
                    if not data:
                        return
                    other[end].sendall(data)


@contextlib.contextmanager
def _iperf3(*words: str) -> Iterator[list[dict[str, Any]]]:
    """Run it over a link of its own; at the end the list has what it has written."""
    environment = _iperf3_environment()
    written: list[dict[str, Any]] = []
    with contextlib.ExitStack() as stack:
        serve = partial(_server, "tcp", lambda port: (IPERF3, "-s", "-1", "-B", "127.0.0.1", "-p", port))
        server = stack.enter_context(serve(environment))
        listener, at = _relay(stack, server)
        _ControlConnection(listener, server).start()
        command = [str(IPERF3), "-c", "127.0.0.1", "-p", str(at), "-u", "-J", "-O", "1", *words]
        command += ["-t", str(SECONDS - 1), "-l", str(DEFAULT_PACKET)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as client:
            yield written
            text, _ = client.communicate(timeout=HANG_S)
        written.append(json.loads(text))


def _relay(stack: contextlib.ExitStack, server: tuple[str, int]) -> tuple[socket.socket, int]:
    """Make a relay of datagrams, and listen at the same port for TCP, which somebody else may have."""
    while True:
        relay = stack.enter_context(UdpRelay(server, LOAD_UP, LOAD_DOWN, seed=3))
        with contextlib.suppress(OSError):
            return socket.create_server(relay.address), relay.address[1]


def _load(address: tuple[str, int], way: str, samples: list[Sample]) -> None:
    """More than the way carries, as iperf3 does."""
    peer = ReflectorPeer(KEY)
    rate_bps = OFFERED_BPS[way]
    messages_hz = rate_bps / 8 / (MESSAGE + CHUNKS * (DEFAULT_PACKET - ROOM + HEADERS))
    with UdpTransport(address) as transport:
        plan = MessagePlan(MESSAGE, messages_hz, SECONDS - 1, pace_bps=rate_bps, timeout_s=1)
        stream = MessageStream if way == "up" else DownMessageStream
        run(
            transport, peer, [stream(way, plan, peer, transport, samples.append)], BudgetGuard(Budget(), time.monotonic)
        )


def _beside(folder: Path) -> _Beside:
    train: list[Sample] = []
    load: list[Sample] = []
    with (
        _server("udp", lambda port: (IRTT, "server", "-b", f"127.0.0.1:{port}")) as far_irtt,
        UdpRelay(far_irtt, LINK, LINK, seed=1) as theirs,
        reflector(folder / "far") as (_, ours_port),
        UdpRelay(("127.0.0.1", ours_port), LINK, LINK, seed=2) as ours,
        UdpRelay(("127.0.0.1", ours_port), LOAD_UP, LOAD_DOWN, seed=4) as loaded_up,
        UdpRelay(("127.0.0.1", ours_port), LOAD_UP, LOAD_DOWN, seed=5) as loaded_down,
        UdpTransport(ours.address) as transport,
        _iperf3("-b", f"{OFFERED_BPS['up']:.0f}") as iperf3_up,
        _iperf3("-b", f"{OFFERED_BPS['down']:.0f}", "-R") as iperf3_down,
    ):
        host, relayed = theirs.address
        written = folder / "irtt.json"
        words = ["-i", "50ms", "-d", f"{SECONDS}s", "-l", "172", "-q", "-o", str(written), f"{host}:{relayed}"]
        with subprocess.Popen([IRTT, "client", *words]) as client:
            ways = (("up", loaded_up), ("down", loaded_down))
            loads = [threading.Thread(target=_load, args=(relay.address, way, load)) for way, relay in ways]
            for thread in loads:
                thread.start()
            peer = ReflectorPeer(KEY)
            stream = Train("t", TrainPlan(172, 0.05, SECONDS, timeout_s=1), peer, transport, train.append)
            run(transport, peer, [stream], BudgetGuard(Budget(), time.monotonic))
            for thread in loads:
                thread.join()
            assert client.wait(timeout=HANG_S) == 0
    return _Beside(train, load, json.loads(written.read_text(encoding="utf-8")), iperf3_up[0], iperf3_down[0])


def test_irtt_and_iperf3_measure_the_same_as_we_do(tmp_path: Path) -> None:
    numbers = itertools.count()

    def judge() -> None:
        folder = tmp_path / str(next(numbers))
        folder.mkdir()
        beside = _beside(folder)
        same_round_trips(beside)
        same_goodput(beside, "up")
        same_goodput(beside, "down")
        figures_of_irtt(beside)

    measure(judge)


def same_round_trips(beside: _Beside) -> None:
    rtt, stats = train_figures(beside.train, "t").rtt, beside.irtt["stats"]["rtt"]
    assert rtt is not None
    for ours, theirs in ((rtt.p50, stats["median"]), (rtt.min, stats["min"])):
        assert ours == pytest.approx(theirs / 1e9, rel=tolerances()["judge_share"])
    assert rtt.min >= 2 * LINK.delay_s


def same_goodput(beside: _Beside, way: str) -> None:
    """By what each receiver had, as UDP payload: iperf3 has no header of its own to take off."""
    figures = message_figures(beside.load, way)
    assert figures is not None
    assert figures.receiver_bps is not None
    theirs = (beside.iperf3_up if way == "up" else beside.iperf3_down)["end"]["sum_received"]["bits_per_second"]
    assert figures.receiver_bps * DEFAULT_PACKET / ROOM == pytest.approx(theirs, rel=tolerances()["judge_share"])
    carries = (LOAD_UP if way == "up" else LOAD_DOWN).rate_bps
    assert carries is not None
    truth = carries * ROOM / (DEFAULT_PACKET + HEADERS)
    assert figures.receiver_bps == pytest.approx(truth, rel=tolerances()["goodput_share"])


def figures_of_irtt(beside: _Beside) -> None:
    """Our figures of its samples are its own."""
    stats, figures = beside.irtt["stats"], train_figures(_samples_of_irtt(beside.irtt), "irtt")
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
    least = min(trip["delay"]["send"] for trip in beside.irtt["round_trips"] if trip["lost"] == "false")
    worst = max(trip["delay"]["send"] for trip in beside.irtt["round_trips"] if trip["lost"] == "false")
    assert figures.up.above_min.max == pytest.approx((worst - least) / 1e9, abs=exact)


def _samples_of_irtt(written: dict[str, Any]) -> list[Sample]:
    """Its raw round trips as samples of ours."""
    trips = written["round_trips"]
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
            samples.append(ReplySample("irtt", trip["seqno"], at, numbers, received, replied, 172, 64, 1))
            numbers += 1
    samples.append(CounterSample("irtt", written["stats"]["server_packets_received"], 0, 0, numbers))
    samples.append(StreamEnd("irtt", 60_000_000_000, "done"))
    return samples
