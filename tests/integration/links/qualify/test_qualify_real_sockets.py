"""The sender and the reflector's program through real sockets, over the emulated link."""

import subprocess
import sys
import time
from pathlib import Path
from tempfile import mkdtemp

import pytest
from waiting import HANG_S, measure

from atlantis_netcfg.emulator.udp_link import HEADERS, LinkShape, UdpRelay
from atlantis_netcfg.links.qualify.budget import Budget, BudgetGuard
from atlantis_netcfg.links.qualify.figures import train_figures
from atlantis_netcfg.links.qualify.messages import DEFAULT_PACKET, MessagePlan, MessageStream
from atlantis_netcfg.links.qualify.messages_down import DownMessageStream
from atlantis_netcfg.links.qualify.reflector.stamp import chunk_room
from atlantis_netcfg.links.qualify.samples import SampleWriter, read
from atlantis_netcfg.links.qualify.session import ReflectorPeer, Train, TrainPlan, run
from atlantis_netcfg.links.qualify.transfers import message_figures
from atlantis_netcfg.links.qualify.transport import UdpTransport

sys.path.insert(0, str(Path(__file__).parents[3] / "unit" / "links" / "qualify"))

from collections.abc import Iterator

from tolerances import tolerances

from atlantis_netcfg.links.qualify.samples import Sample

KEY = b"an example key, 32 octets long.."


class reflector:  # noqa: N801 - a context
    """The program, on a free port."""

    def __init__(self, folder: Path, *more: str) -> None:
        folder.mkdir(exist_ok=True)
        (folder / "key").write_bytes(KEY + b"\n")
        words = ["--address", "127.0.0.1", "--port", "0", "--key-file", str(folder / "key"), *more]
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-m", "atlantis_netcfg.links.qualify.reflector", *words],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def __enter__(self) -> tuple[subprocess.Popen[str], int]:
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        assert line.startswith("ready on port "), line
        return self.process, int(line.split()[-1])

    def __exit__(self, *_: object) -> None:
        self.process.terminate()
        self.process.communicate(timeout=HANG_S)


def _now() -> float:
    return time.monotonic()


@pytest.fixture
def port(tmp_path: Path) -> Iterator[int]:
    with reflector(tmp_path / "far") as (_, found):
        yield found


def test_a_train_over_the_emulated_link(port: int, tmp_path: Path) -> None:
    up = LinkShape(rate_bps=352_000, delay_s=0.15, loss=0.05)
    down = LinkShape(rate_bps=704_000, delay_s=0.15, loss=0.05)

    def judge() -> None:
        path = Path(mkdtemp(dir=tmp_path)) / "samples.jsonl"
        with UdpRelay(("127.0.0.1", port), up, down, seed=4) as relay, UdpTransport(relay.address) as transport:
            peer = ReflectorPeer(KEY)
            guard = BudgetGuard(Budget(), _now)
            with path.open("a", encoding="utf-8") as file:
                train = Train("train", TrainPlan(172, 0.03, 1.8, timeout_s=1), peer, transport, SampleWriter(file))
                assert run(transport, peer, [train], guard) == "done"
            lost = relay.up.loss_count + relay.down.loss_count
        with path.open(encoding="utf-8") as file:
            figures = train_figures(read(file), "train")
        assert figures.rtt is not None
        serialised = 200 * 8 / 352_000 + 200 * 8 / 704_000
        assert figures.rtt.min >= 0.3 + serialised
        assert figures.rtt.p50 == pytest.approx(0.3 + serialised, rel=tolerances()["rtt_real_share"])
        assert figures.loss.why == "by the reflector's count"
        assert lost - 3 <= figures.loss.lost <= lost, "up to three of those lost may be questions for the counters"
        assert guard.sent_bytes >= 60 * 200

    measure(judge)


