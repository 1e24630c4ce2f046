from pathlib import Path
from typing import Literal

import pytest
from wire_helpers import Client, now, router, run

from atlantis_netcfg.emulator.routeros import RouterLink, WireBehaviour

pytestmark = pytest.mark.coroutine(run=run)
PRINT = "/system/identity/print"
RTT = 0.7


async def test_batch_of_sixteen_takes_one_round_trip(tmp_path: Path) -> None:
    async with router(tmp_path, link=RouterLink(delay_s=RTT / 2)) as twin, Client(twin) as client:
        await client.login()
        twin.reset_counters()
        start = now()
        client.write(*((PRINT, f".tag={number}") for number in range(16)))
        for _ in range(16):
            await client.answer()
        assert now() - start == pytest.approx(RTT)
        assert twin.counters().turns == 1
        assert twin.counters().sentences == 16


async def test_sequential_requests_take_a_round_trip_each(tmp_path: Path) -> None:
    async with router(tmp_path, link=RouterLink(delay_s=RTT / 2)) as twin, Client(twin) as client:
        await client.login()
        start = now()
        for _ in range(5):
            await client.talk(PRINT)
        assert now() - start == pytest.approx(5 * RTT)
        assert twin.counters().turns == 6


@pytest.mark.parametrize(
    ("service", "tls", "round_trips"), [("api", "1.2", 2), ("api-ssl", "1.3", 3), ("api-ssl", "1.2", 4)]
)
async def test_round_trips_to_connect(
    tmp_path: Path, service: str, tls: Literal["1.2", "1.3"], round_trips: int
) -> None:
    async with router(tmp_path, link=RouterLink(delay_s=RTT / 2), knobs=WireBehaviour(tls=tls)) as twin:
        start = now()
        async with Client(twin, service) as client:
            await client.login()
            assert now() - start == pytest.approx(round_trips * RTT)
            assert twin.counters().turns == 1


async def test_bytes_are_counted_above_and_below_tls(tmp_path: Path) -> None:
    async with router(tmp_path) as twin, Client(twin, "api-ssl") as client:
        await client.login()
        seen = twin.counters()
        assert seen.bytes_in < 100 < seen.wire_in
        assert seen.bytes_out == len(b"\x05!done\0")
        assert seen.wire_out > 500


async def test_narrow_link_limits_the_rate(tmp_path: Path) -> None:
    async with router(tmp_path, link=RouterLink(rate_up_bps=8000)) as twin, Client(twin) as client:
        await client.login()
        start = now()
        await client.talk("/ip/pool/add", "=name=p", "=ranges=10.0.0.2-10.0.0.9", "=comment=" + "x" * 2000)
        assert 2.0 < now() - start < 2.2


async def test_a_gap_of_seventy_seconds_is_only_a_delay(tmp_path: Path) -> None:
    async with router(tmp_path) as twin, Client(twin) as client:
        await client.login()
        start = now()
        twin.gap(70)
        assert (await client.talk(PRINT))[-1] == ("!done", ())
        assert now() - start == pytest.approx(70)


async def test_requests_after_a_burst_take_twenty_milliseconds_each(tmp_path: Path) -> None:
    async with router(tmp_path, knobs=WireBehaviour(knee_after=10)) as twin, Client(twin) as client:
        await client.login()
        start = now()
        client.write(*((PRINT, f".tag={number}") for number in range(19)))
        for _ in range(19):
            await client.answer()
        assert now() - start == pytest.approx(10 * 0.02)
