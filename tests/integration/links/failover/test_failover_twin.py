"""The declared failover on the emulated router: who carries the traffic while canaries fall silent and come back."""

from __future__ import annotations

import random
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest
from quay_world import World, shipped

from atlantis_netcfg.emulator.routeros.spec import DeviceMode, DeviceModeName

if TYPE_CHECKING:
    from atlantis_netcfg.inventory.model import Failover

pytestmark = pytest.mark.slow

VERSIONS = ("7.16", "7.18.2", "7.21.5")
HOLD_DOWN_S, FAIL_BACK_S, PROBE_S = 20, 120, 30
LATER_S = 11.0
"""How much later than declared a free link may be left: the watch's interval, netwatch's start, two time-outs."""
BACK_LATER_S = 15.0
PATIENCE_S = 200.0


def world(site: str = "coastal", version: str = "7.18.2", *, home: bool = False) -> World:
    made = World(site, version, DeviceMode(mode=DeviceModeName.HOME) if home else None)
    made.passes(60)
    assert made.order() == [made.ways()[0].name]
    return made


def declared(**times: int) -> World:
    given = shipped()
    site = given.sites["coastal"]
    failover: Failover = site.failover.model_copy(update=times)
    changed = replace(given, sites={**given.sites, "coastal": site.model_copy(update={"failover": failover})})
    made = World("coastal", declaration=changed)
    made.passes(60)
    return made


@pytest.mark.smoke("7.18.2-True")
@pytest.mark.parametrize("home", [False, True])
@pytest.mark.parametrize("version", VERSIONS)
def test_traffic_fails_over_and_back_within_the_declared_times(version: str, home: bool) -> None:  # noqa: FBT001
    quay = world(version=version, home=home)
    begun = quay.now
    quay.lose("wifi-ptp")
    quay.passes(PATIENCE_S)
    assert HOLD_DOWN_S <= quay.seen[-1][0] - begun <= HOLD_DOWN_S + LATER_S
    begun = quay.now
    quay.lose("wifi-ptp", "4g")
    quay.passes(PATIENCE_S)
    assert HOLD_DOWN_S <= quay.seen[-1][0] - begun <= PROBE_S + HOLD_DOWN_S + LATER_S
    begun = quay.now
    quay.lose("wifi-ptp")
    quay.passes(PATIENCE_S)
    assert FAIL_BACK_S <= quay.seen[-1][0] - begun <= FAIL_BACK_S + PROBE_S + BACK_LATER_S
    begun = quay.now
    quay.lose()
    quay.passes(PATIENCE_S)
    assert FAIL_BACK_S <= quay.seen[-1][0] - begun <= FAIL_BACK_S + BACK_LATER_S
    assert quay.order() == ["wifi-ptp", "4g", "satellite", "4g", "wifi-ptp"]
    assert quay.errors() == []


@pytest.mark.smoke
def test_configuration_is_unchanged_after_fail_back() -> None:
    """Nothing is left behind: distances, the holding route, rows of netwatch."""
    quay = world()
    before = quay.device.export(header=False)
    quay.lose("wifi-ptp", "4g")
    quay.passes(PATIENCE_S)
    assert quay.device.export(header=False) != before
    quay.lose()
    quay.passes(2 * PATIENCE_S)
    assert quay.device.export(header=False) == before


@pytest.mark.parametrize("hold_down_s", [20, 45, 200])
@pytest.mark.parametrize("fail_back_s", [200, 600])
def test_any_declared_times_are_respected(hold_down_s: int, fail_back_s: int) -> None:
    quay = declared(hold_down_s=hold_down_s, fail_back_s=fail_back_s)
    begun = quay.now
    quay.lose("wifi-ptp")
    quay.passes(hold_down_s + LATER_S)
    assert quay.active() == "4g"
    assert hold_down_s <= quay.seen[-1][0] - begun
    begun = quay.now
    quay.lose()
    quay.passes(fail_back_s + BACK_LATER_S)
    assert quay.active() == "wifi-ptp"
    assert fail_back_s <= quay.seen[-1][0] - begun


def test_one_silent_probe_target_does_not_fail_over() -> None:
    quay = world()
    quay.silence(quay.canaries("wifi-ptp")[:1])
    quay.passes(600)
    assert quay.order() == ["wifi-ptp"]


def test_short_silence_does_not_fail_over() -> None:
    """Not even where check-gateway has given both canaries up meanwhile."""
    quay = world()
    for _ in range(20):
        quay.lose("wifi-ptp")
        quay.passes(HOLD_DOWN_S - 1)
        quay.lose()
        quay.passes(17)
    assert quay.order() == ["wifi-ptp"]


@pytest.mark.parametrize("version", VERSIONS)
def test_flapping_link_is_left_once_and_not_used_again(version: str) -> None:
    quay = world(version=version)
    for _ in range(40):
        quay.lose("wifi-ptp")
        quay.passes(30)
        quay.lose()
        quay.passes(30)
    assert quay.order() == ["wifi-ptp", "4g"]
    quay.passes(FAIL_BACK_S + BACK_LATER_S)
    assert quay.order() == ["wifi-ptp", "4g", "wifi-ptp"]