def test_messages_over_the_emulated_link(port: int) -> None:
    samples: list[Sample] = []
    shape = LinkShape(rate_bps=2_000_000, delay_s=0.05, loss=0.02)
    with UdpRelay(("127.0.0.1", port), shape, shape, seed=2) as relay, UdpTransport(relay.address) as transport:
        peer = ReflectorPeer(KEY)
        plan = MessagePlan(60_000, 2, 1, resend=True, pace_bps=1_500_000, timeout_s=0.5)
        stream = MessageStream("m", plan, peer, transport, samples.append)
        assert run(transport, peer, [stream], BudgetGuard(Budget(), _now)) == "done"
    figures = message_figures(samples, "m")
    assert figures is not None
    assert (figures.sent_count, figures.received_count) == (2, 2)


@pytest.mark.parametrize("kind", [MessageStream, DownMessageStream])
def test_fast_sending_rate_is_kept(port: int, kind: type[MessageStream | DownMessageStream]) -> None:
    """A sender that falls behind its pace would show a slower link than there is."""

    def judge() -> None:
        samples: list[Sample] = []
        with UdpTransport(("127.0.0.1", port)) as transport:
            peer = ReflectorPeer(KEY)
            stream = kind("m", MessagePlan(200_000, 4, 1, pace_bps=10_000_000), peer, transport, samples.append)
            assert run(transport, peer, [stream], BudgetGuard(Budget(), _now)) == "done"
        figures = message_figures(samples, "m")
        assert figures is not None
        room = chunk_room(DEFAULT_PACKET, is_authenticated=True)
        offered = 10_000_000 * room / (DEFAULT_PACKET + HEADERS)
        assert figures.busy_bps == pytest.approx(offered, rel=tolerances()["goodput_share"])
        assert (figures.received_count, figures.lost_count) == (4, 0)

    measure(judge)


def test_missing_reflector_is_loss_and_not_an_error() -> None:
    samples: list[Sample] = []
    with UdpTransport(("127.0.0.1", 9)) as transport:
        peer = ReflectorPeer(KEY)
        train = Train("t", TrainPlan(112, 0.02, 0.2, timeout_s=0.1), peer, transport, samples.append)
        assert run(transport, peer, [train], BudgetGuard(Budget(), _now)) == "done"
    loss = train_figures(samples, "t").loss
    assert (loss.received, loss.sent + loss.unsent) == (0, 10)


def test_reflector_exits_cleanly_and_reports_refused_packets(tmp_path: Path) -> None:
    far = reflector(tmp_path / "far")
    with far as (process, port), UdpTransport(("127.0.0.1", port)) as transport:
        transport.send(b"no packet of STAMP")
        peer = ReflectorPeer(KEY)
        train = Train("t", TrainPlan(112, 0.01, 0.05, timeout_s=1), peer, transport, lambda _sample: None)
        run(transport, peer, [train], BudgetGuard(Budget(), _now))
        process.terminate()
        _, said = process.communicate(timeout=HANG_S)
    assert process.returncode == 0
    assert said == "Statistics(answered=6, refused=1, stale=0, replayed=0, limited=0, requested=0)\n"


def test_reflector_exits_when_idle(tmp_path: Path) -> None:
    with reflector(tmp_path / "far", "--idle-s", "0.1") as (process, _):
        assert process.wait(HANG_S) == 0


@pytest.mark.parametrize("key", ["short", None])
def test_reflector_needs_a_key_or_unauthenticated(key: str | None, tmp_path: Path) -> None:
    words = []
    if key is not None:
        (tmp_path / "key").write_text(key)
        words = ["--key-file", str(tmp_path / "key")]
    command = [sys.executable, "-P", "-m", "atlantis_netcfg.links.qualify.reflector", "--port", "0", *words]
    ended = subprocess.run(command, capture_output=True, text=True, check=False, timeout=HANG_S)
    assert ended.returncode == 2
    expected = "has fewer than 16 octets" if key else "--key-file --unauthenticated is required"
    assert expected in ended.stderr
