"""The engine beside a router that moves its own routes: what netwatch does is neither drift nor put right."""

import asyncio
from pathlib import Path

import pytest
from engine_bench import Bench, on
from test_sites import bench

from atlantis_netcfg.routeros import JobMode, Status

pytestmark = pytest.mark.slow

PTP = ("198.51.100.11", "198.51.100.12")
LTE = ("198.51.100.21", "198.51.100.22")


async def route(bench: Bench, name: str, comment: str) -> str:
    answers = await bench.router.console(["/ip/route/print", f"?comment=atlantis: {comment}"])
    row = dict(word[1:].partition("=")[::2] for word in answers[0].words)
    return row[name]


@pytest.mark.parametrize("version", ["7.16", "7.18.2", "7.21.5"])
def test_run_does_not_change_a_failed_over_router(tmp_path: Path, version: str) -> None:
    async def act(bench: Bench) -> None:
        first = await bench.converge()
        assert first.status is Status.CHANGED, first.message
        await asyncio.sleep(60)
        bench.router.silence([*PTP, *LTE])
        await asyncio.sleep(120)
        assert await route(bench, "active", "satellite, not probed") == "true"
        assert await route(bench, "distance", f"wifi-ptp, while {PTP[0]} answers") == "110"
        export = bench.export()
        for mode in (JobMode.PLAN, JobMode.APPLY):
            again = await bench.converge(mode)
            assert (again.status, again.planned_count) == (Status.UNCHANGED, 0), again.message
        assert bench.export() == export
        bench.router.silence([])
        await asyncio.sleep(300)
        assert await route(bench, "active", f"wifi-ptp, while {PTP[0]} answers") == "true"
        assert (await bench.converge()).status is Status.UNCHANGED

    on(bench(tmp_path, "coastal-router", version=version), act)


@pytest.mark.smoke
def test_change_during_failover_is_applied_and_failover_remains(tmp_path: Path) -> None:
    """A router is reconfigured while its link is left: the run reads back, and the link stays left."""

    async def act(bench: Bench) -> None:
        await bench.converge()
        bench.router.silence(PTP)
        await asyncio.sleep(120)
        bench.text = bench.text.replace("memory-lines=2000", "memory-lines=3000")
        changed = await bench.converge()
        assert (changed.status, changed.planned_count) == (Status.CHANGED, 1), changed.message
        assert await route(bench, "active", f"4g, while {LTE[0]} answers") == "true"
        assert (await bench.converge()).status is Status.UNCHANGED

    on(bench(tmp_path, "coastal-router"), act)


def test_disabled_watch_is_enabled(tmp_path: Path) -> None:
    async def act(bench: Bench) -> None:
        await bench.converge()
        await bench.router.console(["/tool/netwatch/disable", f"=numbers=wifi-ptp-{PTP[0]}-watch"])
        again = await bench.converge()
        assert (again.status, again.planned_count) == (Status.CHANGED, 1), again.message
        assert (await bench.converge()).status is Status.UNCHANGED

    on(bench(tmp_path, "coastal-router"), act)