@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.campaign) for seed in range(2, 6))])
def test_no_pattern_of_silence_violates_hold_down_or_fail_back_time(seed: int) -> None:
    """A link is left after its hold-down of silence at the earliest, and taken back after as long without any."""
    quay, chance = world(), random.Random(seed)  # noqa: S311 - repeatable, no secret
    silent_since: float | None = None
    heard_since = quay.now - FAIL_BACK_S
    for _ in range(60):
        silent = chance.random() < 0.5
        if silent and silent_since is None:
            silent_since = quay.now
        elif not silent and silent_since is not None:
            silent_since, heard_since = None, quay.now
        quay.lose(*(["wifi-ptp"] if silent else []))
        known = len(quay.seen)
        quay.passes(chance.choice((3, 8, 14, 19, 26, 33, 70, 140)))
        for moment, active in quay.seen[known:]:
            if active == "wifi-ptp":
                assert moment - heard_since >= FAIL_BACK_S
            else:
                assert silent_since is not None
                assert moment - silent_since >= HOLD_DOWN_S
    assert quay.errors() == []


def test_satellite_gaps_cause_no_flapping() -> None:
    quay = world()
    quay.lose("wifi-ptp", "4g")
    quay.passes(PATIENCE_S)
    assert quay.active() == "satellite"
    lost = quay.canaries("wifi-ptp", "4g")
    rows = quay.rows("/ip/route")
    for _ in range(10):
        quay.silence((*lost, "10.10.2.1", "203.0.113.2", "192.0.2.123", "192.0.2.124"))
        quay.passes(70)
        quay.silence(lost)
        quay.passes(50)
    assert quay.order() == ["wifi-ptp", "4g", "satellite"]
    assert quay.rows("/ip/route") == rows


def test_a_reboot_does_not_bring_traffic_back_to_a_silent_link() -> None:
    quay = world()
    quay.lose("wifi-ptp")
    quay.passes(60)
    quay.reboot()
    quay.passes(600)
    assert quay.order() == ["wifi-ptp", "4g"]
    quay.reboot()
    begun = quay.now
    quay.lose()
    quay.passes(PATIENCE_S)
    assert quay.order() == ["wifi-ptp", "4g", "wifi-ptp"]
    assert quay.seen[-1][0] - begun >= FAIL_BACK_S


def test_a_link_that_falls_silent_during_a_reboot_is_left() -> None:
    quay = world()
    quay.lose("wifi-ptp")
    quay.reboot()
    quay.passes(30 + HOLD_DOWN_S + LATER_S)
    assert quay.order() == ["wifi-ptp", "4g"]


@pytest.mark.smoke("4")
@pytest.mark.parametrize("moment_s", [0, 4, 10, 18, 25, 60, 130])
def test_reboot_at_any_moment_ends_in_the_declared_state(moment_s: int) -> None:
    """Half-done: held, not yet left; left, not yet proved. The router finds out anew and ends as declared."""
    quay = world()
    before = quay.device.export(header=False)
    quay.lose("wifi-ptp")
    quay.passes(moment_s)
    quay.reboot()
    quay.passes(moment_s)
    quay.lose()
    quay.passes(moment_s)
    quay.reboot()
    quay.passes(2 * PATIENCE_S)
    assert quay.active() == "wifi-ptp"
    assert quay.device.export(header=False) == before


def test_failover_works_without_netwatch() -> None:
    """The fail-safe: check-gateway leaves after two misses, and returns at the first answer."""
    quay = world()
    quay.run("/tool netwatch disable [find]")
    quay.lose("wifi-ptp")
    quay.passes(22)
    assert quay.order() == ["wifi-ptp", "4g"]
    quay.silence(("10.10.0.1", *quay.canaries("wifi-ptp"), "10.10.1.1"))
    quay.passes(22)
    assert quay.order() == ["wifi-ptp", "4g", "satellite"]
    quay.lose()
    quay.passes(22)
    assert quay.active() == "wifi-ptp"


@pytest.mark.smoke
def test_site_always_has_a_route() -> None:
    """All canaries silent, and the satellite unplugged: a link that was given up is still better than nothing."""
    quay = world()
    quay.lose("wifi-ptp", "4g")
    quay.passes(PATIENCE_S)
    quay.run("/interface ethernet disable ether3")
    quay.passes(5)
    assert quay.active() == "wifi-ptp"
    quay.run("/interface ethernet disable ether1")
    quay.passes(PATIENCE_S)
    assert quay.active() == "4g"
    assert None not in quay.order()


def test_vessel_fails_over_to_its_only_other_link() -> None:
    vessel = world("te4sea")
    vessel.lose("4g")
    vessel.passes(PATIENCE_S)
    vessel.lose()
    vessel.passes(PATIENCE_S)
    assert vessel.order() == ["4g", "satellite", "4g"]


def test_idle_time_causes_no_extra_probes_and_no_changes() -> None:
    quay = world()
    revision = quay.device.revision
    quay.passes(3600)
    assert quay.device.revision == revision
    asked = {row["name"]: row.get("done-tests") for row in quay.rows("/tool/netwatch")}
    assert all((name.endswith("-watch")) is (done is not None) for name, done in asked.items())
    assert {int(done) for name, done in asked.items() if done is not None and name.startswith("4g")} == {121}


def test_inconsistent_failover_state_is_corrected() -> None:
    """As a restored configuration does: a good link given up, or a silent one in use, and netwatch none the wiser."""
    quay = world()
    left = quay.canaries("wifi-ptp")
    for canary in left:
        quay.run(f'/ip route set [find comment="atlantis: wifi-ptp, while {canary} answers"] distance=110')
    quay.passes(FAIL_BACK_S + BACK_LATER_S)
    assert quay.order() == ["wifi-ptp", "4g", "wifi-ptp"]
    quay.lose("4g")
    quay.passes(PATIENCE_S)
    quay.run('/ip route set [find comment~"^atlantis: 4g, while"] distance=20')
    quay.lose("wifi-ptp", "4g")
    quay.passes(PATIENCE_S)
    assert quay.active() == "satellite"
    assert quay.errors() == []
