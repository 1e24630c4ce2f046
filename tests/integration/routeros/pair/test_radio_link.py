"""The air between two twins: how long it is silent, what lives on meanwhile, and where the far end's path leads."""

import asyncio
from dataclasses import replace
from pathlib import Path

import pytest
from pair_bench import PairBench, Words, on

from atlantis_netcfg.emulator.routeros import Air
from atlantis_netcfg.routeros.api import Command, Session, Unreachable

SET = "/interface/wireless/set"
OLD = Words()


async def outage(bench: PairBench) -> float:
    """Seconds until the link is back."""
    clock = asyncio.get_running_loop().time
    started = clock()
    while not bench.link.up:  # noqa: ASYNC110 - in time that jumps
        await asyncio.sleep(0.5)
    return clock() - started


async def session(bench: PairBench, name: str, connect_timeout_s: float = 120.0) -> Session:
    return await Session.open(replace(bench.job(name, OLD).endpoint, connect_timeout_s=connect_timeout_s))


OUTAGES = [
    ("near", ["=frequency=5520"], 63.0),
    ("near", ["=frequency=5620"], 603.0),
    ("near", ["=hide-ssid=yes"], 63.0),
    ("far", ["=scan-list=5490-5510"], 3.0),
    ("far", ["=comment=north mast"], 0.0),
]


@pytest.mark.parametrize(("end", "words", "seconds"), OUTAGES)
def test_duration_of_the_link_outage(tmp_path: Path, end: str, words: list[str], seconds: float) -> None:
    async def act(bench: PairBench) -> float:
        await bench.router(end).console([SET, "=.id=wlan1", *words])
        return await outage(bench)

    found = on(PairBench(tmp_path), act)
    assert found == pytest.approx(seconds, abs=1.0)


def test_a_session_over_the_link_lives_through_a_short_outage(tmp_path: Path) -> None:
    async def act(bench: PairBench) -> tuple[float, str]:
        far = await session(bench, "far")
        clock = asyncio.get_running_loop().time
        await bench.router("near").console([SET, "=.id=wlan1", "=frequency=5520"])
        assert not bench.link.up
        started = clock()
        reply = await far.command(Command("/system/identity/print"))
        await far.close()
        return clock() - started, reply.rows[0]["name"]

    seconds, name = on(PairBench(tmp_path), act)
    assert seconds == pytest.approx(63.0, abs=1.0)
    assert name


def test_dead_session_over_a_lost_link_is_detected_late(tmp_path: Path) -> None:
    async def act(bench: PairBench) -> tuple[int, int]:
        far = await session(bench, "far")
        bench.link.change(Air(distance_m=500_000.0))
        with pytest.raises(Unreachable, match="did not answer within 30 s"):
            await session(bench, "far", connect_timeout_s=30.0)
        device = bench.router("far").device
        before = len(device.core.sessions)
        await asyncio.sleep(600)
        await far.close()
        return before, len(device.core.sessions)

    assert on(PairBench(tmp_path), act) == (1, 0)


@pytest.mark.parametrize("row", ["ether1", "wlan1"])
def test_far_end_is_reached_through_the_bridge_of_the_near_end(tmp_path: Path, row: str) -> None:
    async def act(bench: PairBench) -> tuple[bool, bool]:
        await bench.router("near").console(["/interface/bridge/port/remove", f"=.id={row}"])
        try:
            await session(bench, "far", connect_timeout_s=30.0)
        except Unreachable:
            return False, bench.link.up
        return True, bench.link.up

    assert on(PairBench(tmp_path), act) == (False, True)


def test_a_reboot_of_either_end_takes_the_link_away(tmp_path: Path) -> None:
    async def act(bench: PairBench) -> list[float]:
        seconds = []
        for name in ("near", "far"):
            bench.router(name).reboot()
            assert bench.link.down_reason == "a radio is not there"
            seconds.append(await outage(bench))
        return seconds

    near, far = on(PairBench(tmp_path), act)
    assert near == pytest.approx(123.0, abs=1.0), "a boot, and the access point listens for radar"
    assert far == pytest.approx(63.0, abs=1.0), "a boot, and the station finds it again"
