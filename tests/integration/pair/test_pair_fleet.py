"""A pair is one member of a run, beside single devices; kept as one, stopped as one."""

import asyncio
from dataclasses import replace
from pathlib import Path

from pair_bench import PairBench, Words, on

from atlantis_netcfg.routeros import DeviceResult, Status, fleet
from atlantis_netcfg.routeros.pair import Pair

NEW = Words(ssid="new name")


def test_a_pair_gives_two_results_in_the_order_of_the_jobs(tmp_path: Path) -> None:
    async def act(bench: PairBench) -> tuple[list[DeviceResult], list[str], list[DeviceResult]]:
        told: list[str] = []
        pair = Pair(bench.job("near", NEW), bench.job("far", NEW))
        single = replace(bench.job("near", bench.words), name="single")
        first = await fleet.run([pair], done=lambda result: told.append(result.name))
        second = await fleet.run([single, pair], mode="plan", done=lambda result: told.append(result.name))
        return first, told, second

    first, told, second = on(PairBench(tmp_path), act)
    assert [(result.name, result.status) for result in first] == [("near", Status.CHANGED), ("far", Status.CHANGED)]
    assert [result.name for result in second] == ["single", "near", "far"]
    assert [result.status for result in second[1:]] == [Status.UNCHANGED] * 2
    assert sorted(told) == ["far", "far", "near", "near", "single"]


def test_stopped_by_hand_both_ends_are_as_before(tmp_path: Path) -> None:
    async def act(bench: PairBench) -> tuple[list[DeviceResult], bool]:
        before = bench.exports()
        pair = Pair(bench.job("near", NEW), bench.job("far", NEW))
        running = asyncio.create_task(fleet.run([pair]))
        while bench.link.up:  # noqa: ASYNC110 - in time that jumps
            await asyncio.sleep(0.01)
        running.cancel()
        results = await running
        return results, bench.exports() == before

    results, as_before = on(PairBench(tmp_path), act)
    assert as_before
    assert {result.status for result in results} <= {Status.ROLLED_BACK, Status.LEFT_AS_FOUND}
    assert all("stopped by hand" in result.message for result in results)
