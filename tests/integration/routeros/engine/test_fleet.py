"""Many devices at once: a dead one holds nobody up, and every one gets its own word."""

import asyncio
import socket
from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest
from engine_bench import TEXT, Bench, run

from atlantis_netcfg.emulator.routeros import FaultKind, LinkFault, RouterLink
from atlantis_netcfg.operations.common.session_link import LAN, PATIENCE_S, with_timeouts
from atlantis_netcfg.routeros import DeviceJob, DeviceResult, Endpoint, JobMode, Patience, Status, fleet
from atlantis_netcfg.routeros.api import Session
from atlantis_netcfg.routeros.apply import Channel


@dataclass
class Ships:
    """Several twins in one event loop."""

    benches: list[Bench] = field(default_factory=list)

    async def __aenter__(self) -> list[Bench]:
        for bench in self.benches:
            bench.tmp_path.mkdir()
            await bench.router.start()
        return self.benches

    async def __aexit__(self, *_: object) -> None:
        for bench in self.benches:
            await bench.router.stop()


def ships(tmp_path: Path, number: int, link: RouterLink | None = None) -> Ships:
    return Ships([Bench(tmp_path / f"ship{each}", link=link) for each in range(number)])


def jobs(benches: list[Bench]) -> list[DeviceJob]:
    return [bench.job(name=f"ship{number}") for number, bench in enumerate(benches)]


def test_devices_do_not_wait_for_each_other(tmp_path: Path) -> None:
    """Seven over a slow link take as long as one."""

    async def main() -> tuple[list[DeviceResult], list[str], float]:
        async with ships(tmp_path, 7, RouterLink(delay_s=0.35)) as benches:
            begun = asyncio.get_running_loop().time()
            told: list[str] = []
            results = await fleet.run(jobs(benches), on_result=lambda result: told.append(result.name))
            return results, told, asyncio.get_running_loop().time() - begun

    results, told, took_s = run(main())
    assert [result.status for result in results] == [Status.CHANGED] * 7
    assert [result.name for result in results] == [f"ship{each}" for each in range(7)]
    assert sorted(told) == [result.name for result in results]
    assert took_s < 1.5 * max(result.seconds for result in results)


def test_dead_device_does_not_delay_the_others(tmp_path: Path) -> None:
    """One is not there, one falls silent for ever in mid-apply, one drops its session; the others never notice."""
    done: dict[str, float] = {}

    async def main() -> list[DeviceResult]:
        clock = asyncio.get_running_loop().time
        async with ships(tmp_path, 5) as benches:
            begun = clock()
            work = jobs(benches)
            benches[0].router.arm(LinkFault(do=FaultKind.VANISH, match="/execute", sentence=3))
            benches[1].router.arm(LinkFault(do=FaultKind.DROP, match="/execute", sentence=3))
            nowhere = Endpoint("127.0.0.1", 1, "provision", work[0].endpoint.password, "00" * 32)
            work.append(benches[0].job(name="nowhere", endpoint=nowhere))
            return await fleet.run(work, on_result=lambda result: done.__setitem__(result.name, clock() - begun))

    results = run(main())
    assert [result.status for result in results] == [
        Status.ROLLED_BACK,
        Status.ROLLED_BACK,
        Status.CHANGED,
        Status.CHANGED,
        Status.CHANGED,
        Status.LEFT_AS_FOUND,
    ]
    assert max(done[name] for name in ("ship2", "ship3", "ship4", "nowhere")) < 30
    assert done["ship0"] > 500


def test_silent_devices_on_a_cable_are_given_up_in_seconds(tmp_path: Path) -> None:
    """Fifty on a cable, of which two accept a connection and say nothing: it took 121 s with a satellite's patience."""

    async def main() -> tuple[list[DeviceResult], float]:
        async with ships(tmp_path, 6) as benches:
            clock = asyncio.get_running_loop().time
            with socket.create_server(("127.0.0.1", 0)) as silent:
                port = silent.getsockname()[1]
                work = [benches[each % 6].job(name=f"ship{each}") for each in range(48)]
                dead = replace(benches[0].job().endpoint, port=port)
                work += [benches[0].job(name=name, endpoint=dead) for name in ("dead1", "dead2")]
                work = [replace(job, endpoint=with_timeouts(job.endpoint, LAN)) for job in work]
                begun = clock()
                return await fleet.run(work, mode=JobMode.PLAN), clock() - begun

    results, took_s = run(main())
    assert [result.status for result in results] == [Status.PLANNED] * 48 + [Status.LEFT_AS_FOUND] * 2
    assert results[-1].message.endswith("did not answer within 15 s")
    # In this clock nothing else takes time: both are waited for once, and at the same time.
    assert took_s == pytest.approx(PATIENCE_S, abs=0.1)


def test_number_of_concurrent_devices_is_limited(tmp_path: Path) -> None:
    open_now: set[int] = set()
    most = 0

    async def connect(endpoint: Endpoint) -> Channel:
        nonlocal most
        open_now.add(endpoint.port)
        most = max(most, len(open_now))
        return await Session.open(endpoint)

    async def main() -> list[DeviceResult]:
        async with ships(tmp_path, 5) as benches:
            work = [bench.job(connect=connect) for bench in benches]
            return await fleet.run(work, mode=JobMode.PLAN, at_once=2, on_result=lambda _: open_now.pop())

    results = run(main())
    assert [result.status for result in results] == [Status.PLANNED] * 5
    assert most <= 3


def test_a_stopped_run_reports_every_device(tmp_path: Path) -> None:
    async def main() -> list[DeviceResult]:
        async with ships(tmp_path, 3, RouterLink(delay_s=0.35)) as benches:
            running = asyncio.ensure_future(fleet.run(jobs(benches), at_once=2))
            await asyncio.sleep(4)
            running.cancel()
            return await running

    results = run(main())
    assert [result.status for result in results] == [Status.LEFT_AS_FOUND] * 3
    assert results[2].message == "stopped by the user before its turn: nothing was changed"


def test_no_device_is_no_result() -> None:
    assert run(fleet.run([])) == []


def test_result_does_not_hold_the_rows_of_the_device(tmp_path: Path) -> None:
    """A result holds what is told of a device, not its rows."""

    async def main() -> list[DeviceResult]:
        async with ships(tmp_path, 1) as benches:
            return await fleet.run([benches[0].job(patience=Patience())])

    (result,) = run(main())
    assert len(repr(result)) < len(TEXT) * 5
