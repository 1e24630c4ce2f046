"""Hundreds of devices in one process: what comes first, what is kept, and who waits for whom."""

from __future__ import annotations

import asyncio
import gc
import tracemalloc
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import pytest
from engine_bench import run
from test_fleet import jobs, ships

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.emulator.routeros import FaultKind, LinkFault, RouterLink
from atlantis_netcfg.routeros import DeviceJob, DeviceResult, Endpoint, JobMode, Status, fleet

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

MANY = 200


def waiting(job: DeviceJob) -> fleet.PendingJob:
    return fleet.PendingJob(job.name, partial(replace, job))


@pytest.mark.slow
def test_fast_devices_report_before_slow_silent_and_dead_ones(tmp_path: Path) -> None:
    told: dict[str, tuple[float, Status]] = {}

    async def main() -> None:
        clock = asyncio.get_running_loop().time
        async with ships(tmp_path, MANY) as benches:
            silent, slow = benches[:2]
            silent.router.arm(LinkFault(do=FaultKind.HANG, match="/login"))
            slow.router.set_link(RouterLink(delay_s=0.35))
            work = jobs(benches)
            nowhere = Endpoint("127.0.0.1", 1, "provision", work[0].endpoint.password, "00" * 32)
            work.insert(2, benches[2].job(name="nowhere", endpoint=nowhere))
            begun = clock()

            def keep(result: DeviceResult) -> None:
                told[result.name] = (clock() - begun, result.status)

            await fleet.stream(map(waiting, work), keep, mode=JobMode.PLAN)

    run(main())
    assert len(told) == MANY + 1
    assert {status for name, (_, status) in told.items() if name not in ("ship0", "nowhere")} == {Status.PLANNED}
    assert told["nowhere"][1] is told["ship0"][1] is Status.LEFT_AS_FOUND
    assert list(told)[-2:] == ["ship1", "ship0"]
    assert told["ship1"][0] > 2
    assert told["ship0"][0] > 100


def test_slow_device_gives_its_slot_to_the_next(tmp_path: Path) -> None:
    """Two places, two silent devices: the third does not wait for their time-outs."""
    ended: dict[str, float] = {}

    async def main() -> None:
        clock = asyncio.get_running_loop().time
        async with ships(tmp_path, 3) as benches:
            for bench in benches[:2]:
                bench.router.arm(LinkFault(do=FaultKind.HANG, match="/login"))
            begun = clock()
            work = map(waiting, jobs(benches))
            await fleet.stream(
                work, lambda result: ended.__setitem__(result.name, clock() - begun), mode=JobMode.PLAN, at_once=2
            )

    run(main())
    assert ended["ship2"] < fleet.PATIENCE_S + 5
    assert min(ended["ship0"], ended["ship1"]) > 100


def test_memory_of_finished_devices_is_released(tmp_path: Path) -> None:
    """What engine and parser allocated and still hold, after the results were reduced to data."""
    number = 12
    told: dict[str, Mapping[str, Any]] = {}

    def held() -> int:
        gc.collect()
        snapshot = tracemalloc.take_snapshot()
        ours = [tracemalloc.Filter(inclusive=True, filename_pattern=f"*/atlantis_netcfg/{part}/*") for part in PARTS]
        return sum(trace.size for trace in snapshot.filter_traces(ours).traces)

    async def main() -> int:
        async with ships(tmp_path, number + 1) as benches:
            first, *rest = [fleet.PendingJob(f"ship{each}", bench.job) for each, bench in enumerate(benches)]
            await fleet.stream([first], lambda _: None, mode=JobMode.PLAN)
            tracemalloc.start()
            try:
                await fleet.stream(rest, lambda result: told.__setitem__(str(len(told)), result.as_dict()), mode="plan")
                return held()
            finally:
                tracemalloc.stop()

    bytes_each = run(main()) / number
    assert len(told) == number
    assert bytes_each < 30_000, "keeping the desired rows of each would be 38 kB, and plans and observations more"


PARTS = ("routeros", "rsc")


def test_job_that_cannot_be_created_fails_only_its_device(tmp_path: Path) -> None:
    def refused() -> DeviceJob:
        raise UsageError("`via=smoke`: no such bearer", hint="it has: lan")

    async def main() -> list[DeviceResult]:
        results: list[DeviceResult] = []
        async with ships(tmp_path, 1) as benches:
            both = [fleet.PendingJob("odd", refused), fleet.PendingJob("ship", benches[0].job)]
            await fleet.stream(both, results.append, mode=JobMode.PLAN)
        return results

    odd, ship = run(main())
    assert (odd.name, odd.status, odd.exit, odd.hint) == ("odd", Status.LEFT_AS_FOUND, 3, "it has: lan")
    assert ship.status is Status.PLANNED
