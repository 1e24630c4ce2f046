"""What the links of a rehearsal do: declared, or as a run has measured them; and which run a person means."""

from pathlib import Path

import pytest

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.emulator.udp_link import DrawnGap, LinkShape
from atlantis_netcfg.inventory import load
from atlantis_netcfg.inventory.model import Link, LinkGap
from atlantis_netcfg.links.qualify.profile import DirectionProfile, LinkProfile, ProfileGap, write_profile
from atlantis_netcfg.operations.common.link_shapes import Replay, link_shapes, open_replay, shapes_to
from atlantis_netcfg.operations.common.rehearsal import link, site_spec

DECLARED = load(Path(__file__).parents[4] / "inventory")
ROUTER = DECLARED.hosts["coastal-router"]


def _bearer(name: str = "satellite") -> Link:
    return next(bearer for bearer in DECLARED.sites["coastal"].bearers if bearer.name == name)


def _direction(*delays_s: float, loss: float = 0.0, rate_bps: float | None = None) -> DirectionProfile:
    return DirectionProfile(
        delays_s=delays_s, loss=loss, duplicates=0.0, reordered=0.0, reorder_s=0.0, rate_bps=rate_bps, mtu=None
    )


def _profile(link_name: str = "satellite") -> LinkProfile:
    return LinkProfile(
        run=f"{link_name}-20261126T022248Z",
        site="coastal",
        link=link_name,
        kind="satellite",
        emulated=False,
        recorded_s=120.0,
        interval_s=0.25,
        packet_octets=200,
        packets=480,
        split="half of the sum of both least delays each way",
        up=_direction(0.3, 0.32, 0.4, loss=0.0125, rate_bps=200_000),
        down=_direction(0.29, 0.3, 0.31),
        gaps=(ProfileGap(seconds=70.0, up=True, down=True), ProfileGap(seconds=3.0, up=False, down=True)),
    )


def test_a_declared_link_has_its_jitter_loss_and_gaps() -> None:
    bearer = _bearer()
    assert link_shapes(bearer) == (LinkShape(352_000, 0.35), LinkShape(704_000, 0.35))
    worse = {"jitter_ms": 30.0, "loss": 0.01, "gaps": (LinkGap(length_s=70.0, per_hour=2),)}
    rate = bearer.rate.model_copy(update=worse)
    up, _ = link_shapes(bearer.model_copy(update={"rate": rate}))
    assert (up.jitter_s, up.loss, up.gap_cycle_s) == (0.03, 0.01, 3600)
    assert up.gaps == (DrawnGap(70.0), DrawnGap(70.0))


def test_replayed_link_has_the_measured_shape() -> None:
    up, down = link_shapes(_bearer(), Replay(_profile(), "it"))
    assert (up.rate_bps, down.rate_bps) == (200_000, 704_000), "what was not measured is as in the inventory"
    assert up.delays_s == pytest.approx((0.292, 0.312, 0.392)), "sending 200 octets takes 8 ms"
    assert (up.loss, up.even, up.hold_s, up.gap_cycle_s) == (0.0125, True, 0.125, 120)
    assert up.gaps == (DrawnGap(70.0), DrawnGap(3.0, carries=True))
    assert down.gaps == (DrawnGap(70.0), DrawnGap(3.0))


def test_replay_affects_only_its_link() -> None:
    replay = Replay(_profile(), "it")
    assert link_shapes(_bearer("4g"), replay) == link_shapes(_bearer("4g"))
    assert shapes_to(DECLARED, "coastal", "lan", replay)[0] == LinkShape(rate_bps=100e6, delay_s=0.0005)


def test_emulators_use_the_replayed_link() -> None:
    replay = Replay(_profile(), "it")
    up, down = link_shapes(_bearer(), replay)
    spec = site_spec(DECLARED, [ROUTER], "satellite", replay=replay)
    assert (spec.emulators[0].link.up, spec.emulators[0].link.down) == (up, down)
    sent = type(spec).model_validate_json(spec.model_dump_json())
    assert sent == spec, "as it reaches the twin's process"
    assert link(DECLARED, ROUTER, "satellite", replay).up == up


def test_a_run_is_found_by_its_name_or_by_its_path(tmp_path: Path) -> None:
    profile = _profile()
    kept = tmp_path / "real" / "coastal" / "qualify" / profile.run
    kept.mkdir(parents=True)
    write_profile(kept, profile)
    roots = [tmp_path / "real", tmp_path / "rehearsal"]
    for name in (profile.run, str(kept), str(kept / "profile.json")):
        assert open_replay(name, roots, ["coastal"]).profile == profile
    with pytest.raises(UsageError, match="coastal has no such run") as missing:
        open_replay("satellite-1", roots, ["coastal"])
    assert missing.value.hint == f"its latest runs: {profile.run}"
    with pytest.raises(UsageError, match="te4sea has no such run") as none:
        open_replay("satellite-1", roots, ["te4sea"])
    assert none.value.hint == "measure the link first; the folder of a run is accepted, too"


def test_replay_of_an_unknown_link_is_refused() -> None:
    with pytest.raises(UsageError, match="the run measured link `mesh`, which coastal does not have") as refused:
        Replay(_profile("mesh"), "it").refuse_elsewhere(DECLARED, ["coastal"])
    assert refused.value.hint == "its links are: wifi-ptp, 4g, satellite"
    Replay(_profile(), "it").refuse_elsewhere(DECLARED, ["scc", "coastal"])


def test_replay_text_names_the_run_and_its_figures() -> None:
    words = Replay(_profile(), "it").words
    assert words == (
        "Replay: link satellite as measured by run satellite-20261126T022248Z at coastal: 620 ms, "
        "loss 1.2 % up and 0.0 % down, 2 outages in 120 s"
    )
    reported = Replay(_profile(), "it").not_rehearsed
    assert reported == "link satellite in its current state: this was a replay of run satellite-20261126T022248Z"
