"""After a run that has died between the two releases: `resume` lets the near end follow, and says so if it cannot."""

import asyncio
from pathlib import Path

import pytest
from hints_said import advised, said
from pair_bench import PairBench, Words, on, without_job

from atlantis_netcfg.emulator.routeros import Air
from atlantis_netcfg.routeros import DeviceResult, JobMode, Status

NEW = Words(ssid="new name")
Results = tuple[DeviceResult, DeviceResult]


async def far_alone(bench: PairBench) -> None:
    """Make the far end what it is declared to become, as a run does that dies then."""
    radio, name = {"legacy": ("wireless", "ssid"), "wifi": ("wifi", "configuration.ssid")}[bench.family]
    number = {"legacy": "wlan1", "wifi": "wifi1"}[bench.family]
    await bench.router("far").console([f"/interface/{radio}/set", f"=.id={number}", f"={name}=new name"])
    assert bench.link.down_reason == "the network names differ"


@pytest.mark.smoke("wifi")
@pytest.mark.parametrize("family", ["legacy", "wifi"])
def test_resume_brings_the_near_end_to_the_far_end(tmp_path: Path, family: str) -> None:
    async def act(bench: PairBench) -> tuple[Results, Results, bool]:
        await far_alone(bench)
        return await bench.converge(NEW, JobMode.RESUME), await bench.converge(NEW), bench.link.up

    first, second, up = on(PairBench(tmp_path, family=family), act)
    assert [result.status for result in first] == [Status.CHANGED, Status.UNCHANGED], [each.message for each in first]
    assert [result.status for result in second] == [Status.UNCHANGED] * 2
    assert up


@pytest.mark.slow
def test_ordinary_run_changes_nothing_if_only_the_far_end_changed(tmp_path: Path) -> None:
    async def act(bench: PairBench) -> tuple[Results, bool]:
        await far_alone(bench)
        before = bench.exports()
        return await bench.converge(NEW), bench.exports() == before

    results, as_before = on(PairBench(tmp_path), act)
    assert [result.status for result in results] == [Status.LEFT_AS_FOUND] * 2
    assert as_before


def test_resume_with_a_lost_far_end_rolls_the_near_end_back(tmp_path: Path) -> None:
    async def act(bench: PairBench) -> tuple[Results, bool]:
        before = bench.exports()
        bench.link.change(Air(distance_m=500_000.0))
        return await bench.converge(NEW, JobMode.RESUME), bench.exports() == before

    results, as_before = on(PairBench(tmp_path), act)
    assert [result.status for result in results] == [Status.ROLLED_BACK, Status.LEFT_AS_FOUND]
    assert "did not respond after near was changed to match it" in results[0].message
    assert as_before


@pytest.mark.smoke("apply-left-as-found")
@pytest.mark.parametrize(("mode", "status"), [(JobMode.APPLY, Status.LEFT_AS_FOUND), (JobMode.RESUME, Status.CHANGED)])
def test_only_resume_takes_over_an_existing_job(tmp_path: Path, mode: JobMode, status: Status) -> None:
    async def act(bench: PairBench) -> tuple[Results, bool, str]:
        before = bench.exports()
        job = [
            *("/system/scheduler/add", "=name=atlantis-pair", "=interval=1h"),
            *("=start-time=startup", "=on-event=:put 1"),
        ]
        await bench.router("far").console(job)
        results = await bench.converge(NEW, mode)
        near, far = bench.exports()
        return results, (near, without_job(far)) == before, far

    results, as_before, far = on(PairBench(tmp_path), act)
    assert {result.status for result in results} == {status}, [result.message for result in results]
    assert as_before == (status is Status.LEFT_AS_FOUND)
    assert ("atlantis-pair" in far) == (status is Status.LEFT_AS_FOUND)


TYPED = {"recover resume": JobMode.RESUME}
"""What a command of a hint is for the engine, which knows no command line."""


def test_advice_about_the_job_of_a_dead_run_leads_on(tmp_path: Path) -> None:
    hint = (
        "let them finish, then run the same command again; if a run of ours was interrupted there: `provision recover "
        "resume site={}`"
    )

    async def act(bench: PairBench) -> tuple[Results, list[list[str]], Results]:
        job = ["=name=atlantis-pair", "=interval=1h", "=start-time=startup", "=on-event=:put 1"]
        await bench.router("far").console(["/system/scheduler/add", *job])
        refused = await bench.converge(NEW)
        commands = [words for each in refused for words in advised(said(str(each.hint), hint))]
        return refused, commands, await bench.converge(NEW, TYPED[" ".join(commands[0][:2])])

    refused, commands, followed = on(PairBench(tmp_path), act)
    assert [each.status for each in refused] == [Status.LEFT_AS_FOUND] * 2
    assert commands == [["recover", "resume", "site=quay"]] * 2
    assert [each.status for each in followed] == [Status.CHANGED] * 2


def test_advice_for_an_unknown_outcome_settles_it(tmp_path: Path) -> None:
    hint = (
        "each end rolls back by itself what was not kept, within ten minutes if its link is lost; then: "
        "`provision recover resume site={}`"
    )

    async def act(bench: PairBench) -> tuple[list[list[str]], Results, Results]:
        run = asyncio.ensure_future(bench.converge(NEW))
        for _ in iter(lambda: "new name" in bench.exports()[1], True):
            await asyncio.sleep(0)
        bench.link.change(Air(distance_m=500_000.0))
        unknown = await run
        bench.link.change(Air())
        told = [str(each.hint) for each in unknown if each.status is Status.UNKNOWN]
        commands = [words for each in told for words in advised(said(each, hint))]
        return commands, await bench.converge(NEW, TYPED[" ".join(commands[0][:2])]), await bench.converge(NEW)

    commands, followed, again = on(PairBench(tmp_path), act)
    assert commands[0] == ["recover", "resume", "site=quay"]
    assert {each.status for each in followed} <= {Status.CHANGED, Status.UNCHANGED}
    assert [each.status for each in again] == [Status.UNCHANGED] * 2
