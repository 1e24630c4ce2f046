"""Acceptance 3: what a rehearsal replays agrees with what was recorded, and the profile with the truth, within 5 %.

On a simulated clock: a link of known truth is measured, its profile is made and replayed, and the replay is measured.
"""

from datetime import UTC, datetime
from pathlib import Path

import pytest
from simulated_network import KEY, SECOND, Recording, SimulatedNetwork, network, unlimited
from tolerances import tolerances

from atlantis_netcfg.emulator.udp_link import LinkShape
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
from atlantis_netcfg.links.qualify.messages import MessagePlan, MessageStream
from atlantis_netcfg.links.qualify.profile import LinkProfile, NoProfile, ProfileGap, profile_of, read_profile
from atlantis_netcfg.links.qualify.session import ReflectorPeer, Train, TrainPlan, run
from atlantis_netcfg.operations.common.link_shapes import build_shapes

PLAN = TrainPlan(172, 0.25, 300)
CERTUS_UP = LinkShape(352_000, 0.28, jitter_s=0.03, loss=0.01)
CERTUS_DOWN = LinkShape(704_000, 0.28, jitter_s=0.03, loss=0.01)
THREE_GAPS = ((40.0, 110.0), (150.0, 153.0), (200.0, 208.0))


def measured_run(link: str = "satellite") -> MeasuredRun:
    begun = datetime(2026, 11, 26, 2, 22, 48, tzinfo=UTC)
    return MeasuredRun(
        id=f"{link}-20261126T022248Z",
        tool="0",
        site="coastal",
        link=link,
        kind="satellite",
        emulated=True,
        selection=Selection.ALL,
        far_end=FarEnd(
            name="scc", address="192.0.2.1", port=862, over_vpn=False, authenticated=True, source="192.0.2.9"
        ),
        begun=begun,
        ended=begun,
        reason="done",
        clock_synchronised=False,
        budget=BudgetLimits(),
        path_mtu_up=1400,
        path_mtu_both=1380,
        thresholds_name="satellite",
        thresholds=thresholds("satellite"),
    )


def measure(net: SimulatedNetwork, plan: TrainPlan = PLAN) -> Recording:
    recording, peer = Recording(), ReflectorPeer(KEY)
    run(net, peer, [Train("idle", plan, peer, net, recording.write)], unlimited(net))
    return recording


def replay(profile: LinkProfile, seed: int = 77) -> SimulatedNetwork:
    return network(*build_shapes(profile, 352_000, 704_000), seed, skew_ns=5 * SECOND)


def agree(recorded: TrainFigures, again: TrainFigures) -> None:
    """Percentiles, loss each way and the histogram of gaps, within the tolerance of the page."""
    share = tolerances()["replay_share"]
    assert recorded.rtt is not None
    assert again.rtt is not None
    for name in ("min", "p50", "p90", "p95", "p99"):
        assert getattr(again.rtt, name) == pytest.approx(getattr(recorded.rtt, name), rel=share), name
    for before, after in ((recorded.loss.up, again.loss.up), (recorded.loss.down, again.loss.down)):
        assert before is not None
        assert after == pytest.approx(before, rel=share, abs=1.01), "one packet at the edge of a stretch"
    assert again.gaps.above == recorded.gaps.above
    assert again.gaps.longest_s == pytest.approx(recorded.gaps.longest_s, rel=share)
    assert again.gaps.beyond_1_s == pytest.approx(recorded.gaps.beyond_1_s, rel=share)


@pytest.mark.parametrize("seed", [1, *(pytest.param(seed, marks=pytest.mark.campaign) for seed in range(2, 12))])
def test_a_replay_agrees_with_the_recording_of_a_satellite(seed: int) -> None:
    up = LinkShape(352_000, 0.28, jitter_s=0.03, loss=0.01, gaps_s=THREE_GAPS)
    down = LinkShape(704_000, 0.28, jitter_s=0.05, loss=0.02, gaps_s=THREE_GAPS)
    recording = measure(network(up, down, seed, skew_ns=-3 * SECOND))
    recorded = train_figures(recording.samples, "idle")
    assert [count for _, count in recorded.gaps.above] == [3, 2, 1, 1]
    profile = profile_of(measured_run(), recording.samples)
    assert [gap.seconds for gap in profile.gaps] == pytest.approx([70, 3, 8], abs=0.5)
    assert all(gap.up and gap.down for gap in profile.gaps)
    net = replay(profile, seed + 10)
    again = train_figures(measure(net).samples, "idle")
    agree(recorded, again)
    assert recorded.up is not None
    assert again.up is not None
    for name in ("p50", "p90", "p95", "p99"):
        before, after = (getattr(figures.up.above_min, name) for figures in (recorded, again) if figures.up)
        assert after == pytest.approx(before, rel=0.15, abs=0.002), "of what varies alone, which is little"


