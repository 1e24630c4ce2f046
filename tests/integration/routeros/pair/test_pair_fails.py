"""The link does not come back, or never may: nothing is sent, or both ends are as before within the declared time."""

import asyncio
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from pair_bench import LINK_TIMEOUT_S, PairBench, Words, on, without_job

from atlantis_netcfg.emulator.routeros import Air
from atlantis_netcfg.routeros import DeviceResult, JobMode, Status
from atlantis_netcfg.routeros.pair import Signal

pytestmark = pytest.mark.slow

NEW = Words(ssid="new name", key="a new key for both ends", frequency=5520)
FAMILIES = pytest.mark.parametrize("family", ["legacy", "wifi"])


def writes(bench: PairBench) -> list[str]:
    """Sentences that could have changed something; a script that only parses cannot."""
    words = ("/add", "/set", "/remove", "/execute", "/take")
    sentences = (
        one for name in ("near", "far") for tally in bench.router(name).connections() for one in tally.sentences
    )
    parses = "=script=:foreach n,s in={"
    return [each[0] for each in sentences if each[0].endswith(words) and not any(w.startswith(parses) for w in each)]


@pytest.mark.smoke("far0-the keys of near and far would differ-legacy")
@FAMILIES
@pytest.mark.parametrize(
    ("far", "why"),
    [
        (Words(ssid="new name", key="a new key with a typo", frequency=5520), "the keys of near and far would differ"),
        (Words(ssid="nwe name", key=NEW.key, frequency=5520), "ssid would be new name on near and nwe name on far"),
    ],
)
def test_ends_that_disagree_are_refused_before_anything_is_sent(
    tmp_path: Path, family: str, far: Words, why: str
) -> None:
    async def act(bench: PairBench) -> tuple[tuple[DeviceResult, DeviceResult], list[str]]:
        return await bench.converge(NEW, far_words=far), writes(bench)

    results, sent = on(PairBench(tmp_path, family=family), act)
    assert [result.status for result in results] == [Status.REFUSED] * 2
    assert all(why in result.message for result in results), results[0].message
    assert sent == []


@FAMILIES
@pytest.mark.parametrize("mode", [JobMode.PLAN, JobMode.APPLY])
def test_syntax_refused_by_the_device_parser_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, family: str, mode: JobMode
) -> None:
    monkeypatch.setattr(
        "atlantis_netcfg.emulator.routeros.console.run._code",
        lambda *_: "(evl bad parameter ssid (line 1 column 9) /interface/set)",
    )

    async def act(bench: PairBench) -> tuple[tuple[DeviceResult, DeviceResult], list[str]]:
        return await bench.converge(NEW, mode=mode), writes(bench)

    results, sent = on(PairBench(tmp_path, family=family), act)
    assert [result.status for result in results] == [Status.REFUSED] * 2
    assert "the device's own parser does not take this (set " in results[0].message
    assert "): bad parameter ssid" in results[0].message
    assert sent == []


def test_incompatible_protocols_are_refused(tmp_path: Path) -> None:
    async def act(bench: PairBench) -> tuple[tuple[DeviceResult, DeviceResult], list[str]]:
        return await bench.converge(Words(protocol="nv2"), far_words=Words(ssid="other")), writes(bench)

    results, sent = on(PairBench(tmp_path), act)
    assert "wireless-protocol would be nv2 on near and 802.11 on far" in results[0].message
    assert sent == []


NO_LINK = {
    "radar on the new channel": (Air(radar_mhz=(5520,)), 5520),
    "a long wait for radar": (Air(dfs_wait_s=400.0), 5520),
    "weather radar": (Air(), 5600),
    "association takes too long": (Air(association_s=500.0), 5520),
}
ROLES = [
    ("legacy", "bridge", "radar on the new channel"),
    ("legacy", "station-bridge", "radar on the new channel"),
    ("legacy", "bridge", "a long wait for radar"),
    ("legacy", "station-bridge", "weather radar"),
    ("wifi", "bridge", "radar on the new channel"),
    ("wifi", "station-bridge", "association takes too long"),
]


