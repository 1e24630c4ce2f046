"""Rows of others by the hundred in a menu that is ours entirely: counted, told, agreed to apart, and gone."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from engine_bench import TEXT, Bench, Meddler, on

from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.routeros import DeviceResult, JobMode, Status
from atlantis_netcfg.routeros.api import Session
from atlantis_netcfg.routeros.commands import script_command
from atlantis_netcfg.routeros.estimate import LinkMetrics
from bench.proxy import Count, Proxy, Shape

pytestmark = pytest.mark.slow

OURS = "# atlantis:entire /ip firewall address-list\n" + TEXT
LISTS = "/ip/firewall/address-list"
SATELLITE = LinkMetrics("satellite", 0.7, 352_000, 704_000, is_metered=True)


async def foreign(bench: Bench, number: int) -> None:
    """Let somebody add rows to a list that is ours entirely."""
    for each in range(number):
        words = (f"=address=198.18.{each // 250}.{1 + each % 250}", "=comment=blocked", "=list=sat-allow")
        await bench.router.console([f"{LISTS}/add", *words])


def left(bench: Bench) -> int:
    return bench.export().count("comment=blocked")


def test_hundred_foreign_rows_are_removed_without_consent(tmp_path: Path) -> None:
    async def act(bench: Bench) -> tuple[DeviceResult, int]:
        await bench.converge()
        await foreign(bench, 100)
        return await bench.converge(), left(bench)

    result, there = on(Bench(tmp_path, text=OURS), act)
    assert (result.status, result.planned_count, result.rows, there) == (Status.CHANGED, 1, 100, 0)
    assert result.message == "1 action on 100 rows applied and verified"
    assert result.foreign_words == ""


@pytest.mark.smoke
def test_more_than_a_hundred_foreign_rows_need_consent(tmp_path: Path) -> None:
    words = "removes 101 rows that do not carry our mark: 101 from /ip firewall address-list"

    async def act(bench: Bench) -> tuple[list[DeviceResult], list[int]]:
        await bench.converge()
        await foreign(bench, 101)
        results, there = [], []
        for mode, agreed in (
            (JobMode.PLAN, False),
            (JobMode.APPLY, False),
            (JobMode.APPLY, True),
            (JobMode.APPLY, False),
        ):
            results.append(await bench.converge(mode, remove_foreign=agreed))
            there.append(left(bench))
        return results, there

    (planned, refused, done, again), there = on(Bench(tmp_path, text=OURS), act)
    assert there == [101, 101, 0, 0]
    assert (planned.status, planned.message) == (Status.PLANNED, "1 action on 101 rows planned")
    assert planned.notes[-1] == f"the plan {words}"
    assert planned.foreign_words == words
    assert (refused.status, refused.exit) == (Status.REFUSED, ExitCode.FAILED)
    assert refused.message == f"refused, nothing was changed: nobody has confirmed that it {words}"
    assert refused.hint is not None
    assert "run the same command with `--remove-foreign` (plain Ansible" in refused.hint
    assert (done.status, done.rows, done.confirmed_count) == (Status.CHANGED, 101, 1)
    assert (again.status, again.rows, again.foreign_words) == (Status.UNCHANGED, 0, "")


@pytest.mark.smoke
def test_our_own_rows_are_not_foreign(tmp_path: Path) -> None:
    """A declaration that shrinks by two hundred rows of its own needs no other word than the plan."""
    rows = "".join(f'add address=198.18.0.{each} comment="atlantis: b" list=sat-allow\n' for each in range(1, 201))

    async def act(bench: Bench) -> DeviceResult:
        await bench.converge()
        bench.text = OURS
        return await bench.converge()

    result = on(Bench(tmp_path, text=f"{OURS}/ip firewall address-list\n{rows}"), act)
    assert (result.status, result.rows, result.foreign_words) == (Status.CHANGED, 200, "")


def test_foreign_rows_in_an_unmanaged_menu_remain(tmp_path: Path) -> None:
    async def act(bench: Bench) -> tuple[DeviceResult, int]:
        await bench.converge()
        await foreign(bench, 150)
        return await bench.converge(), left(bench)

    result, there = on(Bench(tmp_path), act)
    assert (result.status, there, len(result.drift)) == (Status.UNCHANGED, 150, 150)


@pytest.mark.slow
def test_estimate_for_a_thousand_rows_over_the_satellite_is_accurate(tmp_path: Path) -> None:
    """What the plan says it costs is what it costs: bytes within a fiftieth, pieces of safe mode included."""

    async def act(bench: Bench) -> tuple[DeviceResult, DeviceResult]:
        await bench.converge()
        await foreign(bench, 1000)
        planned = await bench.converge(JobMode.PLAN, link=SATELLITE)
        return planned, await bench.converge(link=SATELLITE, remove_foreign=True)

    planned, done = on(Bench(tmp_path, text=OURS), act)
    assert (planned.planned_count, planned.rows, done.status) == (1, 1000, Status.CHANGED)
    assert planned.estimate is not None
    assert planned.estimate.bytes == pytest.approx(done.sent_bytes + done.received_bytes, rel=0.02)
    assert planned.sessions == 1
    assert done.sessions == 1 + 1000 // 80 + 1


async def many(bench: Bench, number: int, words: str = "list=sat-allow comment=blocked", first: int = 0) -> None:
    """Let somebody add rows by scripts, as one who pastes a list of addresses does."""
    async with await Session.open(bench.job().endpoint) as session:
        for begin in range(first, first + number, 500):
            script = "".join(
                f"/ip firewall address-list add address=198.{18 + each // 62_500}.{each // 250 % 250}.{1 + each % 250} "
                f"{words}\n"
                for each in range(begin, min(begin + 500, first + number))
            )
            reply = await session.command(script_command(script))
            assert (reply.trap, reply.ret or "") == (None, "")


async def metered(bench: Bench, mode: JobMode, **changes: Any) -> tuple[DeviceResult, Count]:  # noqa: ANN401 - of DeviceJob
    """Converge over the satellite, and count on the wire."""
    async with Proxy("127.0.0.1", 0, (bench.router.host, bench.router.ports["api-ssl"]), Shape(0.35)) as proxy:
        host, port = proxy.address
        endpoint = replace(bench.job().endpoint, host=host, port=port)
        result = await bench.converge(mode, link=SATELLITE, endpoint=endpoint, **changes)
        return result, proxy.count


def test_plan_over_the_satellite_reads_three_thousand_rows_partially(tmp_path: Path) -> None:
    """Before the rows of others were read bare it was 349 kB for this plan, 281 of them for the first reading."""

    async def act(bench: Bench) -> tuple[list[tuple[DeviceResult, Count]], int]:
        await bench.converge()
        nothing = await metered(bench, JobMode.PLAN)
        await many(bench, 3000)
        planned = await metered(bench, JobMode.PLAN)
        refused = await metered(bench, JobMode.APPLY)
        whole = await bench.converge(JobMode.PLAN, remove_foreign=True)
        assert whole.received_bytes > 250_000
        agreed = planned[0].plan_hash
        assert agreed == whole.plan_hash
        return [
            nothing,
            planned,
            refused,
            await metered(bench, JobMode.APPLY, remove_foreign=True, agreed_hash=agreed),
        ], left(bench)

    ((nothing, none), (planned, count), (refused, short), (done, _)), there = on(Bench(tmp_path, text=OURS), act)
    assert (nothing.status, none.round_trips) == (Status.UNCHANGED, 5)
    assert none.bytes < 21_500
    assert count.bytes < 93_000
    assert (count.round_trips, short.round_trips) == (7, 7)
    assert short.bytes < 93_000
    assert planned.message == "1 action on 3000 rows planned"
    assert planned.foreign_words.startswith("removes 3000 rows that do not carry our mark")
    assert planned.diff.count("\n- add address=198.18.11.") == 3
    assert "- # 2997 rows more without our mark, of which only the number was read\n" in planned.diff
    assert refused.status is Status.REFUSED
    assert (done.status, done.rows, there) == (Status.CHANGED, 3000, 0)


@pytest.mark.parametrize("mode", [JobMode.PLAN, JobMode.APPLY])
def test_five_thousand_rows_are_read_partially_over_a_cable_too(tmp_path: Path, mode: JobMode) -> None:
    """A hundred kilobytes for 3,000 rows at most, whatever they are read for; it was 520 kB for these."""

    async def act(bench: Bench) -> tuple[DeviceResult, DeviceResult, DeviceResult]:
        await bench.converge()
        nothing = await bench.converge(JobMode.PLAN)
        await many(bench, 5000)
        return nothing, await bench.converge(mode), await bench.converge(JobMode.PLAN, remove_foreign=True)

    nothing, result, whole = on(Bench(tmp_path, text=OURS), act)
    assert result.status is (Status.PLANNED if mode is JobMode.PLAN else Status.REFUSED)
    assert result.foreign_words == whole.foreign_words
    assert (result.sent_bytes + result.received_bytes) - (nothing.sent_bytes + nothing.received_bytes) < 5 * 100_000 / 3
    assert whole.received_bytes > 400_000
    assert whole.diff.count("\n- add address=198.18.") == 5000


def test_up_to_a_hundred_rows_are_read_fully(tmp_path: Path) -> None:
    async def act(bench: Bench) -> tuple[DeviceResult, Count]:
        await bench.converge()
        await many(bench, 100)
        return await metered(bench, JobMode.PLAN)

    planned, count = on(Bench(tmp_path, text=OURS), act)
    assert (planned.planned_count, planned.rows, count.round_trips) == (1, 100, 7)
    assert planned.diff.count("\n- add address=198.18.0.") == 100


def test_unmarked_row_that_matches_a_declared_one_becomes_ours(tmp_path: Path) -> None:
    """A row without our mark may be the one that is declared: it becomes ours, and is not added a second time."""
    unmarked = "/ip firewall address-list add address=192.0.2.10 list=sat-allow\n"

    async def act(bench: Bench) -> list[DeviceResult]:
        await many(bench, 150)
        async with await Session.open(bench.job().endpoint) as session:
            await session.command(script_command(unmarked))
        planned, _ = await metered(bench, JobMode.PLAN)
        done, _ = await metered(bench, JobMode.APPLY, remove_foreign=True, agreed_hash=planned.plan_hash)
        return [planned, done, (await metered(bench, JobMode.PLAN))[0]]

    planned, done, again = on(Bench(tmp_path, text=OURS), act)
    assert f"{LISTS.strip('/').replace('/', ' ')}" in planned.diff
    assert planned.foreign_words.startswith("removes 150 rows")
    assert [planned.status, done.status, again.status] == [Status.PLANNED, Status.CHANGED, Status.UNCHANGED]


def test_guard_reads_foreign_rows_fully_before_judging_access(tmp_path: Path) -> None:
    """What lets us in stands in a row that is read bare: the guard has all of them read before it judges."""
    closed = OURS.replace(
        'add action=accept chain=input comment="atlantis: management" in-interface=ether8\n',
        'add action=accept chain=input comment="atlantis: management" src-address-list=sat-allow\n',
    )

    by_hand = (
        "/ip firewall address-list add address=10.64.101.0/24 list=sat-allow\n"
        '/ip firewall filter set [find comment="atlantis: management"] src-address-list=sat-allow !in-interface\n'
    )

    async def act(bench: Bench) -> list[DeviceResult]:
        await bench.converge()
        await many(bench, 150, first=1)
        async with await Session.open(bench.job().endpoint) as session:
            assert (await session.command(script_command(by_hand))).ret == ""
        bench.text = closed
        return [(await metered(bench, JobMode.PLAN))[0], await bench.converge(JobMode.PLAN)]

    over_the_satellite, whole = on(Bench(tmp_path, text=OURS), act)
    assert (whole.status, whole.planned_count) == (Status.REFUSED, 1)
    assert "would drop your new sessions" in whole.message
    assert over_the_satellite.message == whole.message


@pytest.mark.slow
@pytest.mark.parametrize("number", [2_000, pytest.param(10_000, marks=pytest.mark.campaign)])
def test_thousands_of_foreign_rows_are_removed_in_linear_time(tmp_path: Path, number: int) -> None:
    """Planned, refused, removed and nothing left to do, over TLS, in a time that grows with their number alone."""

    async def act(bench: Bench) -> tuple[list[DeviceResult], int]:
        await bench.converge()
        await many(bench, number)
        planned, _ = await metered(bench, JobMode.PLAN)
        done = await bench.converge(link=SATELLITE, remove_foreign=True, agreed_hash=planned.plan_hash)
        return [planned, done, await bench.converge(link=SATELLITE)], left(bench)

    (planned, done, again), there = on(Bench(tmp_path, text=OURS), act)
    assert planned.message == f"1 action on {number} rows planned"
    assert planned.sent_bytes + planned.received_bytes < 30_000 + 23 * number
    assert (done.status, done.rows, there) == (Status.CHANGED, number, 0)
    assert done.sessions == 1 + number // 80
    assert (again.status, again.round_trips) == (Status.UNCHANGED, 5)


@pytest.mark.parametrize(
    ("words", "where"),
    [
        ((f"{LISTS}/add", "=address=198.19.0.1", "=list=sat-allow"), "/ip firewall address-list"),
        (("/ip/pool/add", "=name=theirs", "=ranges=10.9.0.1-10.9.0.9"), "/ip pool"),
    ],
)
def test_concurrent_change_is_still_detected(tmp_path: Path, words: tuple[str, ...], where: str) -> None:
    """Where history is full all is looked at again before the first change; of very many rows their number."""

    async def act(bench: Bench) -> tuple[DeviceResult, int]:
        await bench.converge()
        await foreign(bench, 150)
        meddler = Meddler("/user/print", lambda: bench.router.console(words))
        return await bench.converge(remove_foreign=True, connect=meddler.connect), left(bench)

    result, there = on(Bench(tmp_path, text=OURS), act)
    assert (result.status, there) == (Status.LEFT_AS_FOUND, 150)
    assert f"somebody else has changed the device since it was read ({where})" in result.message
