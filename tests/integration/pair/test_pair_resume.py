"""After a run that has died between the two releases: `resume` lets the near end follow, and says so if it cannot."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from pair_bench import PairBench, Words, on, without_job

from atlantis_netcfg.routeros import DeviceResult, Mode, Status
from atlantis_netcfg.twin import Air

if TYPE_CHECKING:
    from pathlib import Path

NEW = Words(ssid="new name")
Results = tuple[DeviceResult, DeviceResult]


async def far_alone(bench: PairBench) -> None:
    """Make the far end what it is declared to become, as a run does that dies then."""
    radio, name = {"legacy": ("wireless", "ssid"), "wifi": ("wifi", "configuration.ssid")}[bench.family]
    number = {"legacy": "wlan1", "wifi": "wifi1"}[bench.family]
    await bench.router("far").console([f"/interface/{radio}/set", f"=.id={number}", f"={name}=new name"])
    assert bench.link.why == "the network names differ"


@pytest.mark.parametrize("family", ["legacy", "wifi"])
def test_the_near_end_follows(tmp_path: Path, family: str) -> None:
    async def act(bench: PairBench) -> tuple[Results, Results, bool]:
        await far_alone(bench)
        return await bench.converge(NEW, Mode.RESUME), await bench.converge(NEW), bench.link.up

    first, second, up = on(PairBench(tmp_path, family=family), act)
    assert [result.status for result in first] == [Status.CHANGED, Status.UNCHANGED], [each.message for each in first]
    assert [result.status for result in second] == [Status.UNCHANGED] * 2
    assert up


def test_an_ordinary_run_does_not_guess(tmp_path: Path) -> None:
    async def act(bench: PairBench) -> tuple[Results, bool]:
        await far_alone(bench)
        before = bench.exports()
        return await bench.converge(NEW), bench.exports() == before

    results, as_before = on(PairBench(tmp_path), act)
    assert [result.status for result in results] == [Status.LEFT_AS_FOUND] * 2
    assert as_before


def test_a_far_end_that_has_gone_for_good_is_not_followed(tmp_path: Path) -> None:
    async def act(bench: PairBench) -> tuple[Results, bool]:
        before = bench.exports()
        bench.link.change(Air(distance_m=500_000.0))
        return await bench.converge(NEW, Mode.RESUME), bench.exports() == before

    results, as_before = on(PairBench(tmp_path), act)
    assert [result.status for result in results] == [Status.ROLLED_BACK, Status.LEFT_AS_FOUND]
    assert "did not answer after near had followed it" in results[0].message
    assert as_before


@pytest.mark.parametrize(("mode", "status"), [(Mode.APPLY, Status.LEFT_AS_FOUND), (Mode.RESUME, Status.CHANGED)])
def test_a_job_that_is_there_is_somebody_elses_unless_we_resume(tmp_path: Path, mode: Mode, status: Status) -> None:
    async def act(bench: PairBench) -> tuple[Results, bool, str]:
        before = bench.exports()
        job = [
            "/system/scheduler/add",
            "=name=atlantis-pair",
            "=interval=1h",
            "=start-time=startup",
            "=on-event=:put 1",
        ]
        await bench.router("far").console(job)
        results = await bench.converge(NEW, mode)
        near, far = bench.exports()
        return results, (near, without_job(far)) == before, far

    results, as_before, far = on(PairBench(tmp_path), act)
    assert {result.status for result in results} == {status}, [result.message for result in results]
    assert as_before == (status is Status.LEFT_AS_FOUND)
    assert ("atlantis-pair" in far) == (status is Status.LEFT_AS_FOUND)