@pytest.mark.smoke("legacy-bridge-radar on the new channel")
@pytest.mark.parametrize(("family", "near_mode", "case"), ROLES)
def test_link_that_does_not_return_is_rolled_back(tmp_path: Path, family: str, near_mode: str, case: str) -> None:
    air, frequency = NO_LINK[case]
    words = Words(ssid="new name", key=NEW.key, frequency=frequency)

    async def act(bench: PairBench) -> tuple[tuple[DeviceResult, DeviceResult], bool, tuple[str, str]]:
        before = bench.exports()
        running = asyncio.create_task(bench.converge(words))
        await asyncio.sleep(LINK_TIMEOUT_S + 5)
        within = bench.exports()
        results = await running
        assert bench.exports() == before
        assert without_job(within[1]) == before[1]
        assert within[0] == before[0]
        return results, bench.link.up, before

    results, up, _ = on(PairBench(tmp_path, family=family, near_mode=near_mode, air=air), act)
    assert up or "association" in case or "long" in case
    assert [result.status for result in results] == [Status.ROLLED_BACK] * 2, [result.message for result in results]
    assert all("the link was not back and verified within 270 s" in result.message for result in results)


def test_far_end_without_scheduler_is_rolled_back_by_safe_mode(tmp_path: Path) -> None:
    async def act(bench: PairBench) -> tuple[tuple[DeviceResult, DeviceResult], tuple[str, str], tuple[str, str]]:
        before = bench.exports()
        return await bench.converge(Words(ssid="new name", frequency=5520)), before, bench.exports()

    home = {"device_mode": {"mode": "home"}}
    results, before, after = on(PairBench(tmp_path, air=Air(radar_mhz=(5520,)), far_spec=home), act)
    assert [result.status for result in results] == [Status.ROLLED_BACK] * 2, [result.message for result in results]
    assert after == before
    assert any("needs about nine minutes to roll back by itself" in note for note in results[1].notes)
    assert results[1].protection == "safe-mode"


LEVELS: Mapping[str, tuple[Signal, Status]] = {
    "fine": (Signal(weakest_dbm=-60, strongest_dbm=-35), Status.CHANGED),
    "too weak": (Signal(weakest_dbm=-40, strongest_dbm=-20), Status.ROLLED_BACK),
    "too strong": (Signal(weakest_dbm=-80, strongest_dbm=-50), Status.ROLLED_BACK),
}


@pytest.mark.smoke("too weak-wifi")
@FAMILIES
@pytest.mark.parametrize("case", LEVELS)
def test_signal_levels_are_verified_before_the_change_is_kept(tmp_path: Path, family: str, case: str) -> None:
    signal, expected = LEVELS[case]

    async def act(bench: PairBench) -> tuple[tuple[DeviceResult, DeviceResult], bool]:
        before = bench.exports()
        results = await bench.converge(NEW, signal=signal)
        return results, bench.exports() == before

    results, as_before = on(PairBench(tmp_path, family=family), act)
    assert {result.status for result in results} == {expected}, [result.message for result in results]
    assert as_before == (expected is Status.ROLLED_BACK)
    assert expected is Status.CHANGED or "dBm, not between" in results[0].message
    assert [result.protection for result in results] == ["safe-mode", "safe-mode and a job of the scheduler"]


@pytest.mark.smoke
def test_unreachable_far_end_leaves_both_ends_unchanged(tmp_path: Path) -> None:
    async def act(bench: PairBench) -> tuple[tuple[DeviceResult, DeviceResult], tuple[str, str], tuple[str, str]]:
        before = bench.exports()
        bench.link.change(Air(distance_m=500_000.0))
        changes: dict[str, Any] = {}
        return await bench.converge(NEW, **changes), before, bench.exports()

    results, before, after = on(PairBench(tmp_path), act)
    assert [result.status for result in results] == [Status.LEFT_AS_FOUND] * 2
    assert "cannot read its other end far" in results[0].message
    assert after == before