def test_a_replay_agrees_with_the_recording_of_a_4g_link() -> None:
    up = LinkShape(5_000_000, 0.03, jitter_s=0.015, loss=0.005, reordering=0.02, reorder_s=0.4)
    down = LinkShape(20_000_000, 0.025, jitter_s=0.004, duplicates=0.01)
    recording = measure(network(up, down, 5))
    recorded = train_figures(recording.samples, "idle")
    profile = profile_of(measured_run("4g"), recording.samples)
    again = train_figures(measure(replay(profile)).samples, "idle")
    agree(recorded, again)
    assert recorded.reordered_up == pytest.approx(0.02, abs=0.01)
    assert again.reordered_up == pytest.approx(recorded.reordered_up, abs=1.01 / 1200)
    assert again.loss.copies_down == pytest.approx(recorded.loss.copies_down, abs=1)


def test_one_way_gaps_stay_one_way() -> None:
    up = LinkShape(delay_s=0.3, gaps_s=((50.0, 60.0),))
    down = LinkShape(delay_s=0.3, gaps_s=((200.0, 220.0),))
    recording = measure(network(up, down))
    profile = profile_of(measured_run(), recording.samples)
    assert profile.gaps == (
        ProfileGap(seconds=10.0, up=True, down=False),
        ProfileGap(seconds=20.0, up=False, down=True),
    )
    assert profile.recorded_s == pytest.approx(300)
    assert (profile.up.loss, profile.down.loss) == (0, 0), "what was lost in gaps is no random loss"
    agree(train_figures(recording.samples, "idle"), train_figures(measure(replay(profile)).samples, "idle"))


def test_round_trip_is_halved_and_clock_drift_removed() -> None:
    up, down = LinkShape(delay_s=0.5, jitter_s=0.02), LinkShape(delay_s=0.1)
    recording = measure(network(up, down, skew_ns=40 * SECOND, drift=50e-6))
    profile = profile_of(measured_run(), recording.samples)
    assert profile.split == "half of the sum of both least delays each way"
    assert profile.up.delays_s[0] == pytest.approx(0.3, abs=0.002)
    assert profile.down.delays_s[0] == pytest.approx(0.3, abs=0.002)
    assert profile.up.delays_s[-1] - profile.up.delays_s[0] == pytest.approx(0.07, abs=0.02)
    assert profile.down.delays_s[-1] - profile.down.delays_s[0] < 0.004, "15 ms of drift in five minutes"


def test_profile_has_measured_rates_and_mtu_of_the_run() -> None:
    net, peer, recording = network(CERTUS_UP, CERTUS_DOWN), ReflectorPeer(KEY), Recording()
    run(net, peer, [Train("idle", TrainPlan(172, 0.25, 60), peer, net, recording.write)], unlimited(net))
    load = MessageStream("load up", MessagePlan(30_000, 0.5, 20), peer, net, recording.write)
    run(net, peer, [load], unlimited(net))
    profile = profile_of(measured_run(), recording.samples)
    assert profile.up.rate_bps == pytest.approx(352_000, rel=tolerances()["goodput_share"])
    assert profile.down.rate_bps is None, "not measured, so it stays as declared"
    up, down = build_shapes(profile, 1.0, 704_000.0)
    assert up.rate_bps == profile.up.rate_bps
    assert (down.rate_bps, up.mtu, down.mtu) == (704_000.0, 1400, 1380)


def test_run_with_too_few_samples_gives_no_profile(tmp_path: Path) -> None:
    with pytest.raises(NoProfile, match="0 packets of its train `idle` were answered"):
        profile_of(measured_run(), measure(network(LinkShape(loss=1.0)), TrainPlan(172, 0.25, 60)).samples)
    with pytest.raises(NoProfile, match="holds no measured run"):
        read_profile(tmp_path)
    (tmp_path / "profile.json").write_text("{}")
    with pytest.raises(NoProfile, match="holds no measured run"):
        read_profile(tmp_path / "profile.json")


def test_profile_is_stored_in_the_run_folder(tmp_path: Path) -> None:
    recording = measure(network(CERTUS_UP, CERTUS_DOWN), TrainPlan(172, 0.25, 60))
    write_run(tmp_path, measured_run())
    (tmp_path / SAMPLES_FILE).write_text(recording.text.getvalue())
    made = read_profile(tmp_path)
    assert made == profile_of(measured_run(), recording.samples)
    (tmp_path / SAMPLES_FILE).unlink()
    assert read_profile(tmp_path) == read_profile(tmp_path / "profile.json") == made
