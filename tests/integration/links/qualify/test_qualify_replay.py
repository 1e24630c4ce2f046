"""Acceptance 3 through real sockets: a link is measured, its profile replayed by the relay, and measured again."""

import time
from datetime import UTC, datetime
from pathlib import Path
from tempfile import mkdtemp

import pytest
from test_qualify_real_sockets import KEY, reflector
from waiting import measure

from atlantis_netcfg.emulator.udp_link import LinkShape, UdpRelay
from atlantis_netcfg.links.qualify.budget import Budget, BudgetGuard
from atlantis_netcfg.links.qualify.figures import TrainFigures, train_figures
from atlantis_netcfg.links.qualify.judgement import profile as thresholds
from atlantis_netcfg.links.qualify.measured_run import (
    SAMPLES_FILE,
    BudgetLimits,
    FarEnd,
    MeasuredRun,
    Selection,
    write_run,
)
from atlantis_netcfg.links.qualify.samples import SampleWriter, read
from atlantis_netcfg.links.qualify.session import ReflectorPeer, Train, TrainPlan, run
from atlantis_netcfg.links.qualify.transport import UdpTransport
from atlantis_netcfg.operations.common.link_shapes import build_shapes, open_replay

_PLAN = TrainPlan(172, 0.02, 4, timeout_s=1.5)
_SHARE = 0.05
"""`replay_share` of docs/engineers/qualify-method.md."""


def _measure(port: int, shapes: tuple[LinkShape, LinkShape], path: Path, seed: int) -> TrainFigures:
    with UdpRelay(("127.0.0.1", port), *shapes, seed=seed) as relay, UdpTransport(relay.address) as transport:
        peer = ReflectorPeer(KEY)
        with path.open("a", encoding="utf-8") as file:
            train = Train("idle", _PLAN, peer, transport, SampleWriter(file))
            assert run(transport, peer, [train], BudgetGuard(Budget(), time.monotonic)) == "done"
    with path.open(encoding="utf-8") as file:
        return train_figures(read(file), "idle")


def _run(name: str) -> MeasuredRun:
    now = datetime.now(UTC)
    far_end = FarEnd(name="x", address="127.0.0.1", port=1, over_vpn=False, authenticated=True, source="127.0.0.1")
    return MeasuredRun(
        id=name, tool="0", site="coastal", link="satellite", kind="satellite", emulated=True, selection=Selection.ALL,
        far_end=far_end, begun=now, ended=now, reason="done", clock_synchronised=False, budget=BudgetLimits(),
        thresholds_name="satellite", thresholds=thresholds("satellite"),
    )  # fmt: skip


def test_a_replay_through_real_sockets_agrees_with_its_recording(tmp_path: Path) -> None:
    gaps = ((1.2, 2.6),)
    truth = (
        LinkShape(352_000, 0.25, jitter_s=0.02, loss=0.02, gaps_s=gaps),
        LinkShape(704_000, 0.25, jitter_s=0.01, loss=0.02, gaps_s=gaps),
    )

    def judge() -> None:
        folder = Path(mkdtemp(dir=tmp_path))
        kept = folder / "coastal" / "qualify" / "satellite-1"
        kept.mkdir(parents=True)
        write_run(kept, _run("satellite-1"))
        with reflector(folder / "far") as (_, port):
            recorded = _measure(port, truth, kept / SAMPLES_FILE, seed=3)
            profile = open_replay("satellite-1", [folder], ["coastal"]).profile
            again = _measure(port, build_shapes(profile, 352_000, 704_000), folder / "again.jsonl", seed=8)
        assert [(gap.up, gap.down) for gap in profile.gaps] == [(True, True)]
        assert recorded.rtt is not None
        assert again.rtt is not None
        for name in ("p50", "p90", "p95"):
            assert getattr(again.rtt, name) == pytest.approx(getattr(recorded.rtt, name), rel=_SHARE), name
        assert again.loss.lost == pytest.approx(recorded.loss.lost, rel=_SHARE, abs=2.01), "one packet each way"
        assert again.gaps.above == recorded.gaps.above
        assert again.gaps.longest_s == pytest.approx(recorded.gaps.longest_s, rel=_SHARE)

    measure(judge)
