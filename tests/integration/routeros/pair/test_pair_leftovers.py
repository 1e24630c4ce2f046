"""A run is killed, and what the next command says of what is armed: it is removed or told, and never green."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from pair_bench import PairBench, Words, on

from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.emulator.routeros import Air
from atlantis_netcfg.routeros import DeviceResult, JobMode, Status, converge
from atlantis_netcfg.routeros.apply import Patience
from atlantis_netcfg.routeros.pair import Pair, converge_pair
from atlantis_netcfg.runs import Journal, Record, ReleaseRecord

pytestmark = pytest.mark.slow

NEW = Words(ssid="new name", key="a new key for both ends")
LATER_S = 1200.0
"""More than the declared time, and more than a dead session keeps safe mode."""
Results = tuple[DeviceResult, DeviceResult]


class Killed(BaseException):
    """The process is gone: nothing of ours catches it, and its sockets are closed."""


class Deadly(Journal):
    """A journal whose process is killed when a record is on disk."""

    dies: Callable[[Record], bool]

    def write(self, record: Record) -> None:
        super().write(record)
        if self.dies(record):
            raise Killed


@dataclass
class AtRecord:
    """Dies at the n-th record."""

    left: int

    def __call__(self, _: Record) -> bool:
        self.left -= 1
        return self.left == 0


def kept(name: str) -> Callable[[Record], bool]:
    """Die when this end was released."""
    return lambda record: isinstance(record, ReleaseRecord) and record.device == name


async def killed(bench: PairBench, dies: Callable[[Record], bool]) -> bool:
    """Kill a run; False if it ended before."""
    with bench.journal() as started:
        deadly = Deadly(started.directory)
    deadly.dies = dies
    try:
        await pair_run(bench, JobMode.APPLY, deadly)
    except Killed:
        return True
    else:
        return False
    finally:
        deadly.close()


async def pair_run(bench: PairBench, mode: JobMode, journal: Journal, **changes: Any) -> Results:  # noqa: ANN401
    """A run as the command line has it: it knows the runs of this computer that have died."""
    near, far = (
        bench.job(
            name,
            NEW,
            journal=journal,
            run=journal.run,
            history=bench.store.history("quay", name, current=journal.run),
            **changes,
        )
        for name in ("near", "far")
    )
    return await converge_pair(Pair(near, far, link_timeout_s=300.0), mode=mode)


async def again(bench: PairBench, mode: JobMode = JobMode.APPLY) -> Results:
    if mode is JobMode.RESUME:
        with Journal(bench.store.runs("quay")[-1].directory) as journal:
            return await pair_run(bench, mode, journal)
    with bench.journal() as journal:
        return await pair_run(bench, mode, journal)


async def armed(bench: PairBench, name: str) -> list[str]:
    """What is armed or marked on an end, as somebody at its console reads it."""
    found = []
    for words, mark in (
        (["/system/scheduler/print"], "=name=atlantis-"),
        (["/safe-mode/print"], "=enabled=true"),
        (["/ip/firewall/address-list/print"], "=list=atlantis-run"),
    ):
        found += [mark] * str(await bench.router(name).console(words)).count(mark)
    return found


def told(results: Results) -> list[str]:
    return [f"{each.name}: {each.status.value}: {each.message} {each.hint} {each.notes}" for each in results]


async def lose_the_link(bench: PairBench) -> tuple[str, str]:
    """The link is lost for longer than every rollback waits; return both exports."""
    bench.link.change(Air(distance_m=500_000.0))
    await asyncio.sleep(LATER_S)
    return bench.exports()


@pytest.mark.smoke("apply")
@pytest.mark.parametrize("mode", [JobMode.APPLY, JobMode.RESUME, JobMode.ROLLBACK])
def test_job_of_a_killed_but_completed_run_is_removed(tmp_path: Path, mode: JobMode) -> None:
    async def act(bench: PairBench) -> tuple[Results, list[str], bool, Results, str]:
        assert await killed(bench, kept("near"))
        assert await armed(bench, "far") == ["=name=atlantis-"]
        first = await again(bench, mode)
        left = [*await armed(bench, "near"), *await armed(bench, "far")]
        second = await again(bench)
        before = bench.exports()
        return first, left, await lose_the_link(bench) == before, second, bench.store.runs("quay")[0].id

    first, left, stays, second, run = on(PairBench(tmp_path), act)
    assert left == [], told(first)
    assert stays, "the far end went back alone"
    assert [each.status for each in first] == [Status.UNCHANGED, Status.CHANGED], told(first)
    assert f"removed the job atlantis-pair of run {run} of provision@" in " ".join(told(first))
    assert [each.exit for each in first] == [ExitCode.DONE] * 2
    assert [each.status for each in second] == [Status.UNCHANGED] * 2, told(second)


@pytest.mark.smoke
def test_plan_and_drift_report_an_armed_job(tmp_path: Path) -> None:
    async def act(bench: PairBench) -> tuple[Results, Results, list[str], str]:
        assert await killed(bench, kept("near"))
        plan, drift = await again(bench, JobMode.PLAN), await again(bench, JobMode.DRIFT)
        return plan, drift, await armed(bench, "far"), bench.store.runs("quay")[0].id

    plan, drift, left, run = on(PairBench(tmp_path), act)
    assert left == ["=name=atlantis-"], "nothing is changed"
    assert [each.exit for each in plan] == [ExitCode.DONE, ExitCode.CHANGES], told(plan)
    assert f"the job atlantis-pair of run {run} of provision@" in plan[1].message
    assert [each.exit for each in drift] == [ExitCode.DONE, ExitCode.CHECKS_FAILED], told(drift)
    comparison = drift[1].comparison
    assert comparison is not None
    (difference,) = comparison.drift
    assert (difference.menu, difference.subject, difference.kind) == ("/system scheduler", "atlantis-pair", "open")
    assert difference.menu in comparison.menus


def test_run_on_one_end_reports_the_job_and_leaves_it(tmp_path: Path) -> None:
    """Whether the pair is as declared, only a run that sees both ends knows."""

    async def act(bench: PairBench) -> tuple[DeviceResult, list[str]]:
        assert await killed(bench, kept("near"))
        result = await converge(bench.job("far", NEW))
        return result, await armed(bench, "far")

    result, left = on(PairBench(tmp_path), act)
    assert left == ["=name=atlantis-"]
    assert (result.status, result.exit) == (Status.LEFT_AS_FOUND, ExitCode.FAILED)
    assert "the job atlantis-pair of" in result.message


def test_visible_end_is_not_green_while_its_job_is_armed(tmp_path: Path) -> None:
    """The technician has crossed the water: the former far end is the near one, and the other end is away."""

    async def act(bench: PairBench) -> Results:
        assert await killed(bench, kept("near"))
        bench.router("near").gap(10_000.0)
        with bench.journal() as journal:
            patient = {"journal": journal, "patience": Patience(reach_s=5.0)}
            pair = Pair(bench.job("far", NEW, **patient), bench.job("near", NEW, **patient), link_timeout_s=300.0)
            return await converge_pair(pair)

    results = on(PairBench(tmp_path), act)
    assert [each.exit for each in results] == [ExitCode.FAILED] * 2, told(results)
    assert "the job atlantis-pair of" in results[0].message


def kill_and_run_again(folder: Path, record: int, mode: JobMode) -> bool:
    """Kill a run, type what comes next at once, and lose the link for long; False if the run ended before."""

    async def act(bench: PairBench) -> bool:
        if not await killed(bench, AtRecord(record)):
            return False
        results = await again(bench, mode)
        if any(each.exit is not ExitCode.DONE for each in results):
            results = await again(bench, JobMode.RESUME)
        assert [each.exit for each in results] == [ExitCode.DONE] * 2, told(results)
        assert [*await armed(bench, "near"), *await armed(bench, "far")] == [], told(results)
        assert [each.status for each in await again(bench)] == [Status.UNCHANGED] * 2
        before = bench.exports()
        assert await lose_the_link(bench) == before, "one end went back alone"
        return True

    return on(PairBench(folder), act)


@pytest.mark.smoke("15-resume")
@pytest.mark.parametrize("mode", [JobMode.APPLY, JobMode.RESUME])
@pytest.mark.parametrize("record", [7, 10, 15, 16, 17, 18])
def test_nothing_is_armed_after_the_run_that_follows_a_kill(tmp_path: Path, record: int, mode: JobMode) -> None:
    assert kill_and_run_again(tmp_path, record, mode)


@pytest.mark.campaign
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("mode", [JobMode.APPLY, JobMode.RESUME])
def test_nothing_is_armed_after_a_kill_at_each_record(tmp_path: Path, mode: JobMode) -> None:
    record = 1
    while kill_and_run_again(tmp_path / str(record), record, mode):
        record += 1
    assert record > 20
